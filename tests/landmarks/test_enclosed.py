"""Enclosed regions, against a flood fill in plain Python and against shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from trailmark.landmarks import enclosed, enclosed_cells, enclosed_points

BoolArray = NDArray[np.bool_]


def flood(occupied: BoolArray, seeds: list[tuple[int, int]]) -> BoolArray:
    """The free cells that can be reached from the seeds over the cells' sides."""
    rows, columns = occupied.shape
    reached = np.zeros_like(occupied)
    stack = [cell for cell in seeds if not occupied[cell]]
    while stack:
        i, j = stack.pop()
        if reached[i, j]:
            continue
        reached[i, j] = True
        near = [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
        stack += [(a, b) for a, b in near if 0 <= a < rows and 0 <= b < columns and not occupied[a, b]]
    return reached


grids = arrays.arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9)))


@pytest.mark.slow
@given(grids)
def test_without_a_robot_the_edge_is_open(occupied: BoolArray) -> None:
    rows, columns = occupied.shape
    edge = [(i, j) for i in range(rows) for j in range(columns) if i in (0, rows - 1) or j in (0, columns - 1)]
    assert np.array_equal(enclosed_cells(occupied), ~occupied & ~flood(occupied, edge))


@pytest.mark.slow
@given(grids, st.data())
def test_with_a_robot_the_edge_is_closed(occupied: BoolArray, data: st.DataObject) -> None:
    rows, columns = occupied.shape
    robot = data.draw(st.integers(0, rows - 1)), data.draw(st.integers(0, columns - 1))
    found = enclosed_cells(occupied, robot)
    if occupied[robot]:
        assert np.array_equal(found, enclosed_cells(occupied))
    else:
        assert np.array_equal(found, ~occupied & ~flood(occupied, [robot]))


def test_a_diagonal_of_occupied_cells_closes() -> None:
    picture = ["......", "..#...", ".#.#..", "..#...", "......"]
    occupied = np.array([[cell == "#" for cell in row] for row in picture])
    found = enclosed_cells(occupied)
    assert np.argwhere(found).tolist() == [[2, 2]]


RECTANGLE = (0.0, 0.0, 10.0, 8.0)


@pytest.mark.slow
@pytest.mark.parametrize("lines", [enclosed.MAX_LINES, 200])
@given(st.integers(0, 30), st.integers(0, 999))
def test_points_behind_boxes(lines: int, m: int, seed: int) -> None:
    """With fewer lines than boxes have edges, the boxes grow outwards by less than a cell."""
    rng = np.random.default_rng(seed)
    low = rng.uniform(-1.0, 9.0, (m, 2))
    boxes = np.column_stack([low, low + rng.choice([0.3, 2.0, 4.0], (m, 2))])
    points, robot = rng.uniform((0.0, 0.0), (10.0, 8.0), (300, 2)), rng.uniform((0.0, 0.0), (10.0, 8.0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(enclosed, "MAX_LINES", lines)
        found = enclosed_points(points, boxes, RECTANGLE, robot)
    region, solid = shapely.box(*RECTANGLE), shapely.union_all([shapely.box(*box) for box in boxes])
    if shapely.distance(solid, shapely.Point(robot)) == 0.0:
        return
    rooms = shapely.get_parts(region.difference(solid))
    free = ~shapely.intersects(solid, shapely.points(points))
    home = rooms[int(np.argmin(shapely.distance(rooms, shapely.Point(robot))))]
    there = shapely.intersects(home, shapely.points(points))
    if len(rooms) == 1 or lines > 2 * m:
        assert np.array_equal(found[free], ~there[free])


def test_walls_as_thin_as_lines_enclose() -> None:
    walls = np.array([[2.0, 2.0, 6.0, 2.0], [2.0, 5.0, 6.0, 5.0], [2.0, 2.0, 2.0, 5.0], [6.0, 2.0, 6.0, 5.0]])
    points = np.array([[3.0, 3.0], [1.0, 1.0], [6.1, 3.0]])
    assert enclosed_points(points, walls, RECTANGLE, np.array([9.0, 7.0])).tolist() == [True, False, False]
    assert enclosed_points(points, walls, RECTANGLE).tolist() == [True, False, False]
    assert enclosed_points(points, walls, RECTANGLE, np.array([4.0, 4.0])).tolist() == [False, True, True]


def test_a_gap_however_narrow_lets_through() -> None:
    wall = np.array([[5.0, -1.0, 5.5, 4.0], [5.0, 4.0 + 1e-6, 5.5, 9.0]])
    points = np.array([[1.0, 1.0], [9.0, 1.0]])
    assert enclosed_points(points, wall, RECTANGLE, points[0]).tolist() == [False, False]
    wall[1, 1] = 4.0
    assert enclosed_points(points, wall, RECTANGLE, points[0]).tolist() == [False, True]


def test_no_boxes_enclose_nothing() -> None:
    assert not enclosed_points(np.ones((3, 2)), np.empty((0, 4)), RECTANGLE, np.ones(2)).any()
