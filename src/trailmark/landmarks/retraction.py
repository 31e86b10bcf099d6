"""Retraction: configurations that collide by little, pushed off the obstacles into the free space around them.

In a passage hardly wider than the robot almost no random configuration and no node of a lattice is valid, but many are
nearly so. The covering discs that lie too near to an obstacle push along the clearance field's slope, all at once:
least squares, so that between two walls the robot comes to rest in the middle and along them. Configurations retracted
from obstacles into narrow passages: Wilmarth, Amato & Stiller, "MAPRM", ICRA 1999; the steps: Levenberg, "A method for
the solution of certain non-linear problems in least squares", Quarterly of Applied Mathematics 1944.
"""

from __future__ import annotations

from math import cos, inf, sin, sqrt

import numpy as np

from trailmark.collision import StateChecker
from trailmark.collision.field import ClearanceField, interpolated
from trailmark.collision.footprint import Footprint
from trailmark.heading import wrapped
from trailmark.jit import njit
from trailmark.se2 import FloatArray

__all__ = ["retract", "retract_all"]

SHARE_OF_REACH = 0.1
"""Clearance that many configurations are pushed to, in units of how far they may move: in a passage hardly wider
than the robot there is no more, and walls that both push for more push it askew."""

STEPS = 4
"""At most."""

AT_REST = 0.2
"""Share of the margin by which discs may still lie too near."""

DAMPING = 0.05
"""Of the squared slopes: where they tell no direction, inside an obstacle or midway between two, nothing moves far."""


@njit(numbers=True)
def retract(field: ClearanceField, robot: Footprint, q: FloatArray, reach: float, turn: float, margin: float) -> None:
    """Push the configuration q, shape (3,), off the obstacles, in place; it may be invalid still.

    Args:
        field: clearance.
        robot: its covering discs are pushed.
        q: configuration.
        reach: metres, by how much x and y may change.
        turn: radians, by how much the heading may change.
        margin: metres, the clearance sought.
    """
    x, y, theta = q[0], q[1], q[2]
    # Turning counts as moving a point this far from the reference point.
    lever = sqrt(0.5) * robot.circumradius
    for _ in range(STEPS):
        c, s = cos(theta), sin(theta)
        xx = yy = tt = DAMPING
        xy = xt = yt = px = py = pt = most = 0.0
        for k in range(len(robot.cover)):
            ax, ay = c * robot.cover[k, 0] - s * robot.cover[k, 1], s * robot.cover[k, 0] + c * robot.cover[k, 1]
            distance, gx, gy = interpolated(field, x + ax, y + ay)
            short = robot.cover[k, 2] + margin - distance
            if short <= 0.0 or not short < inf:
                continue
            gt = (gy * ax - gx * ay) / lever
            xx, yy, tt = xx + gx * gx, yy + gy * gy, tt + gt * gt
            xy, xt, yt = xy + gx * gy, xt + gx * gt, yt + gy * gt
            px, py, pt = px + short * gx, py + short * gy, pt + short * gt
            most = max(most, short)
        if most < AT_REST * margin:
            break
        # Cramer's rule.
        a, b, d = yy * tt - yt * yt, xt * yt - xy * tt, xy * yt - xt * yy
        whole = xx * a + xy * b + xt * d
        dx = (px * a + py * b + pt * d) / whole
        dy = (px * b + py * (xx * tt - xt * xt) + pt * (xy * xt - xx * yt)) / whole
        dt = (px * d + py * (xy * xt - xx * yt) + pt * (xx * yy - xy * xy)) / whole
        x = min(max(x + dx, q[0] - reach), q[0] + reach)
        y = min(max(y + dy, q[1] - reach), q[1] + reach)
        theta = min(max(theta + dt / lever, q[2] - turn), q[2] + turn)
    q[0], q[1], q[2] = x, y, wrapped(theta)


def retract_all(checker: StateChecker, q: FloatArray, reach: float) -> FloatArray:
    """Return the configurations, valid or not, pushed off the obstacles near them; shape (n, 3).

    Args:
        checker: its field and footprint.
        q: shape (n, 3).
        reach: metres, how far each may move along either axis, and the farthest point of the robot by turning.
    """
    radius = checker.footprint.sweep_radius
    turn = reach / radius if radius > 0.0 else 0.0
    return np.asarray(_retract_all(checker.field, checker.footprint, np.array(q), reach, turn))


@njit(nogil=True)
def _retract_all(field: ClearanceField, robot: Footprint, q: FloatArray, reach: float, turn: float) -> FloatArray:
    for i in range(len(q)):
        retract(field, robot, q[i], reach, turn, SHARE_OF_REACH * reach)
    return q
