"""World.from_grid: the cells that are not free, exactly, wherever the grid lies."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import TrailmarkError
from trailmark.formats.grid import MAX_CELLS
from trailmark.world import World


def corners(cell: float, origin: tuple[float, float, float], row: int, column: int) -> list[tuple[float, float]]:
    """Return a cell's corners by the definition of a map's origin, in complex numbers."""
    turn = complex(math.cos(origin[2]), math.sin(origin[2]))
    places = ((column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1))
    points = (complex(origin[0], origin[1]) + turn * complex(cell * x, cell * y) for x, y in places)
    return [(point.real, point.imag) for point in points]


@pytest.mark.slow
@given(
    st.integers(0, 2**30),
    st.sampled_from([0.05, 0.1, 1.0]),
    st.tuples(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0)),
    st.sampled_from([0.0, math.pi / 2, math.pi, -math.pi, -1.2, 0.3, 3.0, 7.0, 1e-9]),
)
def test_a_turned_grids_cells_are_where_their_corners_are(
    seed: int, cell: float, place: tuple[float, float], yaw: float
) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.integers(0, 2, rng.integers(1, 7, 2)).astype(bool)
    origin = (*place, yaw)
    world = World.from_grid(cells, cell, origin)
    expected = shapely.union_all([shapely.Polygon(corners(cell, origin, *where)) for where in np.argwhere(cells)])
    got = shapely.union_all([shape.polygon().shapely() for shape in world.obstacles])
    assert shapely.symmetric_difference(expected, got).area <= 1e-10
    rows, columns = cells.shape
    whole = shapely.Polygon(
        [
            corners(cell, origin, *at)[k]
            for k, at in enumerate(((0, 0), (0, columns - 1), (rows - 1, columns - 1), (rows - 1, 0)))
        ]
    )
    free = shapely.box(*world.bounds) if world.boundary is None else world.boundary.shapely()
    assert shapely.hausdorff_distance(whole, free) <= 1e-9
    assert world.bounds == pytest.approx(whole.bounds, abs=1e-9)


def test_an_occupancy_grids_unknown_cells_are_not_free() -> None:
    data = np.array([0, 100, -1, 0, 0, 50], dtype=np.int8).reshape(2, 3)  # of a nav_msgs/OccupancyGrid
    world = World.from_grid(data, 0.5, (10, 20), name="yard")
    assert (world.name, world.bounds, world.robot) == ("yard", (10.0, 20.0, 11.5, 21.0), None)
    (obstacle,) = world.obstacles
    assert obstacle.area == pytest.approx(3 * 0.25)
    assert obstacle.bounding_box() == (10.5, 20.0, 11.5, 21.0)
    assert World.from_grid((data != 0).tolist(), 0.5, [10.0, 20.0, 0.0]).obstacles == world.obstacles


def test_a_free_grid_has_no_obstacles() -> None:
    assert World.from_grid(np.zeros((3, 4), dtype=np.uint8), 0.25).bounds == (0.0, 0.0, 1.0, 0.75)


CELLS = np.zeros((2, 3), dtype=bool)


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ((np.zeros((2, 3)), 1), r"grid: expected truth values or whole numbers .*, got float64 .* \(compare them with"),
        (([0, 1], 1), r"grid: expected .*, got int64 of shape \(2,\)"),
        ((np.zeros((2, 3, 3), dtype=np.uint8), 1), r"got uint8 of shape \(2, 3, 3\)"),
        (("office", 1), r"grid: expected .*, got <U6 of shape \(\)"),
        ((CELLS[:0], 1), f"expected 1 to {MAX_CELLS:,} cells, got 3 x 0"),
        ((CELLS, 0), "grid: resolution: expected a finite number above 0, got 0"),
        ((CELLS, math.nan), "grid: resolution: expected"),
        ((CELLS, "1"), "grid: resolution: expected"),
        ((CELLS, 1, (0,)), r"grid: origin: expected x, y or x, y, yaw, got \(0,\)"),
        ((CELLS, 1, (0, 0, 0, 0)), "grid: origin: expected x, y or x, y, yaw"),
        ((CELLS, 1, 5), "grid: origin: expected x, y or x, y, yaw, got 5"),
        ((CELLS, 1, (0, math.inf)), "grid: origin: expected a finite number, got inf"),
        ((CELLS, 1, (0, 1e9)), "bounds: expected"),
        ((CELLS, 1, (0, 0), 7), "world: name: expected str, got 7"),
    ],
)
def test_other_grids_are_refused_in_one_line(arguments: tuple[Any, ...], problem: str) -> None:
    with pytest.raises(TrailmarkError, match=problem) as caught:
        World.from_grid(*arguments)
    assert "\n" not in str(caught.value)


def test_masked_cells_are_not_free() -> None:
    cells = np.ma.zeros((2, 3), np.int8)
    cells[:, 1] = np.ma.masked
    unknown = World.from_grid(cells.filled(-1), 1.0).obstacles
    assert len(unknown) == 1
    assert World.from_grid(cells, 1.0).obstacles == unknown
    assert World.from_grid(cells.astype(bool), 1.0).obstacles == unknown
    assert World.from_grid(list(cells), 1.0).obstacles == unknown
