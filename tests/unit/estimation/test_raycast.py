"""Rays against shapely, which knows nothing of edges and discs: only regions, a little too large and too small."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.trials import few

from trailmark import Disc, Polygon, Rectangle, World
from trailmark.estimation.virtual_sensors import RayCaster
from trailmark.shapes import Shape

FloatArray = NDArray[np.float64]
SLACK = 1e-6
SQUARE = Polygon(
    np.array([[4.0, 4.0], [8.0, 4.0], [8.0, 8.0], [4.0, 8.0]]), (np.array([[5.0, 5.0], [6, 5], [6, 6], [5, 6]]),)
)


def random_world(rng: np.random.Generator, boundary: bool) -> World:
    shapes: list[Shape] = []
    for _ in range(rng.integers(0, 9)):
        x, y = rng.uniform(0.0, 20.0, 2)
        kind = rng.integers(3)
        if kind == 0:
            shapes.append(Disc((x, y), rng.uniform(0.1, 2.0)))
        elif kind == 1:
            length, width = rng.uniform(0.2, 4.0, 2)
            shapes.append(Rectangle((x, y), length, width, rng.uniform(-3.0, 3.0)))
        else:
            angle = 2 * np.pi / 7 * (np.arange(7) + rng.uniform(-0.4, 0.4, 7))
            star = rng.uniform(0.3, 2.0, 7)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
            shapes.append(Polygon(np.array([x, y]) + star))
    edge = Polygon(np.array([[1.0, 0.0], [19.0, 1.0], [20.0, 18.0], [10.0, 12.0], [0.0, 20.0]])) if boundary else None
    return World("random", (0.0, 0.0, 20.0, 20.0), tuple(shapes), boundary=edge)


def solid(world: World, bounds: bool, slack: float) -> shapely.Geometry:
    """All that a ray can meet, grown by slack."""
    parts = [
        shapely.Point(shape.center).buffer(shape.radius, quad_segs=1000)
        if isinstance(shape, Disc)
        else shape.polygon().shapely()
        for shape in world.obstacles
    ]
    far = shapely.box(-1000, -1000, 1000, 1000)
    if bounds:
        parts.append(far - shapely.box(*world.bounds))
    if world.boundary is not None:
        parts.append(far - world.boundary.shapely())
    return shapely.union_all(parts).buffer(slack, join_style="mitre")


def first_met(region: shapely.Geometry, origin: FloatArray, angle: float, reach: float = 100.0) -> float:
    ray = shapely.LineString([origin, origin + reach * np.array([math.cos(angle), math.sin(angle)])])
    met = ray.intersection(region)
    return math.inf if met.is_empty else float(shapely.distance(shapely.Point(origin), met))


@pytest.mark.slow
@settings(max_examples=few(20))
@given(
    seed=st.integers(0, 10**6), boundary=st.booleans(), bounds=st.booleans(), reach=st.sampled_from([3.0, 12.0, 80.0])
)
def test_against_shapely(seed: int, boundary: bool, bounds: bool, reach: float) -> None:
    rng = np.random.default_rng(seed)
    world = random_world(rng, boundary)
    small, large = solid(world, bounds, -SLACK), solid(world, bounds, SLACK)
    origins = [o for o in rng.uniform(1.0, 19.0, (20, 2)) if not large.intersects(shapely.Point(o))][:3]
    caster = RayCaster(world, bounds=bounds)
    for origin in origins:
        angles = rng.uniform(-10.0, 10.0, 12)
        found = caster.distances(origin, angles, reach)
        for angle, distance in zip(angles, found, strict=True):
            # What is met lies between what a little more and a little less of everything would be met at.
            near, far = first_met(large, origin, angle), first_met(small, origin, angle)
            if near > reach:
                assert distance == math.inf
            elif far < reach:
                assert near - 1e-9 <= distance <= far + 1e-9
            else:
                assert distance == math.inf or near - 1e-9 <= distance <= reach


def test_no_ray_slips_through_a_corner() -> None:
    rng = np.random.default_rng(5)
    angle = np.sort(rng.uniform(0.0, 2 * np.pi, 40))
    ring = rng.uniform(3.0, 9.0, 40)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    world = World("star", (-10.0, -10.0, 10.0, 10.0), boundary=Polygon(ring))
    at_corners = np.arctan2(ring[:, 1], ring[:, 0])
    angles = np.concatenate([at_corners, np.nextafter(at_corners, 9.0), np.nextafter(at_corners, -9.0)])
    found = RayCaster(world, bounds=False).distances((0.0, 0.0), angles)
    assert np.isfinite(found).all()
    assert np.abs(found - np.tile(np.hypot(*ring.T), 3)).max() < 1e-9


def test_a_sensor_that_touches_a_wall() -> None:
    world = World("touch", (0.0, 0.0, 10.0, 10.0), (SQUARE, Disc((2.0, 7.0), 1.0)))
    caster = RayCaster(world)
    for slack in (0.0, 1e-6, -1e-6):
        # On the left bound, on the square's left side, at the disc's rim: freely away, no way into it.
        assert caster.distances((slack, 1.0), [0.0, 0.4, np.pi])[[0, 2]] == pytest.approx([10.0, 0.0], abs=1e-5)
        assert caster.distances((4.0 - slack, 5.0), [0.0, np.pi]) == pytest.approx([0.0, 4.0], abs=1e-5)
        assert caster.distances((3.0 + slack, 7.0), [0.0, np.pi]) == pytest.approx([1.0, 0.0], abs=1e-5)
