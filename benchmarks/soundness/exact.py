"""Does a point lie deep in a polygon? Decided in rational numbers: doubles are taken as exactly what they stand for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["apart_less", "deeper", "inside", "nearer", "overlaps"]

Point = tuple[Fraction, Fraction]


def points_of(rows: NDArray[np.float64]) -> list[Point]:
    """Return rows x, y of doubles as points with rational coordinates."""
    return [(Fraction(float(x)), Fraction(float(y))) for x, y in rows]


def inside(point: Point, rings: Iterable[Sequence[Point]]) -> bool:
    """Return whether a point lies in a region, whose rings are its outline and its holes: by crossings of a ray."""
    px, py = point
    odd = False
    for ring in rings:
        for (ax, ay), (bx, by) in edges_of(ring):
            # The half-open rule counts a vertex at the ray's height once.
            if (ay > py) != (by > py) and px < ax + (py - ay) * (bx - ax) / (by - ay):
                odd = not odd
    return odd


def edges_of(ring: Sequence[Point]) -> Iterable[tuple[Point, Point]]:
    """Return the edges of a ring."""
    return zip(ring, (*ring[1:], ring[0]), strict=True)


def squared_distance(point: Point, a: Point, b: Point) -> Fraction:
    """Return the squared distance of a point to the segment from a to b."""
    ux, uy, vx, vy = b[0] - a[0], b[1] - a[1], point[0] - a[0], point[1] - a[1]
    square = ux * ux + uy * uy
    if square > 0:
        along = min(max((ux * vx + uy * vy) / square, Fraction(0)), Fraction(1))
        vx, vy = vx - along * ux, vy - along * uy
    return vx * vx + vy * vy


def nearer(point: Point, rings: Iterable[Sequence[Point]], distance: Fraction) -> bool:
    """Return whether a point is nearer than ``distance`` to the outline of a region."""
    square = distance * distance
    return any(squared_distance(point, *edge) < square for ring in rings for edge in edges_of(ring))


def deeper(point: Point, rings: Sequence[Sequence[Point]], depth: Fraction) -> bool:
    """Return whether a point lies in a region, at least ``depth`` from its outline."""
    return inside(point, rings) and not nearer(point, rings, depth)


def overlaps(a: Sequence[Sequence[Point]], b: Sequence[Sequence[Point]], depth: Fraction) -> bool:
    """Return whether a corner of one region, or the middle of what an edge of one has in the other, lies so deep in it.

    So deep an overlap is undone by no shorter shift. Not all overlaps are found by these points; those that are, are.
    """
    for one, other in ((a, b), (b, a)):
        for ring in one:
            for p, q in edges_of(ring):
                for low, high in pairs_of(sorted({Fraction(0), Fraction(1), *_crossings(p, q, other)})):
                    for t in (low, (low + high) / 2):
                        if deeper((p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])), other, depth):
                            return True
    return False


def apart_less(a: Sequence[Sequence[Point]], b: Sequence[Sequence[Point]], distance: Fraction) -> bool:
    """Return whether the outlines of two regions are less than ``distance`` apart at a vertex of one of them.

    Outlines that do not cross are nearest there. None are less than 0 apart.
    """
    pairs = ((a, b), (b, a)) if distance > 0 else ()
    return any(nearer(point, other, distance) for one, other in pairs for ring in one for point in ring)


def pairs_of(values: Sequence[Fraction]) -> Iterable[tuple[Fraction, Fraction]]:
    """Return each value with the one after it."""
    return pairwise(values)


def _crossings(p: Point, q: Point, rings: Sequence[Sequence[Point]]) -> Iterable[Fraction]:
    """Yield where, as fractions of the way from p to q, it crosses the rings' edges."""
    ux, uy = q[0] - p[0], q[1] - p[1]
    for ring in rings:
        for a, b in edges_of(ring):
            vx, vy = b[0] - a[0], b[1] - a[1]
            cross = ux * vy - uy * vx
            if cross == 0:
                continue
            wx, wy = a[0] - p[0], a[1] - p[1]
            t, s = (wx * vy - wy * vx) / cross, (wx * uy - wy * ux) / cross
            if 0 <= t <= 1 and 0 <= s <= 1:
                yield t
