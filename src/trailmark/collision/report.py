"""Why a configuration is not valid, in words: which obstacle or bound, and by how much. Uses shapely alone."""

from __future__ import annotations

import numpy as np
import shapely

from trailmark import se2
from trailmark.shapes import Disc, Shape
from trailmark.world import Robot, World

__all__ = ["invalid_reason"]


def invalid_reason(world: World, robot: Robot, q: se2.FloatArray) -> str:
    """Return a clause such as ``overlaps obstacle 3 (disc) by 0.12 m`` for an invalid configuration, shape (3,)."""
    body = _placed(robot, q)
    xmin, ymin, xmax, ymax = world.bounds
    left, low, right, high = body.bounds
    beyond = {"left": xmin - left, "lower": ymin - low, "right": right - xmax, "upper": high - ymax}
    side, most = max(beyond.items(), key=lambda item: item[1])
    if most > 0.0:
        return f"reaches {most:.3g} m over the {side} bound"
    if world.boundary is not None:
        inside = world.boundary.shapely()
        outside = shapely.difference(body, inside)
        if outside.area > 0.0:
            return f"reaches {_farthest(outside, inside):.3g} m over the boundary"
    for i, shape in enumerate(world.obstacles):
        box = shape.bounding_box()
        if box[0] > right or box[2] < left or box[1] > high or box[3] < low:
            continue
        region = _region(shape)
        common = shapely.intersection(body, region)
        if common.area > 0.0:
            depth = _farthest(common, shapely.boundary(region))
            return f"overlaps obstacle {i} ({type(shape).__name__.lower()}) by {depth:.3g} m"
    return "touches an obstacle within rounding"


def _placed(robot: Robot, q: se2.FloatArray) -> shapely.Polygon:
    if isinstance(robot.footprint, Disc):
        return _region(Disc((float(q[0]), float(q[1])), robot.footprint.radius))
    return shapely.Polygon(se2.transform(q, robot.outline.vertices))


def _region(shape: Shape) -> shapely.Polygon:
    return shape.polygon(1e-3 * shape.radius if isinstance(shape, Disc) else 0.0).shapely()


def _farthest(region: shapely.Geometry, line: shapely.Geometry) -> float:
    """Return the largest distance of the region's vertices from ``line`` (metres)."""
    vertices = shapely.points(shapely.get_coordinates(region))
    return float(np.max(shapely.distance(vertices, line)))
