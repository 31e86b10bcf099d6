"""Nearest neighbours: among points that come in over time, by scipy's k-d tree, and within compiled searches."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from trailmark.compiled import njit

__all__ = ["Forest", "NearestNeighbours", "nearest_in", "nearest_to", "room_for"]

FloatArray = NDArray[np.float64]
Element = TypeVar("Element", bound=np.generic)

LEAF = 12
"""Points of a range that is looked through one by one."""

NEWER = 64, 0.25
"""Points at most, and share of the others, that are looked through one by one until a tree of all is built."""

DEEPEST = 64
"""Ranges that wait in a search at most: one for each halving of what memory can hold."""


class Forest(NamedTuple):
    """A balanced k-d tree for compiled searches: points in an order in which each half of a range is a range.

    Source: Bentley, "Multidimensional binary search trees used for associative searching", CACM 1975.

    Attributes:
        points: (n, d) in the order of the tree.
        ids: (n,) which point each row is, by the order in which they came.
        axis: (n,) int64, at the middle of each range the axis along which it is split.
        split: (n,) there the coordinate that its first half does not exceed and its second does not fall below.
    """

    points: FloatArray
    ids: NDArray[np.int64]
    axis: NDArray[np.int64]
    split: FloatArray


class NearestNeighbours:
    """An index of points that grows.

    Args:
        dimension: of the points.
    """

    def __init__(self, dimension: int) -> None:
        self._points: FloatArray = np.empty((0, dimension))
        self._tree = cKDTree(self._points)

    def __len__(self) -> int:
        return len(self._points)

    def add(self, points: FloatArray) -> None:
        """Add points, shape (m, d); they are numbered on from those that are there."""
        self._points = np.concatenate([self._points, points])

    def merged(self) -> Forest:
        """Return all points in a tree for compiled searches."""
        return _tree_of(self._points, np.arange(len(self._points)))

    def around(self, point: FloatArray, k: int) -> Forest:
        """Return the k points nearest to one, shape (d,), in a tree for compiled searches."""
        ids = self.query(point[None], min(k, len(self._points)))[0]
        return _tree_of(self._points[ids], ids)

    def query(self, points: FloatArray, k: int, *, first: int = -1) -> NDArray[np.int64]:
        """Return which k points are nearest to each row, nearest first, shape (m, k); -1 where there are fewer.

        Args:
            points: shape (m, d).
            k: how many, >= 1.
            first: what the rows are numbered from themselves, if they are in the index: none is its own neighbour.
        """
        n, m = len(self._points), len(points)
        most, share = NEWER
        if n - self._tree.n > max(most, share * self._tree.n):
            self._tree = cKDTree(self._points)
        tree, ids = self._tree, np.empty((m, 0), np.int64)
        if tree.n:
            found = tree.query(points, np.arange(1, min(k + (first >= 0), tree.n) + 1))[1]
            ids = np.asarray(found, dtype=np.int64)
        ids = np.hstack([ids, np.broadcast_to(np.arange(tree.n, n), (m, n - tree.n))])
        # By one formula for all, and of points equally far the older one first: it does not matter when they came.
        apart = ((self._points[ids] - points[:, None]) ** 2).sum(axis=2)
        if first >= 0:
            own = ids == first + np.arange(m)[:, None]
            ids[own], apart[own] = -1, np.inf
        result, order = np.full((m, k), -1, np.int64), np.lexsort((ids, apart), axis=1)[:, :k]
        result[:, : order.shape[1]] = ids[np.arange(m)[:, None], order]
        return result


def _tree_of(points: FloatArray, ids: NDArray[np.int64]) -> Forest:
    order, axis, split = np.arange(len(ids)), np.zeros(len(ids), np.int64), np.zeros(len(ids))
    waiting = [(0, len(ids))]
    while waiting:
        a, b = waiting.pop()
        if b - a > LEAF:
            part, middle = points[order[a:b]], (a + b) >> 1
            axis[middle] = widest = np.ptp(part, axis=0).argmax()
            order[a:b] = order[a:b][np.argpartition(part[:, widest], middle - a)]
            split[middle] = points[order[middle], widest]
            waiting += [(a, middle), (middle, b)]
    return Forest(points[order], ids[order], axis, split)


def nearest_to(targets: FloatArray, points: FloatArray) -> NDArray[np.int64]:
    """Return which of the points, shape (n, d), n >= 1, is nearest to each target, shape (m, d); shape (m,)."""
    return np.asarray(cKDTree(points).query(targets)[1], dtype=np.int64)


def room_for(array: NDArray[Element], n: int) -> NDArray[Element]:
    """Return the array, or where it has fewer than n rows a copy with room for n and a half more."""
    if len(array) >= n:
        return array
    larger = np.empty((n + n // 2, *array.shape[1:]), array.dtype)
    larger[: len(array)] = array
    return larger


@njit(cache=True, nogil=True)
def nearest_in(forest: Forest, point: FloatArray, k: int, distances: FloatArray, ids: NDArray[np.int64]) -> int:
    """Write the k nearest points, nearest first, into ``distances`` (squared) and ``ids``; return how many there are.

    Args:
        forest: the points.
        point: shape (d,).
        k: how many are wanted, at most as many as the arrays hold.
        distances: (>= k,), overwritten.
        ids: (>= k,), overwritten.
    """
    waiting, beyond, size = np.empty((DEEPEST, 2), np.int64), np.empty(DEEPEST), int(k > 0)
    waiting[0, 0], waiting[0, 1], beyond[0], count = 0, len(forest.points), 0.0, 0
    while size > 0:
        size -= 1
        a, b, least = waiting[size, 0], waiting[size, 1], beyond[size]
        if count == k and least > distances[k - 1]:
            continue
        while b - a > LEAF:
            # The half across the split waits.
            middle = (a + b) >> 1
            gap = point[forest.axis[middle]] - forest.split[middle]
            beyond[size] = max(least, gap * gap)
            if gap <= 0.0:
                waiting[size, 0], waiting[size, 1] = middle, b
                b = middle
            else:
                waiting[size, 0], waiting[size, 1] = a, middle
                a = middle
            size += 1
        for i in range(a, b):
            apart = 0.0
            for e in range(len(point)):
                apart += (point[e] - forest.points[i, e]) ** 2
            if count == k and apart >= distances[k - 1]:
                continue
            place = min(count, k - 1)
            while place > 0 and distances[place - 1] > apart:
                distances[place], ids[place] = distances[place - 1], ids[place - 1]
                place -= 1
            distances[place], ids[place] = apart, forest.ids[i]
            count = min(count + 1, k)
    return count
