"""The shortest path of a point in a triangulated polygon, exactly.

Source: Cui, Harabor & Grastien, "Compromise-free pathfinding on a navigation mesh", IJCAI 2017 (Polyanya). A node
of the search is a root, where the path bends last, and an interval of an edge that is seen from there; its key is the
length of the shortest way from start to root, through the interval, to the goal as if nothing lay behind it.
"""

from __future__ import annotations

from math import hypot

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.planning.lower_bound.mesh import Mesh, locate

__all__ = ["shortest_way"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

START = -2
"""In place of a vertex: the start."""

NOWHERE = -1
"""In place of a vertex: a point within an edge."""

TIE = 1e-12
"""Shares of an edge, and metres of length, that count as nothing."""


def shortest_way(mesh: Mesh, start: FloatArray, goal: FloatArray) -> tuple[float, FloatArray]:
    """Return the length (metres) of the shortest path and its bends, shape (k, 2), ends included.

    Args:
        mesh: the region.
        start: shape (2,).
        goal: shape (2,).

    Returns:
        Infinity and no bends if an end lies outside of the mesh, or nothing joins them.
    """
    first, last = locate(mesh, start), locate(mesh, goal)
    if first < 0 or last < 0:
        return np.inf, np.empty((0, 2))
    if first == last:
        return float(np.hypot(*(goal - start))), np.array([start, goal])
    length, bends, end = _search(
        mesh.points, mesh.triangles, mesh.neighbours, mesh.corner, np.array(start), first, np.array(goal), last
    )
    if not np.isfinite(length):
        return np.inf, np.empty((0, 2))
    way = [start, *mesh.points[bends[::-1]], end, goal]
    # The last interval is crossed on the straight line, or at its end.
    kept = [np.asarray(p) for i, p in enumerate(way) if i == 0 or np.hypot(*(p - way[i - 1])) > 0.0]
    return float(length), np.array(kept)


@njit(cache=True, inline="always")
def _turn(ox: float, oy: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return a value above 0 if b lies left of the ray from o to a, below 0 if right."""
    return (ax - ox) * (by - oy) - (ay - oy) * (bx - ox)


@njit(cache=True)
def _hit(
    px: float, py: float, x: float, y: float, ax: float, ay: float, bx: float, by: float
) -> tuple[float, float, float]:
    """Return where the ray from p through (x, y) meets the edge from a to b, and at which share of it, in [0, 1]."""
    first, second = _turn(px, py, x, y, ax, ay), _turn(px, py, x, y, bx, by)
    share = first / (first - second) if first != second else 0.0
    share = min(1.0, max(0.0, share))
    return ax + share * (bx - ax), ay + share * (by - ay), share


@njit(cache=True)
def _through(
    px: float, py: float, lx: float, ly: float, rx: float, ry: float, gx: float, gy: float
) -> tuple[float, float, float]:
    """Return the length of the shortest way from p through the interval from l to r to g, and where it crosses."""
    dx, dy = lx - rx, ly - ry
    norm = dx * dx + dy * dy
    if norm == 0.0:
        return hypot(lx - px, ly - py) + hypot(gx - lx, gy - ly), lx, ly
    side_p, side_g = _turn(rx, ry, lx, ly, px, py), _turn(rx, ry, lx, ly, gx, gy)
    mx, my = gx, gy
    if side_p * side_g > 0.0:
        # On the same side: as far from the interval's line on the other.
        along = ((gx - rx) * dx + (gy - ry) * dy) / norm
        fx, fy = rx + along * dx, ry + along * dy
        mx, my = 2.0 * fx - gx, 2.0 * fy - gy
        side_g = -side_g
    if side_p == side_g:
        # All on one line.
        t = ((px - rx) * dx + (py - ry) * dy) / norm
    else:
        share = side_p / (side_p - side_g)
        cx, cy = px + share * (mx - px), py + share * (my - py)
        t = ((cx - rx) * dx + (cy - ry) * dy) / norm
    t = min(1.0, max(0.0, t))
    cx, cy = rx + t * dx, ry + t * dy
    return hypot(cx - px, cy - py) + hypot(gx - cx, gy - cy), cx, cy


@njit(cache=True, nogil=True)
def _search(
    points: FloatArray,
    triangles: IntArray,
    neighbours: IntArray,
    corner: NDArray[np.bool_],
    start: FloatArray,
    first: int,
    goal: FloatArray,
    last: int,
) -> tuple[float, IntArray, FloatArray]:
    """Return the length, the vertices at which the path bends, goal first, and where it crosses the last interval."""
    gx, gy = goal[0], goal[1]
    best = np.full(len(points), np.inf)
    capacity = 1024
    # Per node: interval's ends l and r (x, y), length to the root; vertices at l and r, root, triangle ahead, the
    # triangle's edge that the interval lies on, parent.
    places, ids = np.empty((capacity, 5)), np.empty((capacity, 6), np.int64)
    keys, values = np.empty(capacity), np.empty(capacity, np.int64)
    count, size = 0, 0
    # What one node leads to: at most four intervals.
    found, kinds = np.empty((4, 5)), np.empty((4, 4), np.int64)
    current, triangle, j = -1, first, -1
    end = np.empty(2)
    while True:
        n = 0
        if current < 0:
            for i in range(3):
                right, left = triangles[first, i], triangles[first, (i + 1) % 3]
                found[n, 0], found[n, 1] = points[left, 0], points[left, 1]
                found[n, 2], found[n, 3], found[n, 4] = points[right, 0], points[right, 1], 0.0
                kinds[n, 0], kinds[n, 1], kinds[n, 2], kinds[n, 3] = left, right, START, i
                n += 1
        else:
            lx, ly, rx, ry = places[current, 0], places[current, 1], places[current, 2], places[current, 3]
            length = places[current, 4]
            at_l, at_r, root = ids[current, 0], ids[current, 1], ids[current, 2]
            px, py = (start[0], start[1]) if root == START else (points[root, 0], points[root, 1])
            left, right, apex = (
                triangles[triangle, j],
                triangles[triangle, (j + 1) % 3],
                triangles[triangle, (j + 2) % 3],
            )
            vx, vy = points[apex, 0], points[apex, 1]
            beyond_left = _turn(px, py, lx, ly, vx, vy) > 0.0
            beyond_right = _turn(px, py, rx, ry, vx, vy) < 0.0
            if beyond_left:
                # The apex lies left of all that is seen: only the right edge is.
                x1, y1, s1 = _hit(px, py, lx, ly, vx, vy, points[right, 0], points[right, 1])
                x2, y2, s2 = _hit(px, py, rx, ry, vx, vy, points[right, 0], points[right, 1])
                if at_r == right:
                    x2, y2, s2 = points[right, 0], points[right, 1], 1.0
                found[n, 0], found[n, 1], found[n, 2], found[n, 3], found[n, 4] = x1, y1, x2, y2, length
                kinds[n, 0] = apex if s1 <= TIE else (right if s1 >= 1.0 - TIE else NOWHERE)
                kinds[n, 1] = right if s2 >= 1.0 - TIE else (apex if s2 <= TIE else NOWHERE)
                kinds[n, 2], kinds[n, 3] = root, (j + 1) % 3
                n += 1
                if at_l == left and corner[left]:
                    longer = length + hypot(lx - px, ly - py)
                    if longer <= best[left] + TIE:
                        best[left] = min(best[left], longer)
                        found[n, 0], found[n, 1], found[n, 2], found[n, 3], found[n, 4] = vx, vy, x1, y1, longer
                        kinds[n, 0], kinds[n, 1], kinds[n, 2], kinds[n, 3] = apex, kinds[n - 1, 0], left, (j + 1) % 3
                        n += 1
                        found[n, 0], found[n, 1], found[n, 2], found[n, 3], found[n, 4] = lx, ly, vx, vy, longer
                        kinds[n, 0], kinds[n, 1], kinds[n, 2], kinds[n, 3] = left, apex, left, (j + 2) % 3
                        n += 1
            elif beyond_right:
                x1, y1, s1 = _hit(px, py, lx, ly, vx, vy, points[left, 0], points[left, 1])
                x2, y2, s2 = _hit(px, py, rx, ry, vx, vy, points[left, 0], points[left, 1])
                if at_l == left:
                    x1, y1, s1 = points[left, 0], points[left, 1], 1.0
                found[n, 0], found[n, 1], found[n, 2], found[n, 3], found[n, 4] = x1, y1, x2, y2, length
                kinds[n, 0] = left if s1 >= 1.0 - TIE else (apex if s1 <= TIE else NOWHERE)
                kinds[n, 1] = apex if s2 <= TIE else (left if s2 >= 1.0 - TIE else NOWHERE)
                kinds[n, 2], kinds[n, 3] = root, (j + 2) % 3
                n += 1
                if at_r == right and corner[right]:
                    longer = length + hypot(rx - px, ry - py)
                    if longer <= best[right] + TIE:
                        best[right] = min(best[right], longer)
                        found[n, 0], found[n, 1], found[n, 2], found[n, 3], found[n, 4] = x2, y2, vx, vy, longer
                        kinds[n, 0], kinds[n, 1], kinds[n, 2], kinds[n, 3] = kinds[n - 1, 1], apex, right, (j + 2) % 3
                        n += 1
                        found[n, 0], found[n, 1], found[n, 2], found[n, 3], found[n, 4] = vx, vy, rx, ry, longer
                        kinds[n, 0], kinds[n, 1], kinds[n, 2], kinds[n, 3] = apex, right, right, (j + 1) % 3
                        n += 1
            else:
                x1, y1, s1 = _hit(px, py, lx, ly, vx, vy, points[left, 0], points[left, 1])
                if at_l == left:
                    x1, y1, s1 = points[left, 0], points[left, 1], 1.0
                found[n, 0], found[n, 1], found[n, 2], found[n, 3], found[n, 4] = x1, y1, vx, vy, length
                kinds[n, 0] = left if s1 >= 1.0 - TIE else NOWHERE
                kinds[n, 1], kinds[n, 2], kinds[n, 3] = apex, root, (j + 2) % 3
                n += 1
                x2, y2, s2 = _hit(px, py, rx, ry, vx, vy, points[right, 0], points[right, 1])
                if at_r == right:
                    x2, y2, s2 = points[right, 0], points[right, 1], 1.0
                found[n, 0], found[n, 1], found[n, 2], found[n, 3], found[n, 4] = vx, vy, x2, y2, length
                kinds[n, 1] = right if s2 >= 1.0 - TIE else NOWHERE
                kinds[n, 0], kinds[n, 2], kinds[n, 3] = apex, root, (j + 1) % 3
                n += 1
        for k in range(n):
            ahead = neighbours[triangle, kinds[k, 3]]
            if ahead < 0:
                continue
            root = kinds[k, 2]
            px, py = (start[0], start[1]) if root == START else (points[root, 0], points[root, 1])
            rest, _, _ = _through(px, py, found[k, 0], found[k, 1], found[k, 2], found[k, 3], gx, gy)
            if count == capacity:
                capacity *= 2
                more_places, more_ids = np.empty((capacity, 5)), np.empty((capacity, 6), np.int64)
                more_places[:count], more_ids[:count] = places, ids
                places, ids = more_places, more_ids
            if size == len(keys):
                keys, values = heap_grow(keys, values)
            places[count] = found[k]
            ids[count, 0], ids[count, 1], ids[count, 2] = kinds[k, 0], kinds[k, 1], root
            ids[count, 3], ids[count, 5] = ahead, current
            for i in range(3):
                if (
                    neighbours[ahead, i] == triangle
                    and triangles[ahead, (i + 1) % 3] == triangles[triangle, kinds[k, 3]]
                ):
                    ids[count, 4] = i
            size = heap_push(keys, values, size, found[k, 4] + rest, count)
            count += 1
        while True:
            if size == 0:
                return np.inf, np.empty(0, np.int64), end
            size = heap_pop(keys, values, size)
            key, current = keys[size], values[size]
            root = ids[current, 2]
            if root == START or places[current, 4] <= best[root] + TIE:
                break
        triangle, j = ids[current, 3], ids[current, 4]
        if triangle == last:
            px, py = (start[0], start[1]) if root == START else (points[root, 0], points[root, 1])
            _, end[0], end[1] = _through(
                px, py, places[current, 0], places[current, 1], places[current, 2], places[current, 3], gx, gy
            )
            bends = np.empty(len(points), np.int64)
            m, node = 0, current
            while node >= 0:
                root = ids[node, 2]
                if root != START and (m == 0 or bends[m - 1] != root):
                    bends[m] = root
                    m += 1
                node = ids[node, 5]
            return key, bends[:m].copy(), end
