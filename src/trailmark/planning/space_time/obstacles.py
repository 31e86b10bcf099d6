"""MovingObstacles: obstacles that move in straight lines, and whether a robot that moves too stays clear of them.

In the frame of an obstacle with velocity v, a robot that goes straight from a, at time s, to b, at time t, goes
straight from a - v·s to b - v·t, and turns as before. So a motion is certified against each obstacle as it is against
one that stands: for discs by the distance of a point from a segment, for other shapes by conservative advancement
(:func:`trailmark.verify.advance.may_meet`). Nothing is sampled.

Between two moments nothing gets into or out of an obstacle without crossing its outline: that one is not inside the
other is looked at for the first state of a path alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, fabs, hypot, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.footprint import Footprint
from trailmark.heading import turn
from trailmark.jit import array_callee, callee, njit
from trailmark.moving import Moving
from trailmark.se2 import ROTATION_WEIGHT, FloatArray
from trailmark.shapes import Disc
from trailmark.verify.advance import may_meet

__all__ = ["MovingObstacles", "motion_clear", "path_clear", "state_clear"]

ROUNDING = 1e-9
"""Metres: what comes closer does not count as clear."""

BUDGET = 2_000
"""Intervals of one motion that are looked at for one obstacle at most; a motion that needs more is not certified."""


class MovingObstacles(NamedTuple):
    """Moving obstacles and the robot that is to stay clear of them, as compiled code takes them. Metres and seconds.

    Attributes:
        edges: (e, 5) where the obstacles are at time 0: both ends of an edge, and by how much it is thickened. A disc
            is an edge of length 0.
        first: (k + 1,) where the edges of each obstacle begin.
        circles: (k, 3) x, y, radius of a circle that holds the obstacle at time 0; a disc itself.
        velocities: (k, 2).
        until: (k,) up to when each is foreseen; nothing is claimed for later times.
        body: (b, 4) the robot's edges in its own frame; one of length 0 for a disc.
        radius: by which they are thickened: the clearance that the robot keeps, and the radius of a disc.
        reach: largest distance of a point of the robot from its reference point.
        size: half of the shortest side of the obstacles' bounding boxes, the smallest disc's radius.
    """

    edges: FloatArray
    first: NDArray[np.int64]
    circles: FloatArray
    velocities: FloatArray
    until: FloatArray
    body: FloatArray
    radius: float
    reach: float
    size: float

    @classmethod
    def of(cls, obstacles: Sequence[Moving], robot: Footprint) -> MovingObstacles:
        """Return obstacles, at least one, and a robot as arrays."""
        edges: list[tuple[float, ...]] = []
        circles, first, size = [], [0], np.inf
        for shape in (obstacle.shape for obstacle in obstacles):
            if isinstance(shape, Disc):
                circles.append((*shape.center, shape.radius))
                edges.append((*shape.center, *shape.center, shape.radius))
                size = min(size, shape.radius)
            else:
                rings = shape.polygon().rings()
                low, high = rings[0].min(axis=0), rings[0].max(axis=0)
                center = 0.5 * (low + high)
                circles.append((*center, float(np.hypot(*(rings[0] - center).T).max())))
                edges += [(*edge, 0.0) for ring in rings for edge in _closed(ring)]
                size = min(size, 0.5 * float((high - low).min()))
            first.append(len(edges))
        return cls(
            np.array(edges),
            np.array(first),
            np.array(circles),
            np.array([obstacle.velocity for obstacle in obstacles]),
            np.array([obstacle.until for obstacle in obstacles]),
            np.zeros((1, 4)) if robot.is_disc else _closed(robot.outline),
            robot.dilation,
            robot.circumradius,
            size,
        )


def _closed(ring: FloatArray) -> FloatArray:
    """Return the edges of a ring (n, 2), shape (n, 4)."""
    return np.hstack([ring, np.roll(ring, -1, axis=0)])


@njit(nogil=True)
def path_clear(moving: MovingObstacles, states: FloatArray, speed: float) -> int:
    """Return the first motion of a path along which the robot may meet a moving obstacle; -1 if it stays clear.

    Args:
        moving: the obstacles and the robot.
        states: of the path, shape (n, 3), headings in [-pi, pi].
        speed: metres of cost (:attr:`trailmark.Path.cost`) per second.
    """
    if not state_clear(moving, states[0]):
        return 0
    begin = 0.0
    for i in range(len(states) - 1):
        a, b = states[i], states[i + 1]
        end = begin + (hypot(b[0] - a[0], b[1] - a[1]) + ROTATION_WEIGHT * fabs(turn(a[2], b[2]))) / speed
        if not motion_clear(moving, a, begin, b, end):
            return i
        begin = end
    return -1


@njit(nogil=True, numbers=True)
def motion_clear(moving: MovingObstacles, a: FloatArray, begin: float, b: FloatArray, end: float) -> bool:
    """Return whether the robot meets no outline on a straight motion from a at time ``begin`` to b at time ``end``."""
    for k in range(len(moving.until)):
        if begin >= moving.until[k]:
            continue
        share = 1.0 if end <= moving.until[k] else (moving.until[k] - begin) / (end - begin)
        vx, vy = moving.velocities[k]
        cx, cy, r = moving.circles[k]
        span = share * (end - begin)
        x, y = a[0] - cx - begin * vx, a[1] - cy - begin * vy
        dx, dy = share * (b[0] - a[0]) - span * vx, share * (b[1] - a[1]) - span * vy
        square = dx * dx + dy * dy
        t = min(1.0, max(0.0, -(x * dx + y * dy) / square)) if square > 0.0 else 0.0
        if hypot(x + t * dx, y + t * dy) >= r + moving.reach + ROUNDING:
            continue
        first, last = moving.first[k], moving.first[k + 1]
        if len(moving.body) == 1 and last - first == 1:
            return False
        edges = moving.edges[first:last]
        if not _clear_of(moving, edges, x + cx, y + cy, a[2], dx, dy, share * turn(a[2], b[2])):
            return False
    return True


@njit(numbers=True)
def state_clear(moving: MovingObstacles, q: FloatArray) -> bool:
    """Return whether the robot overlaps no obstacle in a configuration, shape (3,), at time 0."""
    if not motion_clear(moving, q, 0.0, q, 0.0):
        return False
    c, s = cos(q[2]), sin(q[2])
    px = q[0] + c * moving.body[0, 0] - s * moving.body[0, 1]
    py = q[1] + s * moving.body[0, 0] + c * moving.body[0, 1]
    for k in range(len(moving.until)):
        edges = moving.edges[moving.first[k] : moving.first[k + 1]]
        dx, dy = edges[0, 0] - q[0], edges[0, 1] - q[1]
        if _encloses(edges, px, py) or _encloses(moving.body, c * dx + s * dy, c * dy - s * dx):
            return False
    return True


@callee
def _encloses(edges: FloatArray, x: float, y: float) -> bool:
    """Return whether a point lies inside closed rings of edges (even-odd rule)."""
    inside = False
    for k in range(len(edges)):
        x1, y1, x2, y2 = edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3]
        if (y1 > y) != (y2 > y) and x < x1 + (y - y1) / (y2 - y1) * (x2 - x1):
            inside = not inside
    return inside


@array_callee
def _clear_of(
    moving: MovingObstacles,
    edges: FloatArray,
    x: float,
    y: float,
    theta: float,
    dx: float,
    dy: float,
    dtheta: float,
) -> bool:
    """Return whether the robot meets no edge on a straight motion from (x, y, theta) by (dx, dy, dtheta)."""
    body, low, high, depth = moving.body, np.empty(64), np.empty(64), 1
    placed = np.empty_like(body)
    low[0], high[0] = 0.0, 1.0
    for _ in range(BUDGET):
        if depth == 0:
            return True
        depth -= 1
        begin, end = low[depth], high[depth]
        half, middle = 0.5 * (end - begin), 0.5 * (begin + end)
        mx, my, heading = x + middle * dx, y + middle * dy, theta + middle * dtheta
        c, s = cos(heading), sin(heading)
        for k in range(len(body)):
            placed[k, 0], placed[k, 1] = c * body[k, 0] - s * body[k, 1], s * body[k, 0] + c * body[k, 1]
            placed[k, 2], placed[k, 3] = c * body[k, 2] - s * body[k, 3], s * body[k, 2] + c * body[k, 3]
        meets = False
        for k in range(len(edges)):
            x1, y1, x2, y2, thickness = edges[k]
            gap = thickness + moving.radius + ROUNDING
            vx, vy, turned = half * dx, half * dy, half * dtheta
            if may_meet(placed, x1 - mx, y1 - my, x2 - mx, y2 - my, gap, vx, vy, turned, 0.0):
                meets = True
                break
        if not meets:
            continue
        if half * (hypot(dx, dy) + moving.reach * fabs(dtheta)) < ROUNDING or depth + 2 > len(low):
            return False
        low[depth], high[depth] = middle, end
        low[depth + 1], high[depth + 1] = begin, middle
        depth += 2
    return False
