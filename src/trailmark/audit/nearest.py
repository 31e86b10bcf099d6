"""The least clearance along a path, by branch and bound: nothing is sampled."""

# Tested by tests/audit/test_auditor.py.
from __future__ import annotations

from math import cos, fabs, hypot, sin

import numpy as np

from trailmark.audit.body import Body
from trailmark.audit.pieces import chord_error, nearby, sweep
from trailmark.audit.verdict import LONGEST, pose_on, track_of
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import exact_clearance, field_cap, field_clearance, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.compiled import njit
from trailmark.se2 import FloatArray

__all__ = ["least_clearance"]

OFF_CHORD = 2e-7
"""Metres that a point may be off its chord where the least clearance is sought."""

TOLERANCE = 2e-7
"""Metres by which the clearance found may be above the least one, besides."""

SHARE = 0.5
"""Of half of an interval: where the clearance is less than that above the least one known, all of it is judged."""


@njit(cache=True)
def _clearance(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    x: float,
    y: float,
    theta: float,
    cap: float,
) -> float:
    """Return min(clearance, cap) at a configuration."""
    c, s = cos(theta), sin(theta)
    return float(exact_clearance(grid, robot, placed, x, y, c, s, field_cap(field, robot, x, y, c, s, cap)))


@njit(cache=True, nogil=True)
def least_clearance(
    grid: ObstacleGrid, field: ClearanceField, robot: Footprint, body: Body, states: FloatArray
) -> tuple[float, int, float]:
    """Return the least clearance along a free path, at most 5e-7 m too large, and where: motion and share of it.

    An interval cannot hold the least clearance if the clearance in its middle is larger by half of its length. One that
    is short enough for points to go along their chords is judged as a whole (:func:`trailmark.audit.pieces.sweep`).

    Args:
        grid: the obstacles.
        field: their clearance field.
        robot: its footprint.
        body: all of it.
        states: shape (n, 3).
    """
    placed, items, times = workspace(robot), np.empty(256, np.int64), np.empty(1)
    stack = np.empty((256, 2))
    best, motion, share = np.inf, 0, 0.0
    for i in range(len(states)):
        d = _clearance(grid, field, robot, placed, states[i, 0], states[i, 1], states[i, 2], best)
        if d < best:
            best, motion, share = d, max(0, i - 1), 0.0 if i == 0 else 1.0
    for i in range(len(states) - 1):
        track = track_of(robot, states[i], states[i + 1])
        bound = track.bound
        if bound == 0.0:
            continue
        speed, spin = hypot(track.dx, track.dy), fabs(track.dtheta)
        stack[0, 0], stack[0, 1] = 0.0, bound
        depth = 1
        while depth > 0:
            depth -= 1
            low, high = stack[depth]
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            need = best - TOLERANCE + half
            x, y, theta = track.x + middle * track.dx, track.y + middle * track.dy, track.theta + middle * track.dtheta
            if field_clearance(field, robot, x, y, cos(theta), sin(theta), need) >= need:
                continue
            d = _clearance(grid, field, robot, placed, x, y, theta, max(need, best))
            if d < best:
                best, motion, share = d, i, middle / bound
            if d >= need:
                continue
            if d - best <= SHARE * half and high - low <= LONGEST * robot.circumradius:
                reach = body.reach + half + best
                error = chord_error(high - low, speed, spin, body.turning, reach + half)
                if error <= max(OFF_CHORD, d - best):
                    items = nearby(grid, x, y, reach + error, items)
                    start, end = pose_on(track, low), pose_on(track, high)
                    _, found, at = sweep(grid, body, items[1 : items[0]], start, end, best + error, times)
                    if found >= best - TOLERANCE + error:
                        continue
                    if error <= OFF_CHORD:
                        best, motion, share = found, i, (low + at * (high - low)) / bound
                        continue
            spare = max(0.0, d - best)
            if half > TOLERANCE + spare:
                stack[depth, 0], stack[depth, 1] = middle + spare, high
                stack[depth + 1, 0], stack[depth + 1, 1] = low, middle - spare
                depth += 2
    return best, motion, share
