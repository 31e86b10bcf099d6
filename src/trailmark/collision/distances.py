"""Exact distances from a point or an outline to the obstacles of the cells around it, compiled."""

from __future__ import annotations

from math import floor, hypot, sqrt

import numpy as np

from trailmark.collision.obstacles import ObstacleGrid
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = ["point_clearance", "point_depth", "ring_clearance"]


@callee
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


@callee
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


@callee
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


@callee
def _blocked_regions(grid: ObstacleGrid, px: float, py: float) -> int:
    """Return how many blocked regions (discs left out) cover a point; 1 outside the grid.

    From the cell's centre, whose number is known, first along x, then along y, counting the segments crossed. A
    point stands for the one just right of it and, by far less, above it: the half-open rule of the grid's own
    numbers. On which side of a segment the corner lies is decided once, so that rounding cannot make the two parts
    contradict each other.
    """
    column = floor((px - grid.x0) / grid.size)
    row = floor((py - grid.y0) / grid.size)
    if not (0 <= row < grid.rows and 0 <= column < grid.columns):
        return 1
    cx, cy = grid.x0 + (column + 0.5) * grid.size, grid.y0 + (row + 0.5) * grid.size
    winding = int(grid.winding[row, column])
    for k in range(grid.cell_start[row, column], grid.cell_start[row, column + 1]):
        item = grid.items[k]
        if item < 0:
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


@callee
def ring_clearance(grid: ObstacleGrid, ring: FloatArray, n: int, x: float, y: float, cap: float) -> float:
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
    best, best2 = cap, cap * cap
    last = before = len(grid.segments)  # no item's number
    for row in range(low, high + 1):
        for k in range(grid.cell_start[row, left], grid.cell_start[row, right + 1]):
            item = grid.items[k]
            # A segment lies in many consecutive cells.
            if item in (last, before):
                continue
            last, before = item, last
            if item >= 0:
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
                dx, dy = grid.discs[-1 - item, 0] - x, grid.discs[-1 - item, 1] - y
                r = grid.discs[-1 - item, 2]
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


@njit(numbers=True)
def point_clearance(grid: ObstacleGrid, x: float, y: float, cap: float) -> float:
    """Return min(clearance, cap) of a point; 0 in an obstacle."""
    left = max(0, floor((x - cap - grid.x0) / grid.size))
    right = min(grid.columns - 1, floor((x + cap - grid.x0) / grid.size))
    low = max(0, floor((y - cap - grid.y0) / grid.size))
    high = min(grid.rows - 1, floor((y + cap - grid.y0) / grid.size))
    if left > right or low > high or _blocked_regions(grid, x, y) > 0:
        return 0.0
    best, best2 = cap, cap * cap
    for row in range(low, high + 1):
        for k in range(grid.cell_start[row, left], grid.cell_start[row, right + 1]):
            item = grid.items[k]
            if item >= 0:
                ax, ay = grid.segments[item, 0] - x, grid.segments[item, 1] - y
                bx, by = grid.segments[item, 2] - x, grid.segments[item, 3] - y
                found = _point_segment(0.0, 0.0, ax, ay, bx, by)
                if found < best2:
                    best2 = found
                    best = sqrt(best2)
            else:
                found = hypot(grid.discs[-1 - item, 0] - x, grid.discs[-1 - item, 1] - y) - grid.discs[-1 - item, 2]
                if found < best:
                    if found <= 0.0:
                        return 0.0
                    best = found
                    best2 = best * best
    return best


@njit(numbers=True)
def point_depth(grid: ObstacleGrid, x: float, y: float, cap: float) -> float:
    """Return min(depth, cap): no point nearer than ``depth`` to this one is outside of all obstacles; 0 if it is."""
    left = max(0, floor((x - cap - grid.x0) / grid.size))
    right = min(grid.columns - 1, floor((x + cap - grid.x0) / grid.size))
    low = max(0, floor((y - cap - grid.y0) / grid.size))
    high = min(grid.rows - 1, floor((y + cap - grid.y0) / grid.size))
    if left > right or low > high:
        return 0.0
    covered = _blocked_regions(grid, x, y) > 0
    deepest, boundary2 = 0.0, cap * cap
    for row in range(low, high + 1):
        for k in range(grid.cell_start[row, left], grid.cell_start[row, right + 1]):
            item = grid.items[k]
            if item < 0:
                inside = grid.discs[-1 - item, 2] - hypot(grid.discs[-1 - item, 0] - x, grid.discs[-1 - item, 1] - y)
                deepest = max(deepest, inside)
            elif covered:
                ax, ay = grid.segments[item, 0] - x, grid.segments[item, 1] - y
                bx, by = grid.segments[item, 2] - x, grid.segments[item, 3] - y
                boundary2 = min(boundary2, _point_segment(0.0, 0.0, ax, ay, bx, by))
    # Where regions overlap, their boundaries run through blocked space too: the depth is that of one of them.
    return min(cap, max(deepest, sqrt(boundary2) if covered else 0.0))
