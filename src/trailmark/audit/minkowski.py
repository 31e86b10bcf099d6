"""Minkowski differences of polygons made of convex pieces, and how far the origin is inside of them, compiled.

With the robot's reference point at the origin, it overlaps an obstacle if and only if the origin lies inside the
difference of the two; the shortest translation out leads to the nearest point inside of no piece's difference.
"""

from __future__ import annotations

from math import cos, hypot, sin

import numpy as np

from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray
from trailmark.sorting import order_of

__all__ = ["penetration_depths"]

SLIVER = 1e-9
"""Share of an edge: a gap between two pieces that is no wider is rounding."""


@callee
def _lowest(polygon: FloatArray) -> int:
    best = 0
    for k in range(1, len(polygon)):
        if polygon[k, 1] < polygon[best, 1] or (polygon[k, 1] == polygon[best, 1] and polygon[k, 0] < polygon[best, 0]):
            best = k
    return best


@callee
def _add_convex(a: FloatArray, b: FloatArray, total: FloatArray) -> None:
    """Write the Minkowski sum of two convex polygons, counter-clockwise, into ``total``: as many vertices as both."""
    n, m = len(a), len(b)
    i0, j0 = _lowest(a), _lowest(b)
    i = j = 0
    for k in range(n + m):
        p, q = a[(i0 + i) % n], b[(j0 + j) % m]
        total[k, 0], total[k, 1] = p[0] + q[0], p[1] + q[1]
        p2, q2 = a[(i0 + i + 1) % n], b[(j0 + j + 1) % m]
        cross = (p2[0] - p[0]) * (q2[1] - q[1]) - (p2[1] - p[1]) * (q2[0] - q[0])
        if j == m or (i < n and cross >= 0.0):
            i += 1
        else:
            j += 1


@callee
def _covered(hull: FloatArray, px: float, py: float, dx: float, dy: float) -> tuple[float, float]:
    """Return the part (low, high) of the line p + t·d, 0 <= t <= 1, inside of a convex polygon; low > high if none."""
    low, high = 0.0, 1.0
    n = len(hull)
    for k in range(n):
        ax, ay = hull[k]
        ex, ey = hull[(k + 1) % n, 0] - ax, hull[(k + 1) % n, 1] - ay
        at, rate = ex * (py - ay) - ey * (px - ax), ex * dy - ey * dx
        if rate == 0.0:
            if at <= 0.0 and (ex != 0.0 or ey != 0.0):
                return 1.0, 0.0
        elif rate > 0.0:
            low = max(low, -at / rate)
        else:
            high = min(high, -at / rate)
        if low >= high:
            return 1.0, 0.0
    return low, high


@callee
def _origin_depth(hulls: FloatArray) -> float:
    """Return how far the origin is from the nearest point that lies inside of none of the hulls, shape (k, n, 2)."""
    k, n = hulls.shape[:2]
    inside = False
    edges, distances = np.empty((k * n, 5)), np.empty(k * n)
    for i in range(k):
        holds = True
        for j in range(n):
            ax, ay = hulls[i, j]
            dx, dy = hulls[i, (j + 1) % n, 0] - ax, hulls[i, (j + 1) % n, 1] - ay
            norm = dx * dx + dy * dy
            foot = min(1.0, max(0.0, -(ax * dx + ay * dy) / norm)) if norm > 0.0 else 0.0
            holds &= norm == 0.0 or ax * dy - ay * dx < 0.0
            edges[i * n + j] = np.array([ax, ay, dx, dy, foot])
            distances[i * n + j] = hypot(ax + foot * dx, ay + foot * dy)
        inside |= holds
    best = np.inf
    parts = np.empty((k, 2))
    # Inside a union of overlapping regions although of none of them strictly: on the edges between them.
    if not inside:
        for i in range(k):
            low, high = _covered(hulls[i], -1e-9, -1e-9, 2e-9, 2e-9)
            inside |= low < 0.5 < high
        if not inside:
            return 0.0
    for e in order_of(distances):
        if distances[e] >= best:
            break
        ax, ay, dx, dy, foot = edges[e]
        if dx == 0.0 and dy == 0.0:
            continue
        count = 0
        for i in range(k):
            if i == e // n:
                continue
            low, high = _covered(hulls[i], ax, ay, dx, dy)
            if low < high:
                parts[count, 0], parts[count, 1] = low, high
                count += 1
        # What lies free of the edge, from one covered part to the next: the place in it that is nearest.
        reached = 0.0
        order = order_of(parts[:count, 0])
        for step in range(count + 1):
            begin = parts[order[step], 0] if step < count else 1.0
            if begin > reached + SLIVER or (step == count and reached == 0.0):
                at = min(begin, max(reached, foot))
                best = min(best, hypot(ax + at * dx, ay + at * dy))
            if step < count:
                reached = max(reached, parts[order[step], 1])
    return best


@njit(nogil=True)
def penetration_depths(obstacle: FloatArray, robot: FloatArray, states: FloatArray) -> FloatArray:
    """Return the shortest translations (metres, shape (n,)) that take a robot out of an obstacle; 0 if it is outside.

    Args:
        obstacle: convex pieces of the same number of vertices, counter-clockwise, shape (k, m, 2).
        robot: likewise, in the robot's frame.
        states: configurations, shape (n, 3).
    """
    k, m = obstacle.shape[:2]
    parts, n = robot.shape[:2]
    result = np.empty(len(states))
    turned, piece = np.empty((parts, n, 2)), np.empty((m, 2))
    near = np.empty(k, np.bool_)
    span = 0.0
    for part in range(parts):
        for v in range(n):
            span = max(span, hypot(robot[part, v, 0], robot[part, v, 1]))
    for index in range(len(states)):
        x, y, theta = states[index]
        c, s = cos(theta), sin(theta)
        for part in range(parts):
            for v in range(n):
                # The robot's points with the other sign: a sum is the difference then.
                turned[part, v, 0] = -(c * robot[part, v, 0] - s * robot[part, v, 1])
                turned[part, v, 1] = -(s * robot[part, v, 0] + c * robot[part, v, 1])
        reach = 0.25 * span
        while True:
            # Pieces farther away than the robot is moved do not matter.
            count = 0
            for i in range(k):
                x1 = y1 = np.inf
                x2 = y2 = -np.inf
                for v in range(m):
                    x1, x2 = min(x1, obstacle[i, v, 0] - x), max(x2, obstacle[i, v, 0] - x)
                    y1, y2 = min(y1, obstacle[i, v, 1] - y), max(y2, obstacle[i, v, 1] - y)
                near[i] = x1 <= span + reach and x2 >= -span - reach and y1 <= span + reach and y2 >= -span - reach
                count += near[i]
            hulls = np.empty((count * parts, m + n, 2))
            row = 0
            for i in range(k):
                if not near[i]:
                    continue
                for v in range(m):
                    piece[v, 0], piece[v, 1] = obstacle[i, v, 0] - x, obstacle[i, v, 1] - y
                for part in range(parts):
                    _add_convex(piece, turned[part], hulls[row])
                    row += 1
            depth = _origin_depth(hulls) if count > 0 else 0.0
            if depth <= reach or count == k:
                result[index] = depth
                break
            reach *= 2.0
    return result
