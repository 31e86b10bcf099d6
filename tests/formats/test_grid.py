from __future__ import annotations

import base64
import math
import pickle
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray
from scipy import ndimage

from trailmark import FormatError, Robot, ShapeError, StateChecker, TrailmarkError, World, WorldError
from trailmark.formats.grid import (
    MAX_CELLS,
    CellObstacles,
    cells_of,
    check_size,
    grid_polygons,
    grid_sides,
    packed_cells,
)
from trailmark.formats.yaml_data import parse_yaml
from trailmark.shapes import Disc, Polygon, signed_area
from trailmark.world.world_file import world_fields, world_text

grids = arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.booleans())


def rasterised(polygons: tuple[Polygon, ...], points: NDArray[np.float64]) -> NDArray[np.int64]:
    """How many polygons hold each point; points of shape (..., 2)."""
    count = np.zeros(points.shape[:-1], dtype=np.int64)
    for polygon in polygons:
        count += shapely.contains_xy(polygon.shapely(), points[..., 0], points[..., 1])
    return count


def centres(shape: tuple[int, ...]) -> NDArray[np.float64]:
    rows, columns = np.indices(shape)
    return np.stack([columns + 0.5, rows + 0.5], axis=-1)


@pytest.mark.slow
@given(grids)
def test_polygons_cover_the_occupied_cells_exactly(occupied: NDArray[np.bool_]) -> None:
    polygons = grid_polygons(occupied)
    # Each centre in exactly one polygon or none, and not a sliver of area more.
    assert np.array_equal(rasterised(polygons, centres(occupied.shape)), occupied.astype(int))
    assert sum(polygon.area for polygon in polygons) == occupied.sum()
    assert len(polygons) == ndimage.label(occupied)[1]
    lowest = [polygon.vertices[:, 1].min() for polygon in polygons]
    assert lowest == sorted(lowest)
    for polygon in polygons:
        assert polygon.shapely().is_valid
        assert signed_area(polygon.vertices) > 0.0
        assert all(signed_area(hole) < 0.0 for hole in polygon.holes)
        for ring in (polygon.vertices, *polygon.holes):
            before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
            assert (np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) >= 1.0).all()


@pytest.mark.slow
@given(grids, st.floats(0.01, 10.0), st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-4, 4)))
def test_cells_are_placed_by_size_origin_and_angle(
    occupied: NDArray[np.bool_], cell: float, origin: tuple[float, float, float]
) -> None:
    x, y, yaw = origin
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    points = np.array([x, y]) + cell * centres(occupied.shape) @ turn.T
    polygons = grid_polygons(occupied, cell, origin)
    assert np.array_equal(rasterised(polygons, points), occupied.astype(int))
    assert sum(p.area for p in polygons) == pytest.approx(occupied.sum() * cell**2, rel=1e-9)


def test_polygons_need_no_check_where_the_grids_lines_keep_their_order() -> None:
    rng = np.random.default_rng(9)
    occupied = rng.random((40, 60)) < 0.5
    for cell, origin in ((0.05, (-3.7, 11.1, 0.0)), (1.0, (0.0, 0.0, 0.0)), (1e-7, (0.1, 0.1, 0.0))):
        found = grid_polygons(occupied, cell, origin)
        assert found == tuple(Polygon(polygon.vertices, polygon.holes) for polygon in found)
        assert not any(ring.flags.writeable for polygon in found for ring in polygon.rings()[:1])


@pytest.mark.parametrize(
    ("cell", "origin"),
    [
        pytest.param(1e-9, (9e7, 0.0, 0.0), id="lines-fall-together"),
        pytest.param(1e300, (0.0, 0.0, 0.0), id="out-of-range"),
        pytest.param(1.0, (1e300, 0.0, 0.0), id="far-away"),
    ],
)
def test_lines_that_rounding_joins_are_refused(cell: float, origin: tuple[float, float, float]) -> None:
    with pytest.raises(ShapeError):
        grid_polygons(np.eye(3, dtype=bool), cell, origin)


def test_noise_beyond_the_limit_is_refused() -> None:
    board = np.indices((708, 708)).sum(axis=0) % 2 == 0
    with pytest.raises(WorldError, match="expected outlines with at most 1,000,000 corners, got 1,002,528"):
        grid_polygons(board)


@pytest.mark.parametrize("size", [(0, 5), (5, 0), (8001, 8000), (10**9, 10**9)])
def test_sizes_beyond_the_limit_are_refused(size: tuple[int, int]) -> None:
    check_size(8000, 8000)
    with pytest.raises(WorldError, match=r"expected 1 to 64,000,000 cells"):
        check_size(*size)


ROBOT = Robot.rectangle(0.7, 0.3)


def made(world: World) -> bool:
    """Whether the world's polygons have been made."""
    return "shapes" in world.obstacles.__dict__


@pytest.mark.slow
@given(grids)
def test_sides_are_those_of_the_polygons(occupied: NDArray[np.bool_]) -> None:
    origin = (0.5, -2.0, 0.0)
    sides = grid_sides(occupied, 0.1, origin)
    rings = [ring for polygon in grid_polygons(occupied, 0.1, origin) for ring in polygon.rings()]
    wanted = [np.hstack([ring, np.roll(ring, -1, axis=0)]) for ring in rings]
    expected = np.concatenate(wanted) if wanted else np.empty((0, 4))

    # Where polygons touch in a corner one straight side may be two: the unit edges are the same.
    def units(rows: NDArray[np.float64]) -> set[tuple[int, ...]]:
        cells = np.rint((rows - [0.5, -2.0, 0.5, -2.0]) / 0.1).astype(int)
        found = set[tuple[int, ...]]()
        for x1, y1, x2, y2 in cells.tolist():
            n = max(abs(x2 - x1), abs(y2 - y1))
            dx, dy = (x2 - x1) // n, (y2 - y1) // n
            found |= {(x1 + k * dx, y1 + k * dy, dx, dy) for k in range(n)}
        return found

    assert units(sides) == units(expected)


@pytest.mark.parametrize("seed", range(4))
def test_answers_are_those_of_the_polygons_which_are_not_made(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = World.from_grid(rng.random((12, 15)) < 0.2, 0.5, (3.0, -1.0))
    q = np.column_stack([rng.uniform(3.0, 10.5, 400), rng.uniform(-1.0, 5.0, 400), rng.uniform(-3.0, 3.0, 400)])
    mine = StateChecker(world, ROBOT)
    valid, clearance = mine.valid(q), mine.clearance(q)
    assert not made(world)
    theirs = StateChecker(replace(world, obstacles=tuple(world.obstacles)), ROBOT)
    assert made(world)
    assert np.array_equal(valid, theirs.valid(q))
    assert clearance == pytest.approx(theirs.clearance(q), abs=1e-12)
    assert cells_of(world.edited(remove=[len(world.obstacles) // 2], add=[Disc((6.0, 2.0), 0.3)]).obstacles) is None


def test_is_a_sequence_like_a_tuple() -> None:
    occupied = np.eye(4, dtype=np.bool_)
    world, other = World.from_grid(occupied, 1.0), World.from_grid(occupied, 1.0)
    shapes = grid_polygons(occupied)
    assert world == other
    assert hash(world.obstacles) == hash(shapes)
    assert world.obstacles == shapes
    assert shapes == world.obstacles
    assert world.obstacles != shapes[1:]
    assert world.obstacles + shapes == shapes + world.obstacles == (*shapes, *shapes)
    assert world.obstacles[1:3] == shapes[1:3]
    assert repr(world.obstacles) == repr(shapes)
    assert not made(pickle.loads(pickle.dumps(world)))  # noqa: S301  # its own
    assert pickle.loads(pickle.dumps(world)) == world  # noqa: S301  # its own


def test_a_turned_grid_is_no_longer_cells() -> None:
    occupied = np.eye(4, dtype=np.bool_)
    assert cells_of(World.from_grid(occupied, 1.0, (0.0, 0.0, 0.3)).obstacles) is None
    assert cells_of(World.from_grid(occupied, 1.0).obstacles) is not None
    assert CellObstacles(occupied).upright


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
    with pytest.raises(TrailmarkError, match=problem):
        World.from_grid(*arguments)


def test_masked_cells_are_not_free() -> None:
    cells = np.ma.zeros((2, 3), np.int8)
    cells[:, 1] = np.ma.masked
    unknown = World.from_grid(cells.filled(-1), 1.0).obstacles
    assert len(unknown) == 1
    assert World.from_grid(cells, 1.0).obstacles == unknown
    assert World.from_grid(cells.astype(bool), 1.0).obstacles == unknown
    assert World.from_grid(list(cells), 1.0).obstacles == unknown


FILE = Path("map.yaml")


def test_a_world_file_holds_cells_or_polygons() -> None:
    occupied = np.random.default_rng(2).random((9, 17)) < 0.3
    world = World.from_grid(occupied, 0.25, (-1.0, 2.0), name="map")
    read = {grid: _read(world_text(world, grid)) for grid in (False, True)}
    cells = cells_of(read[True].obstacles)
    assert (cells.occupied == occupied).all()
    assert cells_of(read[False].obstacles) is None
    assert tuple(read[True].obstacles) == read[False].obstacles == tuple(world.obstacles)
    # What is known of single obstacles is written with them.
    named = World("map", world.bounds, world.obstacles, ids=tuple(map(str, range(len(world.obstacles)))))
    assert _read(world_text(named, grid=True)).ids == named.ids


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": 0}, "grid.rows: "),
        ({"rows": 4}, "expected 3 bytes of bits for 4 rows of 6 cells, got 2"),
        ({"rows": 1}, "expected 1 bytes of bits for 1 rows of 6 cells, got more than 1"),
        ({"columns": 10**9}, "expected 1 to 64,000,000 cells"),
        ({"occupied": "x"}, "expected occupied to be bits"),
        ({"occupied": base64.b64encode(b"bits").decode()}, "expected occupied to be bits"),
        ({"occupied": base64.b64encode(zlib.compress(bytes(10**8))).decode()}, "got more than 2"),
        ({"origin": [0.0, 0.0]}, "grid.origin: "),
        ({"side": 1.0}, "grid.side: unknown key"),
    ],
)
def test_other_cells_are_refused(change: dict[str, Any], message: str) -> None:
    grid = packed_cells(CellObstacles(np.eye(2, 6, dtype=np.bool_)))
    with pytest.raises(FormatError, match=message):
        _from_data(grid=grid | change)


def test_cells_and_obstacles_exclude_each_other() -> None:
    grid = packed_cells(CellObstacles(np.eye(2, dtype=np.bool_)))
    with pytest.raises(FormatError, match="expected obstacles or a grid, got both"):
        _from_data(grid=grid, obstacles=[{"shape": "disc", "center": [0.5, 0.5], "radius": 0.1}])


def _read(text: str) -> World:
    data = parse_yaml(text, FILE)
    assert isinstance(data, dict)
    return World(**world_fields(data, FILE))


def _from_data(**parts: Any) -> World:
    return World(**world_fields({"trailmark": 1, "bounds": [0.0, 0.0, 6.0, 6.0], **parts}, FILE))
