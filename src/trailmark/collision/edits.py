"""Kernels that bring an obstacle grid and its clearance field up to date after an obstacle came, went or moved."""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from trailmark.collision.field import row_distances
from trailmark.collision.obstacles import cell_of
from trailmark.jit import callee, njit
from trailmark.lock import Lock
from trailmark.se2 import FloatArray

__all__ = ["Blocks", "Window", "replace_items", "spread_rows", "update_field", "window_of"]

Int32Array = NDArray[np.int32]
Window = tuple[int, int, int, int]

NEAR = 2.0
"""Cells by which a cell may be farther from the changed ones than its distance was, so that a flood over neighbouring
cells reaches all that change: 1.42 for cells beside the straight line to the changed ones, the rest for rounding."""


@njit(nogil=True)
def window_of(
    segments: FloatArray, discs: FloatArray, x0: float, y0: float, size: float, columns: int, rows: int
) -> Window:
    """Return first row, end row, first column, end column of a window of the grid, with a cell to spare on each side.

    Rows and columns from the first to before the end hold all that segments (m, 4) and discs (k, 3) touch of the grid.
    """
    low_x = low_y = np.inf
    high_x = high_y = -np.inf
    for x1, y1, x2, y2 in segments:
        low_x, high_x = min(low_x, x1, x2), max(high_x, x1, x2)
        low_y, high_y = min(low_y, y1, y2), max(high_y, y1, y2)
    for x, y, r in discs:
        low_x, high_x = min(low_x, x - r), max(high_x, x + r)
        low_y, high_y = min(low_y, y - r), max(high_y, y + r)
    return (
        max(0, cell_of(low_y - size, y0, size, rows)),
        min(rows, cell_of(high_y + size, y0, size, rows) + 1),
        max(0, cell_of(low_x - size, x0, size, columns)),
        min(columns, cell_of(high_x + size, x0, size, columns) + 1),
    )


@njit(nogil=True)
def replace_items(
    cell_start: Int32Array,
    items: Int32Array,
    row_start: NDArray[np.int64],
    removed: Int32Array,
    cells: NDArray[np.int64],
    owners: Int32Array,
    window: Window,
) -> bool:
    """Take items out of the cells of a window and put others in, in place.

    Returns False, and changes nothing, if a row may have too little room.

    Args:
        cell_start: (rows, columns + 1), as in the grid.
        items: as in the grid.
        row_start: (rows + 1,) where the room of each row begins in ``items``.
        removed: (r,) the items to take out.
        cells: (p,) row * columns + column of each of ``owners``.
        owners: (p,) items to put in.
        window: of the rows and columns that hold all these cells.
    """
    first_row, end_row, first_column, end_column = window
    if first_row >= end_row or first_column >= end_column:
        return True
    columns = cell_start.shape[1] - 1
    width = end_column - first_column
    # Where the new items of each cell of the window begin in ``added``.
    added, begin = np.empty(len(owners), np.int32), np.zeros((end_row - first_row) * width + 1, np.int64)
    for cell in cells:
        begin[(cell // columns - first_row) * width + cell % columns - first_column + 1] += 1
    for k in range(1, len(begin)):
        begin[k] += begin[k - 1]
    for row in range(first_row, end_row):
        base = (row - first_row) * width
        if cell_start[row, columns] + begin[base + width] - begin[base] > row_start[row + 1]:
            return False
    place = begin[:-1].copy()
    for cell, owner in zip(cells, owners):  # noqa: B905  # compiled code knows no strict
        k = (cell // columns - first_row) * width + cell % columns - first_column
        added[place[k]] = owner
        place[k] += 1
    lowest, highest = np.int32(0), np.int32(-1)
    gone = np.zeros(0, np.bool_)
    if len(removed) > 0:
        lowest, highest = removed.min(), removed.max()
        gone = np.zeros(highest - lowest + 1, np.bool_)
        for item in removed:
            gone[item - lowest] = True
    for row in range(first_row, end_row):
        start, end = cell_start[row, first_column], cell_start[row, end_column]
        behind = cell_start[row, columns] - end
        base = (row - first_row) * width
        fresh = np.empty(end - start + begin[base + width] - begin[base], np.int32)
        count, next_start = 0, start
        for column in range(width):
            before, next_start = next_start, cell_start[row, first_column + column + 1]
            cell_start[row, first_column + column] = start + count
            for k in range(before, next_start):
                item = items[k]
                if not (lowest <= item <= highest and gone[item - lowest]):
                    fresh[count] = item
                    count += 1
            for k in range(begin[base + column], begin[base + column + 1]):
                fresh[count] = added[k]
                count += 1
        shift = start + count - end
        if shift < 0:
            for k in range(end, end + behind):
                items[k + shift] = items[k]
        elif shift > 0:
            for k in range(end + behind - 1, end - 1, -1):
                items[k + shift] = items[k]
        for k in range(count):
            items[start + k] = fresh[k]
        if shift != 0:
            for column in range(end_column, columns + 1):
                cell_start[row, column] += shift
    return True


@njit(nogil=True)
def spread_rows(
    cell_start: Int32Array,
    items: Int32Array,
    row_start: NDArray[np.int64],
    new_start: Int32Array,
    new_items: Int32Array,
) -> None:
    """Write the items of every row to the room that begins at ``row_start`` (rows + 1,) in ``new_items``.

    Args:
        cell_start: (rows, columns + 1), as in the grid.
        items: as in the grid.
        row_start: (rows + 1,).
        new_start: written to, shape (rows, columns + 1).
        new_items: written to.
    """
    for row in range(len(cell_start)):
        begin, end = cell_start[row, 0], cell_start[row, -1]
        shift = row_start[row] - begin
        for column in range(cell_start.shape[1]):
            new_start[row, column] = cell_start[row, column] + shift
        new_items[begin + shift : end + shift] = items[begin:end]


@njit(nogil=True)
def update_field(
    cell_start: Int32Array,
    winding: Int32Array,
    steps: Int32Array,
    distance: NDArray[np.float32],
    row_max: NDArray[np.float32],
    size: float,
    window: Window,
) -> tuple[Window, Window]:
    """Bring the field up to date, in place, where cells of a window became occupied or free.

    A cell's distance can change only if the changed cells are no farther from it than its nearest occupied cell was.
    From such a cell, all cells on the straight line to the box of the changed ones are such cells, too: so a flood
    from that box finds them, row by row.

    Args:
        cell_start: of the grid, up to date.
        winding: of the grid, up to date.
        steps: (rows, columns), :func:`trailmark.collision.field.vertical_steps`.
        distance: (rows, columns), the field's.
        row_max: (rows,) the largest distance of each row.
        size: edge of a cell, metres.
        window: which may hold changed cells.

    Returns:
        Windows outside of which ``steps``, and the others, are as they were.
    """
    box = _changed_cells(cell_start, winding, steps, window)
    if box[0] >= box[1]:
        return box, box
    rows, columns = steps.shape
    lowest, highest = _update_steps(cell_start, winding, steps, box)
    first_row, end_row, first_column, end_column = box
    vertex, begin = np.empty(columns, np.int64), np.empty(columns + 1)
    left_most, right_most = first_column, end_column - 1
    top = bottom = first_row
    for direction in (1, -1):
        left, right = first_column, end_column - 1
        row = first_row if direction == 1 else first_row - 1
        while 0 <= row < rows:
            up = max(row - (end_row - 1), first_row - row, 0)
            if up > 0:
                # Cells of this row are reached from those of the row before, and from their neighbours in this one.
                low, high = max(left - 1, 0), min(right + 1, columns - 1)
                left, right = low, high
                while left <= high and not _reached(distance[row, left], size, up, left, box):
                    left += 1
                if left > high:
                    break
                while not _reached(distance[row, right], size, up, right, box):
                    right -= 1
            else:
                low, high = left, right = first_column, end_column - 1
            if left == low:
                while left > 0 and _reached(distance[row, left - 1], size, up, left - 1, box):
                    left -= 1
            if right == high:
                while right < columns - 1 and _reached(distance[row, right + 1], size, up, right + 1, box):
                    right += 1
            before = distance[row, left : right + 1].max()
            # Nearest columns of cells further to the right are further to the right.
            first, end = _nearest_column(steps[row], left), _nearest_column(steps[row], right) + 1
            row_distances(steps[row], first, end, size, vertex, begin, distance[row], left, right + 1)
            largest = distance[row, left : right + 1].max()
            if largest >= row_max[row]:
                row_max[row] = largest
            elif before == row_max[row]:
                row_max[row] = distance[row].max()
            left_most, right_most = min(left_most, left), max(right_most, right)
            bottom, top = min(bottom, row), max(top, row)
            row += direction
    return (lowest, highest, first_column, end_column), (bottom, top + 1, left_most, right_most + 1)


@callee
def _reached(distance: float, size: float, up: int, column: int, box: Window) -> bool:
    """Return whether a cell ``up`` rows from the box is no farther from it than its distance was, or by NEAR."""
    across = max(column - (box[3] - 1), box[2] - column, 0)
    reach = distance / size + NEAR
    return up * up + across * across <= reach * reach


@callee
def _changed_cells(cell_start: Int32Array, winding: Int32Array, steps: Int32Array, window: Window) -> Window:
    """Return the smallest window of all cells of ``window`` that became occupied or free since ``steps`` was made."""
    first_row, end_row, first_column, end_column = window[1], window[0], window[3], window[2]
    for row in range(window[0], window[1]):
        for column in range(window[2], window[3]):
            if _occupied(cell_start, winding, row, column) != (steps[row, column] == 0):
                first_row, end_row = min(first_row, row), max(end_row, row + 1)
                first_column, end_column = min(first_column, column), max(end_column, column + 1)
    return first_row, end_row, first_column, end_column


@callee
def _occupied(cell_start: Int32Array, winding: Int32Array, row: int, column: int) -> bool:
    return bool(cell_start[row, column + 1] > cell_start[row, column] or winding[row, column] > 0)


@callee
def _update_steps(cell_start: Int32Array, winding: Int32Array, steps: Int32Array, box: Window) -> tuple[int, int]:
    """Bring the steps of a box's columns up to date; return the first row changed and one behind the last."""
    rows, columns = steps.shape
    far = rows + columns
    lowest, highest = box[0], box[1]
    for column in range(box[2], box[3]):
        # Beyond the nearest occupied cells below and above the box nothing changes.
        low, high = box[0] - 1, box[1]
        while low >= 0 and steps[low, column] != 0:
            low -= 1
        while high < rows and steps[high, column] != 0:
            high += 1
        count = 0 if low >= 0 else far
        for row in range(low + 1, high):
            inside = box[0] <= row < box[1] and _occupied(cell_start, winding, row, column)
            count = 0 if inside else min(count + 1, far)
            steps[row, column] = count
        count = 0 if high < rows else far
        for row in range(high - 1, low, -1):
            count = min(steps[row, column], count + 1)
            steps[row, column] = count
        lowest, highest = min(lowest, low + 1), max(highest, high)
    return lowest, highest


@callee
def _nearest_column(steps: Int32Array, column: int) -> int:
    """Return the column in which the nearest occupied cell of a row's cell is."""
    best, found = steps[column] ** 2, column
    away = 1
    while away * away < best and (column - away >= 0 or column + away < len(steps)):
        for other in (column - away, column + away):
            if 0 <= other < len(steps) and steps[other] ** 2 + away * away < best:
                best, found = steps[other] ** 2 + away * away, other
        away += 1
    return found


# --- Blocks: memory for versions of the same arrays, used again once nobody holds any array of a version.

ALIGNMENT = 64
"""Bytes: where arrays begin in a block."""


class Blocks:
    """Memory for versions of a set of arrays, all of them in one block.

    To allocate memory for a new version takes longer than to change it: the system hands out pages one by one, and all
    the arrays are copied. A block of an older version is free as soon as no array, and no view of one, is referenced
    any more; it still holds that version's content, of which only a part is out of date. Threads may share the object.

    Args:
        arrays: of the first version: their shapes and types are those of all versions.
    """

    def __init__(self, arrays: Sequence[NDArray[Any]]) -> None:
        self._kinds: list[tuple[int, int, tuple[int, ...], DTypeLike]] = []
        self._size = 0
        for array in arrays:
            self._kinds.append((self._size, array.nbytes, array.shape, array.dtype))
            self._size += math.ceil(array.nbytes / ALIGNMENT) * ALIGNMENT
        self._used: list[tuple[bytearray, weakref.ref[NDArray[np.uint8]], object]] = []
        self._lock = Lock()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_used": []}

    def take(self, version: object, wanted: Sequence[object]) -> tuple[list[NDArray[Any]], object | None]:
        """Return arrays for a new version, and the version whose content they hold; None if it is none of the wanted.

        Args:
            version: stands for the new version.
            wanted: versions whose content would be useful, the most useful first.
        """
        with self._lock:
            free = [entry for entry in self._used if entry[1]() is None]
            self._used = [entry for entry in self._used if entry[1]() is not None]
            # The newest of the others stays for the next time; more are never needed at once.
            free.sort(key=lambda entry: wanted.index(entry[2]) if entry[2] in wanted else len(wanted))
            block, _, content = free[0] if free else (bytearray(self._size), None, None)
            self._used += free[1:2]
            root = np.frombuffer(block, np.uint8)
            self._used.append((block, weakref.ref(root), version))
        # All views of these arrays hold ``root`` itself: numpy names as base what is no array's view.
        arrays = [root[at : at + size].view(kind).reshape(shape) for at, size, shape, kind in self._kinds]
        return arrays, content if content in wanted else None
