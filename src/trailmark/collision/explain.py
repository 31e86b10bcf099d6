"""Why a configuration is not valid, in words: which obstacle or bound, and by how much. Computed by shapely alone."""

from __future__ import annotations

import numpy as np
import shapely

from trailmark import se2
from trailmark.collision.footprint import TOUCHING_TOLERANCE
from trailmark.shapes import Disc, Shape
from trailmark.world import Robot, World
from trailmark.zones import KEEP_OUT

__all__ = ["invalid_reason", "overlaps", "worst_overlap"]


def invalid_reason(world: World, robot: Robot, q: se2.FloatArray) -> str:
    """Return a clause such as ``overlaps obstacle 3 (disc) by 0.12 m`` for an invalid configuration, shape (3,).

    Bounds come first, then the boundary, then the obstacle with the largest overlap. The overlap of two polygons is
    how far a corner of their common region lies behind the obstacle's edge, or that region's width if larger.
    """
    return worst_overlap(world, robot, q)[1]


def worst_overlap(world: World, robot: Robot, q: se2.FloatArray) -> tuple[float, str]:
    """Return by how much (metres) an invalid configuration is so, and :func:`invalid_reason`."""
    body, radius = _placed(robot, q)
    (xmin, ymin, xmax, ymax), (left, low, right, high) = world.bounds, body.bounds
    beyond = {"left": xmin - left, "lower": ymin - low, "right": right - xmax, "upper": high - ymax}
    side = max(beyond, key=lambda name: beyond[name])
    if beyond[side] + radius > TOUCHING_TOLERANCE:
        return beyond[side] + radius, f"reaches {beyond[side] + radius:.3g} m over the {side} bound"
    if world.boundary is not None:
        free = world.boundary.shapely()
        edge = shapely.boundary(free)
        depth = _depth_in_complement(body, free, edge, radius)
        if depth > TOUCHING_TOLERANCE:
            return depth, f"reaches {depth:.3g} m over the boundary"
    depths = overlaps(world, robot, q)
    if len(depths) and depths.max() > 0.0:
        worst = int(np.argmax(depths))
        kind = type(world.obstacles[worst]).__name__.lower()
        name = world.ids[worst] if world.ids and world.ids[worst] is not None else worst
        what = name if str(name).startswith(KEEP_OUT) else f"obstacle {name} ({kind})"
        return float(depths[worst]), f"overlaps {what} by {depths[worst]:.3g} m"
    return 0.0, "touches an obstacle within rounding"


def overlaps(world: World, robot: Robot, q: se2.FloatArray) -> se2.FloatArray:
    """Return how far (metres, shape (n,)) the robot reaches into each obstacle; 0 or less where it does not."""
    body, radius = _placed(robot, q)
    return np.array([_overlap(body, radius, shape) for shape in world.obstacles])


def _placed(robot: Robot, q: se2.FloatArray) -> tuple[shapely.Geometry, float]:
    """Return the robot in its place, and a radius (metres) to be added to distances from it.

    A disc is represented by its centre: no polygon approximates it.
    """
    if isinstance(robot.footprint, Disc):
        return shapely.Point(q[:2]), robot.footprint.radius
    return shapely.Polygon(se2.transform(q, robot.outline.vertices)), 0.0


def _overlap(body: shapely.Geometry, radius: float, shape: Shape) -> float:
    """Return how far (metres) the body, grown by ``radius``, reaches into an obstacle; 0 or less if it does not."""
    left, low, right, high = body.bounds
    box = shape.bounding_box()
    apart = float(max(box[0] - right, left - box[2], box[1] - high, low - box[3]))
    if apart > radius:
        return radius - apart
    if isinstance(shape, Disc):
        return radius + shape.radius - float(shapely.distance(body, shapely.Point(shape.center)))
    region = shape.polygon().shapely()
    edge = shapely.boundary(region)
    if radius:
        gap = float(shapely.distance(body, edge))
        return radius + gap if region.contains(body) else radius - gap
    return _depth(shapely.intersection(body, region), edge)


def _depth_in_complement(
    body: shapely.Geometry, free: shapely.Geometry, edge: shapely.Geometry, radius: float
) -> float:
    """Return how far (metres) the body, grown by ``radius``, reaches out of the region ``free``."""
    if radius:
        gap = float(shapely.distance(body, edge))
        return radius - gap if free.contains(body) else radius + gap
    return _depth(shapely.difference(body, free), edge)


def _depth(common: shapely.Geometry, edge: shapely.Geometry) -> float:
    """Return the largest distance (metres) of a region's corners from ``edge``, or the region's width if larger."""
    parts = [part for part in shapely.get_parts(common) if part.area > 0.0]
    if not parts:
        return 0.0
    depth = float(shapely.distance(shapely.points(shapely.get_coordinates(parts)), edge).max())
    for part in parts:
        # The search for the inscribed circle of a region as thin as rounding may not terminate.
        if 2.0 * part.area > TOUCHING_TOLERANCE * part.length:
            depth = max(depth, 2.0 * float(shapely.maximum_inscribed_circle(part).length))
    return depth
