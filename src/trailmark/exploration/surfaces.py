"""Where in the cells of a grid the surfaces lie that the beams of a scan met.

A cell keeps the box of the stretches of surface in it, so that a passage is as wide as it was measured.
"""

# Tested by tests/exploration/test_known_map.py.

from __future__ import annotations

from math import atan2, ceil, cos, floor, hypot, log2, pi, sin
from typing import Final

from trailmark.compiled import njit
from trailmark.estimation.maps.cell_walk import first_step
from trailmark.exploration.cells import LOST, MET, OCCUPIED, TILE, TOUCHED, WHOLE

__all__ = ["enter_surfaces"]

OCTAVE: Final = 4
"""Levels by which the gap between beams halves: what was seen twice as finely replaces what was seen before."""

STEEP: Final = 3.0
"""Gaps between beams from one end point to the next on a surface that goes on: it is met at 20 degrees or more."""


@njit(cache=True)
def enter_surfaces(cells, now, start, ends, kinds, normals, gap):  # type: ignore[no-untyped-def]  # numba infers the types
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
            level = min(254, max(TOUCHED + 1, WHOLE + ceil(OCTAVE * log2(width))))
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
    i, j, last_i, last_j, step_i, step_j, next_i, next_j, each_i, each_j = first_step(ax, ay, bx, by)
    at = 0.0
    for _ in range(abs(last_i - i) + abs(last_j - j) + 1):
        until = min(1.0, next_i, next_j)
        _meet(cells, j, i, ax + at * dx, ay + at * dy, ax + until * dx, ay + until * dy, level, facing, now)
        at = until
        if next_i < next_j:
            next_i += each_i
            i += step_i
        else:
            next_j += each_j
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
