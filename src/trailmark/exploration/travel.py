"""What ways cost, roughly and at once: over the cells of the known map where the robot may pass."""

# Tested by tests/exploration/test_survey.py.

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit
from trailmark.exploration.reachability import CERTAIN, NOWHERE
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.se2 import FloatArray

__all__ = ["Travel", "costs_between"]

TIGHT = 2.0
"""Times as much that a metre is taken to cost where it is not certain that the robot fits."""

SPARE = 0.6
"""Of the robot's inner radius: the coarser cells are no larger, so that no wall lies within one of them."""

COARSEST = 4
"""Cells, along either side of one of the coarser ones, at most."""

NEAREST = 10
"""Places up to which ways from a place are followed; to the others they lead by way of those."""


class Travel:
    """Estimates of what ways cost, over cells some times as large as the map's.

    Args:
        fits: from NOWHERE to CERTAIN for each cell of the map, shape (rows, columns).
        inner: radius of the robot's disc about its reference point, in cells of the map.
    """

    def __init__(self, fits: NDArray[np.uint8], inner: float) -> None:
        self.factor = max(1, min(COARSEST, int(SPARE * inner)))
        f = self.factor
        rows, columns = -(-fits.shape[0] // f), -(-fits.shape[1] // f)
        padded = np.zeros((rows * f, columns * f), np.uint8)
        padded[: fits.shape[0], : fits.shape[1]] = fits
        self.fits = padded.reshape(rows, f, columns, f).max(axis=(1, 3))

    def between(self, cells: NDArray[np.intp]) -> FloatArray:
        """Return the costs of the ways between cells of the map, in cells, infinite where none leads, shape (n, n).

        Args:
            cells: rows and columns, shape (n, 2).
        """
        costs = costs_between(self.fits, np.ascontiguousarray(cells, dtype=np.int64) // self.factor, NEAREST, TIGHT)
        for k in range(len(costs)):  # Floyd 1962
            costs = np.minimum(costs, costs[:, k, None] + costs[None, k])
        return np.asarray(costs * self.factor)


@njit(cache=True, nogil=True)
def costs_between(fits: NDArray[np.uint8], cells: NDArray[np.int64], nearest: int, tight: float) -> FloatArray:
    """Return the costs of the ways between some cells, in cells, shape (n, n), infinite where none was found.

    Ways lead to the eight cells around, and from each of the cells to the nearest ones (Dijkstra 1959).

    Args:
        fits: NOWHERE, up to CERTAIN, shape (rows, columns).
        cells: rows and columns, shape (n, 2), whatever they are.
        nearest: to how many others.
        tight: times as much that a step into a cell that is not CERTAIN costs.
    """
    rows, columns = fits.shape
    n = len(cells)
    between = np.full((n, n), np.inf)
    here = np.zeros((rows, columns), np.int32)
    for k in range(n):
        here[cells[k, 0], cells[k, 1]] += 1
    costs = np.empty((rows, columns))
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    for k in range(n):
        costs[:] = np.inf
        costs[cells[k, 0], cells[k, 1]] = 0.0
        size, found = heap_push(keys, values, 0, 0.0, cells[k, 0] * columns + cells[k, 1]), 0
        # The first is the first of the list, which needs the ways to all others.
        wanted = n if k == 0 else nearest + 1
        while size > 0 and found < wanted:
            size = heap_pop(keys, values, size)
            key, place = keys[size], values[size]
            r, c = place // columns, place % columns
            if key > costs[r, c]:
                continue
            found += here[r, c]
            for i in range(max(r - 1, 0), min(r + 2, rows)):
                for j in range(max(c - 1, 0), min(c + 2, columns)):
                    if fits[i, j] == NOWHERE and here[i, j] == 0:
                        continue
                    step = sqrt(2.0) if i != r and j != c else 1.0
                    cost = key + step * (1.0 if fits[i, j] == CERTAIN else tight)
                    if cost < costs[i, j]:
                        costs[i, j] = cost
                        if size == len(keys):
                            keys, values = heap_grow(keys, values)
                        size = heap_push(keys, values, size, cost, i * columns + j)
        for other in range(n):
            way = costs[cells[other, 0], cells[other, 1]]
            between[k, other], between[other, k] = min(between[k, other], way), min(between[other, k], way)
    return between
