"""Shapes: triangles that fill exactly, discs that are contained, bad input refused in one line."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from tests.helpers.worlds import star_polygon

from trailmark.errors import ShapeError
from trailmark.shapes import LIMIT, Disc, Polygon, Rectangle, signed_area, triangulate

SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
HOLE = np.array([[1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0]])
L = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]])
U = np.array([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]], dtype=float)
COMB = np.array(
    [[0, 0], [9, 0], *[p for i in range(8, 0, -2) for p in ((i + 0.5, 5), (i, 0.01), (i - 0.5, 5))]], dtype=float
)

POLYGONS = {
    "square": Polygon(SQUARE),
    "clockwise": Polygon(SQUARE[::-1]),
    "L": Polygon(L),
    "U": Polygon(U),
    "comb": Polygon(COMB),
    "hole": Polygon(SQUARE, (HOLE,)),
    "two holes": Polygon(SQUARE, (HOLE, HOLE[::-1] + 1.5)),
    "holes touch in a corner": Polygon(SQUARE, (HOLE, HOLE + 1.0)),
    "hole touches the outline": Polygon(SQUARE, (np.array([[0.0, 2.0], [2.0, 1.0], [2.0, 3.0]]),)),
    "vertices on a line": Polygon(np.insert(SQUARE, 1, [[1.0, 0.0], [2.0, 0.0]], axis=0)),
    "a vertex twice": Polygon(np.insert(SQUARE, 1, SQUARE[1], axis=0)),
    "sliver": Polygon(np.array([[0.0, 0.0], [100.0, 1e-4], [50.0, 1e-3]])),
    "far away": Polygon(U + 1e6),
    "tiny": Polygon(U * 1e-6),
}


def assert_fills(polygon: Polygon, tolerance: float) -> None:
    """Assert that the triangles lie in the polygon, overlap nowhere and leave nothing out."""
    triangles = triangulate(polygon)
    region = shapely.Polygon(polygon.vertices, polygon.holes)
    u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    areas = 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    assert (areas >= 0.0).all()
    assert areas.sum() == pytest.approx(region.area, rel=tolerance)
    pieces = shapely.polygons(triangles)
    # With the areas equal, being inside rules out both gaps and overlaps.
    assert shapely.area(shapely.difference(pieces, region)).max() <= tolerance * region.area
    given_vertices = {tuple(p) for ring in (polygon.vertices, *polygon.holes) for p in ring.tolist()}
    assert {tuple(p) for p in triangles.reshape(-1, 2).tolist()} <= given_vertices


@pytest.mark.parametrize("name", POLYGONS)
def test_triangles_fill_the_polygon(name: str) -> None:
    assert_fills(POLYGONS[name], 1e-9)


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_triangles_fill_random_polygons(seed: int, hollow: bool) -> None:
    rng = np.random.default_rng(seed)
    polygon = star_polygon(rng, (10.0, -20.0), 3.0)
    if hollow and len(polygon.vertices) > 3:
        polygon = Polygon(polygon.vertices, (0.5 * (polygon.vertices + np.array([10.0, -20.0])),))
    assert_fills(polygon, 1e-9)
    assert polygon.area == pytest.approx(shapely.Polygon(polygon.vertices, polygon.holes).area, rel=1e-12)


# --- discs and rectangles


@pytest.mark.parametrize("radius", [1e-6, 0.01, 0.5, 1.0, 30.0, 1e4])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-3, 0.1])
def test_a_discs_polygon_contains_it_and_keeps_the_stated_error(radius: float, tolerance: float) -> None:
    ring = Disc((3.0, -2.0), radius).polygon(tolerance).vertices - (3.0, -2.0)
    assert len(ring) >= 8
    rounding = 1e-12 * max(radius, 1.0)
    assert np.hypot(*ring.T).max() <= radius + max(tolerance, radius * (1 / math.cos(math.pi / 8) - 1)) + rounding
    if len(ring) > 8:
        assert np.hypot(*ring.T).max() <= radius + tolerance + rounding
    # The nearest that an edge comes to the centre is its distance from it: no part of the disc sticks out.
    following = np.roll(ring, -1, axis=0)
    edge = following - ring
    distance = np.abs(ring[:, 0] * edge[:, 1] - ring[:, 1] * edge[:, 0]) / np.hypot(*edge.T)
    assert distance.min() >= radius - rounding


@given(st.floats(-10, 10), st.floats(-10, 10), st.floats(0.01, 50), st.floats(0.01, 50), st.floats(-7, 7))
def test_a_rectangle_lies_along_its_heading(x: float, y: float, length: float, width: float, heading: float) -> None:
    rectangle = Rectangle((x, y), length, width, heading)
    z = (rectangle.polygon().vertices - (x, y)) @ np.array([1, 1j]) * np.exp(-1j * heading)
    assert np.abs(z.real) == pytest.approx(np.full(4, length / 2), rel=1e-9, abs=1e-9)
    assert np.abs(z.imag) == pytest.approx(np.full(4, width / 2), rel=1e-9, abs=1e-9)
    assert rectangle.area == pytest.approx(length * width)
    assert rectangle.bounding_box() == pytest.approx(rectangle.polygon().shapely().bounds)


def test_shapes_are_values() -> None:
    assert Disc((0, 0), 1) == Disc((0.0, 0.0), 1.0)
    assert Polygon(SQUARE) == Polygon(SQUARE.tolist()) == Polygon(np.vstack([SQUARE, SQUARE[:1]]))
    assert Polygon(SQUARE, (HOLE,)) != Polygon(SQUARE)
    assert Polygon(SQUARE) != Polygon(np.roll(SQUARE, 1, axis=0))
    assert Polygon(SQUARE) != "square"
    assert len({Polygon(SQUARE), Polygon(SQUARE.copy()), Polygon(2.0 * SQUARE / 2.0), Disc((0, 0), 1)}) == 2


def test_zero_has_one_hash() -> None:
    minus = Polygon(np.where(SQUARE == 0.0, -0.0, SQUARE))
    assert minus == Polygon(SQUARE)
    assert hash(minus) == hash(Polygon(SQUARE))


def test_shapes_cannot_be_changed_from_outside() -> None:
    points = SQUARE.copy()
    polygon = Polygon(points)
    points[0] = 99.0
    assert polygon.vertices[0].tolist() == [0.0, 0.0]
    with pytest.raises(ValueError, match="read-only"):
        polygon.vertices[0] = 1.0


@pytest.mark.parametrize("name", POLYGONS)
def test_rings_have_the_region_on_their_left(name: str) -> None:
    polygon = POLYGONS[name]
    outline, *holes = polygon.rings()
    assert signed_area(outline) > 0.0
    assert all(signed_area(hole) < 0.0 for hole in holes)
    assert polygon.area == pytest.approx(polygon.shapely().area, rel=1e-6)
    assert polygon.bounding_box() == polygon.shapely().bounds
    assert polygon.polygon() is polygon


def test_area_keeps_its_digits_far_from_the_origin() -> None:
    assert signed_area(SQUARE + 1e7) == 16.0
    assert signed_area(SQUARE[::-1] - 1e7) == -16.0


# --- what is refused

BOW_TIE = [[0, 0], [1, 1], [1, 0], [0, 1]]
BAD: list[tuple[type, tuple[Any, ...], str]] = [
    (Disc, ((0, 0), 0.0), "disc: radius: expected a finite number above 0 and at most 1e+08, got 0.0 m"),
    (Disc, ((0, 0), math.nan), "disc: radius: expected a finite number above 0 and at most 1e+08, got nan m"),
    (Disc, ((0, 0), 2 * LIMIT), "at most 1e+08, got"),
    (Disc, ((0, 0), "wide"), "disc: radius: expected a finite number above 0 and at most 1e+08, got 'wide'"),
    (Disc, ((0, math.inf), 1), "disc: center: expected a finite number of -1e+08 or more and at most 1e+08, got inf m"),
    (Disc, ((0, 0, 0), 1), "disc: center: expected two numbers x, y, got (0, 0, 0)"),
    (Rectangle, ((0, 0), 0, 1), "rectangle: length: expected a finite number above 0 and at most 1e+08, got 0 m"),
    (Rectangle, ((0, 0), 1, -2), "rectangle: width: expected a finite number above 0 and at most 1e+08, got -2 m"),
    (Rectangle, ((0, 0), 1, 1, math.nan), "rectangle: heading: expected a finite number, got nan"),
    (Polygon, ([[0, 0], [1, 1]],), "polygon: vertices: expected 3 or more different points, got 2"),
    (Polygon, ([],), "polygon: vertices: expected shape (n, 2), got (0,)"),
    (Polygon, ([[0, 0], [1, 0], [0]],), "is not a list of points"),
    (Polygon, ([[0, 0], [1, 0], [0, "x"]],), "is not a list of points"),
    (Polygon, ([[0, 0], [10**400, 0], [0, 1]],), "is not a list of points"),
    (Polygon, ([[0, 0], [1, 0], [0, math.nan]],), "not a finite number"),
    (Polygon, ([[0, 0], [1e200, 0], [0, 1]],), "expected coordinates of at most 1e+08 m, got 1e+200"),
    (Polygon, (BOW_TIE,), "not simple: Self-intersection"),
    (Polygon, ([[0, 0], [1, 0], [2, 0]],), "polygon:"),
    (Polygon, ([[0, 0], [2, 0], [2, 2], [2, 3], [2, 2], [0, 2]],), "not simple"),
    (Polygon, (SQUARE, (HOLE + 10.0,)), "Hole lies outside shell"),
    (Polygon, (SQUARE, (HOLE, HOLE + 0.5)), "not simple"),
    (Polygon, (SQUARE, (HOLE, HOLE)), "not simple"),
    (Polygon, (SQUARE, ([[1, 1], [2, 2]],)), "polygon: holes[0]: expected 3 or more different points, got 2"),
]


@pytest.mark.parametrize(("shape", "arguments", "part"), BAD)
def test_bad_shapes_are_refused_in_one_line(shape: type, arguments: tuple[Any, ...], part: str) -> None:
    with pytest.raises(ShapeError) as caught:
        shape(*arguments)
    assert part in str(caught.value)
    assert len(str(caught.value)) < 300
