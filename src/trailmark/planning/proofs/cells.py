"""Cells of SE(2): boxes of positions times intervals of headings, split where a proof needs it.

The cells of level l + 1 have half the edge of those of level l, and half the headings where that keeps what turning
within a cell moves the robot by near to what shifting does. Cells are closed and tile bounds times all headings. A cell
is blocked if no path leads through it; others are free or mixed, by which the flood is guided.

The flood goes through free cells, and from there into mixed ones. Where it would come out into another free cell, the
mixed cells on the way, the largest first, are divided, until they are blocked, or free, or of the finest level; such
ways are passed last. So cells get small only between free regions that may be joined there, not along all obstacles.
Whether they are joined, a plain search over all cells that are not blocked tells in the end.

Sources: boxes that are free, blocked or mixed, and split by need: Zhu & Latombe, "New heuristic algorithms for
efficient hierarchical path planning", IEEE Trans. Robotics and Automation 1991; tests that only tend to be exact: Wang,
Chiang & Yap, "On soft predicates in subdivision motion planning", Computational Geometry 2015.
"""

from __future__ import annotations

from math import cos, hypot, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.distances import point_clearance, point_depth, ring_clearance
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import field_clearance, field_value
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.jit import array_callee, callee, njit
from trailmark.planning.proofs.region import MARGIN
from trailmark.se2 import FloatArray

__all__ = [
    "BLOCKED",
    "CHILD",
    "COLUMNS",
    "ENCLOSED",
    "FREE",
    "LEVEL",
    "LEVELS",
    "UNDER_WAY",
    "Blocking",
    "Division",
    "Flood",
    "I",
    "J",
    "K",
    "begin",
    "decided",
    "kind_of",
    "leads_across",
    "leaf_at",
    "neighbours",
    "new_flood",
    "resume",
    "split",
]

IntArray = NDArray[np.int64]
Table = NDArray[np.int32]

UNKNOWN, BLOCKED, FREE, MIXED = 0, 1, 2, 3
"""What a cell is: BLOCKED if every configuration in it is proven to collide; FREE if none of its parts will be, as far
as its centre tells; else MIXED. Proofs rest on BLOCKED alone."""

LEVELS = 14
"""Levels at most: along each axis the finest cells are 2^13 times smaller than the largest."""

LEVEL, I, J, K, CHILD, STATE, FROM, WAY, QUEUED, COLUMNS = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9  # noqa: E741 - so it is called
"""Columns of a table of cells: level, place along x, y and heading, first child (-1: none), what it is; the cell that
the flood came from; how far it is through mixed cells from a free one, in halves of the last level's edge; whether it
waits in the queue."""

UNREACHED, ROOT = -2, -1
"""In place of a cell that the flood came from."""

UNDER_WAY, ENCLOSED, UNRESOLVED, JOINED = 0, 1, 2, 3
"""A flood goes on; ended; came to the other end through mixed cells of the finest level; through free cells alone."""

LAST = 1e9
"""Added to the keys of ways through mixed cells of the finest level: they are passed once nothing else is left."""

WEIGHT = 3.0
"""Metres nearer to the other end that a metre more of mixed cells is worth."""


class Division(NamedTuple):
    """How space is divided. Positions are those of the pivot.

    Attributes:
        x0: left edge of the first column, metres.
        y0: lower edge of the first row, metres.
        columns: of level 0.
        rows: of level 0.
        half: (levels,) half the edge of a cell, metres.
        turns: (levels,) the number of headings is 2 to this power; from one level to the next it grows by 0 or 1.
    """

    x0: float
    y0: float
    columns: int
    rows: int
    half: FloatArray
    turns: IntArray


class Blocking(NamedTuple):
    """What cells are judged by.

    Attributes:
        division: how space is divided.
        finest: the finest level: what its core is not clear of may still turn out to be blocked.
        open: (levels,) clearance of a cell's centre, for the finest level's core, from which on it counts as free.
        points: (p, 2) vertices of all cores: what all configurations of a cell cover, about the pivot, at heading 0.
        rings: (r + 1,) where each ring begins in ``points``.
        cores: (levels + 1,) where each level's rings begin in ``rings``.
        placed: (v, 2) room for any ring.
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint about the pivot.
    """

    division: Division
    finest: int
    open: FloatArray
    points: FloatArray
    rings: IntArray
    cores: IntArray
    placed: FloatArray
    grid: ObstacleGrid
    field: ClearanceField
    robot: Footprint


@njit(numbers=True)
def leaf_at(cells: Table, division: Division, level: int, i: int, j: int, k: int) -> int:
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
def children_of(cells: Table, division: Division, cell: int) -> int:
    """Return how many children a cell has, or would have."""
    level = cells[cell, LEVEL]
    return 8 if division.turns[level + 1] > division.turns[level] else 4


@njit(numbers=True)
def split(cells: Table, division: Division, cell: int, used: int) -> int:
    """Give a cell its children, in the rows from ``used`` on; return the rows used then."""
    level, more = cells[cell, LEVEL], children_of(cells, division, cell)
    for child in range(more):
        row = used + child
        cells[row, LEVEL] = level + 1
        cells[row, I] = 2 * cells[cell, I] + (child & 1)
        cells[row, J] = 2 * cells[cell, J] + ((child >> 1) & 1)
        cells[row, K] = 2 * cells[cell, K] + (child >> 2) if more == 8 else cells[cell, K]
        cells[row, CHILD], cells[row, STATE], cells[row, FROM], cells[row, QUEUED] = -1, UNKNOWN, UNREACHED, 0
    cells[cell, CHILD] = used
    return used + more


@njit(nogil=True)
def neighbours(cells: Table, division: Division, cell: int, found: IntArray) -> tuple[int, IntArray]:
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


# --- What a cell is.


@njit(numbers=True)
def kind_of(cells: Table, cell: int, by: Blocking) -> int:
    """Return whether a cell is BLOCKED, FREE or MIXED, and take it down."""
    known = cells[cell, STATE]
    if known != UNKNOWN:
        return int(known)
    level, division = cells[cell, LEVEL], by.division
    half = division.half[level]
    x, y = division.x0 + (2 * cells[cell, I] + 1) * half, division.y0 + (2 * cells[cell, J] + 1) * half
    theta = (2 * cells[cell, K] + 1) * pi / (1 << division.turns[level]) - pi
    found = decided(level, x, y, theta, by)
    cells[cell, STATE] = found
    return found


@callee
def decided(level: int, x: float, y: float, theta: float, by: Blocking) -> int:
    """Return what the cell of a level is, BLOCKED, FREE or MIXED, whose centre lies there."""
    c, s, enough = cos(theta), sin(theta), by.open[level] + MARGIN
    if field_clearance(by.field, by.robot, x, y, c, s, enough) >= enough:
        return FREE
    # The core lies deeper in the robot than touching and rounding reach, wherever in the cell the robot is.
    if _gap(level, 0.0, x, y, c, s, by) <= 0.0 or _deep(level, x, y, c, s, by):
        return BLOCKED
    return FREE if _gap(by.finest, enough, x, y, c, s, by) >= enough else MIXED


@array_callee
def _gap(level: int, enough: float, x: float, y: float, c: float, s: float, by: Blocking) -> float:
    """Return the clearance of a level's core, dilated, 0 on overlap; it may be less if above ``enough`` and MARGIN."""
    gap = max(enough, MARGIN)
    for ring in range(by.cores[level], by.cores[level + 1]):
        begin, end = by.rings[ring], by.rings[ring + 1]
        for k in range(begin, end):
            px, py = by.points[k, 0], by.points[k, 1]
            by.placed[k - begin, 0], by.placed[k - begin, 1] = c * px - s * py, s * px + c * py
        # The dilated core is as deep in the dilated robot as the core is in the robot.
        apart = ring_clearance(by.grid, by.placed, end - begin, x, y, gap + by.robot.dilation)
        gap = min(gap, apart - by.robot.dilation)
        if gap <= 0.0:
            return 0.0
    return gap


@callee
def _deep(level: int, x: float, y: float, c: float, s: float, by: Blocking) -> bool:
    """Return whether one of the robot's discs meets obstacles wherever in the cell the robot is.

    Distances change by no more than the disc's centre moves; below 0 they are depths.
    """
    grid, robot = by.grid, by.robot
    shift, turn = sqrt(2.0) * by.division.half[level], 2.0 * sin(0.5 * pi / (1 << by.division.turns[level]))
    for dx, dy, radius in robot.inner:
        px, py = x + c * dx - s * dy, y + s * dx + c * dy
        most = radius - shift - turn * hypot(dx, dy) - 2.0 * MARGIN
        # Outside of the grid everything is blocked, and the distances' own search has nothing to look at.
        across = max(grid.x0 - px, px - grid.x0 - grid.columns * grid.size)
        beyond = max(across, grid.y0 - py, py - grid.y0 - grid.rows * grid.size)
        if beyond > -MARGIN:
            if beyond >= MARGIN - most:
                return True
            continue
        if field_value(by.field, px, py) - by.field.slack >= max(most, 0.0):
            continue
        if most > 0.0:
            if point_clearance(grid, px, py, most) < most:
                return True
        elif point_depth(grid, px, py, MARGIN - most) >= MARGIN - most:
            return True
    return False


# --- The flood.


Plain = tuple["Table", FloatArray, IntArray, IntArray]
"""A :class:`Flood` as Python is given it: making a named tuple runs Python, which a signal may interrupt."""


class Flood(NamedTuple):
    """A flood's table of cells and its queue.

    Attributes:
        cells: (n, COLUMNS), one row for each cell.
        keys: of the queue, a heap.
        values: cells that wait there.
        counts: (4,) rows of the table that are used, entries of the queue, the flood's end's cell, the other end's.
    """

    cells: Table
    keys: FloatArray
    values: IntArray
    counts: IntArray


def new_flood(division: Division) -> Flood:
    """Return a flood that has not begun: a table of the cells of level 0."""
    columns, base = division.columns, division.columns * division.rows
    cells = np.zeros((2 * base + 4096, COLUMNS), np.int32)
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
    flood.counts[0] = split(flood.cells, division, cell, flood.counts[0])
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
def begin(flood: Flood, by: Blocking, poses: FloatArray) -> Plain:
    """Return a flood that is to begin at the first pose; both ends' cells are free or of the finest level."""
    division = by.division
    for cell in range(flood.counts[0]):
        flood.cells[cell, FROM], flood.cells[cell, QUEUED] = UNREACHED, 0
        if flood.cells[cell, STATE] == FREE:
            flood.cells[cell, STATE] = UNKNOWN
    for n in range(2):
        cell = _cell_of(flood, division, poses[n])
        while flood.cells[cell, LEVEL] < by.finest and kind_of(flood.cells, cell, by) != FREE:
            flood = _split(flood, division, cell)
            cell = _cell_of(flood, division, poses[n])
        flood.counts[2 + n] = cell
    flood.counts[1] = 0
    flood = _push(flood, flood.counts[2], 0.0)
    return flood.cells, flood.keys, flood.values, flood.counts


@njit(nogil=True)
def resume(flood: Flood, by: Blocking, other: FloatArray, most: int) -> tuple[int, int, Plain]:
    """Return what a flood has come to after ``most`` cells at most, how many it took, and the flood."""
    division, around, taken = by.division, np.empty(256, np.int64), 0
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
        kind = kind_of(cells, cell, by)
        if kind == BLOCKED:
            continue
        if cell == flood.counts[2]:
            cells[cell, FROM], cells[cell, WAY] = ROOT, 0 if kind == FREE else _across(cells, cell)
        else:
            count, around = neighbours(cells, division, cell, around)
            best, hops = -1, 1 << 30
            for n in range(count):
                if cells[around[n], FROM] != UNREACHED and cells[around[n], WAY] < hops:
                    best, hops = around[n], cells[around[n], WAY]
            if best < 0:
                continue
            if kind == FREE or cell == flood.counts[3]:
                if hops > 0:
                    largest = _largest(cells, best, by.finest)
                    if largest >= 0:
                        flood = _divide(flood, division, largest)
                        flood = _push(flood, cell, key)
                        continue
                    if key < LAST:
                        flood = _push(flood, cell, LAST + key)
                        continue
                cells[cell, WAY] = 0
            else:
                cells[cell, WAY] = hops + _across(cells, cell)
            cells[cell, FROM] = best
            if cell == flood.counts[3]:
                answer = UNRESOLVED if _mixed_before(cells, cell) else JOINED
                return answer, taken, (cells, flood.keys, flood.values, flood.counts)
        count, around = neighbours(cells, division, cell, around)
        hops = cells[cell, WAY]
        for n in range(count):
            near = around[n]
            if flood.cells[near, FROM] == UNREACHED and flood.cells[near, QUEUED] == 0:
                kind = kind_of(flood.cells, near, by)
                if kind != BLOCKED:
                    way = hops if kind == FREE else hops + 0.5 * _across(flood.cells, near)
                    key = WEIGHT * division.half[LEVELS - 1] * way + _left(flood.cells, division, near, other)
                    flood = _push(flood, near, key)
    return UNDER_WAY, taken, (flood.cells, flood.keys, flood.values, flood.counts)


@callee
def _across(cells: Table, cell: int) -> int:
    """Return a cell's edge, as the column WAY counts it."""
    return int(1 << (LEVELS - cells[cell, LEVEL]))


@callee
def _left(cells: Table, division: Division, cell: int, other: FloatArray) -> float:
    """Return how far (metres) a cell's centre is from the other end's position."""
    half = division.half[cells[cell, LEVEL]]
    x, y = division.x0 + (2 * cells[cell, I] + 1) * half, division.y0 + (2 * cells[cell, J] + 1) * half
    return hypot(x - other[0], y - other[1])


@callee
def _largest(cells: Table, cell: int, finest: int) -> int:
    """Return the largest of the mixed cells that led here from a free one, -1 if all are of the finest level."""
    best, level = -1, finest
    while cell != ROOT and cells[cell, STATE] != FREE:
        if cells[cell, LEVEL] < level:
            best, level = cell, cells[cell, LEVEL]
        cell = cells[cell, FROM]
    return best


@callee
def _mixed_before(cells: Table, cell: int) -> bool:
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
                    lost = _longer(lost)
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


# --- The proof.


@njit(nogil=True)
def leads_across(flood: Flood, by: Blocking) -> tuple[bool, IntArray, IntArray]:
    """Return whether cells that are not blocked lead from one end's to the other's, each to the next over a face.

    They count as leading there, too, if an end's own cell is blocked: that end is not valid, and nothing is claimed.
    If they do not lead there, the blocked cells around those that they do lead to come with it, shape (n,), and these,
    shape (m,).

    The proof rests on this alone: a path that is nowhere blocked lies in the union of the cells that this flood reaches
    and of the others that are not blocked. Both are closed: to leave the first it must pass a point in both. All cells
    at that point hold it and so are not blocked; they are joined over faces through it (a small ball less finitely many
    edges is connected), so that the flood has reached them all.
    """
    around = np.empty(256, np.int64)
    cells = flood.cells
    for end in range(2, 4):
        if kind_of(cells, flood.counts[end], by) == BLOCKED:
            return True, np.empty(0, np.int64), np.empty(0, np.int64)
    seen = np.zeros(flood.counts[0], np.bool_)
    stack = np.empty(flood.counts[0], np.int64)
    stack[0], count = flood.counts[2], 1
    rim, walls = np.empty(flood.counts[0], np.int64), 0
    seen[flood.counts[2]] = True
    while count > 0:
        count -= 1
        cell = stack[count]
        if cell == flood.counts[3]:
            return True, np.empty(0, np.int64), np.empty(0, np.int64)
        number, around = neighbours(cells, by.division, cell, around)
        for n in range(number):
            near = around[n]
            if seen[near]:
                continue
            seen[near] = True
            if kind_of(cells, near, by) == BLOCKED:
                rim[walls] = near
                walls += 1
            else:
                stack[count] = near
                count += 1
    seen[rim[:walls]] = False
    return False, rim[:walls].copy(), np.flatnonzero(seen)
