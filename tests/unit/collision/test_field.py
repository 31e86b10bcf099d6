"""The field and its grid: distances, windings and lists of cells, by shapely."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.oracles import signed_distances
from tests.helpers.trials import few
from tests.helpers.worlds import random_world

from trailmark import Polygon, Robot, StateChecker, World
from trailmark.collision.distances import point_clearance, point_depth
from trailmark.collision.field import ClearanceField, build_field
from trailmark.collision.kernels import field_value
from trailmark.collision.obstacles import build_grid


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
    true = signed_distances(world, points)[0]
    value = values_at(field, points)
    rounding = 1e-7 if origin[0] > 1e6 else 1e-9
    assert (true >= value - field.slack - rounding).all()
    inside = (np.abs(points - np.array(origin) - 4.0) < 4.0).all(axis=1)
    assert (true[inside] <= value[inside] + field.slack + rounding).all()


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


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def aligned_cell(distance: float, column: int) -> float:
    """Return the cell size that puts a column's centre ``distance`` metres right of the bounds, up to rounding."""
    return distance / (column + 0.5 - 1.3137)


@pytest.mark.parametrize("left", [-7.0, -3.0, 0.1, 11.0, 1e5])
@pytest.mark.parametrize("column", [7, 16, 22, 34, 43])
def test_a_wall_through_the_centres_of_cells_hides_nothing_behind_it(left: float, column: int) -> None:
    for distance in (2.0, 7.0, 12.0, 27.0, 37.0):
        size = aligned_cell(distance, column)
        wall = Polygon(SQUARE * (10.0, 16.0) + (left + distance, 2.0))
        world = World("aligned", (left, 0.0, left + 60.0, 20.0), (wall,))
        # So small that it lies inside one cell, and far from the wall's edges for its size.
        checker = StateChecker(world, Robot.disc(0.01 * size), cell=size)
        rows = np.linspace(3.0, 17.0, 40)
        for side, expected in ((0.2, False), (-0.2, True)):
            at = np.column_stack([np.full(40, left + distance + side * size), rows, np.zeros(40)])
            assert (checker.valid(at) == expected).all()


def test_winding_counts_the_regions_over_every_cell_centre() -> None:
    world = random_world(4, 60, size=40.0, holes=0.5, boundary=True)
    grid = build_grid(world, 0.37)
    columns, rows = np.meshgrid(np.arange(grid.columns), np.arange(grid.rows))
    x = grid.x0 + (columns.ravel() + 0.5) * grid.size
    y = grid.y0 + (rows.ravel() + 0.5) * grid.size
    expected = np.zeros(len(x), int)
    for shape in world.obstacles:
        expected += shapely.contains_xy(shape.polygon().shapely(), x, y)
    expected += ~shapely.contains_xy(world.boundary.shapely(), x, y)
    expected += ~shapely.contains_xy(shapely.box(*world.bounds), x, y)
    assert (grid.winding.ravel() == expected).all()


@pytest.mark.parametrize("seed", range(3))
def test_every_cell_lists_all_that_touches_it(seed: int) -> None:
    world = random_world(seed, 40, size=20.0, radii=(0.05, 6.0), discs=0.4, holes=0.4, boundary=True)
    grid = build_grid(world, 0.41)
    columns, rows = np.meshgrid(np.arange(grid.columns), np.arange(grid.rows))
    x, y = grid.x0 + columns.ravel() * grid.size, grid.y0 + rows.ravel() * grid.size
    cells = shapely.box(x, y, x + grid.size, y + grid.size)
    items = np.concatenate(
        [
            shapely.linestrings(grid.segments.reshape(-1, 2, 2)),
            shapely.buffer(shapely.points(grid.discs[:, :2]), grid.discs[:, 2], quad_segs=64),
        ]
    )
    touched = shapely.STRtree(cells).query(items, predicate="intersects")
    listed = {
        (int(item) if item >= 0 else len(grid.segments) - 1 - int(item), row * grid.columns + column)
        for row in range(grid.rows)
        for column in range(grid.columns)
        for item in grid.items[grid.cell_start[row, column] : grid.cell_start[row, column + 1]]
    }
    assert {(int(item), int(cell)) for item, cell in touched.T} <= listed
