"""Cells of SE(2): boxes of positions times intervals of headings, split where a proof needs it.

The cells of level l + 1 have half the edge of those of level l, and half the headings where that keeps what turning
within a cell moves the robot by near to what shifting does. Cells are closed and tile bounds times all headings.

Source: Zhu & Latombe, "New heuristic algorithms for efficient hierarchical path planning", IEEE Trans. Robotics and
Automation 1991 (boxes that are free, blocked or mixed, and split by need).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import array_callee, callee, njit
from trailmark.se2 import FloatArray

__all__ = [
    "BLOCKED",
    "CHILD",
    "COLUMNS",
    "FREE",
    "LEVEL",
    "LEVELS",
    "MIXED",
    "STATE",
    "UNKNOWN",
    "Division",
    "I",
    "J",
    "K",
    "children_of",
    "leaf_at",
    "neighbours",
    "split",
]

IntArray = NDArray[np.int64]

UNKNOWN, BLOCKED, FREE, MIXED = 0, 1, 2, 3
"""What a cell is: BLOCKED if every configuration in it is proven to collide; FREE if none of its parts will be, as far
as its centre tells; else MIXED. Proofs rest on BLOCKED alone."""

LEVELS = 14
"""Levels at most: along each axis the finest cells are 2^13 times smaller than the largest."""

LEVEL, I, J, K, CHILD, STATE, COLUMNS = 0, 1, 2, 3, 4, 5, 6  # noqa: E741 - the row's index is called that
"""Columns of a table of cells: level, place along x, y and heading, first child (-1: none), what it is."""


class Division(NamedTuple):
    """How space is divided, and what the robot covers in each level's cells. Positions are those of the pivot.

    Attributes:
        x0: left edge of the first column, metres.
        y0: lower edge of the first row, metres.
        columns: of level 0.
        rows: of level 0.
        half: (levels,) half the edge of a cell, metres.
        turns: (levels,) the number of headings is 2 to this power; from one level to the next it grows by 0 or 1.
        open: (levels,) clearance of a cell's centre, for the finest level's core, from which on it counts as free.
        points: (p, 2) vertices of all cores: what all configurations of a cell cover, about the pivot, at heading 0.
        rings: (r + 1,) where each ring begins in ``points``.
        cores: (levels + 1,) where each level's rings begin in ``rings``.
    """

    x0: float
    y0: float
    columns: int
    rows: int
    half: FloatArray
    turns: IntArray
    open: FloatArray
    points: FloatArray
    rings: IntArray
    cores: IntArray


@njit(numbers=True)
def leaf_at(cells: NDArray[np.int32], division: Division, level: int, i: int, j: int, k: int) -> int:
    """Return the cell of that level and place, or the larger one that holds it if that was never split."""
    cell = (j >> level) * division.columns + (i >> level)
    for deeper in range(1, level + 1):
        if cells[cell, CHILD] < 0:
            break
        shift = level - deeper
        child = ((i >> shift) & 1) + 2 * ((j >> shift) & 1)
        if division.turns[deeper] > division.turns[deeper - 1]:
            child += 4 * ((k >> (division.turns[level] - division.turns[deeper])) & 1)
        cell = cells[cell, CHILD] + child
    return int(cell)


@callee
def children_of(cells: NDArray[np.int32], division: Division, cell: int) -> int:
    """Return how many children a cell has, or would have."""
    level = cells[cell, LEVEL]
    return 8 if division.turns[level + 1] > division.turns[level] else 4


@njit(numbers=True)
def split(cells: NDArray[np.int32], division: Division, cell: int, used: int) -> int:
    """Give a cell its children, in the rows from ``used`` on; return the rows used then."""
    level, more = cells[cell, LEVEL], children_of(cells, division, cell)
    for child in range(more):
        row = used + child
        cells[row, LEVEL] = level + 1
        cells[row, I] = 2 * cells[cell, I] + (child & 1)
        cells[row, J] = 2 * cells[cell, J] + ((child >> 1) & 1)
        cells[row, K] = 2 * cells[cell, K] + (child >> 2) if more == 8 else cells[cell, K]
        cells[row, CHILD], cells[row, STATE] = -1, UNKNOWN
    cells[cell, CHILD] = used
    return used + more


@njit
def neighbours(cells: NDArray[np.int32], division: Division, cell: int, found: IntArray) -> tuple[int, IntArray]:
    """Write the undivided cells that share a part of a face with a cell; return their number, and the array.

    Headings go round. A cell may be found twice where there are two headings only.

    Args:
        cells: the table.
        division: how space is divided.
        cell: which.
        found: room for them; a larger array is returned if it is too short.
    """
    level, i, j, k = cells[cell, LEVEL], cells[cell, I], cells[cell, J], cells[cell, K]
    columns, rows, headings = division.columns << level, division.rows << level, 1 << division.turns[level]
    count = 0
    for face in range(6 if headings > 1 else 4):
        axis, ahead = face >> 1, face & 1
        step = 2 * ahead - 1
        ni, nj, nk = i, j, k
        if axis == 0:
            ni += step
        elif axis == 1:
            nj += step
        else:
            nk = (k + step) % headings
        if not (0 <= ni < columns and 0 <= nj < rows):
            continue
        first = count
        if count == len(found):
            found = _longer(found)
        found[count] = leaf_at(cells, division, level, ni, nj, nk)
        count += 1
        # In place of each that is divided, its children at the face.
        at = first
        while at < count:
            parent = found[at]
            child = cells[parent, CHILD]
            if child < 0:
                at += 1
                continue
            count -= 1
            found[at] = found[count]
            more = children_of(cells, division, parent)
            for n in range(more):
                if (axis < 2 or more == 8) and ((n >> axis) & 1) == ahead:
                    continue
                if count == len(found):
                    found = _longer(found)
                found[count] = child + n
                count += 1
    return count, found


@array_callee
def _longer(array: IntArray) -> IntArray:
    longer = np.empty(2 * len(array), np.int64)
    longer[: len(array)] = array
    return longer
