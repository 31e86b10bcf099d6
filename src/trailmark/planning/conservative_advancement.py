"""Conservative advancement: motions certified against edges, in intervals that are halved until nothing may meet.

Source: Mirtich, "Impulse-based dynamic simulation of rigid body systems", 1996.
"""

from __future__ import annotations

from math import cos, hypot, sin

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = ["advance", "may_meet"]

SMALLEST_MOVE = 1e-9
"""Metres that the robot moves in an interval that is halved no more: it meets an edge there."""

IntArray = NDArray[np.int64]


@njit(nogil=True)
def advance(
    body: FloatArray,
    radius: float,
    starts: FloatArray,
    moves: FloatArray,
    curvature: FloatArray,
    first: IntArray,
    items: IntArray,
    runs: IntArray,
    edges: FloatArray,
) -> tuple[int, float]:
    """Return the first motion that is not certified and at which share of it; -1 if all are.

    Args:
        body: (b, 4) the robot's edges in its frame; for a disc one of length 0.
        radius: by which they are thickened, metres.
        starts: (n, 3).
        moves: (n, 3), changes of x, y and heading; of an arc the metres driven, 0 and the change of heading.
        curvature: (n,), 1/metres.
        first: (n + 1,) where each motion's ``items`` begin.
        items: runs of edges near each motion.
        runs: (r + 1,) where each run of edges begins.
        edges: (e, 5), metres: x and y of either end, and by how much the edge is thickened.
    """
    near = np.empty(1024, np.int64)
    low, high = np.empty(128), np.empty(128)
    begins, ends = np.empty(128, np.int64), np.empty(128, np.int64)
    placed = np.empty_like(body)
    reach = radius
    for k in range(len(body)):
        reach = max(reach, hypot(body[k, 0], body[k, 1]) + radius, hypot(body[k, 2], body[k, 3]) + radius)
    for i in range(len(starts)):
        curved = curvature[i] != 0.0
        n = 0
        for k in range(first[i], first[i + 1]):
            while n + runs[items[k] + 1] - runs[items[k]] > len(near):
                near = _doubled(near)
            for edge in range(runs[items[k]], runs[items[k] + 1]):
                near[n] = edge
                n += 1
        low[0], high[0], begins[0], ends[0], depth = 0.0, 1.0, 0, n, 1
        while depth > 0:
            depth -= 1
            begin, end = begins[depth], ends[depth]
            half, middle = 0.5 * (high[depth] - low[depth]), 0.5 * (low[depth] + high[depth])
            theta = starts[i, 2] + middle * moves[i, 2]
            c, s = cos(theta), sin(theta)
            if curved:
                # Half of the way along the tangent at the middle, and how far an arc leaves that at most.
                vx, vy = half * moves[i, 0] * c, half * moves[i, 0] * s
                bend = 0.5 * abs(half * moves[i, 0] * half * moves[i, 2])
                x = starts[i, 0] + (s - sin(starts[i, 2])) / curvature[i]
                y = starts[i, 1] + (cos(starts[i, 2]) - c) / curvature[i]
            else:
                vx, vy, bend = half * moves[i, 0], half * moves[i, 1], 0.0
                x, y = starts[i, 0] + middle * moves[i, 0], starts[i, 1] + middle * moves[i, 1]
            turn = half * moves[i, 2]
            for k in range(len(body)):
                placed[k, 0], placed[k, 1] = c * body[k, 0] - s * body[k, 1], s * body[k, 0] + c * body[k, 1]
                placed[k, 2], placed[k, 3] = c * body[k, 2] - s * body[k, 3], s * body[k, 2] + c * body[k, 3]
            while 2 * end - begin > len(near):
                near = _doubled(near)
            farthest = reach + hypot(vx, vy) + bend
            left = end
            for k in range(begin, end):
                e = near[k]
                x1, y1, x2, y2 = edges[e, 0] - x, edges[e, 1] - y, edges[e, 2] - x, edges[e, 3] - y
                if _nearest(0.0, 0.0, x1, y1, x2, y2)[0] - edges[e, 4] > farthest:
                    continue
                if may_meet(placed, x1, y1, x2, y2, edges[e, 4] + radius, vx, vy, turn, bend):
                    near[left] = e
                    left += 1
            if left == end:
                continue
            if hypot(vx, vy) + reach * abs(turn) < SMALLEST_MOVE or depth + 2 > len(low):
                return i, middle
            # The first half on top: faults are told where they come first.
            low[depth + 1], high[depth + 1], begins[depth + 1], ends[depth + 1] = low[depth], middle, end, left
            low[depth], begins[depth], ends[depth] = middle, end, left
            depth += 2
    return -1, 0.0


@callee
def _doubled(array: IntArray) -> IntArray:
    larger = np.empty(2 * len(array), np.int64)
    larger[: len(array)] = array
    return larger


@callee
def may_meet(
    placed: FloatArray,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    radius: float,
    vx: float,
    vy: float,
    turn: float,
    bend: float,
) -> bool:
    """Return False if no edge of the robot meets the edge from a to b in an interval of its motion.

    Two edges are kept apart by the strip across the line between their nearest points. Along that line an end r of the
    robot's edge moves by n·(v + turn·z×r) and, to second order, ``bend`` + |r|·turn²/2 at most.

    Args:
        placed: (b, 4) the robot's edges about its reference point in the middle of the interval.
        ax: end of the edge about the same point, metres.
        ay: likewise.
        bx: likewise.
        by: likewise.
        radius: by which the edges are thickened together, metres.
        vx: half of the way in the interval, metres.
        vy: likewise.
        turn: half of the turn in the interval, radians.
        bend: metres by which the way leaves its tangent at most.
    """
    for k in range(len(placed)):
        px, py, qx, qy = placed[k, 0], placed[k, 1], placed[k, 2], placed[k, 3]
        gap, nx, ny = _nearest(px, py, ax, ay, bx, by)
        other, ox, oy = _nearest(qx, qy, ax, ay, bx, by)
        if other < gap:
            gap, nx, ny = other, ox, oy
        other, ox, oy = _nearest(ax, ay, px, py, qx, qy)
        if other < gap:
            gap, nx, ny = other, -ox, -oy
        other, ox, oy = _nearest(bx, by, px, py, qx, qy)
        if other < gap:
            gap, nx, ny = other, -ox, -oy
        if gap <= radius or _cross(px, py, qx, qy, ax, ay, bx, by):
            return True
        behind = max(nx * ax + ny * ay, nx * bx + ny * by) + radius
        along = nx * vx + ny * vy
        for x, y in ((px, py), (qx, qy)):
            moved = abs(along + turn * (ny * x - nx * y)) + bend + 0.5 * turn * turn * hypot(x, y)
            if nx * x + ny * y - behind <= moved:
                return True
    return False


@callee
def _nearest(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> tuple[float, float, float]:
    """Return the distance of the point p from the segment from a to b, and the direction from there to p."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    t = ((px - ax) * dx + (py - ay) * dy) / square if square > 0.0 else 0.0
    t = min(1.0, max(0.0, t))
    dx, dy = px - ax - t * dx, py - ay - t * dy
    distance = hypot(dx, dy)
    return (distance, dx / distance, dy / distance) if distance > 0.0 else (0.0, 0.0, 0.0)


@callee
def _cross(px: float, py: float, qx: float, qy: float, ax: float, ay: float, bx: float, by: float) -> bool:
    """Return whether the segments from p to q and from a to b cross each other."""
    first = (qx - px) * (ay - py) - (qy - py) * (ax - px)
    second = (qx - px) * (by - py) - (qy - py) * (bx - px)
    third = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    fourth = (bx - ax) * (qy - ay) - (by - ay) * (qx - ax)
    return (first > 0.0) != (second > 0.0) and (third > 0.0) != (fourth > 0.0)
