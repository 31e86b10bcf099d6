"""Cells of SE(2): boxes of positions times intervals of headings, split where a proof needs it.

The cells of level l + 1 have half the edge of those of level l, and half the headings where that keeps what turning
within a cell moves the robot by near to what shifting does. Cells are closed and tile bounds times all headings.

Source: Zhu & Latombe, "New heuristic algorithms for efficient hierarchical path planning", IEEE Trans. Robotics and
Automation 1991 (boxes that are free, blocked or mixed, and split by need).
"""

from __future__ import annotations

from math import cos, hypot, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from trailmark.collision.distances import point_clearance, point_depth, ring_clearance
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import field_clearance, field_value
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.planning.lower_bound.region import MARGIN
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
    "kind_of",
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


@njit(cache=True)
def kind_of(
    cells: NDArray[np.int32],
    cell: int,
    division: Division,
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    finest: int,
) -> int:
    """Return BLOCKED, FREE or MIXED, and take it down.

    Args:
        cells: the table, shape (n, COLUMNS or more).
        cell: which.
        division: how space is divided.
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint about the pivot.
        placed: room for any core, shape (v, 2).
        finest: the finest level: what its core is not clear of may still turn out to be blocked.
    """
    known = cells[cell, STATE]
    if known != UNKNOWN:
        return int(known)
    level = cells[cell, LEVEL]
    half = division.half[level]
    x, y = division.x0 + (2 * cells[cell, I] + 1) * half, division.y0 + (2 * cells[cell, J] + 1) * half
    theta = (2 * cells[cell, K] + 1) * pi / (1 << division.turns[level]) - pi
    found = _decided(level, finest, x, y, cos(theta), sin(theta), division, grid, field, robot, placed)
    cells[cell, STATE] = found
    return found


@njit(cache=True)
def _decided(
    level: int,
    finest: int,
    x: float,
    y: float,
    c: float,
    s: float,
    division: Division,
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
) -> int:
    """Return what the cell of a level is whose centre lies there."""
    enough = division.open[level] + MARGIN
    if field_clearance(field, robot, x, y, c, s, enough) >= enough:
        return FREE
    # The core lies deeper in the robot than touching and rounding reach, wherever in the cell the robot is.
    if _gap(level, 0.0, x, y, c, s, division, grid, placed) == 0.0:
        return BLOCKED
    if _deep(level, x, y, c, s, division, grid, field, robot):
        return BLOCKED
    return FREE if _gap(finest, enough, x, y, c, s, division, grid, placed) >= enough else MIXED


@njit(cache=True)
def _gap(
    level: int,
    enough: float,
    x: float,
    y: float,
    c: float,
    s: float,
    division: Division,
    grid: ObstacleGrid,
    placed: FloatArray,
) -> float:
    """Return the clearance of a level's core, 0 on overlap; it may be less if above ``enough`` and MARGIN."""
    gap = max(enough, MARGIN)
    for ring in range(division.cores[level], division.cores[level + 1]):
        begin, end = division.rings[ring], division.rings[ring + 1]
        for k in range(begin, end):
            px, py = division.points[k, 0], division.points[k, 1]
            placed[k - begin, 0], placed[k - begin, 1] = c * px - s * py, s * px + c * py
        gap = min(gap, ring_clearance(grid, placed, end - begin, x, y, gap))
        if gap == 0.0:
            break
    return gap


@njit(cache=True)
def _deep(
    level: int,
    x: float,
    y: float,
    c: float,
    s: float,
    division: Division,
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
) -> bool:
    """Return whether one of the robot's discs meets obstacles wherever in the cell the robot is.

    Distances change by no more than the disc's centre moves; below 0 they are depths.
    """
    shift, turn = sqrt(2.0) * division.half[level], 2.0 * sin(0.5 * pi / (1 << division.turns[level]))
    for k in range(len(robot.inner)):
        bx, by = robot.inner[k, 0], robot.inner[k, 1]
        px, py = x + c * bx - s * by, y + s * bx + c * by
        most = robot.inner[k, 2] - shift - turn * hypot(bx, by) - 2.0 * MARGIN
        # Outside of the grid everything is blocked, and the distances' own search has nothing to look at.
        across = max(grid.x0 - px, px - grid.x0 - grid.columns * grid.size)
        beyond = max(across, grid.y0 - py, py - grid.y0 - grid.rows * grid.size)
        if beyond > -MARGIN:
            if beyond >= MARGIN - most:
                return True
            continue
        if field_value(field, px, py) - field.slack >= max(most, 0.0):
            continue
        if most > 0.0:
            if point_clearance(grid, px, py, most) < most:
                return True
        elif point_depth(grid, px, py, MARGIN - most) >= MARGIN - most:
            return True
    return False


@njit(cache=True)
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


@njit(cache=True, inline="always")
def children_of(cells: NDArray[np.int32], division: Division, cell: int) -> int:
    """Return how many children a cell has, or would have."""
    level = cells[cell, LEVEL]
    return 8 if division.turns[level + 1] > division.turns[level] else 4


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def _longer(array: IntArray) -> IntArray:
    longer = np.empty(2 * len(array), np.int64)
    longer[: len(array)] = array
    return longer
