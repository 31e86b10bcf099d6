"""Conservative advancement: motions certified against edges, in intervals that are halved until nothing may meet.

Two edges are kept apart by the strip across the line between their nearest points. Along that line an end r of the
robot's edge moves in an interval by n·(v + turn·z×r) and, to second order, ``bend`` + |r|·turn²/2 at most: v and
``turn`` half of the way and of the turn in it, ``bend`` what the way leaves its tangent by.

Source: Mirtich, "Impulse-based dynamic simulation of rigid body systems", 1996.
"""

from __future__ import annotations

from math import cos, hypot, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import array_callee, callee, njit
from trailmark.se2 import FloatArray

__all__ = ["Close", "Way", "least_distance", "meetings"]

SMALLEST_MOVE = 1e-9
"""Metres that the robot moves in an interval that is halved no more: it meets an edge there."""

DEEPEST = 128
"""Intervals that wait to be looked at, at most."""

IntArray = NDArray[np.int64]
Four = tuple[float, float, float, float]


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


class _Body(NamedTuple):
    """The robot: its edges (b, 4), what they are thickened by, how far they reach, and room for them in place."""

    edges: FloatArray
    radius: float
    sweep: float
    placed: FloatArray


@njit(nogil=True)
def meetings(body: FloatArray, radius: float, way: Way, close: Close, resolution: float, most: int) -> FloatArray:
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
    rows, count, robot = np.empty((16, 3)), 0, _Body(body, radius, _reach(body), np.empty_like(body))
    near, n, group = np.empty(1024, np.int64), 0, -1
    shares, edges = np.empty((DEEPEST, 2)), np.empty((DEEPEST, 2), np.int64)
    for i in range(len(way.starts)):
        if close.groups[i] != group:
            group = close.groups[i]
            near, n = _edges_near(near, close, group)
        shares[0, 0], shares[0, 1], edges[0, 0], edges[0, 1], depth = 0.0, 1.0, 0, n, 1
        while depth > 0:
            depth -= 1
            low, high, end = shares[depth, 0], shares[depth, 1], edges[depth, 1]
            half, middle = 0.5 * (high - low), 0.5 * (low + high)
            near, left, overlap, moved = _look(robot, way, close, i, (low, high), 0.0, 0.0, near, edges[depth, 0], end)
            if left == end:
                continue
            # What is that near to contact overlaps, as far as rounding tells.
            whole = overlap >= moved or (overlap > -SMALLEST_MOVE and 2.0 * moved <= resolution)
            whole |= moved < SMALLEST_MOVE or depth + 2 > DEEPEST
            part = half if whole else max(0.0, half * overlap / moved)
            if whole or part > 0.0:
                if count == len(rows):
                    more = np.empty((2 * count, 3))
                    more[:count] = rows
                    rows = more
                rows[count, 0], rows[count, 1], rows[count, 2] = i, middle - part, middle + part
                count += 1
                if count == most:
                    return rows[:count]
            if not whole:
                depth = _push(shares, edges, depth, (low, middle - part, middle + part, high), end, left)
    return rows[:count]


@njit(nogil=True)
def least_distance(
    body: FloatArray, radius: float, way: Way, close: Close, cap: float, tolerance: float
) -> tuple[float, int, float]:
    """Return how near the robot's edges come to others, and where: metres, motion and share of it.

    It is the distance at that place, and the true one at most the tolerance less. The motion is -1 if none is nearer
    than ``cap`` (metres). The tolerance is in metres, above 0; other arguments are those of :func:`meetings`.
    """
    best, motion, share, robot = cap, -1, 0.0, _Body(body, radius, _reach(body), np.empty_like(body))
    near, n, group = np.empty(1024, np.int64), 0, -1
    shares, edges = np.empty((DEEPEST, 2)), np.empty((DEEPEST, 2), np.int64)
    last = len(way.starts) - 1
    # The ends of all motions first: then most of what lies between them needs no close look.
    for step in range(2 * last + 3):
        between = step > last + 1
        i = step - last - 2 if between else min(step, last)
        if close.groups[i] != group:
            group = close.groups[i]
            near, n = _edges_near(near, close, group)
        shares[0, 0], shares[0, 1], edges[0, 0], edges[0, 1], depth = 0.0, 1.0, 0, n, 1
        if not between:
            shares[0] = 1.0 if step > last else 0.0
        while depth > 0 and (best > tolerance or not between):
            depth -= 1
            low, high, end = shares[depth, 0], shares[depth, 1], edges[depth, 1]
            middle = 0.5 * (low + high)
            span, slack = (low, high), best - tolerance
            near, left, overlap, _ = _look(robot, way, close, i, span, best, slack, near, edges[depth, 0], end)
            if max(0.0, -overlap) < best:
                best, motion, share = max(0.0, -overlap), i, middle
            if between and left > end and depth + 2 <= DEEPEST:
                depth = _push(shares, edges, depth, (low, middle, middle, high), end, left)
    return best, motion, share


@callee
def _push(shares: FloatArray, edges: IntArray, depth: int, spans: Four, begin: int, end: int) -> int:
    """Put two intervals on the stack, the first on top, with the edges to look at; return its new height."""
    for k in range(2):
        shares[depth + 1 - k, 0], shares[depth + 1 - k, 1] = spans[2 * k], spans[2 * k + 1]
        edges[depth + k, 0], edges[depth + k, 1] = begin, end
    return depth + 2


@array_callee
def _look(
    robot: _Body,
    way: Way,
    close: Close,
    i: int,
    span: tuple[float, float],
    far: float,
    slack: float,
    near: IntArray,
    begin: int,
    end: int,
) -> tuple[IntArray, int, float, float]:
    """Look at an interval of a motion: write which edges may come near in it behind those that are looked at.

    Args:
        robot: likewise.
        way: the motions.
        close: the edges near them.
        i: which motion.
        span: shares of it from which and to which the interval goes.
        far: metres from the robot from which on edges make no difference.
        slack: metres, nearer than which an edge may come that is written.
        near: edges.
        begin: where those that are looked at begin.
        end: where they end.

    Returns:
        The edges, in a larger array if need be, and where those written end; how far the robot's edges may move from
        the interval's middle and surely still meet one of them, below 0 their distance; and how far they do move.
    """
    x, y, move = _interval(robot, way, i, 0.5 * (span[0] + span[1]), 0.5 * (span[1] - span[0]))
    while 2 * end - begin > len(near):
        near = _doubled(near)
    straight = hypot(move[0], move[1]) + move[3]
    farthest, left, overlap = robot.sweep + robot.radius + straight + far, end, -np.inf
    for k in range(begin, end):
        ax, ay, bx, by, thick = close.edges[near[k]]
        edge = (ax - x, ay - y, bx - x, by - y)
        if _nearest(0.0, 0.0, edge)[0] - thick <= farthest:
            deep, may = _beside(robot.placed, edge, thick + robot.radius, slack, move)
            overlap = max(overlap, deep)
            if may:
                near[left] = near[k]
                left += 1
    return near, left, overlap, straight + robot.sweep * abs(move[2])


@callee
def _beside(placed: FloatArray, edge: Four, radius: float, slack: float, move: Four) -> tuple[float, bool]:
    """Return how far the robot may move and surely still meet an edge, and whether it may come near it.

    The first is below 0 their distance; two that cross do so until an end of one comes upon the other. The second is
    False only if they stay farther apart than ``slack`` all along the interval.

    Args:
        placed: (b, 4) the robot's edges about its reference point in the middle of the interval.
        edge: x and y of either end about the same point, metres.
        radius: by which the edges are thickened together, metres.
        slack: metres.
        move: half of the way in the interval, x and y in metres; half of the turn in it, radians; metres by which the
            way leaves its tangent at most.
    """
    overlap, may = -np.inf, False
    vx, vy, turn, bend = move
    for px, py, qx, qy in placed:
        own = (px, py, qx, qy)
        gap, nx, ny = _apart(own, edge)
        cross = _cross(own, edge)
        overlap = max(overlap, max(gap, radius) if cross else radius - gap)
        may = may or cross or gap <= radius + slack
        behind = max(nx * edge[0] + ny * edge[1], nx * edge[2] + ny * edge[3]) + radius + slack
        for x, y in ((px, py), (qx, qy)):
            moved = abs(nx * vx + ny * vy + turn * (ny * x - nx * y)) + bend + 0.5 * turn * turn * hypot(x, y)
            may = may or nx * x + ny * y - behind <= moved
    return overlap, may


@callee
def _reach(body: FloatArray) -> float:
    """Return the largest distance of the edges from the reference point, metres."""
    reach = 0.0
    for ax, ay, bx, by in body:
        reach = max(reach, hypot(ax, ay), hypot(bx, by))
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


@array_callee
def _interval(robot: _Body, way: Way, i: int, middle: float, half: float) -> tuple[float, float, Four]:
    """Return where the robot is in the middle of an interval of motion ``i``, x and y, and half of how it moves in it.

    The latter is the way along the tangent, the turn, and how far the way leaves its tangent at most. The robot's edges
    about that place are written to their room.
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
    for k in range(len(robot.edges)):
        ax, ay, bx, by = robot.edges[k]
        robot.placed[k, 0], robot.placed[k, 1] = c * ax - s * ay, s * ax + c * ay
        robot.placed[k, 2], robot.placed[k, 3] = c * bx - s * by, s * bx + c * by
    return x, y, (vx, vy, turn, bend)


@callee
def _apart(first: Four, second: Four) -> tuple[float, float, float]:
    """Return how near an end of one segment comes to the other one, and the direction from the second to the first."""
    gap, nx, ny = np.inf, 0.0, 0.0
    for one, other, sign in ((first, second, 1.0), (second, first, -1.0)):
        for k in range(2):
            distance, x, y = _nearest(one[2 * k], one[2 * k + 1], other)
            if distance < gap:
                gap, nx, ny = distance, sign * x, sign * y
    return gap, nx, ny


@callee
def _nearest(px: float, py: float, edge: Four) -> tuple[float, float, float]:
    """Return the distance of a point from a segment, and the direction from there to it."""
    ax, ay, bx, by = edge
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
def _cross(first: Four, second: Four) -> bool:
    """Return whether two segments cross each other."""
    return _parted(first, second) and _parted(second, first)


@callee
def _parted(line: Four, ends: Four) -> bool:
    """Return whether the ends of a segment lie on different sides of a line."""
    dx, dy = line[2] - line[0], line[3] - line[1]
    a = dx * (ends[1] - line[1]) - dy * (ends[0] - line[0])
    b = dx * (ends[3] - line[1]) - dy * (ends[2] - line[0])
    return (a > 0.0) != (b > 0.0)
