"""Sorting in compiled code: numba's own sorts take longer to compile than most of the kernels that need one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.heap import heap_pop, heap_push
from trailmark.jit import njit

__all__ = ["order_of", "sort_in_place"]


@njit(numbers=True)
def sort_in_place(values: NDArray[np.float64], count: int) -> None:
    """Sort the first ``count`` values, shape (n,), none NaN, smallest first (Shell 1959, Knuth's gaps)."""
    gap = 1
    while 3 * gap < count:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, count):
            value, j = values[i], i
            while j >= gap and values[j - gap] > value:
                values[j] = values[j - gap]
                j -= gap
            values[j] = value
        gap //= 3


@njit
def order_of(keys: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the indices of the keys, smallest key first, shape (n,); equal keys in any order, none of them NaN."""
    heap, order, size = np.empty(len(keys)), np.empty(len(keys), np.int64), 0
    for i in range(len(keys)):
        size = heap_push(heap, order, size, -keys[i], i)
    while size > 0:  # the largest key goes to the end
        size = heap_pop(heap, order, size)
    return order
