"""The clearance field: its bounds on the distance to the nearest obstacle hold at every point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import distance_transform_edt
from tests.helpers.random_worlds import random_world
from tests.support.trials import few

from trailmark.collision.field import ClearanceField, build_field, distance_transform, interpolated
from trailmark.collision.kernels import field_value
from trailmark.collision.obstacles import build_grid
from trailmark.shapes import Disc, Polygon
from trailmark.world import World


def free_distance(world: World, points: np.ndarray) -> np.ndarray:
    """Return the distance of points to all that blocks them, 0 inside of it."""
    free = shapely.box(*world.bounds)
    if world.boundary is not None:
        free = shapely.intersection(free, world.boundary.shapely())
    places = shapely.points(points)
    distance = np.where(shapely.contains(free, places), shapely.distance(shapely.boundary(free), places), 0.0)
    for shape in world.obstacles:
        if isinstance(shape, Disc):
            gap = np.hypot(*(points - np.array(shape.center)).T) - shape.radius
        else:
            gap = shapely.distance(shape.polygon().shapely(), places)
        distance = np.minimum(distance, np.maximum(gap, 0.0))
    return np.asarray(distance)


def values_at(field: ClearanceField, points: np.ndarray) -> np.ndarray:
    """Return what the kernels read of the field at points (n, 2), shape (n,)."""
    return np.array([field_value(field, x, y) for x, y in points.tolist()])


@pytest.mark.slow
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.02, 0.3, 2.0, 30.0]),
    st.sampled_from([(0.0, 0.0), (1e5, -1e5), (9e6, 9e6)]),
)
@settings(max_examples=40)
def test_the_distance_lies_within_the_slack(seed: int, cell: float, origin: tuple[float, float]) -> None:
    rng = np.random.default_rng(seed)
    world = random_world(
        seed, int(rng.integers(0, 12)), size=8.0, radii=(0.05, 2.0), discs=0.4, holes=0.4,
        boundary=bool(rng.random() < 0.5), origin=origin,
    )  # fmt: skip
    grid = build_grid(world, cell)
    field = build_field(grid)
    assert field.slack >= grid.size * np.sqrt(2.0)
    points = rng.uniform(-1.0, 9.0, (500, 2)) + np.array(origin)
    true = free_distance(world, points)
    value = values_at(field, points)
    rounding = 1e-7 if origin[0] > 1e6 else 1e-9
    assert (true >= value - field.slack - rounding).all()
    inside = (np.abs(points - np.array(origin) - 4.0) < 4.0).all(axis=1)
    assert (true[inside] <= value[inside] + field.slack + rounding).all()


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 40), st.sampled_from([0.01, 0.1, 0.6]))
@settings(max_examples=few(60))
def test_distances_are_those_of_scipys_transform(seed: int, rows: int, columns: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    occupied = rng.random((rows, columns)) < share
    occupied.flat[rng.integers(rows * columns)] = True
    found = distance_transform(occupied, 0.37)
    np.testing.assert_allclose(found, distance_transform_edt(~occupied, sampling=0.37), rtol=1e-6)
    assert (found[occupied] == 0.0).all()


def test_outside_of_the_grid_everything_is_blocked() -> None:
    field = build_field(build_grid(World("w", (0, 0, 10, 6)), 0.5))
    far = np.array([[-50.0, 3.0], [60.0, 3.0], [5.0, -50.0], [5.0, 1e12], [-1e12, -1e12]])
    assert not values_at(field, far).any()
    assert values_at(field, np.array([[5.0, 3.0]])) == pytest.approx([3.0], abs=field.slack)


@pytest.mark.slow
def test_between_cell_centres_distances_are_interpolated_and_slopes_are_theirs() -> None:
    field = build_field(build_grid(random_world(3, 10, size=8.0, radii=(0.3, 1.5)), 0.2))
    rows, columns = field.distance.shape
    centre = [field.x0 + (7 + 0.5) * field.size, field.y0 + (5 + 0.5) * field.size]
    assert interpolated(field, *centre)[0] == pytest.approx(float(field.distance[5, 7]), abs=1e-6)
    at = np.column_stack([field.x0 + (np.arange(columns) + 0.5) * field.size, np.zeros(columns)])
    at[:, 1] = field.y0 + (np.arange(columns) % rows + 0.5) * field.size
    table = RegularGridInterpolator(
        [field.y0 + (np.arange(rows) + 0.5) * field.size, field.x0 + (np.arange(columns) + 0.5) * field.size],
        field.distance.astype(np.float64),
    )
    low, high = at.min(axis=0), [at[-1, 0], field.y0 + (rows - 0.5) * field.size]
    step = 1e-7
    for x, y in np.random.default_rng(0).uniform(low + 1e-3, np.array(high) - 1e-3, (300, 2)):
        value, gx, gy = interpolated(field, x, y)
        assert value == pytest.approx(float(table((y, x))), abs=1e-6)
        assert gx == pytest.approx(float(table((y, x + step)) - table((y, x - step))) / (2 * step), abs=0.05)
        assert gy == pytest.approx(float(table((y + step, x)) - table((y - step, x))) / (2 * step), abs=0.05)
    for x, y in ((field.x0, centre[1]), (centre[0], field.y0 - 1.0), (1e9, 1e9)):
        assert interpolated(field, x, y) == (-np.inf, 0.0, 0.0)


def test_cells_inside_of_an_obstacle_are_occupied_although_no_edge_touches_them() -> None:
    block = Polygon(np.array([[3.0, 3.0], [17.0, 3.0], [17.0, 17.0], [3.0, 17.0]]))
    hollow = Polygon(block.vertices, (np.array([[7.0, 7.0], [13.0, 7.0], [13.0, 13.0], [7.0, 13.0]]),))
    world = World("w", (0, 0, 20, 20), (block,))
    at = np.array([[10.0, 10.0], [5.0, 5.0], [1.5, 1.5]])
    full = values_at(build_field(build_grid(world, 0.4)), at)
    ring = values_at(build_field(build_grid(replace(world, obstacles=(hollow,)), 0.4)), at)
    assert full[:2].tolist() == [0.0, 0.0]
    assert full[2] > 0.0
    assert ring[0] > 2.0
    assert ring[1] == 0.0
