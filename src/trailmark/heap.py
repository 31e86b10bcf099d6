"""A binary heap in flat arrays for compiled searches: smallest key first, stale entries left to the caller."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import njit

__all__ = ["heap_grow", "heap_pop", "heap_push"]


@njit(numbers=True)
def heap_push(keys: NDArray[np.float64], values: NDArray[np.int64], size: int, key: float, value: int) -> int:
    """Add an entry to a heap of ``size`` entries with room for one more; return the new size."""
    i = size
    while i > 0:
        parent = (i - 1) >> 1
        if keys[parent] <= key:
            break
        keys[i], values[i] = keys[parent], values[parent]
        i = parent
    keys[i], values[i] = key, value
    return size + 1


@njit(numbers=True)
def heap_pop(keys: NDArray[np.float64], values: NDArray[np.int64], size: int) -> int:
    """Move the smallest entry to position size - 1, out of the heap; return the new size."""
    size -= 1
    top_key, top_value = keys[0], values[0]
    key, value = keys[size], values[size]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= size:
            break
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[i], values[i] = keys[child], values[child]
        i = child
    keys[i], values[i] = key, value
    keys[size], values[size] = top_key, top_value
    return size


@njit
def heap_grow(keys: NDArray[np.float64], values: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return copies of both arrays of twice the length."""
    more_keys, more_values = np.empty(2 * len(keys)), np.empty(2 * len(values), np.int64)
    more_keys[: len(keys)] = keys
    more_values[: len(values)] = values
    return more_keys, more_values
