"""Costs of cells on a grid by Dijkstra's algorithm, and the room in them; compiled.

Source: Dial, "Algorithm 360: shortest-path forest with topological ordering", CACM 12(11), 1969.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.distances import point_clearance, point_depth
from trailmark.collision.field import ClearanceField
from trailmark.collision.kernels import field_value
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.jit import array_callee, callee, njit
from trailmark.se2 import FloatArray

__all__ = [
    "CLOSED",
    "STEP_X",
    "STEP_Y",
    "UNIT",
    "cell_clearances",
    "flood",
]

IntArray = NDArray[np.int32]

# Columns and rows of the eight neighbours, counter-clockwise from +x: direction k has heading k * 45 degrees.
STEP_X = np.array([1, 1, 0, -1, -1, -1, 0, 1])
STEP_Y = np.array([0, 1, 1, 1, 0, -1, -1, -1])


class _Buckets(NamedTuple):
    """A queue of cells by whole numbers, their levels, in place of a heap; each is in it once."""

    # (buckets,) first cell of each, -1 for none; a power of two of them, more than levels wait at a time
    first: IntArray
    # (cells, 2) next cell of the same bucket, -1 for none; and the one before, -2 - bucket of the first, -1 of a cell
    # that does not wait
    links: IntArray


@array_callee
def _buckets(count: int, cells: int) -> _Buckets:
    """Return an empty queue."""
    return _Buckets(np.full(count, -1, np.int32), np.full((cells, 2), -1, np.int32))


@callee
def _put(queue: _Buckets, cell: int, level: int) -> None:
    """Let a cell wait at a level, and at no other."""
    first, links = queue.first, queue.links
    if links[cell, 1] != -1:
        _leave(queue, cell)
    bucket = level & (len(first) - 1)
    second = first[bucket]
    first[bucket], links[cell, 0], links[cell, 1] = cell, second, -2 - bucket
    if second >= 0:
        links[second, 1] = cell


@callee
def _leave(queue: _Buckets, cell: int) -> None:
    """Let a cell wait no longer."""
    links = queue.links
    after, before = links[cell, 0], links[cell, 1]
    if before >= 0:
        links[before, 0] = after
    else:
        queue.first[-2 - before] = after
    if after >= 0:
        links[after, 1] = before
    links[cell, 1] = -1


@callee
def _take(queue: _Buckets, level: int) -> int:
    """Return a cell that waited at a level, -1 if none does."""
    cell = queue.first[level & (len(queue.first) - 1)]
    if cell >= 0:
        _leave(queue, cell)
    return int(cell)


UNIT, CLOSED, FAR = 70, 0, 2**31 - 1
"""Parts of a cell's edge that costs are counted in: 99 of them are its diagonal within 5e-5; the cost of a cell that is
closed, and of what is not reached."""

FURTHER = 32
"""Cells farther than the target that are still gone through: a way may lead off before it comes nearer."""


@njit(nogil=True)
def flood(dear: IntArray, source: int, target: int, corners: int) -> tuple[NDArray[np.float32], NDArray[np.int8]]:
    """Return the costs of cells to a source, in edges of a cell, and the directions that lead back towards it.

    Args:
        dear: (rows, columns), what crossing each cell costs, in parts; CLOSED ones all around.
        source: row * columns + column.
        target: likewise: cells much farther than it are left out; -1 for none.
        corners: factor on the cost of diagonal steps past a cell that is closed, or costs more than UNIT; 0: none lead
            there.

    Returns:
        Two arrays of that shape: costs, infinite where nothing leads, and numbers of steps, -1 there and at the source.
    """
    cells, width = dear.reshape(-1), dear.shape[1]
    buckets = 1
    while buckets <= 1.5 * cells.max() * max(1, corners):
        buckets *= 2
    queue = _buckets(buckets, len(cells))
    cost, back = np.full(len(cells), FAR, np.int32), np.full(len(cells), -1, np.int8)
    steps = STEP_Y * width + STEP_X
    cost[source], reached, last, empty = 0, 0, FAR, 0
    _put(queue, source, 0)
    while empty < buckets and reached <= last:
        cell = _take(queue, reached)
        if cell < 0:
            reached, empty = reached + 1, empty + 1
            continue
        empty = 0
        if cell == target:
            last = reached + FURTHER * UNIT
        for j in range(8):
            other = cell + steps[j]
            if cells[other] == CLOSED:
                continue
            # Of two cells the dearer counts.
            step = max(cells[cell], cells[other])
            if j % 2:
                if corners != 1 and (cells[cell + STEP_X[j]] != UNIT or cells[other - STEP_X[j]] != UNIT):
                    if corners == 0:
                        continue
                    step *= corners
                # 362 / 256: the square root of 2.
                step = step * 362 + 128 >> 8
            forward = reached + step
            if forward < cost[other]:
                cost[other], back[other] = forward, (j + 4) % 8
                _put(queue, other, forward)
    found = np.empty(len(cells), np.float32)
    for cell in range(len(cells)):
        found[cell] = inf if cost[cell] == FAR else cost[cell] / UNIT
    return found.reshape(dear.shape), back.reshape(dear.shape)


@njit(nogil=True)
def cell_clearances(
    grid: ObstacleGrid, field: ClearanceField, corner: FloatArray, size: float, rows: int, columns: int, radius: float
) -> FloatArray:
    """Return the clearances of cells' centres, shape (rows, columns); in an obstacle minus the depth.

    They are exact up to the radius, and by the field beyond it. Depths matter only where cells are so large that a disc
    may fit at the edge of one although none fits at its centre.

    Args:
        grid: the obstacles.
        field: their clearance field.
        corner: of the first cell, metres, shape (2,).
        size: edge of a cell, metres.
        rows: how many.
        columns: likewise.
        radius: of the disc, metres.
    """
    found = np.empty((rows, columns))
    for row in range(rows):
        for column in range(columns):
            x, y = corner[0] + (column + 0.5) * size, corner[1] + (row + 0.5) * size
            value = field_value(field, x, y)
            if value - field.slack < radius and value + field.slack + size >= radius:
                exact = point_clearance(grid, x, y, radius)
                if exact == 0.0 and radius < size:
                    value = -point_depth(grid, x, y, size)
                else:
                    # A value at the cap is only a lower bound, as the field's is.
                    value = exact if exact < radius else max(exact, value)
            found[row, column] = value
    return found
