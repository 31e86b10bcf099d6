"""Penetration depth: the shortest translation that takes one shape out of another, by shapely.

Source of the definition: Dobkin, Hershberger, Kirkpatrick & Suri, "Computing the intersection-depth of polyhedra",
Algorithmica 9 (1993). With a body's reference point at a place, it overlaps a shape if and only if the place lies
inside the Minkowski difference of the two; the shortest translation out leads to the nearest point outside of that.
"""

from __future__ import annotations

from functools import cached_property
from math import cos, pi
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark import se2
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Shape

__all__ = ["Penetration", "bounds_depth", "outside_of"]

CHORDS = 128
"""Of a quarter of a circle, where a disc's region is made a polygon: it is too large by 2e-5 of the radius at most."""


JOINED, LARGE = 24, 200
"""Triangles at most that are joined to larger convex pieces, vertices at most of a shape that is looked at whole."""


class Penetration:
    """How deep a body is in one shape.

    Args:
        body: in the robot's frame; a disc's centre is the reference point.
        shape: that it should not overlap.
        kept: metres that the body is to keep from the shape.
    """

    def __init__(self, body: Shape, shape: Shape, kept: float = 0.0) -> None:
        self._body, self._shape = body, shape
        self._radius = kept + sum(each.radius for each in (body, shape) if isinstance(each, Disc))

    def at(self, states: FloatArray) -> FloatArray:
        """Return the penetration depth (metres, 0 where there is none) at configurations (n, 3), shape (n,)."""
        places, disc = np.asarray(states[:, :2]), isinstance(self._body, Disc)
        if isinstance(self._shape, Disc) or (disc and not self._large):
            if isinstance(self._shape, Disc):
                places = places - self._shape.center
            if not disc:
                # The disc as the robot sees it.
                cos, sin, (x, y) = np.cos(states[:, 2]), np.sin(states[:, 2]), -places.T
                places = np.column_stack([cos * x + sin * y, cos * y - sin * x])
            return _depths(*self._alone_grown, np.zeros(len(states), np.intp), places)
        found, left, reach = np.zeros(len(states)), np.arange(len(states)), self._span + self._radius
        while len(left):
            low, high = places[left].min(axis=0), places[left].max(axis=0)
            headings, of = np.unique(np.zeros(len(left)) if disc else states[left, 2], return_inverse=True)
            parts, everything = self._differences(headings, low, high, reach)
            found[left] = _depths(*self._grown(parts), of, places[left] - low)
            left, reach = left[(found[left] > reach) & (not everything)], 2.0 * reach
        return found

    def overlapping(self, q: FloatArray, reach: float) -> shapely.Geometry:
        """Return the translations (metres) from a configuration, (3,), by at most ``reach``, to where it overlaps.

        It holds all of these, and may hold longer ones, and shorter ones within 2e-5 of what the shapes are rounded by.
        """
        if isinstance(self._body, Disc) and not self._large:
            center = np.asarray(self._shape.center) if isinstance(self._shape, Disc) else np.zeros(2)
            part = shapely.transform(self._alone, lambda rows: rows + center - q[:2])
        elif isinstance(self._shape, Disc):
            center = np.asarray(self._shape.center)
            part = shapely.transform(self._alone, lambda rows: center - se2.transform(q, rows))
        else:
            part = self._differences(q[2:], q[:2], q[:2], reach)[0][0]
        # Chords around the circle instead of in it.
        radius = self._radius / cos(0.25 * pi / CHORDS)
        return shapely.buffer(part, radius, quad_segs=CHORDS) if radius else part

    def _grown(self, parts: NDArray[Any]) -> tuple[NDArray[Any], float]:
        """Return Minkowski differences grown by what the shapes are rounded by, and by how much they are still to be.

        Of convex ones distances tell that.
        """
        if self._radius and (shapely.area(shapely.convex_hull(parts)) > shapely.area(parts) * (1.0 + 1e-12)).any():
            return shapely.buffer(parts, self._radius, quad_segs=CHORDS), 0.0
        return parts, self._radius

    def _differences(
        self, headings: FloatArray, low: FloatArray, high: FloatArray, reach: float
    ) -> tuple[NDArray[Any], bool]:
        """Return where, seen from ``low``, the reference point must not be at headings (n,), (n,): in a polygon.

        That is exact to ``reach`` metres from any place between ``low`` and ``high``, and whether it is everywhere.
        """
        room = self._span + self._radius + reach
        window = shapely.box(*(low - room), *(high + room))
        if self._large:
            everything = bool(shapely.covers(window, shapely.box(*self._shape.bounding_box())))
            region = shapely.intersection(self._region, window)
            if isinstance(self._body, Disc):
                return np.array([shapely.transform(region, lambda rows: rows - low)]), everything
            parts = [part for part in shapely.get_parts(region) if part.geom_type == "Polygon"]
            near = _padded([ring for part in parts for ring in _convex_pieces(part) if len(ring)])  # slivers have none
        else:
            pieces, boxes = self._pieces
            inside = shapely.intersects(window, boxes)
            near, everything = pieces[inside], bool(inside.all())
        turned = np.column_stack([np.zeros((len(headings), 2)), headings])
        body = se2.transform(turned, self._body_pieces.reshape(-1, 2)).reshape(len(headings), *self._body_pieces.shape)
        # Headings, pieces of the shape, pieces of the body, vertices of the one, and of the other.
        sums = (near - low)[None, :, None, :, None] - body[:, None, :, None]
        if sums.shape[1] == 0:
            return np.full(len(headings), shapely.Polygon()), everything
        shape = len(headings), sums.shape[1] * sums.shape[2]
        hulls = shapely.convex_hull(shapely.linestrings(sums.reshape(*shape, -1, 2)))
        return np.asarray(hulls[:, 0] if shape[1] == 1 else shapely.union_all(hulls, axis=1)), everything

    @cached_property
    def _alone(self) -> shapely.Geometry:
        """What is no disc, in its own frame; of two discs a point."""
        shape = self._shape if isinstance(self._body, Disc) else self._body
        return shapely.Point(0.0, 0.0) if isinstance(shape, Disc) else shape.polygon().shapely()

    @cached_property
    def _alone_grown(self) -> tuple[NDArray[Any], float]:
        return self._grown(np.array([self._alone]))

    @cached_property
    def _region(self) -> shapely.Polygon:
        return self._shape.polygon().shapely()

    @cached_property
    def _large(self) -> bool:
        """Whether the shape has so many vertices that it is looked at in a window."""
        shape = self._shape
        return isinstance(shape, Polygon) and len(shape.vertices) + sum(map(len, shape.holes)) > LARGE

    @cached_property
    def _span(self) -> float:
        """Largest distance of the body from its reference point, metres, of a disc's centre."""
        return 0.0 if isinstance(self._body, Disc) else float(np.hypot(*self._body.polygon().vertices.T).max())

    @cached_property
    def _body_pieces(self) -> FloatArray:
        return _padded(_convex_pieces(self._body.polygon().shapely()))

    @cached_property
    def _pieces(self) -> tuple[FloatArray, NDArray[Any]]:
        """The shape's convex pieces, (k, m, 2), and the boxes around them, (k,)."""
        pieces = _padded(_convex_pieces(self._region))
        return pieces, shapely.box(*pieces.min(axis=1).T, *pieces.max(axis=1).T)


def outside_of(boundary: Polygon, room: float) -> Polygon:
    """Return what lies outside of a boundary, for ``room`` metres: the shortest way out of it leads back inside."""
    ring, wide = boundary.vertices, room + float(np.ptp(boundary.vertices, axis=0).max())
    (x1, y1), (x2, y2) = ring.min(axis=0) - wide, ring.max(axis=0) + wide
    return Polygon(np.array([[x1, y1], [x2, y1], [x2, y2], [x1, y2]]), (ring,))


def bounds_depth(body: Shape, bounds: tuple[float, float, float, float], states: FloatArray) -> FloatArray:
    """Return how far (metres) bodies at configurations (n, 3) must be moved to be inside of bounds again, (n,)."""
    placed: Any = states[:, None, :2] if isinstance(body, Disc) else se2.transform(states, body.polygon().vertices)
    radius = body.radius if isinstance(body, Disc) else 0.0
    low, high = placed.min(axis=1) - radius, placed.max(axis=1) + radius
    over = np.maximum(0.0, np.maximum(np.asarray(bounds[:2]) - low, high - np.asarray(bounds[2:])))
    return np.asarray(np.hypot(*over.T))


def _depths(parts: NDArray[Any], radius: float, of: NDArray[np.intp], places: FloatArray) -> FloatArray:
    """Return how far points (n, 2) are inside of regions that are grown by ``radius`` metres, shape (n,).

    Args:
        parts: the regions.
        radius: metres.
        of: which region for each point, (n,).
        places: the points.
    """
    points, area = shapely.points(places), shapely.area(parts)[of]
    apart = -shapely.distance(parts[of], points)
    within = (area > 0.0) & shapely.contains(parts[of], points)
    apart[within] = shapely.distance(shapely.boundary(parts)[of], points)[within]
    return np.asarray(np.maximum(0.0, np.where(np.isnan(apart), 0.0, radius + apart)))


def _convex_pieces(region: shapely.Polygon) -> list[FloatArray]:
    """Return convex polygons that make up a polygon, each of shape (n, 2)."""
    if shapely.convex_hull(region).area <= region.area * (1.0 + 1e-12):
        return [shapely.get_coordinates(region.exterior)[:-1]]
    pieces = list[shapely.Polygon]()
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(region)).tolist()
    for piece in triangles:
        k = 0 if len(triangles) <= JOINED else len(pieces)
        while k < len(pieces):
            hull = shapely.convex_hull(shapely.MultiPolygon([piece, pieces[k]]))
            if hull.area <= (piece.area + pieces[k].area) * (1.0 + 1e-12):
                del pieces[k]
                piece, k = hull, 0
            else:
                k += 1
        pieces.append(piece)
    return [shapely.get_coordinates(piece)[:-1] for piece in pieces]


def _padded(rings: list[FloatArray]) -> FloatArray:
    """Return rings as one array, (k, m, 2); of those with fewer vertices the last is repeated."""
    most = max(map(len, rings), default=3)
    rows = [np.vstack([ring, np.repeat(ring[-1:], most - len(ring), axis=0)]) for ring in rings]
    return np.array(rows).reshape(-1, most, 2)
