"""Compiled collision kernels: whether a configuration is free, and its distance to the obstacles.

A configuration is decided in three steps, each only where the one before could not decide: the clearance field with the
footprint's discs; exact distances between the footprint's outline and the segments and discs of nearby cells; FCL, for
configurations within DEEP_TOLERANCE of touching (:mod:`trailmark.collision.checker`).
"""

from __future__ import annotations

from math import cos, floor, sin

import numpy as np

from trailmark.collision.distances import point_clearance, ring_clearance
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import DEEP_TOLERANCE, Footprint
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = [
    "BLOCKED",
    "FREE",
    "UNDECIDED",
    "clearances",
    "exact_clearance",
    "field_clearance",
    "field_hit",
    "field_states",
    "field_value",
    "state",
    "states_free",
    "workspace",
]

BLOCKED, FREE, UNDECIDED = 0, 1, 2

ROUNDING = 1e-9
"""Maximum error of exact distances, metres (coordinates up to 1e5 m): what is closer does not count as free."""

WIDEST_GAP = 1e-3
"""Metres: a core's gap wider than this would cost more time to search than it saves."""


@njit(numbers=True)
def field_value(field: ClearanceField, x: float, y: float) -> float:
    """Return the distance stored for the cell of (x, y); 0 outside the grid, where everything is blocked."""
    column = floor((x - field.x0) / field.size)
    row = floor((y - field.y0) / field.size)
    if 0 <= row < field.distance.shape[0] and 0 <= column < field.distance.shape[1]:
        return float(field.distance[row, column])
    return 0.0


@callee
def field_clearance(
    field: ClearanceField, robot: Footprint, x: float, y: float, c: float, s: float, enough: float
) -> float:
    """Return a lower bound on the clearance, or the first one found that is at least ``enough``."""
    best = field_value(field, x, y) - field.slack - robot.circumradius
    if best >= enough:
        return best
    worst = np.inf
    for k in range(len(robot.cover)):
        bx, by, r = robot.cover[k, 0], robot.cover[k, 1], robot.cover[k, 2]
        value = field_value(field, x + c * bx - s * by, y + s * bx + c * by) - field.slack - r
        if value < worst:
            worst = value
            if worst <= best:
                return best
    return max(best, worst)


@callee
def _field_free(field: ClearanceField, robot: Footprint, x: float, y: float, c: float, s: float) -> bool:
    """Return whether the field proves a clearance of at least ROUNDING."""
    spare = field.slack + ROUNDING
    if field_value(field, x, y) >= robot.circumradius + spare:
        return True
    for k in range(len(robot.cover)):
        bx, by, r = robot.cover[k, 0], robot.cover[k, 1], robot.cover[k, 2]
        if field_value(field, x + c * bx - s * by, y + s * bx + c * by) < r + spare:
            return False
    return True


@callee
def field_hit(field: ClearanceField, robot: Footprint, x: float, y: float, c: float, s: float) -> bool:
    """Return whether an inner disc proves a collision deeper than any tolerance."""
    for k in range(len(robot.inner)):
        bx, by, r = robot.inner[k, 0], robot.inner[k, 1], robot.inner[k, 2]
        # From the largest to the smallest; no cell can prove a collision of one smaller than the slack.
        if r - 1e-6 <= field.slack:
            return False
        if field_value(field, x + c * bx - s * by, y + s * bx + c * by) + field.slack < r - 1e-6:
            return True
    return False


@callee
def _place(outline: FloatArray, c: float, s: float, placed: FloatArray) -> int:
    """Write the outline, turned by (c, s) about the reference point, into ``placed``; return its length."""
    n = len(outline)
    for k in range(n):
        placed[k, 0] = c * outline[k, 0] - s * outline[k, 1]
        placed[k, 1] = s * outline[k, 0] + c * outline[k, 1]
    return n


@callee
def exact_clearance(
    grid: ObstacleGrid,
    robot: Footprint,
    placed: FloatArray,
    x: float,
    y: float,
    c: float,
    s: float,
    cap: float,
) -> float:
    """Return min(clearance, cap) of the robot, 0 on overlap; wrong by at most ROUNDING."""
    if len(robot.outline) == 0:
        return max(0.0, point_clearance(grid, x, y, cap + robot.dilation) - robot.dilation)
    n = _place(robot.outline, c, s, placed)
    return max(0.0, ring_clearance(grid, placed, n, x, y, cap + robot.dilation) - robot.dilation)


@callee
def state(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    x: float,
    y: float,
    theta: float,
) -> int:
    """Return FREE, BLOCKED, or UNDECIDED within DEEP_TOLERANCE of touching."""
    c, s = cos(theta), sin(theta)
    if _field_free(field, robot, x, y, c, s):
        return FREE
    if field_hit(field, robot, x, y, c, s):
        return BLOCKED
    if len(robot.outline) == 0:
        d = point_clearance(grid, x, y, robot.dilation + 2.0 * ROUNDING) - robot.dilation
        if d > ROUNDING:
            return FREE
        return BLOCKED if d < -DEEP_TOLERANCE else UNDECIDED
    # The core first: it decides for most free and most blocked configurations at once.
    if len(robot.core) > 0:
        n = _place(robot.core, c, s, placed)
        # A core dilated by so much meets nothing; with a wider gap nothing counts as free here.
        deep = max(0.0, robot.dilation - DEEP_TOLERANCE)
        d = ring_clearance(grid, placed, n, x, y, deep + min(robot.core_gap, WIDEST_GAP) + 2.0 * ROUNDING)
        if d <= deep:
            return BLOCKED
        if d > deep + robot.core_gap + ROUNDING:
            return FREE
    if exact_clearance(grid, robot, placed, x, y, c, s, 2.0 * ROUNDING) > ROUNDING:
        return FREE
    return UNDECIDED


@njit
def workspace(robot: Footprint) -> FloatArray:
    """Return memory for the placed outline, shape (v, 2)."""
    return np.empty((max(len(robot.outline), len(robot.core), 1), 2))


@njit(nogil=True)
def states_free(grid: ObstacleGrid, field: ClearanceField, robot: Footprint, q: FloatArray) -> np.ndarray:
    """Return FREE, BLOCKED or UNDECIDED (uint8, shape (n,)) for configurations of shape (n, 3)."""
    placed = workspace(robot)
    result = np.empty(len(q), np.uint8)
    for i in range(len(q)):
        result[i] = state(grid, field, robot, placed, q[i, 0], q[i, 1], q[i, 2])
    return result


@njit(nogil=True)
def field_states(field: ClearanceField, robot: Footprint, q: FloatArray) -> np.ndarray:
    """Return what the field alone can prove (uint8, shape (n,)): FREE, BLOCKED or UNDECIDED."""
    result = np.empty(len(q), np.uint8)
    for i in range(len(q)):
        x, y, c, s = q[i, 0], q[i, 1], cos(q[i, 2]), sin(q[i, 2])
        if _field_free(field, robot, x, y, c, s):
            result[i] = FREE
        elif field_hit(field, robot, x, y, c, s):
            result[i] = BLOCKED
        else:
            result[i] = UNDECIDED
    return result


@njit(nogil=True)
def clearances(grid: ObstacleGrid, field: ClearanceField, robot: Footprint, q: FloatArray, cap: float) -> FloatArray:
    """Return min(clearance, cap) (metres, shape (n,)) of configurations of shape (n, 3); 0 on overlap."""
    placed = workspace(robot)
    result = np.empty(len(q))
    for i in range(len(q)):
        x, y, c, s = q[i, 0], q[i, 1], cos(q[i, 2]), sin(q[i, 2])
        result[i] = exact_clearance(grid, robot, placed, x, y, c, s, field_cap(field, robot, x, y, c, s, cap))
    return result


@callee
def field_cap(field: ClearanceField, robot: Footprint, x: float, y: float, c: float, s: float, cap: float) -> float:
    """Return a cap (metres) on the clearance: the nearest obstacle is no farther than the field's values stand for."""
    limit = min(cap, field_value(field, x, y) + field.slack + robot.circumradius)
    for k in range(len(robot.inner)):
        bx, by = robot.inner[k, 0], robot.inner[k, 1]
        reach = field_value(field, x + c * bx - s * by, y + s * bx + c * by) + field.slack - robot.inner[k, 2]
        limit = min(limit, max(reach, ROUNDING))
    return limit
