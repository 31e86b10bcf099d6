"""Where along a path the robot collides: nothing is sampled, no collision is missed and touching is none."""

from __future__ import annotations

from math import cos, fabs, hypot, sin

import numpy as np

from trailmark.collision.body import Body
from trailmark.collision.certify import straight_track
from trailmark.collision.distances import point_clearance, point_depth
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import ROUNDING, exact_clearance, field_clearance, field_value, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.collision.pieces import LONGEST, chord_error, nearby, overlapping, pose_on, sweep
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray
from trailmark.sorting import sort_in_place

__all__ = ["colliding_parts"]

OFF_CHORD = 2e-8
"""Metres that a point may be off its chord where a collision is decided: a fifth of what counts as touching."""

SHARE = 0.5
"""Of half of an interval: where the clearance is less, bisection takes many steps, and the events of the piece few."""

CERTAIN = 0.1
"""Share of an interval on which a collision has to be certain for it to be noted, and the rest be looked at."""

INSIDE = 1e-6
"""Metres by which what is counted as certain is deeper than what counts as touching."""

SHORTEST = 1e-9
"""Metres: what happens between two events that are nearer to one another is not looked at."""


@callee
def _depth(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    core: Body,
    x: float,
    y: float,
    c: float,
    s: float,
    enough: float,
) -> float:
    """Return how far (metres) the robot can be moved anywhere and surely still collides; 0 if that is not known.

    The first value found that is ``enough`` will do.
    """
    best = 0.0
    for k in range(len(robot.inner)):
        bx, by, r = robot.inner[k, 0], robot.inner[k, 1], robot.inner[k, 2] - INSIDE
        if r - field.slack <= best:
            break  # they become smaller
        best = max(best, r - field.slack - field_value(field, x + c * bx - s * by, y + s * bx + c * by))
    if best >= enough:
        return float(best)
    # Exactly: how deep points of the robot are in an obstacle, and how deep obstacles are in discs inside the robot.
    for k in range(len(core.vertices)):
        vx, vy = core.vertices[k]
        best = max(best, point_depth(grid, x + c * vx - s * vy, y + s * vx + c * vy, enough))
        if best >= enough:
            return float(best)
    for k in range(len(robot.inner)):
        bx, by, r = robot.inner[k, 0], robot.inner[k, 1], robot.inner[k, 2] - INSIDE
        if r <= best:
            break
        best = max(best, r - point_clearance(grid, x + c * bx - s * by, y + s * bx + c * by, r))
        if best >= enough:
            return float(best)
    return float(best)


@callee
def _add(parts: FloatArray, count: int, motion: int, low: float, high: float) -> FloatArray:
    """Return the rows with one more, in twice the memory where there is none left."""
    if count == len(parts):
        more = np.empty((2 * count, 3))
        more[:count] = parts
        parts = more
    parts[count, 0], parts[count, 1], parts[count, 2] = motion, low, high
    return parts


@njit(nogil=True)
def colliding_parts(
    grid: ObstacleGrid, field: ClearanceField, robot: Footprint, core: Body, states: FloatArray
) -> FloatArray:
    """Return the parts of a path on which the robot collides, in no order; they may abut.

    An interval of a motion is free if the clearance in its middle is at least half of its length, and if chords stay
    farther from all obstacles than points are off their chords. One so short that points go along their chords is
    divided at all events (:func:`trailmark.collision.pieces.sweep`): between two of them the robot collides all along,
    or not at all. Others are halved.

    Args:
        grid: the obstacles.
        field: their clearance field.
        robot: its footprint.
        core: what of it may meet no obstacle.
        states: shape (n, 3).

    Returns:
        Rows (motion, from, to), the latter two as shares of the motion.
    """
    parts, count = np.empty((16, 3)), 0
    placed, core_placed = workspace(robot), np.empty((len(core.vertices), 2))
    items, times = np.empty(256, np.int64), np.empty(128)
    stack = np.empty((256, 2))
    for i in range(max(1, len(states) - 1)):
        track = straight_track(robot, states[i], states[min(i + 1, len(states) - 1)])
        bound = track.bound
        if bound == 0.0:
            if overlapping(grid, core, core_placed, track.x, track.y, track.theta):
                parts = _add(parts, count, i, 0.0, 1.0)
                count += 1
            continue
        speed, spin = hypot(track.dx, track.dy), fabs(track.dtheta)
        # Rounding leaves no place between two that are nearer to one another.
        shortest = max(SHORTEST, 1e-15 * bound)
        stack[0, 0], stack[0, 1] = 0.0, bound
        depth = 1
        while depth > 0:
            depth -= 1
            low, high = stack[depth]
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            need = half + ROUNDING
            x, y, theta = track.x + middle * track.dx, track.y + middle * track.dy, track.theta + middle * track.dtheta
            c, s = cos(theta), sin(theta)
            d = field_clearance(field, robot, x, y, c, s, need)
            if d >= need:
                continue
            if d < 2.0 * field.slack:
                cap = min(need + ROUNDING, max(d, 0.0) + 4.0 * field.slack)
                d = exact_clearance(grid, robot, placed, x, y, c, s, cap)
                if d >= need:
                    continue
            hit = _depth(grid, field, robot, core, x, y, c, s, half) if d == 0.0 else 0.0
            if half < shortest:
                if overlapping(grid, core, core_placed, x, y, theta):
                    parts = _add(parts, count, i, low / bound, high / bound)
                    count += 1
                continue
            if d <= SHARE * half and hit <= CERTAIN * half and high - low <= LONGEST * robot.circumradius:
                reach = core.reach + half
                error = chord_error(high - low, speed, spin, core.turning, reach + half)
                if error <= max(OFF_CHORD, d):
                    items = nearby(grid, x, y, reach + error, items)
                    start, end = pose_on(track, low), pose_on(track, high)
                    found, least, _ = sweep(grid, core, items[1 : items[0]], start, end, 2.0 * error, times)
                    while found == len(times):
                        times = np.empty(2 * len(times))
                        found, least, _ = sweep(grid, core, items[1 : items[0]], start, end, 2.0 * error, times)
                    if d > 0.0 and least > error + ROUNDING:
                        continue
                    if error <= OFF_CHORD:
                        sort_in_place(times, found)
                        before = 0.0
                        for k in range(found + 1):
                            after = times[k] if k < found else 1.0
                            if (high - low) * (after - before) <= SHORTEST:
                                continue
                            q = pose_on(track, low + 0.5 * (before + after) * (high - low))
                            if overlapping(grid, core, core_placed, q[0], q[1], q[2]):
                                shares = (low + before * (high - low)) / bound, (low + after * (high - low)) / bound
                                parts = _add(parts, count, i, shares[0], shares[1])
                                count += 1
                            before = after
                        continue
            if hit > ROUNDING:
                parts = _add(parts, count, i, max(low, middle - hit) / bound, min(high, middle + hit) / bound)
                count += 1
            d = max(hit, d - ROUNDING, 0.0)
            if d < half:
                stack[depth, 0], stack[depth, 1] = middle + d, high
                stack[depth + 1, 0], stack[depth + 1, 1] = low, middle - d
                depth += 2
    return parts[:count]
