"""What ways cost, roughly and at once: over the cells of the known map where the robot may pass."""

# Tested by tests/exploration/test_survey.py.

from __future__ import annotations

from math import sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit
from trailmark.heap import heap_grow, heap_pop, heap_push

__all__ = ["costs_from"]


@njit(cache=True, nogil=True)
def costs_from(passable: NDArray[np.uint8], row: int, column: int, tight: float) -> NDArray[np.float32]:
    """Return the costs of the ways from a cell to all others, in cells, infinite where none leads; (rows, columns).

    Ways lead to the eight cells around (Dijkstra 1959).

    Args:
        passable: 0 where the robot cannot be, 1 where it perhaps can, 2 where it certainly can; shape (rows, columns).
        row: where ways begin, whatever that cell is,
        column: likewise.
        tight: times as much that a step into a cell of kind 1 costs.
    """
    rows, columns = passable.shape
    costs = np.full((rows, columns), np.inf, np.float32)
    keys, values, size = np.empty(1024), np.empty(1024, np.int64), 0
    costs[row, column] = 0.0
    size = heap_push(keys, values, size, 0.0, row * columns + column)
    while size > 0:
        size = heap_pop(keys, values, size)
        key, place = keys[size], values[size]
        r, c = place // columns, place % columns
        if key > costs[r, c] + 1e-4 * (1.0 + key):
            continue
        for i in range(max(r - 1, 0), min(r + 2, rows)):
            for j in range(max(c - 1, 0), min(c + 2, columns)):
                if passable[i, j] == 0:
                    continue
                step = (sqrt(2.0) if i != r and j != c else 1.0) * (tight if passable[i, j] == 1 else 1.0)
                cost = float(np.float32(costs[r, c] + step))
                if cost < costs[i, j]:
                    costs[i, j] = cost
                    if size == len(keys):
                        keys, values = heap_grow(keys, values)
                    size = heap_push(keys, values, size, cost, i * columns + j)
    return costs
