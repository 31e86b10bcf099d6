"""A polygon cut into triangles that know their neighbours."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

__all__ = ["Mesh", "locate", "triangulated"]


class Mesh(NamedTuple):
    """Triangles without gaps or overlaps.

    Attributes:
        points: (v, 2) vertices, metres.
        triangles: (m, 3) indices of the corners, counter-clockwise.
        neighbours: (m, 3) the triangle across the edge from corner i to corner i + 1; -1 where there is none.
        corner: (v,) whether a shortest path may bend there: the region's angle at the vertex is above pi.
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    neighbours: NDArray[np.int64]
    corner: NDArray[np.bool_]


def triangulated(polygon: Any) -> Mesh:
    """Return a polygon with holes cut into triangles, whose corners are all vertices of the polygon."""
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    rings = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    points, index = np.unique(rings.reshape(-1, 2), axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3).astype(np.int64)
    a, b, c = (points[triangles[:, i]] for i in range(3))
    clockwise = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]) < 0.0
    triangles[clockwise] = triangles[clockwise][:, ::-1]
    return Mesh(points, triangles, _neighbours(triangles), _corners(points, triangles))


def locate(mesh: Mesh, point: NDArray[np.float64]) -> int:
    """Return the triangle in which a point, shape (2,), lies, or the nearest by a hair; -1 if it lies outside."""
    a, b, c = (mesh.points[mesh.triangles[:, i]] for i in range(3))
    depth = np.full(len(a), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        edge = q - p
        side = edge[:, 0] * (point[1] - p[:, 1]) - edge[:, 1] * (point[0] - p[:, 0])
        depth = np.minimum(depth, side / np.maximum(np.hypot(edge[:, 0], edge[:, 1]), 1e-300))
    best = int(np.argmax(depth))
    return best if depth[best] >= -1e-9 * max(1.0, float(np.abs(mesh.points).max())) else -1


def _neighbours(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the triangles across each edge, shape (m, 3)."""
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    keys = np.sort(ends, axis=1)
    order = np.lexsort((keys[:, 1], keys[:, 0]))
    same = (keys[order[1:]] == keys[order[:-1]]).all(axis=1)
    first, second = order[:-1][same], order[1:][same]
    neighbours = np.full(len(ends), -1, np.int64)
    neighbours[first], neighbours[second] = second // 3, first // 3
    return neighbours.reshape(-1, 3)


def _corners(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return at which vertices the triangles around add up to an angle above pi."""
    angle = np.zeros(len(points))
    for i in range(3):
        here, ahead, behind = (points[triangles[:, (i + k) % 3]] for k in (0, 1, 2))
        u, v = ahead - here, behind - here
        cross, dot = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], (u * v).sum(axis=1)
        np.add.at(angle, triangles[:, i], np.abs(np.arctan2(cross, dot)))
    return np.asarray(angle > np.pi * (1.0 + 1e-9))
