"""What the beams of a scan tell of the cells of a grid: which they pass, and where in a cell a surface lies.

A cell whose surface was met keeps the box of the stretches of surface in it, not only that it is occupied, so that a
passage is as wide as it was measured. What is gone is told by beams that go through that surface: one that grazes a
wall passes its cells and says nothing against it.
"""

# Tested by tests/exploration/test_known_map.py.

from __future__ import annotations

from math import atan2, ceil, cos, floor, hypot, inf, log2, pi, sin
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit

__all__ = [
    "FREE",
    "LOST",
    "MET",
    "NOTHING",
    "OCCUPIED",
    "SEEN",
    "TILE",
    "UNKNOWN",
    "WHOLE",
    "Cells",
    "enter_scan",
    "rectangles",
]

UNKNOWN: Final = 0
FREE: Final = 1
OCCUPIED: Final = 2

LOST: Final = 0
MET: Final = 1
NOTHING: Final = 2

TILE: Final = 16
"""Cells: side of the squares by which changes are told."""

SEEN: Final = 15
"""All four quarters of a cell."""

WHOLE: Final = 64
"""The gap between beams of one cell, as a level."""

OCTAVE: Final = 4
"""Levels by which the gap between beams halves: what was seen twice as finely replaces what was seen before."""

MISSES: Final = 3
"""Scans in a row with beams through what was there, after which it is gone."""

STEEP: Final = 3.0
"""Gaps between beams from one end point to the next on a surface that goes on: it is met at 20 degrees or more."""

NUDGE: Final = 1e-6
"""Cells by which an end point is moved on along its beam: a surface between two cells belongs to the one behind it."""


class Cells(NamedTuple):
    """What is kept for each cell, arrays of shape (rows, columns, ...)."""

    state: NDArray[np.uint8]
    """UNKNOWN, FREE or OCCUPIED."""
    seen: NDArray[np.uint8]
    """The quarters that beams passed, with half the gap to their neighbours: 1 and 2 in the lower half, 4 and 8."""
    box: NDArray[np.uint8]
    """Shape (rows, columns, 4): xmin, ymin, xmax, ymax of the surface in an occupied cell, in 255ths of its side."""
    facing: NDArray[np.uint8]
    """The direction across that surface, 1 to 255 for 0 to pi; 0 where it is not known."""
    level: NDArray[np.uint8]
    """Gap between beams with which it was seen: WHOLE for a cell, and OCTAVE more for twice that."""
    misses: NDArray[np.uint8]
    """Scans in a row with beams that went through it."""
    stamp: NDArray[np.int32]
    """The last scan that told of it."""
    changed: NDArray[np.bool_]
    """Shape (tile rows, tile columns): whether a cell's state or box changed."""

    @classmethod
    def unknown(cls, rows: int, columns: int) -> Cells:
        """Return cells of which nothing is known."""

        def zeros() -> NDArray[np.uint8]:
            return np.zeros((rows, columns), dtype=np.uint8)

        tiles = -(-rows // TILE), -(-columns // TILE)
        box, stamp = np.zeros((rows, columns, 4), dtype=np.uint8), np.zeros((rows, columns), dtype=np.int32)
        return cls(zeros(), zeros(), box, zeros(), zeros(), zeros(), stamp, np.ones(tiles, dtype=np.bool_))


@njit(cache=True)
def enter_scan(cells, now, start, ends, kinds, normals, gap, tolerance):  # type: ignore[no-untyped-def]  # numba infers the types
    """Enter a scan, all of it in cells from the grid's corner on.

    Args:
        cells: what is known.
        now: the scan's number.
        start: where the scanner stands, shape (2,).
        ends: of its beams in their order, shape (n, 2).
        kinds: LOST, MET or NOTHING, shape (n,).
        normals: across the surfaces that were met, shape (n, 2); zero where that is not known.
        gap: radians from one beam to the next.
        tolerance: how far beyond a surface a beam must have come to speak against it.
    """
    _enter_surfaces(cells, now, start, ends, kinds, normals, gap)
    _enter_passes(cells, now, start, ends, kinds, gap, tolerance)


@njit(cache=True)
def _enter_surfaces(cells, now, start, ends, kinds, normals, gap):  # type: ignore[no-untyped-def]  # numba infers the types
    """Enter what lies between neighbouring end points, and what may lie between the last one and the next beam."""
    n = len(ends)
    for first in (True, False):
        for k in range(n):
            if kinds[k] != MET:
                continue
            x, y = ends[k]
            r = hypot(x - start[0], y - start[1])
            if r < 1e-9:
                continue
            width = max(r * gap, 1e-6)
            level = min(254, max(0, WHOLE + ceil(OCTAVE * log2(width))))
            facing = 0
            if normals[k, 0] != 0.0 or normals[k, 1] != 0.0:
                facing = 1 + floor((atan2(normals[k, 1], normals[k, 0]) % pi) / pi * 254.0 + 0.5)
            before, ahead, behind, is_open = width, True, True, False
            for side in (-1, 1):
                other = k + side
                while 0 <= other < n and kinds[other] == LOST and abs(other - k) < 3:
                    other += side
                ends_here = False
                if not (0 <= other < n) or kinds[other] == LOST:
                    is_open = True
                else:
                    ends_here = True
                    apart = hypot(ends[other, 0] - x, ends[other, 1] - y)
                    if kinds[other] == MET and apart <= STEEP * width * abs(other - k):
                        ends_here = False
                        before = apart / abs(other - k)
                        if side == 1 and not first:
                            _stretch(cells, x, y, ends[other, 0], ends[other, 1], level, facing, now)
                    elif kinds[other] == MET and hypot(ends[other, 0] - start[0], ends[other, 1] - start[1]) < r:
                        # Something nearer hides how the surface goes on.
                        ends_here, is_open = False, True
                if side == 1:
                    ahead = ends_here
                else:
                    behind = ends_here
            if first:
                if is_open:
                    _leave_open(cells, x, y, level, now)
                continue
            # Along the surface, the way in which the beams turn.
            along_x, along_y = -(y - start[1]) / r, (x - start[0]) / r
            if facing:
                angle = (facing - 1) * pi / 254.0
                side_on = -sin(angle) * along_x + cos(angle) * along_y
                along_x, along_y = -sin(angle), cos(angle)
                if side_on < 0.0:
                    along_x, along_y = -along_x, -along_y
            if not facing:
                # How the surface goes on is not known: within the cell it may.
                row, column = floor(y), floor(x)
                ax, ay, bx, by = x, y, x, y
                if behind:
                    ax, ay = x - before * along_x, y - before * along_y
                if ahead:
                    bx, by = x + before * along_x, y + before * along_y
                _meet(cells, row, column, ax, ay, bx, by, level, facing, now)
                continue
            if behind:
                _stretch(cells, x, y, x - before * along_x, y - before * along_y, level, facing, now)
            if ahead:
                _stretch(cells, x, y, x + before * along_x, y + before * along_y, level, facing, now)


@njit(cache=True)
def _leave_open(cells, x, y, level, now):  # type: ignore[no-untyped-def]  # numba infers the types
    """Enter a cell of which a scan shows a part only: all of it counts, unless more was known before."""
    rows, columns = cells.state.shape
    row, column = floor(y), floor(x)
    if not (0 <= row < rows and 0 <= column < columns):
        return
    if cells.state[row, column] != OCCUPIED:
        _meet(cells, row, column, column, row, column + 1.0, row + 1.0, min(254, level + OCTAVE), 0, now)
    cells.stamp[row, column] = now  # so that this scan does not replace what is known


@njit(cache=True)
def _stretch(cells, ax, ay, bx, by, level, facing, now):  # type: ignore[no-untyped-def]  # numba infers the types
    """Enter a straight stretch of surface, cell by cell."""
    dx, dy = bx - ax, by - ay
    i, j, last_i, last_j = floor(ax), floor(ay), floor(bx), floor(by)
    step_i, step_j = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    next_i = ((i + (dx > 0.0)) - ax) / dx if dx != 0.0 else inf
    next_j = ((j + (dy > 0.0)) - ay) / dy if dy != 0.0 else inf
    at = 0.0
    for _ in range(abs(last_i - i) + abs(last_j - j) + 1):
        until = min(1.0, next_i, next_j)
        _meet(cells, j, i, ax + at * dx, ay + at * dy, ax + until * dx, ay + until * dy, level, facing, now)
        at = until
        if next_i < next_j:
            next_i += step_i / dx
            i += step_i
        else:
            next_j += step_j / dy if dy != 0.0 else inf
            j += step_j


@njit(cache=True)
def _meet(cells, row, column, ax, ay, bx, by, level, facing, now):  # type: ignore[no-untyped-def]  # numba infers the types
    """Enter a stretch of surface within one cell."""
    rows, columns = cells.state.shape
    # What noise puts beyond the bounds belongs to the cells along them.
    if not (-1 <= row <= rows and -1 <= column <= columns):
        return
    row, column = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
    known, again = cells.state[row, column] == OCCUPIED, cells.stamp[row, column] == now
    cells.misses[row, column], cells.stamp[row, column] = 0, now
    box = cells.box[row, column]
    if known and level > cells.level[row, column] + OCTAVE:
        return
    if not known or (not again and level + OCTAVE <= cells.level[row, column]):
        cells.state[row, column] = OCCUPIED
        cells.level[row, column] = level
        cells.facing[row, column] = 0
        box[0], box[1], box[2], box[3] = 255, 255, 0, 0
        cells.changed[row // TILE, column // TILE] = True
    if facing:
        cells.facing[row, column] = facing
    x0 = min(255, max(0, floor(255.0 * (min(ax, bx) - column))))
    y0 = min(255, max(0, floor(255.0 * (min(ay, by) - row))))
    x1 = min(255, max(0, ceil(255.0 * (max(ax, bx) - column))))
    y1 = min(255, max(0, ceil(255.0 * (max(ay, by) - row))))
    if x0 < box[0] or y0 < box[1] or x1 > box[2] or y1 > box[3]:
        box[0], box[1], box[2], box[3] = min(box[0], x0), min(box[1], y0), max(box[2], x1), max(box[3], y1)
        cells.changed[row // TILE, column // TILE] = True


@njit(cache=True)
def _enter_passes(cells, now, start, ends, kinds, gap, tolerance):  # type: ignore[no-untyped-def]  # numba infers the types
    """Walk along each beam from cell to cell (Amanatides & Woo 1987, A Fast Voxel Traversal Algorithm)."""
    rows, columns = cells.state.shape
    sx, sy = start
    for k in range(len(ends)):
        if kinds[k] == LOST:
            continue
        ex, ey = ends[k]
        dx, dy = ex - sx, ey - sy
        length = hypot(dx, dy)
        if length < 1e-9:
            continue
        i, j, last_i, last_j = floor(sx), floor(sy), floor(ex), floor(ey)
        step_i, step_j = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        next_i = ((i + (dx > 0.0)) - sx) / dx if dx != 0.0 else inf
        next_j = ((j + (dy > 0.0)) - sy) / dy if dy != 0.0 else inf
        ux, uy = dx / length, dy / length
        for _ in range(abs(last_i - i) + abs(last_j - j) + 1):
            if 0 <= i < columns and 0 <= j < rows:
                if cells.seen[j, i] != SEEN:
                    _see(cells, j, i, i + 0.25 - sx, j + 0.25 - sy, ux, uy, length, gap)
                if kinds[k] == MET and i == last_i and j == last_j:
                    break
                if cells.state[j, i] == UNKNOWN:
                    cells.state[j, i] = FREE
                    cells.changed[j // TILE, i // TILE] = True
                elif (
                    cells.state[j, i] == OCCUPIED
                    and cells.stamp[j, i] != now
                    and _goes_through(cells, j, i, sx, sy, ux, uy, length - tolerance)
                ):
                    cells.stamp[j, i] = now
                    cells.misses[j, i] += 1
                    if cells.misses[j, i] >= MISSES:
                        cells.state[j, i], cells.misses[j, i] = FREE, 0
                        cells.changed[j // TILE, i // TILE] = True
            if next_i < next_j:
                next_i += step_i / dx
                i += step_i
            else:
                next_j += step_j / dy if dy != 0.0 else inf
                j += step_j


@njit(cache=True)
def _see(cells, row, column, wx, wy, ux, uy, length, gap):  # type: ignore[no-untyped-def]  # numba infers the types
    """Count the quarters of a cell, the first of which lies at (wx, wy) from the scanner, that a beam passes."""
    seen = cells.seen[row, column]
    for quarter in range(4):
        x, y = wx + 0.5 * (quarter & 1), wy + 0.5 * (quarter >> 1)
        along = ux * x + uy * y
        if along <= length and abs(ux * y - uy * x) <= 0.25 + 0.5 * gap * along:
            seen |= 1 << quarter
    if seen != cells.seen[row, column]:
        cells.seen[row, column] = seen
        cells.changed[row // TILE, column // TILE] = True


@njit(cache=True)
def _goes_through(cells, row, column, sx, sy, dx, dy, until):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return whether a beam crosses the surface in a cell before it has come so far."""
    box, facing = cells.box[row, column], cells.facing[row, column]
    px, py = column + (int(box[0]) + int(box[2])) / 510.0, row + (int(box[1]) + int(box[3])) / 510.0
    nx, ny = dx, dy
    if facing:
        angle = (facing - 1) * pi / 254.0
        nx, ny = cos(angle), sin(angle)
    steep = nx * dx + ny * dy
    if abs(steep) < 0.1:
        return False
    at = (nx * (px - sx) + ny * (py - sy)) / steep
    x, y = 255.0 * (sx + at * dx - column), 255.0 * (sy + at * dy - row)
    return 0.0 < at < until and box[0] - 2 <= x <= box[2] + 2 and box[1] - 2 <= y <= box[3] + 2


@njit(cache=True)
def rectangles(mask):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return boxes x0, y0, x1, y1, shape (n, 4), that cover a mask exactly: runs of a row, joined to equal ones above.

    Args:
        mask: shape (rows, columns) of bool.
    """
    rows, columns = mask.shape
    found, count = np.empty((mask.size, 4), dtype=np.int64), 0
    open_at = np.full(columns, -1, dtype=np.int64)  # by its first column, the box that the row before ended
    for r in range(rows):
        c = 0
        while c < columns:
            if not mask[r, c]:
                open_at[c] = -1
                c += 1
                continue
            first = c
            while c < columns and mask[r, c]:
                if c > first:
                    open_at[c] = -1
                c += 1
            k = open_at[first]
            if k >= 0 and found[k, 2] == c and found[k, 3] == r:
                found[k, 3] = r + 1
                continue
            found[count, 0], found[count, 1], found[count, 2], found[count, 3] = first, r, c, r + 1
            open_at[first] = count
            count += 1
    return found[:count].copy()
