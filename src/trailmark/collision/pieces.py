"""Short pieces of a motion, on which every point of the robot moves as good as straight: exact events and distances.

On a piece that is short enough, each vertex of the robot, as the world sees it, and each vertex of an obstacle, as the
robot sees it, goes along its chord to within a stated error. Two polygons meet first, and come nearest, where a vertex
of one meets an edge of the other: so all that happens on a piece follows from points that move along a chord and from
segments that stand still.
"""

from __future__ import annotations

from math import cos, floor, hypot, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.body import Body
from trailmark.collision.certify import StraightTrack
from trailmark.collision.distances import point_clearance, ring_clearance
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.jit import callee
from trailmark.se2 import FloatArray

__all__ = ["LONGEST", "chord_error", "nearby", "overlapping", "pose_on", "sweep"]

LONGEST = 4.0
"""Circumradii that a piece is long at most: over a longer one, too many obstacles are near."""

TOUCHED = 1e-9
"""Metres: what comes nearer than this to the core overlaps it, as far as rounding tells."""


@callee
def chord_error(length: float, speed: float, turn: float, turning: float, reach: float) -> float:
    """Return how far (metres) a point may be off its chord on a piece of a motion.

    Args:
        length: of the piece, on the motion's scale.
        speed: metres that the reference point moves for each metre of the scale.
        turn: radians that the robot turns for each metre of the scale, positive.
        turning: largest distance of the robot from its reference point; 0 for a disc, which turning does not move.
        reach: largest distance of an obstacle's point from the reference point.
    """
    # The acceleration of a point at distance r from the reference point is turn²·r; seen from the robot, where the
    # reference point moves too, another 2·turn·speed. A chord is off by an eighth of it times the square of the time.
    if turning == 0.0:
        return 0.0
    return 0.125 * length * length * turn * (turn * max(turning, reach) + 2.0 * speed)


@callee
def pose_on(track: StraightTrack, along: float) -> FloatArray:
    """Return the configuration at a place on the track's scale, shape (3,), the heading not wrapped."""
    return np.array([track.x + along * track.dx, track.y + along * track.dy, track.theta + along * track.dtheta])


@callee
def overlapping(grid: ObstacleGrid, body: Body, placed: FloatArray, x: float, y: float, theta: float) -> bool:
    """Return whether the body at a configuration overlaps what is blocked; ``placed`` is memory, shape (n, 2)."""
    if body.radius > 0.0:
        return bool(point_clearance(grid, x, y, body.radius + TOUCHED) < body.radius)
    c, s = cos(theta), sin(theta)
    for part in range(len(body.first) - 1):
        n = 0
        for k in range(body.first[part], body.first[part + 1]):
            placed[n, 0] = c * body.vertices[k, 0] - s * body.vertices[k, 1]
            placed[n, 1] = s * body.vertices[k, 0] + c * body.vertices[k, 1]
            n += 1
        if ring_clearance(grid, placed, n, x, y, TOUCHED) == 0.0:
            return True
    return False


@callee
def nearby(grid: ObstacleGrid, x: float, y: float, reach: float, memory: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the items of the cells within ``reach`` (metres) of (x, y) along either axis.

    What is returned is ``memory``, or more of it where that is too little: the items stand at 1 to [0] - 1.
    """
    left = max(0, floor((x - reach - grid.x0) / grid.size))
    right = min(grid.columns - 1, floor((x + reach - grid.x0) / grid.size))
    low = max(0, floor((y - reach - grid.y0) / grid.size))
    high = min(grid.rows - 1, floor((y + reach - grid.y0) / grid.size))
    count = 1
    last = before = len(grid.segments)  # no item's number
    for row in range(low, high + 1 if left <= right else low):
        for k in range(grid.cell_start[row, left], grid.cell_start[row, right + 1]):
            item = grid.items[k]
            # An item lies in many consecutive cells.
            if item in (last, before):
                continue
            last, before = item, last
            if count == len(memory):
                more = np.empty(2 * count, np.int64)
                more[:count] = memory
                memory = more
            memory[count] = item
            count += 1
    memory[0] = count
    return memory


@callee
def _seen(x: float, y: float, c: float, s: float, px: float, py: float) -> tuple[float, float]:
    """Return a point as a robot at (x, y), whose heading has cosine c and sine s, sees it."""
    dx, dy = px - x, py - y
    return c * dx + s * dy, c * dy - s * dx


@callee
def _of_segment(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> tuple[float, float]:
    """Return the squared distance of a point to a segment, and where on the segment, 0 to 1, it is nearest."""
    dx, dy, wx, wy = bx - ax, by - ay, px - ax, py - ay
    norm, along = dx * dx + dy * dy, wx * dx + wy * dy
    if along <= 0.0 or norm == 0.0:
        return wx * wx + wy * wy, 0.0
    if along >= norm:
        wx, wy = px - bx, py - by
        return wx * wx + wy * wy, 1.0
    # Across the segment: by the cross product, which keeps small distances exact.
    cross = dx * wy - dy * wx
    return cross * cross / norm, along / norm


@callee
def _chord_distance(
    px: float, py: float, qx: float, qy: float, ax: float, ay: float, bx: float, by: float
) -> tuple[float, float]:
    """Return the squared distance of the chord pq to the segment ab, and where on the chord; 0 where they cross."""
    dx, dy, ex, ey = qx - px, qy - py, bx - ax, by - ay
    sa = dx * (ay - py) - dy * (ax - px)
    sb = dx * (by - py) - dy * (bx - px)
    if (sa > 0.0) != (sb > 0.0):
        sp = ex * (py - ay) - ey * (px - ax)
        sq = ex * (qy - ay) - ey * (qx - ax)
        if (sp > 0.0) != (sq > 0.0):
            return 0.0, sp / (sp - sq)
    best, at = _of_segment(px, py, ax, ay, bx, by)[0], 0.0
    other = _of_segment(qx, qy, ax, ay, bx, by)[0]
    if other < best:
        best, at = other, 1.0
    for x, y in ((ax, ay), (bx, by)):
        other, along = _of_segment(x, y, px, py, qx, qy)
        if other < best:
            best, at = other, along
    return best, at


@callee
def _add_roots(b: float, c: float, a: float, times: FloatArray, count: int) -> int:
    """Add the roots of a·t² + 2·b·t + c that lie in [0, 1]."""
    if a == 0.0:
        return count
    inside = b * b - a * c
    if inside <= 0.0:
        return count
    half = -b - sqrt(inside) if b > 0.0 else -b + sqrt(inside)
    for t in (half / a, c / half if half != 0.0 else -1.0):
        if 0.0 < t < 1.0 and count < len(times):
            times[count] = t
            count += 1
    return count


@callee
def _add_events(
    px: float,
    py: float,
    qx: float,
    qy: float,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    radius: float,
    at: float,
    times: FloatArray,
    count: int,
) -> int:
    """Add the times, 0 to 1, at which a point on its chord pq may come to be ``radius`` from the segment ab.

    ``at`` is the time at which the two are nearest, which is when they cross, if they do.
    """
    if radius == 0.0:
        if count < len(times):
            times[count] = at
            count += 1
        return count
    dx, dy, ex, ey = qx - px, qy - py, bx - ax, by - ay
    length = hypot(ex, ey)
    if length > 0.0:
        sp = (ex * (py - ay) - ey * (px - ax)) / length
        sq = (ex * (qy - ay) - ey * (qx - ax)) / length
        for side in (radius, -radius):
            if (sp > side) != (sq > side) and count < len(times):
                times[count] = (sp - side) / (sp - sq)
                count += 1
    for cx, cy in ((ax, ay), (bx, by)):
        wx, wy = px - cx, py - cy
        count = _add_roots(wx * dx + wy * dy, wx * wx + wy * wy - radius * radius, dx * dx + dy * dy, times, count)
    return count


@callee
def sweep(
    grid: ObstacleGrid,
    body: Body,
    items: NDArray[np.int64],
    start: FloatArray,
    end: FloatArray,
    cap: float,
    times: FloatArray,
) -> tuple[int, float, float]:
    """Find when the body may begin or cease to overlap items on a piece of a motion, and how near it comes to them.

    Args:
        grid: the obstacles.
        body: of the robot.
        items: those that are near.
        start: configuration, shape (3,).
        end: configuration, shape (3,), whose heading is not wrapped.
        cap: metres; larger distances are not sought.
        times: where the events go, 0 to 1, in no order.

    Returns:
        The number of events, all of ``times`` if there may be more; the least distance, 0 if there are events and
        ``cap`` if it is not below; when it comes, 0 to 1.
    """
    count, n = 0, len(body.vertices)
    least, when = cap, 0.0
    # Relative to the piece's start, where coordinates are small and rounding with them.
    ox, oy = start[0], start[1]
    ex, ey = end[0] - ox, end[1] - oy
    disc = body.radius > 0.0
    c0, s0 = (1.0, 0.0) if disc else (cos(start[2]), sin(start[2]))
    c1, s1 = (1.0, 0.0) if disc else (cos(end[2]), sin(end[2]))
    x1 = y1 = np.inf
    x2 = y2 = -np.inf
    placed = np.empty((n, 4))
    for k in range(n):
        vx, vy = body.vertices[k]
        placed[k, 0], placed[k, 1] = c0 * vx - s0 * vy, s0 * vx + c0 * vy
        placed[k, 2], placed[k, 3] = ex + c1 * vx - s1 * vy, ey + s1 * vx + c1 * vy
        x1, x2 = min(x1, placed[k, 0], placed[k, 2]), max(x2, placed[k, 0], placed[k, 2])
        y1, y2 = min(y1, placed[k, 1], placed[k, 3]), max(y2, placed[k, 1], placed[k, 3])
    for item in items:
        if item >= 0:
            ax, ay = grid.segments[item, 0] - ox, grid.segments[item, 1] - oy
            bx, by = grid.segments[item, 2] - ox, grid.segments[item, 3] - oy
            radius = body.radius
        else:
            ax, ay = grid.discs[-1 - item, 0] - ox, grid.discs[-1 - item, 1] - oy
            bx, by = ax, ay
            radius = body.radius + grid.discs[-1 - item, 2]
        reach = least + radius
        if min(ax, bx) > x2 + reach or max(ax, bx) < x1 - reach or min(ay, by) > y2 + reach or max(ay, by) < y1 - reach:
            continue
        if item >= 0:
            for k in range(n):
                px, py, qx, qy = placed[k]
                found, at = _chord_distance(px, py, qx, qy, ax, ay, bx, by)
                if found <= radius * radius:
                    count = _add_events(px, py, qx, qy, ax, ay, bx, by, radius, at, times, count)
                if found < (least + radius) * (least + radius):
                    least, when = max(0.0, sqrt(found) - radius), at
            if disc:
                continue
        # Every vertex of an obstacle is the start of a segment.
        px, py = _seen(0.0, 0.0, c0, s0, ax, ay)
        qx, qy = _seen(ex, ey, c1, s1, ax, ay)
        for k in range(n):
            vx, vy = body.vertices[k]
            wx, wy = body.vertices[body.following[k]]
            found, at = _chord_distance(px, py, qx, qy, vx, vy, wx, wy)
            if found <= radius * radius:
                count = _add_events(px, py, qx, qy, vx, vy, wx, wy, radius, at, times, count)
            if found < (least + radius) * (least + radius):
                least, when = max(0.0, sqrt(found) - radius), at
    return count, least, when
