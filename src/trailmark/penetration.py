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

from trailmark import se2
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Shape, convex_pieces

__all__ = ["Penetration", "bounds_depth", "outside_of"]

CHORDS = 128
"""Of a quarter of a circle, where a disc's region is made a polygon: it is too large by 2e-5 of the radius at most."""


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
        found = np.empty(len(states))
        headings, which = np.unique(states[:, 2], return_inverse=True)
        if isinstance(self._body, Disc):
            headings, which = np.zeros(1), np.zeros(len(states), np.intp)
        for k, heading in enumerate(headings):
            rows = np.flatnonzero(which == k)
            places, reach = states[rows, :2], self._span
            while True:
                part, everything = self._difference(heading, places, reach)
                depths = self._depths(part, places - places[0])
                if everything or depths.max() <= reach:
                    break
                reach *= 2.0
            found[rows] = depths
        return found

    def overlapping(self, q: FloatArray, reach: float) -> shapely.Geometry:
        """Return the translations (metres) from a configuration, (3,), by at most ``reach``, to where it overlaps.

        It holds all of these, and may hold longer ones, and shorter ones within 2e-5 of what the shapes are rounded by.
        """
        part, _ = self._difference(q[2], q[None, :2], reach)
        # Chords around the circle instead of in it.
        radius = self._radius / cos(0.25 * pi / CHORDS)
        return shapely.buffer(part, radius, quad_segs=CHORDS) if radius else part

    def _depths(self, part: shapely.Geometry, places: FloatArray) -> FloatArray:
        """Return how far points (n, 2) are inside a Minkowski difference, grown by what the shapes are rounded by."""
        radius, points = self._radius, shapely.points(places)
        if radius and shapely.convex_hull(part).area > part.area * (1.0 + 1e-12):
            part, radius = shapely.buffer(part, radius, quad_segs=CHORDS), 0.0
        apart = shapely.distance(part, points)
        if part.area == 0.0:
            return np.asarray(np.maximum(0.0, radius - apart))
        within = shapely.contains(part, points)
        return np.asarray(np.maximum(0.0, radius + np.where(within, shapely.distance(part.boundary, points), -apart)))

    def _difference(self, heading: float, places: FloatArray, reach: float) -> tuple[shapely.Geometry, bool]:
        """Return where, seen from the first of some places (n, 2), the reference point must not be, discs being points.

        That is exact to ``reach`` metres from any of the places, and whether it is everywhere.
        """
        turn = np.array([0.0, 0.0, heading])
        if isinstance(self._body, Disc):
            if isinstance(self._shape, Disc):
                return shapely.Point(self._shape.center - places[0]), True
            return shapely.transform(self._shape.polygon().shapely(), lambda rows: rows - places[0]), True
        if isinstance(self._shape, Disc):
            center = np.asarray(self._shape.center) - places[0]
            return shapely.transform(self._outline, lambda rows: center - se2.transform(turn, rows)), True
        pieces, boxes = self._pieces
        room = self._span + self._radius + reach
        near = (boxes[:, :2] <= places.max(axis=0) + room).all(axis=1)
        near &= (boxes[:, 2:] >= places.min(axis=0) - room).all(axis=1)
        body = se2.transform(turn, self._body_pieces.reshape(-1, 2)).reshape(self._body_pieces.shape)
        sums = (pieces[near][:, None, :, None] - places[0]) - body[None, :, None]
        if not len(sums):
            return shapely.Polygon(), bool(near.all())
        hulls = shapely.convex_hull(shapely.linestrings(sums.reshape(-1, sums.shape[2] * sums.shape[3], 2)))
        return hulls[0] if len(hulls) == 1 else shapely.union_all(hulls), bool(near.all())

    @cached_property
    def _outline(self) -> shapely.Polygon:
        return self._body.polygon().shapely()

    @cached_property
    def _span(self) -> float:
        """Largest distance of the body from its reference point, metres, of a disc's centre."""
        return 0.0 if isinstance(self._body, Disc) else float(np.hypot(*self._body.polygon().vertices.T).max())

    @cached_property
    def _body_pieces(self) -> FloatArray:
        return np.array(convex_pieces(self._body.polygon()))

    @cached_property
    def _pieces(self) -> tuple[FloatArray, FloatArray]:
        """The shape's convex pieces, (k, m, 2), and the boxes around them, (k, 4)."""
        pieces = np.array(convex_pieces(self._shape.polygon()))
        return pieces, np.hstack([pieces.min(axis=1), pieces.max(axis=1)])


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
