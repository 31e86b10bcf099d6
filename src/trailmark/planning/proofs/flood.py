"""The flood over cells of SE(2) by which an enclosure is proven, compiled.

It goes through free cells, and from there into mixed ones. Where it would come out into another free cell, the mixed
cells on the way, the largest first, are divided, until they are blocked, or free, or of the finest level; such ways are
passed last. So cells get small only between free regions that may be joined there, not along all obstacles.

Source: splitting by need, with tests that only tend to be exact: Wang, Chiang & Yap, "On soft predicates in subdivision
motion planning", Computational Geometry 2015.
"""

from __future__ import annotations

from math import hypot, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.jit import array_callee, callee, njit
from trailmark.planning.proofs.cell_kinds import kind_of, room_for_cores
from trailmark.planning.proofs.cells import (
    BLOCKED,
    CHILD,
    COLUMNS,
    FREE,
    LEVEL,
    LEVELS,
    STATE,
    UNKNOWN,
    Division,
    I,
    J,
    leaf_at,
    neighbours,
    split,
)
from trailmark.se2 import FloatArray

__all__ = ["ENCLOSED", "JOINED", "LEAKS", "UNDER_WAY", "Flood", "Plain", "begin", "go_on", "new_flood"]

FROM, HOPS, QUEUED = COLUMNS, COLUMNS + 1, COLUMNS + 2
"""More columns of the table: the cell that the flood came from; how far it is through mixed cells from a free one, in
halves of the last level's edge; whether it waits in the queue."""

UNREACHED, ROOT = -2, -1
"""In place of a cell that the flood came from."""

UNDER_WAY, ENCLOSED, LEAKS, JOINED = 0, 1, 2, 3
"""A flood goes on; ended; came to the other end through mixed cells of the finest level; through free cells alone."""

LAST = 1e9
"""Added to the keys of ways through mixed cells of the finest level: they are passed once nothing else is left."""

WEIGHT = 3.0
"""Metres nearer to the other end that a metre more of mixed cells is worth."""


Plain = tuple[NDArray[np.int32], FloatArray, NDArray[np.int64], NDArray[np.int64]]
"""A :class:`Flood` as Python is given it: making a named tuple runs Python, which a signal may interrupt."""


class Flood(NamedTuple):
    """A flood's table of cells and its queue.

    Attributes:
        cells: (n, COLUMNS + 3), one row for each cell.
        keys: of the queue, a heap.
        values: cells that wait there.
        counts: (4,) rows of the table that are used, entries of the queue, the flood's end's cell, the other end's.
    """

    cells: NDArray[np.int32]
    keys: FloatArray
    values: NDArray[np.int64]
    counts: NDArray[np.int64]


def new_flood(columns: int, rows: int) -> Flood:
    """Return a flood that has not begun: a table of the cells of level 0."""
    base = columns * rows
    cells = np.zeros((2 * base + 4096, COLUMNS + 3), np.int32)
    cells[:base, I], cells[:base, J] = np.arange(base) % columns, np.arange(base) // columns
    cells[:base, CHILD] = -1
    return Flood(cells, np.empty(1024), np.empty(1024, np.int64), np.array([base, 0, 0, 0], np.int64))


@array_callee
def _roomier(flood: Flood) -> Flood:
    """Return the flood with room for the children of one more cell and for one more entry of the queue."""
    cells, keys, values = flood.cells, flood.keys, flood.values
    if flood.counts[0] + 8 > len(cells):
        cells = np.empty((2 * len(cells), cells.shape[1]), np.int32)
        cells[: len(flood.cells)] = flood.cells
    while flood.counts[1] + 8 > len(keys):
        keys, values = heap_grow(keys, values)
    return Flood(cells, keys, values, flood.counts)


@callee
def _cell_of(flood: Flood, division: Division, pose: FloatArray) -> int:
    """Return the undivided cell that a pose lies in."""
    level = LEVELS - 1
    edge, headings = 2.0 * division.half[level], 1 << division.turns[level]
    i = min(max(int((pose[0] - division.x0) / edge), 0), (division.columns << level) - 1)
    j = min(max(int((pose[1] - division.y0) / edge), 0), (division.rows << level) - 1)
    k = min(max(int((pose[2] + pi) / (2.0 * pi) * headings), 0), headings - 1)
    return leaf_at(flood.cells, division, level, i, j, k)


@array_callee
def _split(flood: Flood, division: Division, cell: int) -> Flood:
    """Return the flood with a cell's children in its place, which are not reached."""
    flood = _roomier(flood)
    first = flood.counts[0]
    flood.counts[0] = split(flood.cells, division, cell, first)
    for child in range(first, flood.counts[0]):
        flood.cells[child, FROM], flood.cells[child, QUEUED] = UNREACHED, 0
    return flood


@array_callee
def _push(flood: Flood, cell: int, key: float) -> Flood:
    """Return the flood with a cell in its queue, by that key or the one it waits there with already."""
    if flood.cells[cell, QUEUED] != 0:
        return flood
    if flood.counts[1] + 8 > len(flood.keys):
        flood = _roomier(flood)
    flood.cells[cell, QUEUED] = 1
    flood.counts[1] = heap_push(flood.keys, flood.values, flood.counts[1], key, cell)
    return flood


@njit(nogil=True)
def begin(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    division: Division,
    flood: Flood,
    poses: FloatArray,
    finest: int,
) -> Plain:
    """Return a flood that is to begin at the first pose; both ends' cells are free or of the finest level."""
    placed = room_for_cores(division)
    for cell in range(flood.counts[0]):
        flood.cells[cell, FROM], flood.cells[cell, QUEUED] = UNREACHED, 0
        if flood.cells[cell, STATE] == FREE:
            flood.cells[cell, STATE] = UNKNOWN
    for n in range(2):
        cell = _cell_of(flood, division, poses[n])
        while flood.cells[cell, LEVEL] < finest and (
            kind_of(flood.cells, cell, division, grid, field, robot, placed, finest) != FREE
        ):
            flood = _split(flood, division, cell)
            cell = _cell_of(flood, division, poses[n])
        flood.counts[2 + n] = cell
    flood.counts[1] = 0
    flood = _push(flood, flood.counts[2], 0.0)
    return flood.cells, flood.keys, flood.values, flood.counts


@njit(nogil=True)
def go_on(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    division: Division,
    flood: Flood,
    other: FloatArray,
    finest: int,
    most: int,
) -> tuple[int, int, Plain]:
    """Return what a flood has come to after ``most`` cells at most, how many it took, and the flood."""
    placed, around = room_for_cores(division), np.empty(256, np.int64)
    taken = 0
    while taken < most:
        if flood.counts[1] == 0:
            return ENCLOSED, taken, (flood.cells, flood.keys, flood.values, flood.counts)
        taken += 1
        flood.counts[1] = heap_pop(flood.keys, flood.values, flood.counts[1])
        key, cell = flood.keys[flood.counts[1]], flood.values[flood.counts[1]]
        cells = flood.cells
        cells[cell, QUEUED] = 0
        if cells[cell, CHILD] >= 0 or cells[cell, FROM] != UNREACHED:
            continue
        kind = kind_of(cells, cell, division, grid, field, robot, placed, finest)
        if kind == BLOCKED:
            continue
        if cell == flood.counts[2]:
            cells[cell, FROM], cells[cell, HOPS] = ROOT, 0 if kind == FREE else _across(cells, cell)
        else:
            count, around = neighbours(cells, division, cell, around)
            best, hops = -1, 1 << 30
            for n in range(count):
                if cells[around[n], FROM] != UNREACHED and cells[around[n], HOPS] < hops:
                    best, hops = around[n], cells[around[n], HOPS]
            if best < 0:
                continue
            if kind == FREE or cell == flood.counts[3]:
                if hops > 0:
                    largest = _largest(cells, best, finest)
                    if largest >= 0:
                        flood = _divide(flood, division, largest)
                        flood = _push(flood, cell, key)
                        continue
                    if key < LAST:
                        flood = _push(flood, cell, LAST + key)
                        continue
                cells[cell, HOPS] = 0
            else:
                cells[cell, HOPS] = hops + _across(cells, cell)
            cells[cell, FROM] = best
            if cell == flood.counts[3]:
                return (
                    (LEAKS if _mixed_before(cells, cell) else JOINED),
                    taken,
                    (cells, flood.keys, flood.values, flood.counts),
                )
        count, around = neighbours(cells, division, cell, around)
        hops = cells[cell, HOPS]
        for n in range(count):
            near = around[n]
            if flood.cells[near, FROM] == UNREACHED and flood.cells[near, QUEUED] == 0:
                kind = kind_of(flood.cells, near, division, grid, field, robot, placed, finest)
                if kind != BLOCKED:
                    way = hops if kind == FREE else hops + 0.5 * _across(flood.cells, near)
                    key = WEIGHT * division.half[LEVELS - 1] * way + _left(flood.cells, division, near, other)
                    flood = _push(flood, near, key)
    return UNDER_WAY, taken, (flood.cells, flood.keys, flood.values, flood.counts)


@callee
def _across(cells: NDArray[np.int32], cell: int) -> int:
    """Return a cell's edge, as the column HOPS counts it."""
    return int(1 << (LEVELS - cells[cell, LEVEL]))


@callee
def _left(cells: NDArray[np.int32], division: Division, cell: int, other: FloatArray) -> float:
    """Return how far (metres) a cell's centre is from the other end's position."""
    half = division.half[cells[cell, LEVEL]]
    x, y = division.x0 + (2 * cells[cell, I] + 1) * half, division.y0 + (2 * cells[cell, J] + 1) * half
    return hypot(x - other[0], y - other[1])


@callee
def _largest(cells: NDArray[np.int32], cell: int, finest: int) -> int:
    """Return the largest of the mixed cells that led here from a free one, -1 if all are of the finest level."""
    best, level = -1, finest
    while cell != ROOT and cells[cell, STATE] != FREE:
        if cells[cell, LEVEL] < level:
            best, level = cell, cells[cell, LEVEL]
        cell = cells[cell, FROM]
    return best


@callee
def _mixed_before(cells: NDArray[np.int32], cell: int) -> bool:
    """Return whether the flood came to a cell through mixed ones, itself included."""
    while cell != ROOT:
        if cells[cell, STATE] != FREE:
            return True
        cell = cells[cell, FROM]
    return False


@array_callee
def _divide(flood: Flood, division: Division, cell: int) -> Flood:
    """Return the flood with a cell divided, and what it had reached through it to be reached anew."""
    around, lost, count = np.empty(256, np.int64), np.empty(256, np.int64), 1
    lost[0], at = cell, 0
    while at < count:
        number, around = neighbours(flood.cells, division, lost[at], around)
        for n in range(number):
            if flood.cells[around[n], FROM] == lost[at]:
                if count == len(lost):
                    longer = np.empty(2 * count, np.int64)
                    longer[:count] = lost
                    lost = longer
                flood.cells[around[n], FROM] = UNREACHED
                lost[count] = around[n]
                count += 1
        at += 1
    flood.cells[cell, FROM] = UNREACHED
    first = flood.counts[0]
    flood = _split(flood, division, cell)
    for child in range(first, flood.counts[0]):
        flood = _push(flood, child, 0.0)
    for n in range(1, count):
        flood = _push(flood, lost[n], 0.0)
    return flood
