"""Repair: the parts of a path that are free stay as they are, those that collide are planned anew."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trailmark.curves import CurvePath
from trailmark.path import Path
from trailmark.se2 import FloatArray
from trailmark.verify.auditor import PathAuditor
from trailmark.verify.motions import Motions, merged
from trailmark.verify.result import PathAudit

__all__ = ["repaired"]

SAGITTA = 5e-8
"""Metres that a car's arc may be off the straight motions that stand for it: near its ends it may touch."""

MARGINS = (0.1, 0.5, 2.0, 8.0, np.inf)
"""Circumradii along the path, from what collides to where the plan begins and ends: the next one if there is no way."""

ROOM = 0.05
"""Inscribed radii of clearance at a plan's ends, where the path has as much: from contact there may be no way out."""

Plan = Callable[[FloatArray, FloatArray], Path | None]
"""Returns a certified path from a start to a goal, or None if it found none."""


def repaired(auditor: PathAuditor, audit: PathAudit, plan: Plan) -> Path | None:
    """Return the path with its colliding parts planned anew, certified as a whole; None if no way past was found.

    A plan leads from the last place before a colliding part where the robot stands free to the first one after it.

    Args:
        auditor: that the audit is by.
        audit: of the path.
        plan: makes the new parts.

    Raises:
        ConfigurationError: the path's start or goal collides, or is out of bounds.
    """
    if audit.free:
        return audit.path
    states, checker = np.array(audit.path.states), auditor.checker
    checker.require_valid(states[0], "start")
    checker.require_valid(states[-1], "goal")
    scale = Motions.of(audit.path, checker.robot.sweep_radius)
    broken = merged([scale.interval(collision.motions) for collision in audit.collisions])
    room = ROOM * checker.robot.inscribed_disc.radius

    def end_near(place: float, direction: float, margin: int, limit: float) -> float:
        """Return a place that far away from what collides, or farther, with room around the robot; else the limit."""
        for share in MARGINS[margin:]:
            found = place + direction * share * checker.robot.circumradius
            if direction * (limit - found) <= 0.0:
                break
            if checker.clearance(scale.poses(found)[0]) >= room:
                return found
        return limit

    pieces: list[FloatArray] = []
    resumed = 0.0
    while broken:
        for margin in range(len(MARGINS)):
            begin = end_near(broken[0][0], -1.0, margin, resumed)
            end = end_near(broken[0][1], 1.0, margin, scale.total)
            met = 1
            while met < len(broken) and broken[met][0] <= end:
                end = end_near(broken[met][1], 1.0, margin, scale.total)
                met += 1
            a, b = scale.poses([begin, end])
            detour = plan(a, b)
            if detour is not None:
                break
        else:
            return None
        if begin > resumed:
            pieces.append(scale.states(resumed, begin)[:-1])
        pieces.append((detour.polyline(SAGITTA) if isinstance(detour, CurvePath) else detour).states)
        resumed, broken = end, broken[met:]
    if resumed < scale.total:
        pieces.append(scale.states(resumed, scale.total)[1:])
    found = Path(np.concatenate(pieces))
    return found if auditor.audit(found).free else None
