"""Estimated lengths to the goal over the free cells of a grid map, which guide a search and prove nothing; compiled."""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit

__all__ = ["lengths_to"]

STRAIGHT, DIAGONAL, BUCKETS = 70, 99, 128
"""Costs of steps, whole numbers: their ratio is the square root of 2 within 5e-5; a power of two above all of them."""

FURTHER = 32
"""Cells farther than the start's that are still gone through: a way may lead off before it comes nearer."""

_STEP_X = np.array([1, 0, -1, 0, 1, -1, -1, 1])
_STEP_Y = np.array([0, 1, 0, -1, 1, 1, -1, -1])


@njit(cache=True, nogil=True)
def lengths_to(open_: NDArray[np.bool_], goal: int, start: int) -> NDArray[np.float32]:
    """Return the lengths (cells) from cells to the goal's by steps to eight neighbours, none past a closed cell.

    Source: Dial, "Algorithm 360: shortest-path forest with topological ordering", CACM 12(11), 1969.

    Args:
        open_: shape (rows, columns), the outermost cells closed.
        goal: row * columns + column.
        start: likewise; cells much farther than it is are left out.

    Returns:
        Shape (rows, columns); infinite where nothing leads there.
    """
    rows, columns = open_.shape
    cells = open_.reshape(-1)
    cost = np.full(len(cells), np.int32(2**31 - 1))
    first = np.full(BUCKETS, -1, np.int32)
    # A cell may wait in several buckets; what is not used takes no memory, but addresses.
    entries = np.empty((8 * len(cells) + 1, 2), np.int32)
    unused, used, waiting, reached, last = -1, 1, 1, 0, 2**30
    cost[goal], first[0], entries[0, 0], entries[0, 1] = 0, 0, goal, -1
    steps = _STEP_Y * columns + _STEP_X
    while waiting > 0 and reached <= last:
        entry = first[reached & (BUCKETS - 1)]
        if entry < 0:
            reached += 1
            continue
        cell, first[reached & (BUCKETS - 1)] = entries[entry, 0], entries[entry, 1]
        entries[entry, 1], unused = unused, entry
        waiting -= 1
        if cost[cell] != reached:
            continue
        if cell == start:
            last = reached + FURTHER * STRAIGHT
        for k in range(8):
            other = cell + steps[k]
            if not cells[other] or (k > 3 and not (cells[cell + _STEP_X[k]] and cells[other - _STEP_X[k]])):
                continue
            length = reached + (STRAIGHT if k < 4 else DIAGONAL)
            if length >= cost[other]:
                continue
            cost[other] = length
            if unused >= 0:
                entry, unused = unused, entries[unused, 1]
            else:
                entry, used = used, used + 1
            bucket = length & (BUCKETS - 1)
            entries[entry, 0], entries[entry, 1], first[bucket] = other, first[bucket], entry
            waiting += 1
    found = np.empty((rows, columns), np.float32)
    for row in range(rows):
        for column in range(columns):
            value = cost[row * columns + column]
            found[row, column] = inf if value == 2**31 - 1 else value / STRAIGHT
    return found
