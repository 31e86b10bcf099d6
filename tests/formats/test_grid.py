from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray

from trailmark.errors import ShapeError, WorldError
from trailmark.formats.grid import check_size, grid_polygons
from trailmark.shapes import Polygon, signed_area

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


@pytest.mark.slow
@given(grids)
def test_vertices_are_corners_and_rings_have_their_sense(occupied: NDArray[np.bool_]) -> None:
    for polygon in grid_polygons(occupied):
        assert polygon.shapely().is_valid
        assert signed_area(polygon.vertices) > 0.0
        for ring in (polygon.vertices, *polygon.holes):
            before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
            assert (np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) >= 1.0).all()
        assert all(signed_area(hole) < 0.0 for hole in polygon.holes)


@pytest.mark.slow
@given(grids)
def test_one_polygon_for_each_component_of_cells(occupied: NDArray[np.bool_]) -> None:
    waiting = {(int(r), int(c)) for r, c in np.argwhere(occupied)}
    components = 0
    while waiting:
        components += 1
        front = [waiting.pop()]
        while front:
            r, c = front.pop()
            near = {(r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)} & waiting
            waiting -= near
            front += near
    assert len(grid_polygons(occupied)) == components


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


@pytest.mark.parametrize(
    ("picture", "polygons", "holes"),
    [
        (["#"], 1, 0),
        (["."], 0, 0),
        (["#.", ".#"], 2, 0),
        (["###", "#.#", "###"], 1, 1),
        (["####", "#.##", "##.#", "####"], 1, 2),  # two holes that touch in a corner
        (["###", "#.#", "##."], 1, 1),  # a hole that touches the outline
        (["#####", "#...#", "#.#.#", "#...#", "#####"], 2, 1),  # an island
        (["##.", "#.#", ".##"], 2, 0),  # two components that touch twice and enclose a cell
    ],
)
def test_corners_that_touch(picture: list[str], polygons: int, holes: int) -> None:
    found = grid_polygons(np.array([[c == "#" for c in row] for row in picture]))
    assert len(found) == polygons
    assert sum(len(polygon.holes) for polygon in found) == holes


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


def test_a_rectangle_has_four_vertices() -> None:
    (polygon,) = grid_polygons(np.ones((300, 200), dtype=bool), 0.05, (1.0, 2.0, 0.0))
    assert sorted(map(tuple, polygon.vertices.tolist())) == [(1.0, 2.0), (1.0, 17.0), (11.0, 2.0), (11.0, 17.0)]


@pytest.mark.slow
def test_large_maps() -> None:
    rng = np.random.default_rng(5)
    sparse = rng.random((1000, 1000)) < 0.0005
    rooms = np.zeros((256, 256), dtype=bool)
    rooms[::8], rooms[:, ::8] = True, True
    rooms[rng.random(rooms.shape) < 0.02] = False
    for occupied in (sparse, rooms):
        polygons = grid_polygons(occupied)
        assert sum(polygon.area for polygon in polygons) == occupied.sum()
        union = shapely.union_all([polygon.shapely() for polygon in polygons])
        shapely.prepare(union)
        row, column = rng.integers(0, len(occupied), (2, 30_000))
        assert np.array_equal(shapely.contains_xy(union, column + 0.5, row + 0.5), occupied[row, column])


def test_noise_beyond_the_limit_is_refused() -> None:
    board = np.indices((708, 708)).sum(axis=0) % 2 == 0
    with pytest.raises(WorldError, match="expected outlines with at most 1,000,000 corners, got 1,002,528"):
        grid_polygons(board)


@pytest.mark.parametrize("size", [(0, 5), (5, 0), (8001, 8000), (10**9, 10**9)])
def test_sizes_beyond_the_limit_are_refused(size: tuple[int, int]) -> None:
    check_size(8000, 8000)
    with pytest.raises(WorldError, match=r"expected 1 to 64,000,000 cells"):
        check_size(*size)
