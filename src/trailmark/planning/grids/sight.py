"""What is seen from a point among blocked cells, and whether a disc fits along a segment, compiled.

Lengths are in cells. A cell (row, column) covers [column, column + 1] x [row, row + 1]; the outermost are blocked.
A corner is a vertex of the grid at which exactly one of four cells is blocked: nowhere else does a disc's shortest path
turn.
"""

from __future__ import annotations

from math import ceil, floor, hypot, inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = ["Corners", "all_fit", "corners_of", "fits", "seen"]

IntArray = NDArray[np.int64]
Int32Array = NDArray[np.int32]

GRAZING = 1e-12
"""Difference of slopes below which nothing is seen between two obstacles: those of vertices differ by far more."""


class Corners(NamedTuple):
    """Cells, and what is found at their vertices.

    Attributes:
        blocked: (rows, columns), the outermost ones blocked.
        right: (rows, columns) first column from each cell on that is blocked where the cell is free, or the reverse.
        left: (rows, columns) last column before each cell, likewise.
        side: (rows + 1, columns + 1) which of the four cells at a vertex is the only one blocked: 0 lower left, 1 lower
            right, 2 upper left, 3 upper right; -1 where the vertex is no corner.
        number: (rows + 1, columns + 1) of each corner, from 0 on; -1 where there is none.
        next_right: (rows + 1, columns + 1) column of the first corner in the row from each vertex on.
        next_left: (rows + 1, columns + 1) column of the last corner in the row up to each vertex; -1 for none.
    """

    blocked: NDArray[np.bool_]
    right: Int32Array
    left: Int32Array
    side: NDArray[np.int8]
    number: Int32Array
    next_right: Int32Array
    next_left: Int32Array


@njit(nogil=True)
def corners_of(blocked: NDArray[np.bool_]) -> tuple[Any, ...]:
    """Return the fields of :class:`Corners` of blocked cells, shape (rows, columns), the outermost ones blocked."""
    rows, columns = blocked.shape
    right, left = np.empty((rows, columns), np.int32), np.empty((rows, columns), np.int32)
    side = np.full((rows + 1, columns + 1), -1, np.int8)
    number, count = np.full((rows + 1, columns + 1), -1, np.int32), 0
    next_right = np.full((rows + 1, columns + 1), columns + 1, np.int32)
    next_left = np.full((rows + 1, columns + 1), -1, np.int32)
    for row in range(rows):
        for column in range(columns):
            same = column > 0 and blocked[row, column - 1] == blocked[row, column]
            left[row, column] = left[row, column - 1] if same else column - 1
        for column in range(columns - 1, -1, -1):
            same = column < columns - 1 and blocked[row, column + 1] == blocked[row, column]
            right[row, column] = right[row, column + 1] if same else column + 1
    for row in range(1, rows):
        for column in range(1, columns):
            a, b = blocked[row - 1, column - 1], blocked[row - 1, column]
            c, d = blocked[row, column - 1], blocked[row, column]
            if int(a) + int(b) + int(c) + int(d) == 1:
                side[row, column] = 0 if a else 1 if b else 2 if c else 3
                next_left[row, column] = column
                number[row, column], count = count, count + 1
            else:
                next_left[row, column] = next_left[row, column - 1]
        for column in range(columns - 1, 0, -1):
            next_right[row, column] = column if side[row, column] >= 0 else next_right[row, column + 1]
    return (blocked, right, left, side, number, next_right, next_left)


@callee
def seen(
    grid: Corners,
    x: float,
    y: float,
    along_x: int,
    along_y: int,
    most_x: float,
    most_y: float,
    found: Int32Array,
    count: int,
    waiting: FloatArray,
) -> int:
    """Write the corners that are seen from a point in one quadrant, its axes included; return their number in all.

    Who sees a corner only between two obstacles that both touch the ray is not counted: no disc goes there. Rows are
    gone through from the point on, each cutting the slopes at which it is passed into fewer and narrower intervals.

    Args:
        grid: cells and corners.
        x: of the point, cells.
        y: of the point, cells.
        along_x: 1 for the quadrant's x above the point's, -1 for below.
        along_y: likewise.
        most_x: how far from the point corners matter along x, cells.
        most_y: likewise along y.
        found: (n, 2), columns and rows of corners, written to from ``count`` on.
        count: of corners that are there already.
        waiting: memory, (m, 3), for intervals that are still to be gone through.

    Returns:
        -1 if there was not enough memory.
    """
    first = floor(y) if along_y > 0 else ceil(y) - 1
    column = floor(x) if along_x > 0 else ceil(x) - 1
    if not (0 <= first < grid.blocked.shape[0] and 0 <= column < grid.blocked.shape[1]):
        return count
    if y == floor(y) and not grid.blocked[first, column]:
        # Along the axis itself.
        if along_x > 0:
            end, at = min(float(grid.right[first, column]), x + most_x), grid.next_right[int(y), floor(x) + 1]
            while at <= end:
                if count == len(found):
                    return -1
                found[count, 0], found[count, 1] = at, int(y)
                count += 1
                at = grid.next_right[int(y), at + 1]
        else:
            end, at = max(float(grid.left[first, column] + 1), x - most_x), grid.next_left[int(y), ceil(x) - 1]
            while at >= end:
                if count == len(found):
                    return -1
                found[count, 0], found[count, 1] = at, int(y)
                count += 1
                at = grid.next_left[int(y), at - 1]
    waiting[0, 0], waiting[0, 1], waiting[0, 2] = 0.0, 0.0, inf
    size = 1
    while size > 0:
        size -= 1
        k, low, high = int(waiting[size, 0]), waiting[size, 1], waiting[size, 2]
        row = first + k * along_y
        near, far = (row - y, row + 1 - y) if along_y > 0 else (y - row - 1, y - row)
        near = max(near, 0.0)
        vertex_row = row + 1 if along_y > 0 else row
        if low * near > most_x:
            continue
        # The cell that the lowest ray enters first; none lies behind the point.
        u = low * near
        at = floor(x + u) if along_x > 0 else ceil(x - u) - 1
        while True:
            if grid.blocked[row, at]:
                end = grid.right[row, at] if along_x > 0 else grid.left[row, at] + 1
                behind = (end - x) * along_x
                # Rays between these slopes enter the run's interior: those that stay below it go on.
                low = max(low, inf if near == 0.0 else behind / near)
                if not low < high:
                    break
                at = end if along_x > 0 else end - 1
                continue
            end = grid.right[row, at] if along_x > 0 else grid.left[row, at] + 1
            before = (end - x) * along_x / far
            top = min(high, before)
            if top - low > GRAZING and far <= most_y:
                # Corners on the far side of the row, within the interval.
                a, b = low * far - 1e-9, min(top * far + 1e-9, most_x)
                if along_x > 0:
                    corner = grid.next_right[vertex_row, max(0, ceil(x + a))]
                    while corner <= x + b:
                        if count == len(found):
                            return -1
                        found[count, 0], found[count, 1] = corner, vertex_row
                        count += 1
                        corner = grid.next_right[vertex_row, corner + 1]
                else:
                    corner = grid.next_left[vertex_row, floor(x - a)]
                    while corner >= x - b:
                        if count == len(found):
                            return -1
                        found[count, 0], found[count, 1] = corner, vertex_row
                        count += 1
                        corner = grid.next_left[vertex_row, corner - 1]
                if far < most_y:
                    if size == len(waiting):
                        return -1
                    waiting[size, 0], waiting[size, 1], waiting[size, 2] = k + 1, low, top
                    size += 1
            if before >= high or (end - x) * along_x > most_x + 1.0:
                break
            at = end if along_x > 0 else end - 1
    return count


@njit(numbers=True)
def fits(grid: Corners, ax: float, ay: float, bx: float, by: float, radius: float) -> bool:
    """Return whether no blocked cell is nearer than ``radius`` to a segment, all in cells."""
    rows, columns = grid.blocked.shape
    low, high = min(ay, by) - radius, max(ay, by) + radius
    for row in range(max(0, floor(low)), min(rows - 1, floor(high)) + 1):
        # The part of the segment from which this row can be nearer than the radius.
        x1, x2 = ax, bx
        if ay != by:
            t1, t2 = (row - radius - ay) / (by - ay), (row + 1 + radius - ay) / (by - ay)
            t1, t2 = max(0.0, min(t1, t2) - 1e-9), min(1.0, max(t1, t2) + 1e-9)
            x1, x2 = ax + t1 * (bx - ax), ax + t2 * (bx - ax)
        at, last = max(0, floor(min(x1, x2) - radius)), min(columns - 1, floor(max(x1, x2) + radius))
        while at <= last:
            if not grid.blocked[row, at]:
                at = grid.right[row, at]
            elif _near(ax, ay, bx, by, float(at), float(row), radius):
                return False
            else:
                at += 1
    return True


@njit(nogil=True)
def all_fit(grid: Corners, points: FloatArray, radius: float) -> bool:
    """Return whether no blocked cell is nearer than ``radius`` to a path over points (n, 2), all in cells."""
    for i in range(len(points) - 1):
        if not fits(grid, points[i, 0], points[i, 1], points[i + 1, 0], points[i + 1, 1], radius):
            return False
    return True


@callee
def _near(ax: float, ay: float, bx: float, by: float, left: float, low: float, radius: float) -> bool:
    """Return whether a segment comes nearer than ``radius`` to the unit square at (left, low)."""
    for x, y in ((ax, ay), (bx, by)):
        dx, dy = max(left - x, 0.0, x - left - 1.0), max(low - y, 0.0, y - low - 1.0)
        if dx * dx + dy * dy < radius * radius:
            return True
    ex, ey = bx - ax, by - ay
    length = hypot(ex, ey)
    if length == 0.0:
        return False
    above = below = False
    for i in range(2):
        for j in range(2):
            wx, wy = left + i - ax, low + j - ay
            along, across = (wx * ex + wy * ey) / length, (ex * wy - ey * wx) / length
            if 0.0 <= along <= length and abs(across) < radius:
                return True
            above, below = above or across > 0.0, below or across < 0.0
    if not (above and below):
        return False
    # The line passes through the square: the segment does where their boxes overlap along both axes.
    return min(ax, bx) < left + 1.0 and max(ax, bx) > left and min(ay, by) < low + 1.0 and max(ay, by) > low
