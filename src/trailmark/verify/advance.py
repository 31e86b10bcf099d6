"""Conservative advancement: motions certified against edges, in intervals that are halved until nothing may meet.

Source: Mirtich, "Impulse-based dynamic simulation of rigid body systems", 1996.
"""

from __future__ import annotations

from math import cos, hypot, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import array_callee, callee, njit
from trailmark.se2 import FloatArray

__all__ = ["Close", "Way", "least_distance", "may_meet", "meetings"]

SMALLEST_MOVE = 1e-9
"""Metres that the robot moves in an interval that is halved no more: it meets an edge there."""

IntArray = NDArray[np.int64]


class Way(NamedTuple):
    """Motions one after another, straight ones and arcs.

    Attributes:
        starts: shape (n, 3).
        moves: shape (n, 3): changes of x, y and heading; of an arc the metres driven, negative backwards, 0 and the
            change of heading.
        curvature: shape (n,), 1/metres, positive to the left of the robot's front; 0 of straight motions.
    """

    starts: FloatArray
    moves: FloatArray
    curvature: FloatArray


class Close(NamedTuple):
    """Edges near motions.

    Attributes:
        groups: (n,) which group of ``items`` is near each motion, rising.
        first: (groups + 1,) where each group's ``items`` begin.
        items: runs of edges.
        runs: (r + 1,) where each run of edges begins.
        edges: (e, 5), metres: x and y of either end, and by how much the edge is thickened; a disc is one of length 0.
    """

    groups: IntArray
    first: IntArray
    items: IntArray
    runs: IntArray
    edges: FloatArray


@njit(nogil=True)
def meetings(
    body: FloatArray,
    radius: float,
    way: Way,
    close: Close,
    resolution: float,
    most: int,
) -> FloatArray:
    """Return the intervals in which the robot's edges meet others, rows (motion, from, to), the latter two as shares.

    They come in no order, and may abut. Between them it is certain that none meet: intervals of which that is not
    certain are halved until, in the middle, some do, or until the robot moves by no more than rounding.

    Args:
        body: (b, 4) the robot's edges in its frame; for a disc one of length 0.
        radius: by which they are thickened, metres.
        way: the motions.
        close: the edges near them.
        resolution: metres by which the ends of intervals may be off.
        most: intervals that are enough.
    """
    rows, count = np.empty((16, 3)), 0
    near, n, group = np.empty(1024, np.int64), 0, -1
    low, high = np.empty(128), np.empty(128)
    begins, ends = np.empty(128, np.int64), np.empty(128, np.int64)
    placed, sweep = np.empty_like(body), _reach(body)
    for i in range(len(way.starts)):
        if close.groups[i] != group:
            group = close.groups[i]
            near, n = _edges_near(near, close, group)
        low[0], high[0], begins[0], ends[0], depth = 0.0, 1.0, 0, n, 1
        while depth > 0:
            depth -= 1
            begin, end = begins[depth], ends[depth]
            half, middle = 0.5 * (high[depth] - low[depth]), 0.5 * (low[depth] + high[depth])
            x, y, vx, vy, turn, bend = _interval(body, way, i, middle, half, placed)
            while 2 * end - begin > len(near):
                near = _doubled(near)
            farthest, left, overlap = sweep + radius + hypot(vx, vy) + bend, end, -np.inf
            for k in range(begin, end):
                e = near[k]
                ax, ay, bx, by = (
                    close.edges[e, 0] - x,
                    close.edges[e, 1] - y,
                    close.edges[e, 2] - x,
                    close.edges[e, 3] - y,
                )
                thick = close.edges[e, 4] + radius
                if _nearest(0.0, 0.0, ax, ay, bx, by)[0] - close.edges[e, 4] > farthest:
                    continue
                if may_meet(placed, ax, ay, bx, by, thick, vx, vy, turn, bend):
                    overlap = max(overlap, _overlap(placed, ax, ay, bx, by, thick))
                    near[left] = e
                    left += 1
            if left == end:
                continue
            moved = hypot(vx, vy) + bend + sweep * abs(turn)
            # What is that near to contact overlaps, as far as rounding tells.
            whole = overlap >= moved or (overlap > -SMALLEST_MOVE and 2.0 * moved <= resolution)
            whole |= moved < SMALLEST_MOVE or depth + 2 > len(low)
            if whole or overlap > 0.0:
                if count == len(rows):
                    more = np.empty((2 * count, 3))
                    more[:count] = rows
                    rows = more
                part = half if whole else half * overlap / moved
                rows[count, 0], rows[count, 1], rows[count, 2] = i, middle - part, middle + part
                count += 1
                if count == most:
                    return rows[:count]
                if whole:
                    continue
                half = part
            else:
                half = 0.0
            # The first part on top: what comes first is found first.
            low[depth + 1], high[depth + 1], begins[depth + 1], ends[depth + 1] = low[depth], middle - half, end, left
            low[depth], begins[depth], ends[depth] = middle + half, end, left
            depth += 2
    return rows[:count]


@njit(nogil=True)
def least_distance(
    body: FloatArray,
    radius: float,
    way: Way,
    close: Close,
    cap: float,
    tolerance: float,
) -> tuple[float, int, float]:
    """Return how near the robot's edges come to others, and where: metres, motion and share of it.

    It is the distance at that place, and the true one at most the tolerance less. The motion is -1 if none is nearer
    than ``cap``. Arguments not told here are those of :func:`meetings`.

    Args:
        body: likewise.
        radius: likewise.
        way: likewise.
        close: likewise.
        cap: metres; larger distances are not sought.
        tolerance: metres, above 0.
    """
    best, motion, share = cap, -1, 0.0
    near, n, group = np.empty(1024, np.int64), 0, -1
    low, high = np.empty(128), np.empty(128)
    begins, ends = np.empty(128, np.int64), np.empty(128, np.int64)
    placed, sweep = np.empty_like(body), _reach(body)
    # The ends of all motions first: then most of what lies between them needs no close look.
    for between in (False, True):
        for i in range(len(way.starts)):
            if close.groups[i] != group:
                group = close.groups[i]
                near, n = _edges_near(near, close, group)
            low[0], high[0], begins[0], ends[0], depth = 0.0, 1.0, 0, n, 1
            if not between:
                high[0] = 0.0
                if i == len(way.starts) - 1:
                    low[1], high[1], begins[1], ends[1], depth = 1.0, 1.0, 0, n, 2
            while depth > 0 and (best > tolerance or not between):
                depth -= 1
                begin, end = begins[depth], ends[depth]
                half, middle = 0.5 * (high[depth] - low[depth]), 0.5 * (low[depth] + high[depth])
                x, y, vx, vy, turn, bend = _interval(body, way, i, middle, half, placed)
                while 2 * end - begin > len(near):
                    near = _doubled(near)
                farthest, left = sweep + radius + hypot(vx, vy) + bend, end
                for k in range(begin, end):
                    e = near[k]
                    ax, ay, bx, by = (
                        close.edges[e, 0] - x,
                        close.edges[e, 1] - y,
                        close.edges[e, 2] - x,
                        close.edges[e, 3] - y,
                    )
                    thick = close.edges[e, 4] + radius
                    if _nearest(0.0, 0.0, ax, ay, bx, by)[0] - close.edges[e, 4] > farthest + best:
                        continue
                    found = max(0.0, -_overlap(placed, ax, ay, bx, by, thick))
                    if found < best:
                        best, motion, share = found, i, middle
                    near[left] = e
                    left += 1
                if not between:
                    continue
                kept = end
                for k in range(end, left):
                    e = near[k]
                    ax, ay, bx, by = (
                        close.edges[e, 0] - x,
                        close.edges[e, 1] - y,
                        close.edges[e, 2] - x,
                        close.edges[e, 3] - y,
                    )
                    # Whether it may come nearer than what is known.
                    thick = close.edges[e, 4] + radius + best - tolerance
                    if may_meet(placed, ax, ay, bx, by, thick, vx, vy, turn, bend):
                        near[kept] = e
                        kept += 1
                if kept > end and depth + 2 <= len(low):
                    low[depth + 1], high[depth + 1], begins[depth + 1], ends[depth + 1] = low[depth], middle, end, kept
                    low[depth], begins[depth], ends[depth] = middle, end, kept
                    depth += 2
    return best, motion, share


@callee
def _reach(body: FloatArray) -> float:
    """Return the largest distance of the edges from the reference point, metres."""
    reach = 0.0
    for k in range(len(body)):
        reach = max(reach, hypot(body[k, 0], body[k, 1]), hypot(body[k, 2], body[k, 3]))
    return reach


@array_callee
def _edges_near(memory: IntArray, close: Close, group: int) -> tuple[IntArray, int]:
    """Return the edges of a group's runs, at the beginning of ``memory``, or of more where that is too little."""
    n = 0
    for k in range(close.first[group], close.first[group + 1]):
        begin, end = close.runs[close.items[k]], close.runs[close.items[k] + 1]
        while n + end - begin > len(memory):
            memory = _doubled(memory)
        for edge in range(begin, end):
            memory[n] = edge
            n += 1
    return memory, n


@array_callee
def _doubled(array: IntArray) -> IntArray:
    larger = np.empty(2 * len(array), np.int64)
    larger[: len(array)] = array
    return larger


@callee
def _interval(
    body: FloatArray, way: Way, i: int, middle: float, half: float, placed: FloatArray
) -> tuple[float, float, float, float, float, float]:
    """Return where the robot is in the middle of an interval of motion ``i``, and half of how it moves in it.

    That is x and y, the way along the tangent, the turn, and how far the way leaves its tangent at most. Its edges
    about that place are written to ``placed``.
    """
    start, move, curvature = way.starts[i], way.moves[i], way.curvature[i]
    theta, turn = start[2] + middle * move[2], half * move[2]
    c, s = cos(theta), sin(theta)
    if curvature != 0.0:
        vx, vy = half * move[0] * c, half * move[0] * s
        bend = 0.5 * abs(half * move[0] * turn)
        x = start[0] + (s - sin(start[2])) / curvature
        y = start[1] + (cos(start[2]) - c) / curvature
    else:
        vx, vy, bend = half * move[0], half * move[1], 0.0
        x, y = start[0] + middle * move[0], start[1] + middle * move[1]
    for k in range(len(body)):
        placed[k, 0], placed[k, 1] = c * body[k, 0] - s * body[k, 1], s * body[k, 0] + c * body[k, 1]
        placed[k, 2], placed[k, 3] = c * body[k, 2] - s * body[k, 3], s * body[k, 2] + c * body[k, 3]
    return x, y, vx, vy, turn, bend


@njit(numbers=True)
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
        gap, nx, ny = _apart(px, py, qx, qy, ax, ay, bx, by)
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
def _overlap(placed: FloatArray, ax: float, ay: float, bx: float, by: float, radius: float) -> float:
    """Return how far (metres) the robot's edges may move and surely still meet the edge from a to b.

    Negative is their distance. Two that cross each other do so until an end of one comes upon the other. Arguments are
    those of :func:`may_meet`.
    """
    most = -np.inf
    for k in range(len(placed)):
        px, py, qx, qy = placed[k, 0], placed[k, 1], placed[k, 2], placed[k, 3]
        gap = _apart(px, py, qx, qy, ax, ay, bx, by)[0]
        most = max(most, max(gap, radius) if _cross(px, py, qx, qy, ax, ay, bx, by) else radius - gap)
    return most


@callee
def _apart(
    px: float, py: float, qx: float, qy: float, ax: float, ay: float, bx: float, by: float
) -> tuple[float, float, float]:
    """Return how near an end of the segments pq and ab comes to the other one, and the direction from ab to pq."""
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
    return gap, nx, ny


@callee
def _nearest(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> tuple[float, float, float]:
    """Return the distance of the point p from the segment from a to b, and the direction from there to p."""
    dx, dy, wx, wy = bx - ax, by - ay, px - ax, py - ay
    square, along = dx * dx + dy * dy, wx * dx + wy * dy
    if 0.0 < along < square:
        # Across the segment: small distances, and directions there, are exact.
        length = sqrt(square)
        distance = (dx * wy - dy * wx) / length
        return (distance, -dy / length, dx / length) if distance > 0.0 else (-distance, dy / length, -dx / length)
    if along > 0.0:
        wx, wy = px - bx, py - by
    distance = hypot(wx, wy)
    return (distance, wx / distance, wy / distance) if distance > 0.0 else (0.0, 0.0, 0.0)


@callee
def _cross(px: float, py: float, qx: float, qy: float, ax: float, ay: float, bx: float, by: float) -> bool:
    """Return whether the segments from p to q and from a to b cross each other."""
    first = (qx - px) * (ay - py) - (qy - py) * (ax - px)
    second = (qx - px) * (by - py) - (qy - py) * (bx - px)
    third = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
    fourth = (bx - ax) * (qy - ay) - (by - ay) * (qx - ax)
    return (first > 0.0) != (second > 0.0) and (third > 0.0) != (fourth > 0.0)
