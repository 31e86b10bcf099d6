"""Nearest neighbours among points that come in over time: a forest of balanced k-d trees in flat arrays.

Adding m points to n costs O(m log² n) in the mean: full trees are merged as a binary counter carries (Bentley & Saxe,
"Decomposable searching problems I", J. Algorithms 1980). A tree is its points in an order in which every range has its
median in the middle (Bentley, "Multidimensional binary search trees", CACM 1975): no pointers, and a search may run
within other compiled code.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import callee, njit

__all__ = ["Forest", "NearestNeighbours", "near_to_near", "nearest_in", "nearest_to", "room_for"]

FloatArray = NDArray[np.float64]
Element = TypeVar("Element", bound=np.generic)

LEAF = 12
"""Points of a range that is looked through one by one."""

SMALLEST = 64
"""Points of the smallest tree that is worth building: newer ones are looked through until they are as many."""

DEEPEST = 64
"""Ranges that wait in a search at most: one for each halving of what memory can hold."""


class Forest(NamedTuple):
    """What a search reads.

    Attributes:
        points: (n, d) in the order of the trees.
        ids: (n,) which point each row is, by the order in which they came.
        axis: (n,) int8, the axis along which each range is split, stored at its middle.
        starts: (t + 1,) where each tree begins; what lies behind the last start is in no tree yet.
    """

    points: FloatArray
    ids: NDArray[np.int64]
    axis: NDArray[np.int8]
    starts: NDArray[np.int64]


class NearestNeighbours:
    """An index of points that grows.

    Args:
        dimension: of the points.
    """

    def __init__(self, dimension: int) -> None:
        self._points: FloatArray = np.empty((0, dimension))
        self._ids: NDArray[np.int64] = np.empty(0, np.int64)
        self._axis: NDArray[np.int8] = np.empty(0, np.int8)
        self._sizes: list[int] = []
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, points: FloatArray) -> None:
        """Add points, shape (m, d); they are numbered on from those that are there."""
        first, last = self._count, self._count + len(points)
        self._points, self._ids = room_for(self._points, last), room_for(self._ids, last)
        self._axis = room_for(self._axis, last)
        self._points[first:last], self._ids[first:last] = points, np.arange(first, last)
        self._count = last
        treed = sum(self._sizes)
        if last - treed < SMALLEST:
            return
        # Every tree at most twice as large as what is to be sorted goes into the same sort.
        begin = treed
        while self._sizes and self._sizes[-1] < 2 * (last - begin):
            begin -= self._sizes.pop()
        _sort(self._points, self._ids, self._axis, begin, last)
        self._sizes.append(last - begin)

    def forest(self) -> Forest:
        """Return what is there now, not copied: the next :meth:`add` may change it."""
        n = self._count
        starts = np.concatenate([[0], np.cumsum(np.array(self._sizes, dtype=np.int64))]).astype(np.int64)
        return Forest(self._points[:n], self._ids[:n], self._axis[:n], starts)

    def merged(self) -> Forest:
        """Return all points in one tree of its own."""
        points, ids = self._points[: self._count].copy(), self._ids[: self._count].copy()
        axis = np.empty(self._count, np.int8)
        _sort(points, ids, axis, 0, self._count)
        return Forest(points, ids, axis, np.array([0, self._count]))

    def query(self, points: FloatArray, k: int, *, first: int = -1) -> NDArray[np.int64]:
        """Return which k points are nearest to each row, nearest first, shape (m, k); -1 where there are fewer.

        Args:
            points: shape (m, d).
            k: how many, >= 1.
            first: what the rows are numbered from themselves, if they are in the index: none is its own neighbour.
        """
        return np.asarray(_nearest_of(self.forest(), np.ascontiguousarray(points, dtype=np.float64), k, first))


def nearest_to(targets: FloatArray, points: FloatArray) -> NDArray[np.int64]:
    """Return which of the points, shape (n, d), n >= 1, is nearest to each target, shape (m, d); shape (m,)."""
    index = NearestNeighbours(points.shape[1])
    index.add(points)
    return index.query(targets, 1)[:, 0]


def near_to_near(points: FloatArray) -> NDArray[np.int64]:
    """Return an order of points, shape (n, d), in which those close in space are mostly close in memory; shape (n,).

    What goes through near points one after the other then finds them in the processor's caches.
    """
    index = NearestNeighbours(points.shape[1])
    index.add(points)
    return index.merged().ids


def room_for(array: NDArray[Element], n: int) -> NDArray[Element]:
    """Return the array, or where it has fewer than n rows a copy with room for n and a half more."""
    if len(array) >= n:
        return array
    larger = np.empty((n + n // 2, *array.shape[1:]), array.dtype)
    larger[: len(array)] = array
    return larger


@callee
def _swap(points: FloatArray, ids: NDArray[np.int64], i: int, j: int) -> None:
    for d in range(points.shape[1]):
        points[i, d], points[j, d] = points[j, d], points[i, d]
    ids[i], ids[j] = ids[j], ids[i]


@njit(nogil=True)
def _sort(points: FloatArray, ids: NDArray[np.int64], axis: NDArray[np.int8], low: int, high: int) -> None:
    """Put the rows from low to high into the order of a tree."""
    dimension = points.shape[1]
    waiting = np.empty((DEEPEST, 2), np.int64)
    waiting[0, 0], waiting[0, 1] = low, high
    size = 1
    while size > 0:
        size -= 1
        a, b = waiting[size, 0], waiting[size, 1]
        if b - a <= LEAF:
            continue
        widest, spread = 0, -1.0
        for d in range(dimension):
            least, most = points[a, d], points[a, d]
            for i in range(a + 1, b):
                least, most = min(least, points[i, d]), max(most, points[i, d])
            if most - least > spread:
                widest, spread = d, most - least
        middle = (a + b) >> 1
        # Quickselect (Hoare 1961), from the middle: rows that are sorted already are the worst case otherwise.
        left, right = a, b - 1
        while left < right:
            pivot = points[(left + right) >> 1, widest]
            i, j = left, right
            while i <= j:
                while points[i, widest] < pivot:
                    i += 1
                while points[j, widest] > pivot:
                    j -= 1
                if i <= j:
                    _swap(points, ids, i, j)
                    i += 1
                    j -= 1
            if middle <= j:
                right = j
            elif middle >= i:
                left = i
            else:
                break
        axis[middle] = widest
        waiting[size, 0], waiting[size, 1] = a, middle
        waiting[size + 1, 0], waiting[size + 1, 1] = middle + 1, b
        size += 2


@callee
def _offer(distances: FloatArray, ids: NDArray[np.int64], count: int, k: int, distance: float, number: int) -> int:
    """Put a point into the sorted rows of the k best; return how many there are."""
    if count == k:
        if distance > distances[k - 1] or (distance == distances[k - 1] and number > ids[k - 1]):
            return count
        count -= 1
    i = count
    # Of points equally far the older one comes first, whatever the order of the search.
    while i > 0 and (distances[i - 1] > distance or (distances[i - 1] == distance and ids[i - 1] > number)):
        distances[i], ids[i] = distances[i - 1], ids[i - 1]
        i -= 1
    distances[i], ids[i] = distance, number
    return count + 1


@njit(nogil=True)
def nearest_in(
    forest: Forest, point: FloatArray, own: int, k: int, distances: FloatArray, ids: NDArray[np.int64]
) -> int:
    """Write the k nearest points, nearest first, into ``distances`` (squared) and ``ids``; return how many there are.

    Args:
        forest: the points.
        point: shape (d,).
        own: number of a point to leave out, or -1.
        k: how many are wanted, at most as many as the arrays hold.
        distances: (>= k,), overwritten.
        ids: (>= k,), overwritten.
    """
    if k == 0:
        return 0
    dimension = len(point)
    waiting = np.empty((DEEPEST, 2), np.int64)
    # Of each range that waits: its distance from the point so far, squared, and along each axis.
    beyond, offset = np.empty(DEEPEST), np.empty((DEEPEST, dimension))
    away = np.empty(dimension)
    count = 0
    trees = len(forest.starts) - 1
    for tree in range(trees + 1):
        size = 1
        waiting[0, 0] = forest.starts[tree]
        waiting[0, 1] = forest.starts[tree + 1] if tree < trees else len(forest.points)
        beyond[0] = 0.0
        offset[0] = 0.0
        while size > 0:
            size -= 1
            a, b, least = waiting[size, 0], waiting[size, 1], beyond[size]
            if count == k and least > distances[k - 1]:
                continue
            away[:] = offset[size]
            while b - a > LEAF and tree < trees:
                middle = (a + b) >> 1
                d = forest.axis[middle]
                gap = point[d] - forest.points[middle, d]
                farther = least - away[d] * away[d] + gap * gap
                # The farther side waits; the middle itself belongs to both, and is looked at here.
                if forest.ids[middle] != own:
                    apart = 0.0
                    for e in range(dimension):
                        step = point[e] - forest.points[middle, e]
                        apart += step * step
                    count = _offer(distances, ids, count, k, apart, forest.ids[middle])
                beyond[size] = farther
                offset[size] = away
                offset[size, d] = gap
                if gap <= 0.0:
                    waiting[size, 0], waiting[size, 1] = middle + 1, b
                    b = middle
                else:
                    waiting[size, 0], waiting[size, 1] = a, middle
                    a = middle + 1
                size += 1
            for i in range(a, b):
                if forest.ids[i] == own:
                    continue
                apart = 0.0
                for e in range(dimension):
                    step = point[e] - forest.points[i, e]
                    apart += step * step
                count = _offer(distances, ids, count, k, apart, forest.ids[i])
    return count


@njit(nogil=True)
def _nearest_of(forest: Forest, points: FloatArray, k: int, first: int) -> NDArray[np.int64]:
    result = np.full((len(points), k), -1, np.int64)
    distances, ids = np.empty(k), np.empty(k, np.int64)
    for i in range(len(points)):
        own = first + i if first >= 0 else -1
        count = nearest_in(forest, points[i], own, k, distances, ids)
        result[i, :count] = ids[:count]
    return result
