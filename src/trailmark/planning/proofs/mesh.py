"""A polygon cut into triangles that know their neighbours, proven to fill it, and the shortest path of a point in it.

The search is Polyanya: a node is a root, where the path bends last, and an interval of an edge that is seen from there;
its key is the length of the shortest path from start to root, through the interval, to the goal as if nothing lay
behind it. What decides where the search goes is asked of the mesh's vertices and the start alone, without rounding: a
cone of sight is told by the points that its two rays pass, not by where they cross an edge. The crossings only enter
the keys, and are moved outwards by as much as rounding may have moved them inwards: no key is above the length of a way
that it stands for by more than the rounding of a few additions.

Sources: Cui, Harabor & Grastien, "Compromise-free pathfinding on a navigation mesh", IJCAI 2017 (Polyanya); Shewchuk,
"Adaptive precision floating-point arithmetic and fast robust geometric predicates", Discrete & Computational Geometry
18, 1997.
"""

from __future__ import annotations

from math import hypot
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.jit import array_callee, callee, njit
from trailmark.se2 import FloatArray

__all__ = ["Mesh", "locate", "orientation", "orientations", "shortest_point_path", "triangulated"]

IntArray = NDArray[np.int64]

ROUNDED = 3.3306690738754716e-16
"""Share of its two products' sizes that a determinant may be wrong by: Shewchuk's bound A, (3 + 16 eps) eps."""

SPLITTER = 134217729.0
"""2^27 + 1: cuts a double into two halves whose products are exact."""

NOWHERE = -1
"""In place of a vertex: a point within an edge."""

LX, LY, RX, RY, LENGTH = range(5)
"""Columns of what a node knows in metres: its interval's left and right end, and the length of the way to its root."""

AT_L, AT_R, ROOT, VIA, EDGE, L1, L2, R1, R2, TRIANGLE, PARENT = range(11)
"""Columns of indices: vertices at the interval's ends, root, the root before it, the triangle's edge that the interval
lies on, the points that the left ray and the right ray pass (twice the same: there is no such ray), triangle ahead,
parent."""


class Mesh(NamedTuple):
    """Triangles without gaps or overlaps; some may be flat.

    Attributes:
        points: (v, 2) vertices, metres.
        triangles: (m, 3) indices of the corners, counter-clockwise.
        neighbours: (m, 3) the triangle across the edge from corner i to corner i + 1; -1 where there is none.
        corner: (v,) whether a shortest path may bend there: the region's angle at the vertex is pi or more.
        edges: (e, 2) indices of the ends of the region's edges, which have it on their left.
    """

    points: FloatArray
    triangles: IntArray
    neighbours: IntArray
    corner: NDArray[np.bool_]
    edges: IntArray


def triangulated(polygon: Any) -> Mesh | None:
    """Return a polygon with holes cut into triangles, whose corners are all vertices of the polygon.

    No triangle is turned over, each edge of one is an edge of at most one other, and those of none are the edges of the
    polygon's rings: so the triangles cover each point of the polygon once, and no other. All this is looked at without
    rounding; what does not pass, is no mesh.

    Args:
        polygon: a valid one (shapely), with area.

    Returns:
        None if there is no such mesh, by rounding.
    """
    try:
        parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    except shapely.errors.GEOSException:
        return None
    if len(parts) == 0:
        return None
    # All come clockwise, flat ones too, which could not be turned by their area.
    rings = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, 2::-1]
    points, index = np.unique(rings.reshape(-1, 2), axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3).astype(np.int64)
    if (orientations(points, triangles) < 0.0).any():
        return None
    ends = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    keys = ends[:, 0] * len(points) + ends[:, 1]
    order = np.argsort(keys)
    if (keys[order[1:]] == keys[order[:-1]]).any():
        return None
    place = np.minimum(np.searchsorted(keys, ends[:, 1] * len(points) + ends[:, 0], sorter=order), len(keys) - 1)
    twin = order[place]
    across = (ends[twin] == ends[:, ::-1]).all(axis=1)
    edges = ends[~across]
    if not _same(points[edges], _ring_edges(polygon)):
        return None
    neighbours = np.where(across, twin // 3, -1).reshape(-1, 3)
    return Mesh(points, triangles, neighbours, _corners(points, edges), edges)


def locate(mesh: Mesh, point: FloatArray) -> int:
    """Return a triangle that holds a point, shape (2,), without rounding; -1 if it lies outside."""
    a, b, c = (mesh.points[mesh.triangles[:, i]] for i in range(3))
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    near = np.flatnonzero(((low <= point) & (point <= high)).all(axis=1))
    points = np.vstack([mesh.points, point])
    inside = np.ones(len(near), np.bool_)
    for i in range(3):
        edge = mesh.triangles[near][:, [i, (i + 1) % 3]]
        triples = np.column_stack([edge, np.full(len(near), len(mesh.points))])
        inside &= orientations(points, triples) >= 0.0
    return int(near[np.argmax(inside)]) if inside.any() else -1


def _ring_edges(polygon: Any) -> FloatArray:
    """Return the edges of a polygon's rings, the polygon on their left, shape (e, 2, 2)."""
    rings = [shapely.get_coordinates(ring) for ring in shapely.get_rings(shapely.orient_polygons(polygon))]
    return np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings])


def _same(first: FloatArray, second: FloatArray) -> bool:
    """Return whether two sets of edges, shape (e, 2, 2), are the same."""
    if first.shape != second.shape:
        return False
    a, b = (rows.reshape(-1, 4) for rows in (first, second))
    return np.array_equal(a[np.lexsort(a.T)], b[np.lexsort(b.T)])


def _corners(points: FloatArray, edges: IntArray) -> NDArray[np.bool_]:
    """Return which vertices a path may bend round: all but those where the region is convex, and nothing else meets."""
    corner = np.ones(len(points), np.bool_)
    before, after = np.full(len(points), -1), np.full(len(points), -1)
    before[edges[:, 1]], after[edges[:, 0]] = edges[:, 0], edges[:, 1]
    once = np.flatnonzero(np.bincount(edges[:, 0], minlength=len(points)) == 1)
    convex = orientations(points, np.column_stack([before[once], once, after[once]])) > 0.0
    corner[once[convex]] = False
    return corner


# --- On which side of a line a point lies, without rounding.


@njit(numbers=True)
def orientation(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return a value above 0 if c lies left of the line from a to b, below 0 if right, 0 if it lies on it: exactly."""
    left, right = (ax - cx) * (by - cy), (ay - cy) * (bx - cx)
    det = left - right
    # Products of different signs, or with a factor of 0, have a sum of the right sign.
    if (left >= 0.0) != (right > 0.0) or left == 0.0 or right == 0.0:
        return det
    if abs(det) > ROUNDED * (abs(left) + abs(right)):
        return det
    return _exactly(ax, ay, bx, by, cx, cy)


@njit(nogil=True)
def orientations(points: FloatArray, triples: IntArray) -> FloatArray:
    """Return the orientation of each triple (m, 3) of points (v, 2), shape (m,); only its sign means something."""
    found = np.empty(len(triples))
    for k in range(len(triples)):
        a, b, c = points[triples[k, 0]], points[triples[k, 1]], points[triples[k, 2]]
        found[k] = orientation(a[0], a[1], b[0], b[1], c[0], c[1])
    return found


@array_callee
def _exactly(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the determinant's largest part: six products, each as a sum of two doubles, added up exactly."""
    # The parts, from the smallest to the largest; they do not overlap.
    parts, n = np.zeros(12), 0
    factors = ((ax, by), (-ax, cy), (-cx, by), (-ay, bx), (ay, cx), (cy, bx))
    for u, v in factors:
        product = u * v
        big = SPLITTER * u
        u1 = big - (big - u)
        u2 = u - u1
        big = SPLITTER * v
        v1 = big - (big - v)
        v2 = v - v1
        rest = u2 * v2 - (((product - u1 * v1) - u2 * v1) - u1 * v2)
        for term in (rest, product):
            total = term
            for i in range(n):
                part = parts[i]
                added = total + part
                virtual = added - total
                parts[i] = (total - (added - virtual)) + (part - virtual)
                total = added
            parts[n] = total
            n += 1
    for i in range(n - 1, -1, -1):
        if parts[i] != 0.0:
            return float(parts[i])
    return 0.0


# --- Polyanya.


def shortest_point_path(mesh: Mesh, start: FloatArray, goal: FloatArray) -> tuple[float, FloatArray]:
    """Return the length (metres) of the shortest path and its bends, shape (k, 2), ends included.

    It passes no point at which the region's outline touches itself.

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
    points = np.vstack([mesh.points, start])
    length, bends, end = _search(points, mesh.triangles, mesh.neighbours, mesh.corner, first, np.array(goal), last)
    if not np.isfinite(length):
        return np.inf, np.empty((0, 2))
    path = [start, *mesh.points[bends[::-1]], end, goal]
    # The last interval is crossed on the straight line, or at its end.
    different = [np.asarray(p) for i, p in enumerate(path) if i == 0 or np.hypot(*(p - path[i - 1])) > 0.0]
    return float(length), np.array(different)


@callee
def _side(ox: float, oy: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return a value above 0 if b lies left of the ray from o to a, below 0 if right, but for rounding."""
    return (ax - ox) * (by - oy) - (ay - oy) * (bx - ox)


@callee
def _beside(points: FloatArray, a: int, b: int, c: int) -> float:
    """Return a value above 0 if c lies left of the ray through a and b, below 0 if right, 0 if there is no ray."""
    if a == b:
        return 0.0
    return float(orientation(points[a, 0], points[a, 1], points[b, 0], points[b, 1], points[c, 0], points[c, 1]))


@callee
def _crossing(points: FloatArray, a: int, b: int, outer: int, inner: int) -> tuple[float, float]:
    """Return where the line through a and b crosses the edge between two vertices, or a hair nearer to ``outer``."""
    far, far_wrong = _distance(points, a, b, outer)
    near, near_wrong = _distance(points, a, b, inner)
    far = max(0.0, far - far_wrong)
    share = far / (far + near + near_wrong) if far > 0.0 else 0.0
    ox, oy = points[outer, 0], points[outer, 1]
    return ox + share * (points[inner, 0] - ox), oy + share * (points[inner, 1] - oy)


@callee
def _distance(points: FloatArray, a: int, b: int, c: int) -> tuple[float, float]:
    """Return the distance of c from the line through a and b, times that of a from b, and what may be wrong with it."""
    x, y = points[c, 0], points[c, 1]
    left, right = (points[a, 0] - x) * (points[b, 1] - y), (points[a, 1] - y) * (points[b, 0] - x)
    return abs(left - right), ROUNDED * (abs(left) + abs(right))


@callee
def _through(
    px: float, py: float, lx: float, ly: float, rx: float, ry: float, gx: float, gy: float
) -> tuple[float, float, float]:
    """Return the length of the shortest path from p through the interval from l to r to g, and where it crosses."""
    dx, dy = lx - rx, ly - ry
    norm = dx * dx + dy * dy
    if norm == 0.0:
        return hypot(lx - px, ly - py) + hypot(gx - lx, gy - ly), lx, ly
    side_p, side_g = _side(rx, ry, lx, ly, px, py), _side(rx, ry, lx, ly, gx, gy)
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


@callee
def _record(
    points: FloatArray,
    found: FloatArray,
    kinds: IntArray,
    n: int,
    side: int,
    vertex: int,
    a: int,
    b: int,
    outer: int,
    inner: int,
) -> None:
    """Write one end of an interval, 0 the left or 1 the right: at a vertex, or where a ray crosses an edge."""
    if vertex != NOWHERE:
        found[n, 2 * side], found[n, 2 * side + 1] = points[vertex, 0], points[vertex, 1]
    else:
        found[n, 2 * side], found[n, 2 * side + 1] = _crossing(points, a, b, outer, inner)
    kinds[n, AT_L + side], kinds[n, L1 + 2 * side], kinds[n, L2 + 2 * side] = vertex, a, b


@callee
def _turns(points: FloatArray, best: FloatArray, via: IntArray, root: int, vertex: int) -> bool:
    """Return whether a shortest path may bend at a vertex, coming from a root, and take that down.

    Of ways that are equally long but for rounding one is enough: either it goes on as the other would, or there is a
    still shorter one that cuts its corner.
    """
    longer = best[root] + hypot(points[vertex, 0] - points[root, 0], points[vertex, 1] - points[root, 1])
    if longer < best[vertex]:
        best[vertex], via[vertex] = longer, root
    return bool(longer == best[vertex] and via[vertex] == root)


@callee
def _expanded(
    points: FloatArray,
    triangles: IntArray,
    corner: NDArray[np.bool_],
    best: FloatArray,
    via: IntArray,
    place: FloatArray,
    ids: IntArray,
    found: FloatArray,
    kinds: IntArray,
) -> int:
    """Write the intervals that a node leads to, behind the triangle ahead of it; return their number, at most 3."""
    triangle, j, root = ids[TRIANGLE], ids[EDGE], ids[ROOT]
    at_l, at_r, l1, l2, r1, r2 = ids[AT_L], ids[AT_R], ids[L1], ids[L2], ids[R1], ids[R2]
    left, right = triangles[triangle, j], triangles[triangle, (j + 1) % 3]
    apex = triangles[triangle, (j + 2) % 3]
    to_right, to_left = (j + 1) % 3, (j + 2) % 3
    of_left, of_right = _beside(points, l1, l2, apex), _beside(points, r1, r2, apex)
    for k in range(3):
        found[k, LENGTH], kinds[k, ROOT], kinds[k, VIA] = place[LENGTH], root, ids[VIA]
    if of_left > 0.0:
        # The apex lies left of all that is seen: only the right edge is.
        end = right if _beside(points, l1, l2, right) >= 0.0 else NOWHERE
        _record(points, found, kinds, 0, 0, end, l1, l2, apex, right)
        _record(points, found, kinds, 0, 1, right if at_r == right else NOWHERE, r1, r2, right, apex)
        kinds[0, EDGE] = to_right
        if at_l != left or not corner[left]:
            return 1
        if not _turns(points, best, via, root, left):
            return 1
        found[1, LENGTH] = found[2, LENGTH] = best[left]
        kinds[1, ROOT] = kinds[2, ROOT] = left
        kinds[1, VIA] = kinds[2, VIA] = root
        _record(points, found, kinds, 1, 0, apex, left, apex, apex, apex)
        _record(points, found, kinds, 1, 1, end, l1, l2, right, apex)
        kinds[1, EDGE] = to_right
        _record(points, found, kinds, 2, 0, left, left, left, left, left)
        _record(points, found, kinds, 2, 1, apex, left, apex, apex, apex)
        kinds[2, EDGE] = to_left
        return 3
    if of_right < 0.0:
        end = left if _beside(points, r1, r2, left) <= 0.0 else NOWHERE
        _record(points, found, kinds, 0, 0, left if at_l == left else NOWHERE, l1, l2, left, apex)
        _record(points, found, kinds, 0, 1, end, r1, r2, apex, left)
        kinds[0, EDGE] = to_left
        if at_r != right or not corner[right]:
            return 1
        if not _turns(points, best, via, root, right):
            return 1
        found[1, LENGTH] = found[2, LENGTH] = best[right]
        kinds[1, ROOT] = kinds[2, ROOT] = right
        kinds[1, VIA] = kinds[2, VIA] = root
        _record(points, found, kinds, 1, 0, end, r1, r2, left, apex)
        _record(points, found, kinds, 1, 1, apex, right, apex, apex, apex)
        kinds[1, EDGE] = to_left
        _record(points, found, kinds, 2, 0, apex, right, apex, apex, apex)
        _record(points, found, kinds, 2, 1, right, right, right, right, right)
        kinds[2, EDGE] = to_right
        return 3
    end = left if at_l == left else (apex if l1 != l2 and of_left == 0.0 else NOWHERE)
    _record(points, found, kinds, 0, 0, end, l1, l2, left, apex)
    _record(points, found, kinds, 0, 1, apex, root, apex, apex, apex)
    kinds[0, EDGE] = to_left
    end = right if at_r == right else (apex if r1 != r2 and of_right == 0.0 else NOWHERE)
    _record(points, found, kinds, 1, 0, apex, root, apex, apex, apex)
    _record(points, found, kinds, 1, 1, end, r1, r2, right, apex)
    kinds[1, EDGE] = to_right
    return 2


@njit(nogil=True)
def _search(
    points: FloatArray,
    triangles: IntArray,
    neighbours: IntArray,
    corner: NDArray[np.bool_],
    first: int,
    goal: FloatArray,
    last: int,
) -> tuple[float, IntArray, FloatArray]:
    """Return the length, the vertices at which the path bends, goal first, and where it crosses the last interval.

    The start is the last of the points.
    """
    gx, gy = goal[0], goal[1]
    start = len(points) - 1
    # Of the ways from the start to each vertex: the shortest one's length, and where it bends last before.
    best, via = np.full(len(points), np.inf), np.full(len(points), NOWHERE, np.int64)
    best[start] = 0.0
    capacity = 1024
    places, ids = np.empty((capacity, 5)), np.empty((capacity, 11), np.int64)
    keys, values = np.empty(capacity), np.empty(capacity, np.int64)
    count, size = 0, 0
    found, kinds = np.empty((3, 5)), np.empty((3, 9), np.int64)
    current, triangle = -1, first
    end = np.empty(2)
    n = 3
    for i in range(3):
        right, left = triangles[first, i], triangles[first, (i + 1) % 3]
        _record(points, found, kinds, i, 0, left, start, left, left, left)
        _record(points, found, kinds, i, 1, right, start, right, right, right)
        found[i, LENGTH], kinds[i, ROOT], kinds[i, VIA], kinds[i, EDGE] = 0.0, start, NOWHERE, i
    while True:
        for k in range(n):
            across = kinds[k, EDGE]
            ahead = neighbours[triangle, across]
            if ahead < 0:
                continue
            if count == capacity:
                capacity *= 2
                more_places, more_ids = np.empty((capacity, 5)), np.empty((capacity, 11), np.int64)
                more_places[:count], more_ids[:count] = places, ids
                places, ids = more_places, more_ids
            if size == len(keys):
                keys, values = heap_grow(keys, values)
            for i in range(5):
                places[count, i] = found[k, i]
            for i in range(9):
                ids[count, i] = kinds[k, i]
            ids[count, TRIANGLE], ids[count, PARENT] = ahead, current
            # The edge begins there where it ends here; a mesh has each edge once in either direction.
            ids[count, EDGE] = 0
            for i in range(1, 3):
                if triangles[ahead, i] == triangles[triangle, (across + 1) % 3]:
                    ids[count, EDGE] = i
            root = kinds[k, ROOT]
            rest, _, _ = _through(
                points[root, 0], points[root, 1], found[k, LX], found[k, LY], found[k, RX], found[k, RY], gx, gy
            )
            size = heap_push(keys, values, size, found[k, LENGTH] + rest, count)
            count += 1
        while True:
            if size == 0:
                return np.inf, np.empty(0, np.int64), end
            size = heap_pop(keys, values, size)
            key, current = keys[size], values[size]
            root = ids[current, ROOT]
            if places[current, LENGTH] == best[root] and ids[current, VIA] == via[root]:
                break
        triangle = ids[current, TRIANGLE]
        if triangle == last:
            root = ids[current, ROOT]
            place = places[current]
            _, end[0], end[1] = _through(
                points[root, 0], points[root, 1], place[LX], place[LY], place[RX], place[RY], gx, gy
            )
            bends = np.empty(len(points), np.int64)
            m, node = 0, current
            while node >= 0:
                root = ids[node, ROOT]
                if root != start and (m == 0 or bends[m - 1] != root):
                    bends[m] = root
                    m += 1
                node = ids[node, PARENT]
            return key, bends[:m].copy(), end
        n = _expanded(points, triangles, corner, best, via, places[current], ids[current], found, kinds)
