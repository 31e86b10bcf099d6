"""The least clearance along a path, by branch and bound: nothing is sampled."""

from __future__ import annotations

from math import cos, fabs, hypot, sin

import numpy as np

from trailmark.collision.body import Body
from trailmark.collision.certify import straight_track
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import exact_clearance, field_cap, field_clearance, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.collision.pieces import LONGEST, chord_error, nearby, pose_on, sweep
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = ["least_clearance"]

PART = 0.4
"""Of the tolerance: by how much an interval that is left out may hold less, and how far points may be off their chords,
which counts twice."""

SHARE = 0.5
"""Of half of an interval: where the clearance is less than that above the least one known, all of it is judged."""


@callee
def _clearance(
    grid: ObstacleGrid, field: ClearanceField, robot: Footprint, placed: FloatArray, q: FloatArray, cap: float
) -> float:
    """Return min(clearance, cap) at a configuration, shape (3,)."""
    x, y, c, s = q[0], q[1], cos(q[2]), sin(q[2])
    if field_clearance(field, robot, x, y, c, s, cap) >= cap:
        return cap
    return float(exact_clearance(grid, robot, placed, x, y, c, s, field_cap(field, robot, x, y, c, s, cap)))


@njit(nogil=True)
def least_clearance(
    grid: ObstacleGrid, field: ClearanceField, robot: Footprint, body: Body, states: FloatArray, tolerance: float
) -> tuple[float, int, float]:
    """Return the least clearance along a path of straight motions, and where: motion and share of it.

    It is a configuration's own, and the true one at most the tolerance less.

    An interval cannot hold the least clearance if the clearance in its middle is larger by half of its length. One that
    is short enough for points to go along their chords is judged as a whole (:func:`trailmark.collision.pieces.sweep`).

    Args:
        grid: the obstacles.
        field: their clearance field.
        robot: its footprint.
        body: all of it.
        states: shape (n, 3).
        tolerance: metres, above 0.
    """
    placed, items, times = workspace(robot), np.empty(256, np.int64), np.empty(1)
    stack = np.empty((256, 2))
    best, motion, share, tolerance = np.inf, 0, 0.0, PART * tolerance
    # The states first, at which a path touches obstacles: then most of what lies between them needs no close look.
    for i in range(len(states)):
        d = _clearance(grid, field, robot, placed, states[i], best)
        if d < best:
            best, motion, share = d, max(0, i - 1), 0.0 if i == 0 else 1.0
    for i in range(len(states) - 1):
        track = straight_track(robot, states[i], states[i + 1])
        bound = track.bound
        speed, spin = hypot(track.dx, track.dy), fabs(track.dtheta)
        stack[0, 0], stack[0, 1] = 0.0, bound
        depth = 1 if bound > 0.0 else 0
        while depth > 0 and best > tolerance:
            depth -= 1
            low, high = stack[depth]
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            need = best - tolerance + half
            q = pose_on(track, middle)
            d = _clearance(grid, field, robot, placed, q, max(need, best))
            if d < best:
                best, motion, share = d, i, middle / bound
            if d >= need:
                continue
            if d - best <= SHARE * half and half <= 0.5 * LONGEST * robot.circumradius + best:
                reach = body.reach + half + best
                error = chord_error(high - low, speed, spin, body.turning, reach + half)
                if error <= max(tolerance, d - best):
                    items = nearby(grid, q[0], q[1], reach + error, items)
                    start, end = pose_on(track, low), pose_on(track, high)
                    _, found, at = sweep(grid, body, items[1 : items[0]], start, end, best + error, times)
                    if found >= best - tolerance + error:
                        continue
                    if error <= tolerance:
                        place = low + at * (high - low)
                        d = _clearance(grid, field, robot, placed, pose_on(track, place), best)
                        if d < best:
                            best, motion, share = d, i, place / bound
                        continue
            spare = max(0.0, d - best)
            if half > tolerance + spare:
                stack[depth, 0], stack[depth, 1] = middle + spare, high
                stack[depth + 1, 0], stack[depth + 1, 1] = low, middle - spare
                depth += 2
    return best, motion, share
