"""Problems as the native program (``benchmarks/native``) reads them: JSON of flat triangles, discs and numbers.

The obstacles are what :mod:`trailmark.collision.fcl_scene` gives to FCL, for the same reasons: polygons are filled with
their triangles, so that containment counts as overlap; discs stay discs, which FCL holds exactly as spheres; what
lies outside the boundary is an obstacle; the robot is eroded by what counts as touching.
"""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

import numpy as np
import shapely

from trailmark import se2
from trailmark.shapes import Disc, Polygon, triangulate
from trailmark.touching import TOUCHING_TOLERANCE, overlap_core
from trailmark.world import Query, Robot, World, with_keep_outs

__all__ = ["VERSION", "problem_text"]

VERSION = 2
"""Of the format: the native program refuses others."""

MARGIN = 1.0
"""Metres that the obstacle around a boundary reaches beyond the bounds, which no robot leaves by more than 1e-7 m."""

Json = dict[str, Any]


def problem_text(world: World, robot: Robot, query: Query) -> str:
    """Return a problem as one JSON object.

    Fields: ``trailmark_native`` (the format's version); ``bounds`` (xmin, ymin, xmax, ymax, metres) and
    ``tolerance`` (metres that the robot may reach beyond them); ``triangles`` (rows x1, y1, x2, y2, x3, y3,
    counter-clockwise) and ``discs`` (rows x, y, radius); ``robot`` in its own frame: ``shape`` (disc or polygon),
    ``radius`` or ``triangles`` and ``hull`` (the corners of its convex hull), ``circumradius``, ``inscribed`` (x, y,
    radius), ``turning_radius`` (metres; 0 if it is no car) and ``reverse``; ``start`` and ``goal`` (x, y, theta).
    """
    ends = {"start": list(query.start), "goal": list(query.pose())}
    # The obstacles' part is cached as text: queries of one world differ in their last two fields only.
    return (
        _scene(world.bounds, world.boundary, with_keep_outs(world).obstacles, robot)[:-1] + ", " + json.dumps(ends)[1:]
    )


@lru_cache(maxsize=4)
def _scene(
    bounds: tuple[float, float, float, float],
    boundary: Polygon | None,
    obstacles: tuple[Any, ...],
    robot: Robot,
) -> str:
    polygons = [shape.polygon() for shape in obstacles if not isinstance(shape, Disc)]
    scene = {
        "trailmark_native": VERSION,
        "bounds": list(bounds),
        "tolerance": TOUCHING_TOLERANCE,
        "triangles": _triangles(polygons + _outside(bounds, boundary)),
        "discs": [[*shape.center, shape.radius] for shape in obstacles if isinstance(shape, Disc)],
        "robot": _robot(robot),
    }
    return json.dumps(scene)


def _robot(robot: Robot) -> Json:
    inscribed = robot.inscribed_disc
    common = {
        "circumradius": robot.circumradius,
        "inscribed": [*inscribed.center, _less_touching(inscribed.radius)],
        "turning_radius": robot.turning_radius or 0.0,
        "reverse": robot.reverse,
    }
    if isinstance(robot.footprint, Disc):
        return {"shape": "disc", "radius": _less_touching(robot.footprint.radius), **common}
    region = robot.outline.shapely()
    parts = [_polygon(part) for part in overlap_core(robot.outline.rings()[0])]
    hull = shapely.get_coordinates(shapely.convex_hull(region))[:-1]
    return {"shape": "polygon", "triangles": _triangles(parts or [robot.outline]), "hull": hull.tolist(), **common}


def _less_touching(radius: float) -> float:
    """Return a disc's radius (metres) less what counts as touching; something is left of any disc."""
    return max(radius - TOUCHING_TOLERANCE, 0.5 * radius)


def _outside(bounds: tuple[float, float, float, float], boundary: Polygon | None) -> list[Polygon]:
    """Return the part of a frame around the bounds that lies outside the boundary."""
    if boundary is None:
        return []
    xmin, ymin, xmax, ymax = bounds
    frame = shapely.box(xmin - MARGIN, ymin - MARGIN, xmax + MARGIN, ymax + MARGIN)
    outside = shapely.difference(frame, boundary.shapely())
    return [_polygon(part) for part in shapely.get_parts(outside) if part.area > 0.0]


def _polygon(region: shapely.Polygon) -> Polygon:
    return Polygon(
        shapely.get_coordinates(region.exterior), tuple(shapely.get_coordinates(ring) for ring in region.interiors)
    )


def _triangles(polygons: list[Polygon]) -> list[list[float]]:
    """Return rows x1, y1, x2, y2, x3, y3 of triangles that fill the polygons; none without area."""
    if not polygons:
        return []
    corners: se2.FloatArray = np.concatenate([triangulate(polygon) for polygon in polygons])
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    rows: list[list[float]] = corners[u[:, 0] * v[:, 1] > u[:, 1] * v[:, 0]].reshape(-1, 6).tolist()
    return rows
