"""Retraction: configurations moved away from the obstacles, towards the middle of the free space around them.

In a passage hardly wider than the robot almost no random configuration is valid, but many are nearly valid. Moves
towards more clearance align them with the passage. After MAPRM (Wilmarth, Amato & Stiller, ICRA 1999), with the
clearance field and the footprint's covering discs instead of exact penetration depths.
"""

# Tested by tests/landmarks/test_retraction.py.

from __future__ import annotations

from math import cos, sin

import numpy as np

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.field import ClearanceField, interpolated
from trailmark.collision.footprint import Footprint
from trailmark.compiled import njit
from trailmark.heading import wrapped

__all__ = ["retract_all"]

MAX_DISPLACEMENT = 1.5
"""How far a configuration may be moved along either axis, in units of ``reach``."""


def retract_all(
    checker: StateChecker, q: se2.FloatArray, reach: float, rng: np.random.Generator, *, steps: int = 40
) -> se2.FloatArray:
    """Return the configurations, valid or not, moved to places with more clearance; shape (n, 3).

    Args:
        checker: its field and footprint.
        q: shape (n, 3).
        reach: metres, size of the first moves; the sum of all moves is at most MAX_DISPLACEMENT times as large.
        rng: source of randomness.
        steps: number of moves tried for each.
    """
    moves = rng.standard_normal((max(1, len(q)), steps, 3))
    turning = checker.footprint.sweep_radius
    return np.asarray(_climb(checker.field, checker.footprint, np.array(q), moves, reach, turning))


@njit(cache=True, nogil=True)
def _climb(
    field: ClearanceField, robot: Footprint, q: se2.FloatArray, moves: se2.FloatArray, reach: float, turning: float
) -> se2.FloatArray:
    """Try random moves and make those that increase the clearance; moves grow with success and shrink without."""
    for i in range(len(q)):
        best = _field_clearance(field, robot, q[i, 0], q[i, 1], q[i, 2])
        scale = reach
        x0, y0 = q[i, 0], q[i, 1]
        for k in range(moves.shape[1]):
            # A robot that can turn freely is in no passage.
            if best > robot.circumradius:
                break
            x, y = q[i, 0] + scale * moves[i, k, 0], q[i, 1] + scale * moves[i, k, 1]
            # A larger displacement could leave the passage.
            if abs(x - x0) > MAX_DISPLACEMENT * reach or abs(y - y0) > MAX_DISPLACEMENT * reach:
                scale *= 0.85
                continue
            theta = q[i, 2]
            if turning > 0.0:
                theta += scale / turning * moves[i, k, 2]
            value = _field_clearance(field, robot, x, y, theta)
            if value > best:
                best = value
                q[i, 0], q[i, 1] = x, y
                q[i, 2] = wrapped(theta)
                scale *= 1.3
            else:
                scale *= 0.85
    return q


@njit(cache=True)
def _field_clearance(field: ClearanceField, robot: Footprint, x: float, y: float, theta: float) -> float:
    """Return the least of the covering discs' clearances by the field, interpolated; negative in an obstacle."""
    c, s = cos(theta), sin(theta)
    least = np.inf
    for k in range(len(robot.cover)):
        bx, by = robot.cover[k, 0], robot.cover[k, 1]
        distance, _, _ = interpolated(field, x + c * bx - s * by, y + s * bx + c * by)
        least = min(least, distance - robot.cover[k, 2])
    return least
