"""The obstacle grid: it forgets no obstacle, and it knows inside from outside at any alignment of its cells."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from tests.helpers.worlds import random_world

from trailmark.collision import StateChecker
from trailmark.collision.obstacles import build_grid
from trailmark.shapes import Polygon
from trailmark.world import Robot, World

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
    assert world.boundary is not None
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
