"""The shortest any-angle way over a costmap, for ``trailmark benchmark -p benchmarks.any_angle_exact:plan``.

A point's shortest way among blocked squares bends at their convex corners alone, tangent to each. A* over these
corners, joined where they see each other, is exact, unlike Theta*; blocked are the costmap's cells of 5 cm whose
middles are no farther from an obstacle than the disc around the robot, whose heading is then free. What is exact is the
way over these cells, not over the world. The costmap, the blocked cells and their corners are there before the clock
starts, as in a running robot. Not for cars.

Source: visibility graphs: Lozano-Perez & Wesley, "An algorithm for planning collision-free paths among polyhedral
obstacles", CACM 22(10), 1979; tangent edges alone: Oh & Leong, "Edge N-level sparse visibility graphs", SoCS 2017.
"""

from __future__ import annotations

from math import ceil, floor, hypot, inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.costmap import costmap_of, with_headings
from benchmarks.smac_like import SMALL
from trailmark.clock import CLOCK_EVERY, Deadline, now
from trailmark.collision import StateChecker
from trailmark.compiled import njit
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.se2 import FloatArray

__all__ = ["Corners", "corners_of", "plan", "prepare", "shortest_way"]

BoolArray = NDArray[np.bool_]

NEAR = 1e-7
"""Cells: what a line may reach into a blocked one by, for rounding."""


class Corners(NamedTuple):
    """Blocked cells and their convex corners.

    Attributes:
        blocked: shape (rows, columns), the outermost are.
        places: of the corners, columns and rows, shape (n, 2).
        sides: where the one blocked cell at each is, signs along columns and rows, shape (n, 2).
        x0: of the first cell's outer corner, metres.
        y0: likewise.
        size: of a cell, metres.
    """

    blocked: BoolArray
    places: FloatArray
    sides: FloatArray
    x0: float
    y0: float
    size: float


def plan(
    checker: StateChecker, start: FloatArray, goal: FloatArray, time_limit: float, seed: int, *, prepared: Corners
) -> FloatArray | None:
    """Return the states of a path, shape (n, 3), or None; nothing is random."""
    del seed
    if checker.robot.turning_radius is not None:
        return None
    origin = np.array([prepared.x0, prepared.y0])
    ends = (np.array([start[:2], goal[:2]]) - origin) / prepared.size
    way = shortest_way(prepared, ends[0], ends[1], Deadline.after(time_limit))
    if not len(way):
        return None
    return with_headings(np.concatenate([[start[:2]], origin + prepared.size * way[1:-1], [goal[:2]]]), start, goal)


def prepare(checker: StateChecker) -> Corners:
    """Return the corners for the robot, with the kernels loaded."""
    small = StateChecker(SMALL, SMALL.robot)
    plan(small, np.array([1.0, 1.0, 0.0]), np.array([4.0, 1.0, 1.0]), 1.0, 0, prepared=_prepared(small))
    return _prepared(checker)


plan.prepare = prepare  # type: ignore[attr-defined]  # what the benchmark calls before its clock starts


def _prepared(checker: StateChecker) -> Corners:
    costmap = costmap_of(checker)
    blocked = costmap.distance <= float(checker.robot.circumradius)
    return corners_of(blocked, costmap.x0, costmap.y0, costmap.size)


def corners_of(blocked: BoolArray, x0: float = 0.0, y0: float = 0.0, size: float = 1.0) -> Corners:
    """Return the corners of blocked cells; cells at the rim count as blocked."""
    blocked = np.array(blocked, dtype=np.bool_, order="C")
    blocked[[0, -1]] = blocked[:, [0, -1]] = True
    four = np.stack([blocked[:-1, :-1], blocked[:-1, 1:], blocked[1:, :-1], blocked[1:, 1:]])
    row, column = np.nonzero(four.sum(axis=0) == 1)
    which = four[:, row, column].argmax(axis=0)
    places = np.column_stack([column + 1.0, row + 1.0])
    return Corners(blocked, places, np.array([[-1.0, -1], [1, -1], [-1, 1], [1, 1]])[which], x0, y0, size)


@njit(cache=True)
def shortest_way(corners: Corners, start: FloatArray, goal: FloatArray, deadline: Deadline) -> FloatArray:
    """Return the shortest way of a point past blocked cells, none if there is no way or no time.

    Args:
        corners: of the blocked cells.
        start: column and row, in cells, shape (2,).
        goal: likewise.
        deadline: when to end.

    Returns:
        Columns and rows where it bends, ends included, shape (m, 2).
    """
    blocked, n = corners.blocked, len(corners.places)
    none = np.empty((0, 2))
    for end in (start, goal):
        column, row = floor(end[0]), floor(end[1])
        inside = 0 <= row < blocked.shape[0] and 0 <= column < blocked.shape[1]
        if not inside or blocked[row, column]:
            return none
    places, sides = np.empty((n + 2, 2)), np.zeros((n + 2, 2))
    places[:n], sides[:n], places[n], places[n + 1] = corners.places, corners.sides, start, goal
    cost, parent, closed = np.full(n + 2, inf), np.full(n + 2, -1), np.zeros(n + 2, np.bool_)
    keys, values, waiting = np.empty(1024), np.empty(1024, np.int64), 0
    cost[n] = 0.0
    waiting = heap_push(keys, values, waiting, 0.0, n)
    while waiting > 0:
        waiting = heap_pop(keys, values, waiting)
        at = values[waiting]
        if closed[at]:
            continue
        closed[at] = True
        if at == n + 1:
            break
        x, y = places[at]
        # It bends around the blocked cell, towards the side on which it passes it.
        in_x, in_y, towards = 0.0, 0.0, 0.0
        if at < n:
            in_x, in_y = x - places[parent[at], 0], y - places[parent[at], 1]
            towards = 1.0 if in_x * sides[at, 1] - in_y * sides[at, 0] > 0.0 else -1.0
        for other in range(n + 2):
            if other % CLOCK_EVERY == 0 and now(deadline.kind) >= deadline.seconds:
                return none
            dx, dy = places[other, 0] - x, places[other, 1] - y
            # A way that is not tangent to the blocked cell at either end could be cut short there.
            if (
                closed[other]
                or towards * (in_x * dy - in_y * dx) < 0.0
                or sides[at, 0] * dx * sides[at, 1] * dy > 0.0
                or sides[other, 0] * dx * sides[other, 1] * dy > 0.0
            ):
                continue
            through, ahead = cost[at] + hypot(dx, dy), hypot(goal[0] - places[other, 0], goal[1] - places[other, 1])
            if through < cost[other] and through + ahead < cost[n + 1] and sees(blocked, places[at], places[other]):
                cost[other], parent[other] = through, at
                if waiting == len(keys):
                    keys, values = heap_grow(keys, values)
                waiting = heap_push(keys, values, waiting, through + ahead, other)
    if not closed[n + 1]:
        return none
    count, at = 0, n + 1
    while at >= 0:
        count, at = count + 1, parent[at]
    way, at = np.empty((count, 2)), n + 1
    for k in range(count - 1, -1, -1):
        way[k], at = places[at], parent[at]
    return way


@njit(cache=True)
def sees(blocked: BoolArray, a: FloatArray, b: FloatArray) -> bool:
    """Return whether the straight line from a to b (columns, rows) meets no blocked cell's inside.

    It may go along a blocked cell, but not between two of them, nor where two meet at a corner.
    """
    ax, ay, bx, by = (a[0], a[1], b[0], b[1]) if a[0] <= b[0] else (b[0], b[1], a[0], a[1])
    if bx - ax < NEAR:
        return _along(blocked, ax, min(ay, by), max(ay, by))
    if abs(by - ay) < NEAR:
        return _along(blocked.T, ay, ax, bx)
    slope = (by - ay) / (bx - ax)
    for column in range(floor(ax + NEAR), ceil(bx - NEAR)):
        left = ay + slope * (max(ax, column) - ax)
        right = ay + slope * (min(bx, column + 1) - ax)
        for row in range(floor(min(left, right) + NEAR), ceil(max(left, right) - NEAR)):
            if blocked[row, column]:
                return False
        row = round(right)
        if column + 1 < bx - NEAR and abs(right - row) < NEAR:
            if slope > 0.0 and blocked[row, column] and blocked[row - 1, column + 1]:
                return False
            if slope < 0.0 and blocked[row - 1, column] and blocked[row, column + 1]:
                return False
    return True


@njit(cache=True)
def _along(blocked: BoolArray, x: float, low: float, high: float) -> bool:
    """Return whether the line along rows from ``low`` to ``high`` at column ``x`` meets no blocked cell's inside."""
    edge = round(x)
    if abs(x - edge) >= NEAR:
        return not blocked[floor(low + NEAR) : ceil(high - NEAR), floor(x)].any()
    # Between two columns: from one row to the next one of them has to be free in both, or two cells meet at a corner.
    before_left = before_right = True
    for row in range(floor(low + NEAR), ceil(high - NEAR)):
        left, right = not blocked[row, edge - 1], not blocked[row, edge]
        if not ((left and before_left) or (right and before_right)):
            return False
        before_left, before_right = left, right
    return True
