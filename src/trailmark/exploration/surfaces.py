"""Where in the cells of a grid the surfaces lie that the beams of a scan met.

A cell keeps the box of the stretches of surface in it, so that a passage is as wide as it was measured.
"""

from __future__ import annotations

from math import atan2, ceil, cos, floor, hypot, pi, sin
from typing import Final

from trailmark.estimation.grid import first_step
from trailmark.exploration.cells import FREE, LOST, MET, OCCUPIED, OCTAVE, TILE, level_of
from trailmark.jit import callee

__all__ = ["enter_surfaces"]

ALIGNED: Final = 0.97
"""Cosine of the angle between a surface and a cell's sides up to which its box ends where the surface lies."""

GAIN, AHEAD, MOST = 0.02, 5.0, 50
"""A reading moves a surface's front by a share of the innovation: one by the number of readings, of which at most MOST
count, as in a running mean, and GAIN at least. A reading ahead of the front moves it AHEAD times as far, so that the
front comes to lie about a standard deviation before the surface, however many readings there are; the farthest of all
readings would come ever nearer, until narrow passages were shut."""

STEEP: Final = 3.0
"""Gaps between beams from one end point to the next on a surface that goes on: it is met at 20 degrees or more."""


@callee
def enter_surfaces(cells, now, start, ends, kinds, normals, gap, gate):  # type: ignore[no-untyped-def]  # numba infers the types
    """Enter what lies between neighbouring end points, and what may lie between the last one and the next beam.

    What is met within the gate (cells) of a surface that is known, along its normal, refines where that lies.
    """
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
            level = level_of(width)
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
                            bx, by = ends[other]
                            _stretch(cells, x, y, bx, by, False, level, facing, now, start, gate)
                    elif kinds[other] == MET and hypot(ends[other, 0] - start[0], ends[other, 1] - start[1]) < r:
                        # Something nearer hides how the surface goes on.
                        ends_here, is_open = False, True
                if side == 1:
                    ahead = ends_here
                else:
                    behind = ends_here
            if first:
                if is_open:
                    _leave_open(cells, x, y, level, now, start, gate)
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
                _meet(cells, row, column, ax, ay, bx, by, False, level, facing, now, start, gate)
                continue
            if behind:
                _stretch(cells, x, y, x - before * along_x, y - before * along_y, True, level, facing, now, start, gate)
            if ahead:
                _stretch(cells, x, y, x + before * along_x, y + before * along_y, True, level, facing, now, start, gate)


@callee
def _leave_open(cells, x, y, level, now, start, gate):  # type: ignore[no-untyped-def]  # numba infers the types
    """Enter a cell of which a scan shows a part only: all of it counts, unless more was known before."""
    rows, columns = cells.state.shape
    row, column = floor(y), floor(x)
    if not (0 <= row < rows and 0 <= column < columns):
        return
    if cells.state[row, column] != OCCUPIED:
        left, low, coarser = float(column), float(row), min(254, level + OCTAVE)
        _meet(cells, row, column, left, low, left + 1.0, low + 1.0, True, coarser, 0, now, start, gate)
    cells.stamp[row, column] = now  # so that this scan does not replace what is known


@callee
def _stretch(cells, ax, ay, bx, by, beyond, level, facing, now, start, gate):  # type: ignore[no-untyped-def]  # numba infers the types
    """Enter a straight stretch of surface, cell by cell; beyond: between the last end point and the next beam."""
    dx, dy = bx - ax, by - ay
    i, j, last_i, last_j, step_i, step_j, next_i, next_j, each_i, each_j = first_step(ax, ay, bx, by)
    at = 0.0
    for _ in range(abs(last_i - i) + abs(last_j - j) + 1):
        until = min(1.0, next_i, next_j)
        px, py, qx, qy = ax + at * dx, ay + at * dy, ax + until * dx, ay + until * dy
        _meet(cells, j, i, px, py, qx, qy, beyond, level, facing, now, start, gate)
        at = until
        if next_i < next_j:
            next_i += each_i
            i += step_i
        else:
            next_j += each_j
            j += step_j


@callee
def _meet(cells, row, column, ax, ay, bx, by, beyond, level, facing, now, start, gate):  # type: ignore[no-untyped-def]  # numba infers the types
    """Enter a stretch of surface within one cell."""
    rows, columns = cells.state.shape
    # What noise puts beyond the bounds belongs to the cells along them.
    if not (-1 <= row <= rows and -1 <= column <= columns):
        return
    row, column = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
    met = (
        min(255, max(0, floor(255.0 * (min(ax, bx) - column)))),
        min(255, max(0, floor(255.0 * (min(ay, by) - row)))),
        min(255, max(0, ceil(255.0 * (max(ax, bx) - column)))),
        min(255, max(0, ceil(255.0 * (max(ay, by) - row)))),
    )
    ahead_x, ahead_y = start[0] - 0.5 * (ax + bx), start[1] - 0.5 * (ay + by)
    known, again = cells.state[row, column] == OCCUPIED, cells.stamp[row, column] == now
    front = _front(cells.facing[row, column] if known and not facing else facing, ahead_x, ahead_y)
    if not known and front >= 0 and gate > 0.0 and _is_of_next(cells, row, column, front, met[front], gate, now):
        return
    # From afar the next beam lies far away; where it was seen from near that nothing stands, nothing does.
    if beyond and gate > 0.0 and cells.state[row, column] == FREE and level >= cells.level[row, column] + OCTAVE:
        return
    if not (beyond and gate > 0.0):  # else it only may be there, and beams that pass it count
        cells.misses[row, column], cells.stamp[row, column] = 0, now
    box = cells.box[row, column]
    if known and level > cells.level[row, column] + OCTAVE:
        return
    if not known or (not again and level + OCTAVE <= cells.level[row, column]):
        cells.state[row, column], cells.level[row, column] = OCCUPIED, level
        cells.facing[row, column], cells.readings[row, column] = 0, 0
        box[0], box[1], box[2], box[3] = 255, 255, 0, 0
        cells.changed[row // TILE, column // TILE] = True
    if facing:
        cells.facing[row, column] = facing
    for side in range(4):
        ahead = met[side] - int(box[side]) if side >= 2 else int(box[side]) - met[side]
        if side == front and cells.readings[row, column] > 0 and abs(ahead) <= 255.0 * gate:
            # Beams that lie farther apart than those before may pass beside what stands out there.
            as_fine = level <= cells.level[row, column] + OCTAVE // 2
            if ahead > 0 or as_fine:
                _move_front(cells, row, column, side, ahead, AHEAD if as_fine else 1.0)
        elif ahead > 0:
            box[side] = met[side]
            cells.changed[row // TILE, column // TILE] = True
    if front >= 0:
        cells.readings[row, column] = min(cells.readings[row, column] + 1, MOST)


@callee
def _is_of_next(cells, row, column, front, met, gate, now):  # type: ignore[no-untyped-def]  # numba infers the types
    """Refine the surface in the next cell, if what is met here is a reading of it; return whether it is.

    A surface that lies near a cell's side has readings in the cell before. Only where its front has come to that side
    does it take up both.
    """
    row, column = row - (front == 3) + (front == 1), column - (front == 2) + (front == 0)
    if not (0 <= row < cells.state.shape[0] and 0 <= column < cells.state.shape[1]):
        return False
    side, box = front % 2, cells.box[row, column]
    deep = 255 - int(box[front]) if front >= 2 else int(box[front])
    angle = (cells.facing[row, column] - 1) * pi / 254.0
    along = abs(cos(angle)) if side == 0 else abs(sin(angle))
    if cells.state[row, column] != OCCUPIED or not cells.facing[row, column] or along < ALIGNED or deep == 0:
        return False
    ahead = deep + (met if front >= 2 else 255 - met)
    if ahead > 255.0 * gate:
        return False
    _move_front(cells, row, column, front, ahead, AHEAD)
    cells.misses[row, column], cells.stamp[row, column] = 0, now
    return True


@callee
def _move_front(cells, row, column, side, ahead, times):  # type: ignore[no-untyped-def]  # numba infers the types
    """Move the front of the surface in a cell by what a reading that lies so far ahead of it, in 255ths, tells."""
    gain = max(1.0 / (1.0 + cells.readings[row, column]), GAIN)
    step = int(min(1.0, times * gain) * ahead) if ahead > 0 else int(gain * ahead)
    if step != 0:
        at = int(cells.box[row, column, side]) + (step if side >= 2 else -step)
        cells.box[row, column, side] = min(255, max(0, at))
        cells.changed[row // TILE, column // TILE] = True


@callee
def _front(facing, ahead_x, ahead_y):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return which side of its box a surface that lies along it turns to the scanner, so far ahead; -1 for none."""
    angle = (facing - 1) * pi / 254.0
    x, y = cos(angle), sin(angle)
    if not facing or max(abs(x), abs(y)) < ALIGNED:
        return -1
    side = x * ahead_x + y * ahead_y
    if abs(x) > abs(y):
        return 2 if x * side > 0.0 else 0
    return 3 if y * side > 0.0 else 1
