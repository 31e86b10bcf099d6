"""What the beams of a scan tell of the cells of a grid that they pass.

What is gone is told by beams that go through the surface that was there: one that grazes a wall passes its cells and
says nothing against it.
"""

from __future__ import annotations

from math import cos, hypot, pi, sin
from typing import Final

from trailmark.estimation.grid import first_step
from trailmark.exploration.cells import FREE, LOST, MET, OCCUPIED, OCTAVE, SEEN, TILE, TOUCHED, UNKNOWN, level_of
from trailmark.exploration.surfaces import enter_surfaces
from trailmark.jit import callee, njit

__all__ = ["NUDGE", "agreement", "enter_scan"]

CLEAR, SLIGHT, GONE = 4, 1, 12
"""What a scan counts with a beam that ends behind what was there by three standard deviations or more, and by one to
three; and what scans must count, none of which meets it, for it to be gone."""

NUDGE: Final = 1e-6
"""Cells by which an end point is moved on along its beam: a surface between two cells belongs to the one behind it."""

NEAR: Final = 2
"""Cells from an end point within which a surface is the one that it lies on."""


@njit(nogil=True)
def enter_scan(cells, now, start, ends, kinds, normals, gap, tolerance, gate):  # type: ignore[no-untyped-def]  # numba infers the types
    """Enter a scan, all of it in cells from the grid's corner on.

    Args:
        cells: what is known.
        now: the scan's number.
        start: where the scanner stands, shape (2,).
        ends: of its beams in their order, shape (n, 2).
        kinds: LOST, MET or NOTHING, shape (n,).
        normals: across the surfaces that were met, shape (n, 2); zero where that is not known.
        gap: radians from one beam to the next.
        tolerance: how far beyond a surface a beam must have come to speak clearly against it.
        gate: how far from a surface what is met may be a reading of it: three times the noise.
    """
    enter_surfaces(cells, now, start, ends, kinds, normals, gap, gate)
    _enter_passes(cells, now, start, ends, kinds, gap, tolerance, gate)


@callee
def _enter_passes(cells, now, start, ends, kinds, gap, tolerance, gate):  # type: ignore[no-untyped-def]  # numba infers the types
    """Take note of the cells along each beam."""
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
        i, j, last_i, last_j, step_i, step_j, next_i, next_j, each_i, each_j = first_step(sx, sy, ex, ey)
        ux, uy = dx / length, dy / length
        for _ in range(abs(last_i - i) + abs(last_j - j) + 1):
            if 0 <= i < columns and 0 <= j < rows:
                if cells.seen[j, i] != SEEN:
                    _see(cells, j, i, i + 0.25 - sx, j + 0.25 - sy, ux, uy, length, gap)
                if kinds[k] == MET and i == last_i and j == last_j:
                    break
                if cells.state[j, i] == UNKNOWN:
                    cells.state[j, i], cells.level[j, i] = FREE, 254
                    cells.changed[j // TILE, i // TILE] = True
                level = 2 * 255  # coarser than any: without noise nothing counts slightly
                if gate > 0.0:
                    level = level_of(max(((i + 0.5 - sx) * ux + (j + 0.5 - sy) * uy) * gap, 1e-6))
                if cells.state[j, i] == FREE and gate > 0.0:
                    cells.level[j, i] = min(cells.level[j, i], level)
                elif cells.state[j, i] == OCCUPIED and cells.stamp[j, i] != now:
                    against = 0
                    if _goes_through(cells, j, i, sx, sy, ux, uy, length - tolerance):
                        against = CLEAR
                    elif level <= cells.level[j, i] + OCTAVE // 2 and _goes_through(
                        cells, j, i, sx, sy, ux, uy, length - gate / 3.0
                    ):
                        against = SLIGHT
                    if against:
                        cells.stamp[j, i] = now
                        cells.misses[j, i] += against
                        if cells.misses[j, i] >= GONE:
                            cells.state[j, i], cells.level[j, i], cells.misses[j, i] = FREE, 254, 0
                            cells.changed[j // TILE, i // TILE] = True
            if next_i < next_j:
                next_i += each_i
                i += step_i
            else:
                next_j += each_j
                j += step_j


@callee
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


@callee
def _goes_through(cells, row, column, sx, sy, dx, dy, until):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return whether a beam crosses the surface in a cell, wherever in its box it lies, before it has come so far.

    A beam that enters the box in front of the surface and leaves it sideways may not have met it.
    """
    if cells.level[row, column] == TOUCHED:
        return False
    box, facing = cells.box[row, column], cells.facing[row, column]
    px, py = column + (int(box[0]) + int(box[2])) / 510.0, row + (int(box[1]) + int(box[3])) / 510.0
    nx, ny = dx, dy
    if facing:
        angle = (facing - 1) * pi / 254.0
        nx, ny = cos(angle), sin(angle)
    steep = nx * dx + ny * dy
    if abs(steep) < 0.1:
        return False
    wide, high = (int(box[2]) - int(box[0])) / 510.0, (int(box[3]) - int(box[1])) / 510.0
    deep = (abs(nx) * wide + abs(ny) * high) / abs(steep)
    at = (nx * (px - sx) + ny * (py - sy)) / steep
    if not at - deep > 0.0 or at + deep >= until:
        return False
    # From where it is in front of all of the box to where it is behind: within the box's length along the surface.
    beside = abs(nx * (sy + at * dy - py) - ny * (sx + at * dx - px))
    return beside + deep * abs(nx * dy - ny * dx) <= abs(ny) * wide + abs(nx) * high + 2.0 / 255.0


@njit
def agreement(cells, start, ends, kinds, tolerance):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return how many beams end at known surfaces, go through them, and end where nothing was known to be.

    Args:
        cells: what is known.
        start: where the scanner stands, shape (2,), in cells from the grid's corner.
        ends: of its beams, shape (n, 2), likewise.
        kinds: LOST, MET or NOTHING, shape (n,).
        tolerance: cells beyond a surface up to which a beam has not gone through it.
    """
    rows, columns = cells.state.shape
    met, through, new = 0, 0, 0
    sx, sy = start
    for k in range(len(ends)):
        ex, ey = ends[k]
        length = hypot(ex - sx, ey - sy)
        if kinds[k] == LOST or length < 1e-9:
            continue
        ux, uy = (ex - sx) / length, (ey - sy) / length
        i, j, last_i, last_j, step_i, step_j, next_i, next_j, each_i, each_j = first_step(sx, sy, ex, ey)
        passed = False
        for _ in range(abs(last_i - i) + abs(last_j - j) + 1):
            inside = 0 <= i < columns and 0 <= j < rows
            if inside and cells.state[j, i] == OCCUPIED:
                passed = _goes_through(cells, j, i, sx, sy, ux, uy, length - tolerance)
                if passed:
                    break
            if next_i < next_j:
                next_i += each_i
                i += step_i
            else:
                next_j += each_j
                j += step_j
        if passed:
            through += 1
        elif kinds[k] == MET and -1 <= last_i <= columns and -1 <= last_j <= rows:
            last_i, last_j, near = min(max(last_i, 0), columns - 1), min(max(last_j, 0), rows - 1), False
            # Beams that ended right before a wall just out of range have shown its cells as free, not what is behind.
            amid = NEAR <= last_i < columns - NEAR and NEAR <= last_j < rows - NEAR
            for r in range(max(0, last_j - NEAR), min(rows, last_j + NEAR + 1)):
                for c in range(max(0, last_i - NEAR), min(columns, last_i + NEAR + 1)):
                    near = near or cells.state[r, c] == OCCUPIED
                    amid = amid and cells.state[r, c] == FREE
            if near:
                met += 1
            elif amid:
                new += 1
    return met, through, new
