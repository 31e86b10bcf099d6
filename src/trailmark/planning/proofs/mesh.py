"""A polygon cut into triangles that know their neighbours, proven to fill it.

Source: Shewchuk, "Adaptive precision floating-point arithmetic and fast robust geometric predicates", Discrete &
Computational Geometry 18, 1997.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.jit import array_callee, njit

__all__ = ["ROUNDED", "Mesh", "locate", "orientation", "orientations", "triangulated"]


class Mesh(NamedTuple):
    """Triangles without gaps or overlaps; some may be flat.

    Attributes:
        points: (v, 2) vertices, metres.
        triangles: (m, 3) indices of the corners, counter-clockwise.
        neighbours: (m, 3) the triangle across the edge from corner i to corner i + 1; -1 where there is none.
        corner: (v,) whether a shortest path may bend there: the region's angle at the vertex is pi or more.
        edges: (e, 2) indices of the ends of the region's edges, which have it on their left.
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    neighbours: NDArray[np.int64]
    corner: NDArray[np.bool_]
    edges: NDArray[np.int64]


def triangulated(polygon: Any) -> Mesh | None:
    """Return a polygon with holes cut into triangles, whose corners are all vertices of the polygon.

    No triangle is turned over, each edge of one is an edge of at most one other, and those of none are the edges of the
    polygon's rings: so the triangles cover each point of the polygon once, and no other. All this is looked at without
    rounding; what does not pass, is no mesh.

    Args:
        polygon: a valid one (shapely), with area.

    Returns:
        None if there is no such mesh, by rounding.
    """
    try:
        parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    except shapely.errors.GEOSException:
        return None
    if len(parts) == 0:
        return None
    # All come clockwise, flat ones too, which could not be turned by their area.
    rings = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, 2::-1]
    points, index = np.unique(rings.reshape(-1, 2), axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3).astype(np.int64)
    if (orientations(points, triangles) < 0.0).any():
        return None
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    keys = ends[:, 0] * len(points) + ends[:, 1]
    order = np.argsort(keys)
    if (keys[order[1:]] == keys[order[:-1]]).any():
        return None
    place = np.minimum(np.searchsorted(keys, ends[:, 1] * len(points) + ends[:, 0], sorter=order), len(keys) - 1)
    twin = order[place]
    across = (ends[twin] == ends[:, ::-1]).all(axis=1)
    edges = ends[~across]
    if not _same(points[edges], _ring_edges(polygon)):
        return None
    neighbours = np.where(across, twin // 3, -1).reshape(-1, 3)
    return Mesh(points, triangles, neighbours, _corners(points, edges), edges)


def locate(mesh: Mesh, point: NDArray[np.float64]) -> int:
    """Return a triangle that holds a point, shape (2,), without rounding; -1 if it lies outside."""
    a, b, c = (mesh.points[mesh.triangles[:, i]] for i in range(3))
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    near = np.flatnonzero(((low <= point) & (point <= high)).all(axis=1))
    points = np.vstack([mesh.points, point])
    inside = np.ones(len(near), np.bool_)
    for i in range(3):
        edge = mesh.triangles[near][:, [i, (i + 1) % 3]]
        triples = np.column_stack([edge, np.full(len(near), len(mesh.points))])
        inside &= orientations(points, triples) >= 0.0
    return int(near[np.argmax(inside)]) if inside.any() else -1


def _ring_edges(polygon: Any) -> NDArray[np.float64]:
    """Return the edges of a polygon's rings, the polygon on their left, shape (e, 2, 2)."""
    rings = [shapely.get_coordinates(ring) for ring in shapely.get_rings(shapely.orient_polygons(polygon))]
    return np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings])


def _same(first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    """Return whether two sets of edges, shape (e, 2, 2), are the same."""
    if first.shape != second.shape:
        return False
    a, b = (rows.reshape(-1, 4) for rows in (first, second))
    return np.array_equal(a[np.lexsort(a.T)], b[np.lexsort(b.T)])


def _corners(points: NDArray[np.float64], edges: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which vertices a path may bend round: all but those where the region is convex, and nothing else meets."""
    corner = np.ones(len(points), np.bool_)
    before, after = np.full(len(points), -1), np.full(len(points), -1)
    before[edges[:, 1]], after[edges[:, 0]] = edges[:, 0], edges[:, 1]
    once = np.flatnonzero(np.bincount(edges[:, 0], minlength=len(points)) == 1)
    convex = orientations(points, np.column_stack([before[once], once, after[once]])) > 0.0
    corner[once[convex]] = False
    return corner


# --- On which side of a line a point lies, without rounding.

ROUNDED = 3.3306690738754716e-16
"""Share of its two products' sizes that a determinant may be wrong by: Shewchuk's bound A, (3 + 16 eps) eps."""

SPLITTER = 134217729.0
"""2^27 + 1: cuts a double into two halves whose products are exact."""


@njit(numbers=True)
def orientation(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return a value above 0 if c lies left of the line from a to b, below 0 if right, 0 if it lies on it: exactly."""
    left, right = (ax - cx) * (by - cy), (ay - cy) * (bx - cx)
    det = left - right
    # Products of different signs, or with a factor of 0, have a sum of the right sign.
    if (left >= 0.0) != (right > 0.0) or left == 0.0 or right == 0.0:
        return det
    if abs(det) > ROUNDED * (abs(left) + abs(right)):
        return det
    return _exactly(ax, ay, bx, by, cx, cy)


@njit
def orientations(points: NDArray[np.float64], triples: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the orientation of each triple (m, 3) of points (v, 2), shape (m,); only its sign means something."""
    found = np.empty(len(triples))
    for k in range(len(triples)):
        a, b, c = points[triples[k, 0]], points[triples[k, 1]], points[triples[k, 2]]
        found[k] = orientation(a[0], a[1], b[0], b[1], c[0], c[1])
    return found


@array_callee
def _exactly(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the determinant's largest part: six products, each as a sum of two doubles, added up exactly."""
    # The parts, from the smallest to the largest; they do not overlap.
    parts, n = np.zeros(12), 0
    factors = ((ax, by), (-ax, cy), (-cx, by), (-ay, bx), (ay, cx), (cy, bx))
    for u, v in factors:
        product = u * v
        big = SPLITTER * u
        u1 = big - (big - u)
        u2 = u - u1
        big = SPLITTER * v
        v1 = big - (big - v)
        v2 = v - v1
        rest = u2 * v2 - (((product - u1 * v1) - u2 * v1) - u1 * v2)
        for term in (rest, product):
            total = term
            for i in range(n):
                part = parts[i]
                added = total + part
                virtual = added - total
                parts[i] = (total - (added - virtual)) + (part - virtual)
                total = added
            parts[n] = total
            n += 1
    for i in range(n - 1, -1, -1):
        if parts[i] != 0.0:
            return float(parts[i])
    return 0.0
