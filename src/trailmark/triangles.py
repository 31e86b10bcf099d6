"""Polygons cut into convex pieces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.shapes import Polygon

__all__ = ["convex_pieces", "triangulate"]

FloatArray = NDArray[np.float64]


def triangulate(polygon: Polygon) -> FloatArray:
    """Return triangles that fill the polygon exactly and lie in it, shape (m, 3, 2), counter-clockwise.

    The triangulation is constrained Delaunay (GEOS), so it uses the polygon's own vertices only.
    """
    import shapely

    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon.shapely()))
    corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    clockwise = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < 0.0
    corners[clockwise] = corners[clockwise][:, ::-1]
    return np.ascontiguousarray(corners)


def convex_pieces(polygon: Polygon) -> list[FloatArray]:
    """Return convex polygons that make up a polygon, each of shape (n, 2): itself, or triangles."""
    import shapely

    region = polygon.shapely()
    if not polygon.holes and shapely.convex_hull(region).area <= region.area * (1.0 + 1e-12):
        return [polygon.vertices]
    return list(triangulate(polygon))
