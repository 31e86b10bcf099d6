"""Why a configuration is not valid, in words: which obstacle or bound, and by how much. Computed by shapely alone."""

from __future__ import annotations

from trailmark import se2
from trailmark.penetration import Penetration, outside_of
from trailmark.shapes import Disc
from trailmark.touching import TOUCHING_TOLERANCE
from trailmark.world import KEEP_OUT, Robot, World

__all__ = ["invalid_reason", "worst_overlap"]


def invalid_reason(world: World, robot: Robot, q: se2.FloatArray) -> str:
    """Return a clause such as ``overlaps obstacle 3 (disc) by 0.12 m`` for an invalid configuration, shape (3,).

    Bounds come first, then the boundary, then the obstacle with the largest overlap: the shortest translation out of
    it (:mod:`trailmark.penetration`).
    """
    return worst_overlap(world, robot, q)[1]


def worst_overlap(world: World, robot: Robot, q: se2.FloatArray) -> tuple[float, str]:
    """Return by how much (metres) an invalid configuration is so, and :func:`invalid_reason`."""
    shape = robot.footprint
    if isinstance(shape, Disc):
        low, high = q[:2] - shape.radius, q[:2] + shape.radius
    else:
        placed = se2.transform(q, robot.outline.vertices)
        low, high = placed.min(axis=0), placed.max(axis=0)
    (xmin, ymin, xmax, ymax), (left, lower, right, upper) = world.bounds, (*low, *high)
    beyond = {"left": xmin - left, "lower": ymin - lower, "right": right - xmax, "upper": upper - ymax}
    side = max(beyond, key=lambda name: beyond[name])
    if beyond[side] > TOUCHING_TOLERANCE:
        return float(beyond[side]), f"reaches {beyond[side]:.3g} m over the {side} bound"
    if world.boundary is not None:
        outside = outside_of(world.boundary, 2.0 * world.extent + 8.0 * robot.circumradius)
        depth = float(Penetration(shape, outside).at(q[None])[0])
        if depth > TOUCHING_TOLERANCE:
            return depth, f"reaches {depth:.3g} m over the boundary"
    worst, deepest = 0, 0.0
    for i, obstacle in enumerate(world.obstacles):
        box = obstacle.bounding_box()
        if (low < box[2:]).all() and (high > box[:2]).all():
            depth = float(Penetration(shape, obstacle).at(q[None])[0])
            if depth > deepest:
                worst, deepest = i, depth
    if deepest == 0.0:
        return 0.0, "touches an obstacle within rounding"
    kind = type(world.obstacles[worst]).__name__.lower()
    name = world.ids[worst] if world.ids and world.ids[worst] is not None else worst
    what = name if str(name).startswith(KEEP_OUT) else f"obstacle {name} ({kind})"
    return deepest, f"overlaps {what} by {deepest:.3g} m"
