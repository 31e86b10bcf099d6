"""Exact distances of points to the obstacles: outside and inside of them, against shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.random_worlds import random_world
from tests.support.trials import few

from trailmark.collision.distances import point_clearance, point_depth
from trailmark.collision.obstacles import build_grid
from trailmark.shapes import Disc
from trailmark.world import World


def signed_distances(world: World, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance to the nearest obstacle (0 inside) and the depth in the obstacle that one is deepest in."""
    places = shapely.points(points)
    free = shapely.box(*world.bounds)
    if world.boundary is not None:
        free = shapely.intersection(free, world.boundary.shapely())
    to_free = shapely.distance(free, places)
    gap = np.where(to_free > 0.0, 0.0, shapely.distance(shapely.boundary(free), places))
    depth = to_free
    for shape in world.obstacles:
        if isinstance(shape, Disc):
            off = np.hypot(*(points - np.array(shape.center)).T) - shape.radius
        else:
            region = shape.polygon().shapely()
            away = shapely.distance(region, places)
            off = np.where(away > 0.0, away, -shapely.distance(shapely.boundary(region), places))
        gap, depth = np.minimum(gap, np.maximum(off, 0.0)), np.maximum(depth, -off)
    return gap, depth


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.05, 0.3, 2.0]), st.booleans())
@settings(max_examples=few(20))
def test_clearance_and_depth_agree_with_shapely(seed: int, cell: float, boundary: bool) -> None:
    rng = np.random.default_rng(seed)
    world = random_world(
        seed, int(rng.integers(0, 12)), size=8.0, radii=(0.2, 2.0), discs=0.4, holes=0.4, boundary=boundary
    )
    grid = build_grid(world, cell)
    points = rng.uniform(0.0, 8.0, (150, 2))
    gap, depth = signed_distances(world, points)
    for cap in (0.1, 1.0):
        clearance = np.array([point_clearance(grid, x, y, cap) for x, y in points])
        assert clearance == pytest.approx(np.minimum(gap, cap), abs=1e-9)
        found = np.array([point_depth(grid, x, y, cap) for x, y in points])
        assert (found[gap > 1e-9] == 0.0).all()
        # Never deeper than in truth: where regions overlap, a boundary within another region counts too.
        assert (found <= np.minimum(depth, cap) + 1e-9).all()
        # No place nearer than the depth is free.
        around = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        for p, d in zip(points[found > 1e-6], found[found > 1e-6], strict=True):
            ring = p + d * (1.0 - 1e-6) * np.column_stack([np.cos(around), np.sin(around)])
            assert signed_distances(world, ring)[0].max() <= 1e-9


def test_the_depth_in_one_obstacle_is_exact() -> None:
    grid = build_grid(World("disc", (0, 0, 10, 10), (Disc((5.0, 5.0), 2.0),)), 0.3)
    assert point_depth(grid, 5.5, 5.0, 9.0) == pytest.approx(1.5)
    assert point_depth(grid, 5.5, 5.0, 0.7) == 0.7
    assert point_depth(grid, 2.9, 5.0, 9.0) == 0.0
