"""Compiled collision kernels: exact distances of a footprint to the obstacles, and certified motions.

A configuration is decided in three steps, each only where the one before could not: the clearance field with
the footprint's discs; exact distances between the footprint's outline and the segments and discs of nearby
cells; FCL, for configurations within DEEP_TOLERANCE of touching (:mod:`trailmark.collision.checker`).

A motion moves no point of the robot by more than m = ‖Δxy‖ + R·|Δθ|, so a configuration with clearance d
certifies d/m of the motion's length on either side of itself. The motion is covered from its middle outwards;
it is accepted only once it is covered whole.
"""

from __future__ import annotations

from math import cos, floor, hypot, pi, sin, sqrt

import numpy as np
from numba import njit

from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import DEEP_TOLERANCE, Footprint
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.se2 import FloatArray

__all__ = [
    "BLOCKED",
    "CONTACT",
    "FREE",
    "UNDECIDED",
    "clearances",
    "field_states",
    "field_value",
    "motion",
    "motions_certified",
    "point_clearance",
    "states_free",
    "workspace",
]

BLOCKED, FREE, UNDECIDED = 0, 1, 2

ROUNDING = 1e-9
"""Metres that exact distances may be wrong by (coordinates up to 1e5 m): what is closer is not called free."""

CONTACT = 1e-6
"""Metres: a motion that comes closer than this to an obstacle is not certified, but for its ends."""

END_ZONE = 1e-3
"""Metres from either end of a motion in which it may come closer than CONTACT, as one that starts in contact does."""

BUDGET = 20_000
"""Configurations evaluated for one motion at most; a motion that needs more is not certified."""


@njit(cache=True, inline="always")
def field_value(field: ClearanceField, x: float, y: float) -> float:
    """Return the distance stored for the cell of (x, y); 0 outside the grid, where everything is blocked."""
    column = floor((x - field.x0) / field.size)
    row = floor((y - field.y0) / field.size)
    if 0 <= row < field.distance.shape[0] and 0 <= column < field.distance.shape[1]:
        return float(field.distance[row, column])
    return 0.0


@njit(cache=True)
def _field_clearance(
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


@njit(cache=True)
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


@njit(cache=True)
def _field_hit(field: ClearanceField, robot: Footprint, x: float, y: float, c: float, s: float) -> bool:
    """Return whether an inner disc proves a collision deeper than any tolerance."""
    for k in range(len(robot.inner)):
        bx, by, r = robot.inner[k, 0], robot.inner[k, 1], robot.inner[k, 2]
        # From the largest to the smallest; no cell can prove a collision of one smaller than the slack.
        if r - 1e-6 <= field.slack:
            return False
        if field_value(field, x + c * bx - s * by, y + s * bx + c * by) + field.slack < r - 1e-6:
            return True
    return False


@njit(cache=True)
def _place(outline: FloatArray, c: float, s: float, placed: FloatArray) -> int:
    """Write the outline, turned by (c, s) about the reference point, into ``placed``; return its length."""
    n = len(outline)
    for k in range(n):
        placed[k, 0] = c * outline[k, 0] - s * outline[k, 1]
        placed[k, 1] = s * outline[k, 0] + c * outline[k, 1]
    return n


@njit(cache=True, inline="always")
def _point_segment(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the squared distance of a point to a segment."""
    dx, dy = bx - ax, by - ay
    wx, wy = px - ax, py - ay
    norm = dx * dx + dy * dy
    t = wx * dx + wy * dy
    if t <= 0.0 or norm == 0.0:
        return wx * wx + wy * wy
    if t >= norm:
        wx, wy = px - bx, py - by
        return wx * wx + wy * wy
    # Across the segment: by the cross product, which keeps small distances exact.
    cross = dx * wy - dy * wx
    return cross * cross / norm


@njit(cache=True)
def _in_ring(ring: FloatArray, n: int, px: float, py: float) -> bool:
    """Return whether a point lies inside a ring of n vertices (even-odd rule)."""
    inside = False
    j = n - 1
    for i in range(n):
        if (ring[i, 1] > py) != (ring[j, 1] > py) and px < ring[i, 0] + (py - ring[i, 1]) / (
            ring[j, 1] - ring[i, 1]
        ) * (ring[j, 0] - ring[i, 0]):
            inside = not inside
        j = i
    return inside


@njit(cache=True)
def _segment_ring(ring: FloatArray, n: int, ax: float, ay: float, bx: float, by: float, limit: float) -> float:
    """Return the squared distance of a segment to a ring's edges, 0 where they cross, ``limit`` if not below."""
    best, reach = limit, sqrt(limit)
    x1, x2, y1, y2 = min(ax, bx) - reach, max(ax, bx) + reach, min(ay, by) - reach, max(ay, by) + reach
    j = n - 1
    for i in range(n):
        px, py, qx, qy = ring[j, 0], ring[j, 1], ring[i, 0], ring[i, 1]
        j = i
        if max(px, qx) < x1 or min(px, qx) > x2 or max(py, qy) < y1 or min(py, qy) > y2:
            continue
        # Crossing: the ends of each lie on different sides of the other.
        ex, ey, dx, dy = qx - px, qy - py, bx - ax, by - ay
        sa = ex * (ay - py) - ey * (ax - px)
        sb = ex * (by - py) - ey * (bx - px)
        if (sa > 0.0) != (sb > 0.0):
            sp = dx * (py - ay) - dy * (px - ax)
            sq = dx * (qy - ay) - dy * (qx - ax)
            if (sp > 0.0) != (sq > 0.0):
                return 0.0
        best = min(best, _point_segment(qx, qy, ax, ay, bx, by))
        best = min(best, _point_segment(ax, ay, px, py, qx, qy))
        best = min(best, _point_segment(bx, by, px, py, qx, qy))
    return best


@njit(cache=True)
def _blocked_regions(grid: ObstacleGrid, px: float, py: float) -> int:
    """Return how many blocked regions (discs left out) cover a point; 1 outside the grid.

    From the cell's centre, whose number is known, first along x, then along y, counting the segments crossed. A
    point stands for the one just right of it and, by far less, above it: the half-open rule of the grid's own
    numbers. On which side of a segment the path's corner lies is decided once, so that rounding cannot make its
    two legs contradict each other.
    """
    column = floor((px - grid.x0) / grid.size)
    row = floor((py - grid.y0) / grid.size)
    if not (0 <= row < grid.rows and 0 <= column < grid.columns):
        return 1
    cell = row * grid.columns + column
    cx, cy = grid.x0 + (column + 0.5) * grid.size, grid.y0 + (row + 0.5) * grid.size
    winding = int(grid.winding[cell])
    for k in range(grid.cell_start[cell], grid.cell_start[cell + 1]):
        item = grid.items[k]
        if item >= len(grid.segments):
            continue
        ax, ay, bx, by = grid.segments[item]
        corner_above = cy >= max(ay, by)
        if min(ay, by) <= cy < max(ay, by):
            x = ax + (cy - ay) / (by - ay) * (bx - ax)
            centre_right, corner_right = x <= cx, x <= px
            corner_above = corner_right != ((bx > ax) == (by > ay))
            if centre_right != corner_right:
                # Left of an edge that runs upwards is blocked.
                winding += -1 if (by > ay) == corner_right else 1
        if min(ax, bx) <= px < max(ax, bx):
            above = ay + (px - ax) / (bx - ax) * (by - ay) <= py
            if above != corner_above:
                # Above an edge that runs to the right is blocked.
                winding += 1 if (bx > ax) == above else -1
    return winding


@njit(cache=True)
def _ring_clearance(grid: ObstacleGrid, ring: FloatArray, n: int, x: float, y: float, cap: float) -> float:
    """Return min(clearance, cap) of the region within a ring of n vertices around (x, y); 0 on overlap."""
    x1 = y1 = np.inf
    x2 = y2 = -np.inf
    for k in range(n):
        x1, x2 = min(x1, ring[k, 0]), max(x2, ring[k, 0])
        y1, y2 = min(y1, ring[k, 1]), max(y2, ring[k, 1])
    left = max(0, floor((x + x1 - cap - grid.x0) / grid.size))
    right = min(grid.columns - 1, floor((x + x2 + cap - grid.x0) / grid.size))
    low = max(0, floor((y + y1 - cap - grid.y0) / grid.size))
    high = min(grid.rows - 1, floor((y + y2 + cap - grid.y0) / grid.size))
    if left > right or low > high:
        return 0.0
    m = len(grid.segments)
    best, best2 = cap, cap * cap
    last = before = -1
    for row in range(low, high + 1):
        base = row * grid.columns
        for k in range(grid.cell_start[base + left], grid.cell_start[base + right + 1]):
            item = grid.items[k]
            # A segment runs through many cells in a row, where at most another one is its neighbour.
            if item in (last, before):
                continue
            last, before = item, last
            if item < m:
                # Relative to the robot, where coordinates are small and rounding with them.
                ax, ay = grid.segments[item, 0] - x, grid.segments[item, 1] - y
                bx, by = grid.segments[item, 2] - x, grid.segments[item, 3] - y
                if (
                    min(ax, bx) - x2 > best
                    or x1 - max(ax, bx) > best
                    or min(ay, by) - y2 > best
                    or y1 - max(ay, by) > best
                ):
                    continue
                found = _segment_ring(ring, n, ax, ay, bx, by, best2)
                if found < best2:
                    best2 = found
                    best = sqrt(best2)
                # The obstacle may lie wholly inside the ring.
                if best2 == 0.0 or (x1 < ax < x2 and y1 < ay < y2 and _in_ring(ring, n, ax, ay)):
                    return 0.0
            else:
                dx, dy = grid.discs[item - m, 0] - x, grid.discs[item - m, 1] - y
                r = grid.discs[item - m, 2]
                if dx - r - x2 > best or x1 - dx - r > best or dy - r - y2 > best or y1 - dy - r > best:
                    continue
                reach2 = (best + r) * (best + r)
                found = reach2
                j = n - 1
                for i in range(n):
                    found = min(found, _point_segment(dx, dy, ring[j, 0], ring[j, 1], ring[i, 0], ring[i, 1]))
                    j = i
                if found < reach2:
                    best = sqrt(found) - r
                    if best <= 0.0:
                        return 0.0
                    best2 = best * best
                if x1 < dx < x2 and y1 < dy < y2 and _in_ring(ring, n, dx, dy):
                    return 0.0
    # No boundaries cross: the robot is wholly outside or wholly inside each blocked region.
    if _blocked_regions(grid, x + ring[0, 0], y + ring[0, 1]) > 0:
        return 0.0
    return best


@njit(cache=True)
def point_clearance(grid: ObstacleGrid, x: float, y: float, cap: float) -> float:
    """Return min(clearance, cap) of a point; 0 in an obstacle."""
    left = max(0, floor((x - cap - grid.x0) / grid.size))
    right = min(grid.columns - 1, floor((x + cap - grid.x0) / grid.size))
    low = max(0, floor((y - cap - grid.y0) / grid.size))
    high = min(grid.rows - 1, floor((y + cap - grid.y0) / grid.size))
    if left > right or low > high or _blocked_regions(grid, x, y) > 0:
        return 0.0
    m = len(grid.segments)
    best, best2 = cap, cap * cap
    for row in range(low, high + 1):
        base = row * grid.columns
        for k in range(grid.cell_start[base + left], grid.cell_start[base + right + 1]):
            item = grid.items[k]
            if item < m:
                ax, ay = grid.segments[item, 0] - x, grid.segments[item, 1] - y
                bx, by = grid.segments[item, 2] - x, grid.segments[item, 3] - y
                found = _point_segment(0.0, 0.0, ax, ay, bx, by)
                if found < best2:
                    best2 = found
                    best = sqrt(best2)
            else:
                found = hypot(grid.discs[item - m, 0] - x, grid.discs[item - m, 1] - y) - grid.discs[item - m, 2]
                if found < best:
                    if found <= 0.0:
                        return 0.0
                    best = found
                    best2 = best * best
    return best


@njit(cache=True)
def _exact_clearance(
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
    if robot.disc_radius > 0.0:
        return max(0.0, point_clearance(grid, x, y, cap + robot.disc_radius) - robot.disc_radius)
    n = _place(robot.outline, c, s, placed)
    return _ring_clearance(grid, placed, n, x, y, cap)


@njit(cache=True)
def _state(
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
    if _field_hit(field, robot, x, y, c, s):
        return BLOCKED
    if robot.disc_radius > 0.0:
        d = point_clearance(grid, x, y, robot.disc_radius + 2.0 * ROUNDING) - robot.disc_radius
        if d > ROUNDING:
            return FREE
        return BLOCKED if d < -DEEP_TOLERANCE else UNDECIDED
    # The core first: it tells most of the free from most of the blocked at once.
    if len(robot.core) > 0:
        n = _place(robot.core, c, s, placed)
        # A gap wider than END_ZONE would cost more to search than it saves: then nothing is called free here.
        d = _ring_clearance(grid, placed, n, x, y, min(robot.core_gap, END_ZONE) + 2.0 * ROUNDING)
        if d == 0.0:
            return BLOCKED
        if d > robot.core_gap + ROUNDING:
            return FREE
    if _exact_clearance(grid, robot, placed, x, y, c, s, 2.0 * ROUNDING) > ROUNDING:
        return FREE
    return UNDECIDED


@njit(cache=True)
def workspace(robot: Footprint) -> FloatArray:
    """Return room for the placed outline, shape (v, 2)."""
    return np.empty((max(len(robot.outline), len(robot.core), 1), 2))


@njit(cache=True, nogil=True)
def states_free(grid: ObstacleGrid, field: ClearanceField, robot: Footprint, q: FloatArray) -> np.ndarray:
    """Return FREE, BLOCKED or UNDECIDED (uint8, shape (n,)) for configurations of shape (n, 3)."""
    placed = workspace(robot)
    result = np.empty(len(q), np.uint8)
    for i in range(len(q)):
        result[i] = _state(grid, field, robot, placed, q[i, 0], q[i, 1], q[i, 2])
    return result


@njit(cache=True, nogil=True)
def field_states(field: ClearanceField, robot: Footprint, q: FloatArray) -> np.ndarray:
    """Return what the field alone can prove (uint8, shape (n,)): FREE, BLOCKED or UNDECIDED."""
    result = np.empty(len(q), np.uint8)
    for i in range(len(q)):
        x, y, c, s = q[i, 0], q[i, 1], cos(q[i, 2]), sin(q[i, 2])
        if _field_free(field, robot, x, y, c, s):
            result[i] = FREE
        elif _field_hit(field, robot, x, y, c, s):
            result[i] = BLOCKED
        else:
            result[i] = UNDECIDED
    return result


@njit(cache=True, nogil=True)
def clearances(grid: ObstacleGrid, field: ClearanceField, robot: Footprint, q: FloatArray, cap: float) -> FloatArray:
    """Return min(clearance, cap) (metres, shape (n,)) of configurations of shape (n, 3); 0 on overlap."""
    placed = workspace(robot)
    result = np.empty(len(q))
    for i in range(len(q)):
        x, y, c, s = q[i, 0], q[i, 1], cos(q[i, 2]), sin(q[i, 2])
        # No farther than the obstacle that the field knows of can the nearest one be.
        limit = min(cap, field_value(field, x, y) + field.slack + robot.circumradius)
        for k in range(len(robot.inner)):
            bx, by = robot.inner[k, 0], robot.inner[k, 1]
            reach = field_value(field, x + c * bx - s * by, y + s * bx + c * by) + field.slack - robot.inner[k, 2]
            limit = min(limit, max(reach, ROUNDING))
        result[i] = _exact_clearance(grid, robot, placed, x, y, c, s, limit)
    return result


@njit(cache=True)
def motion(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    a: FloatArray,
    b: FloatArray,
    exact: bool,
) -> int:
    """Return FREE if the motion is certified, BLOCKED if it is not, UNDECIDED if the field alone cannot tell.

    Both ends must be valid. A robot may start and stop in contact with an obstacle: what is left open at an end
    counts as free once it is no longer than CONTACT. All of it lies within half of that of the valid end or of
    what is certified already.
    """
    dx, dy, dtheta = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    if dtheta > pi:
        dtheta -= 2.0 * pi
    elif dtheta <= -pi:
        dtheta += 2.0 * pi
    bound = hypot(dx, dy) + robot.sweep_radius * abs(dtheta)
    if bound == 0.0:
        return FREE
    capacity = len(queue)
    queue[0, 0], queue[0, 1] = 0.0, 1.0
    first, count = 0, 1
    answer = FREE
    for _ in range(BUDGET):
        if count == 0:
            return answer
        if count + 1 > capacity:
            break
        # Widest gaps first, which finds collisions soon; newest first once half of the queue is in use, which
        # then grows by one gap for each halving only. A gap that finds no place must not be lost: give up.
        count -= 1
        if 2 * count < capacity:
            low, high = queue[first, 0], queue[first, 1]
            first = (first + 1) % capacity
        else:
            last = (first + count) % capacity
            low, high = queue[last, 0], queue[last, 1]
        if (low == 0.0 or high == 1.0) and (high - low) * bound <= CONTACT:
            continue
        middle = 0.5 * (low + high)
        need = 0.5 * (high - low) * bound + ROUNDING
        x, y, theta = a[0] + middle * dx, a[1] + middle * dy, a[2] + middle * dtheta
        c, s = cos(theta), sin(theta)
        d = _field_clearance(field, robot, x, y, c, s, need)
        if d < need:
            if not exact:
                if _field_hit(field, robot, x, y, c, s):
                    return BLOCKED
                if d < 0.5 * field.slack:
                    answer = UNDECIDED
                    continue
            elif d < 2.0 * field.slack:
                if d < 0.0 and _field_hit(field, robot, x, y, c, s):
                    return BLOCKED
                cap = min(need + ROUNDING, max(d, 0.0) + 4.0 * field.slack)
                d = _exact_clearance(grid, robot, placed, x, y, c, s, cap)
                if d < need and d < CONTACT:
                    near_end = min(middle, 1.0 - middle) * bound < END_ZONE
                    if d <= ROUNDING or not near_end:
                        return BLOCKED
        if d < need:
            reach = (d - ROUNDING) / bound
            queue[(first + count) % capacity, 0] = low
            queue[(first + count) % capacity, 1] = middle - reach
            queue[(first + count + 1) % capacity, 0] = middle + reach
            queue[(first + count + 1) % capacity, 1] = high
            count += 2
    return BLOCKED if exact else UNDECIDED


@njit(cache=True, nogil=True)
def motions_certified(
    grid: ObstacleGrid, field: ClearanceField, robot: Footprint, a: FloatArray, b: FloatArray, exact: bool
) -> np.ndarray:
    """Return FREE, BLOCKED or (only if not ``exact``) UNDECIDED for motions from a to b.

    Args:
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint.
        a: starts, shape (n, 3), valid.
        b: ends, shape (n, 3), valid.
        exact: False asks the field alone.

    Returns:
        uint8, shape (n,).
    """
    placed = workspace(robot)
    queue = np.empty((128, 2))
    result = np.empty(len(a), np.uint8)
    for i in range(len(a)):
        result[i] = motion(grid, field, robot, placed, queue, a[i], b[i], exact)
    return result
