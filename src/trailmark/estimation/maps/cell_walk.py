"""The walk along a line from cell to cell of a grid: where it begins, and where it crosses into the next cells.

Source: Amanatides & Woo, "A fast voxel traversal algorithm for ray tracing", Eurographics 1987.
"""

from __future__ import annotations

from math import floor, inf

from trailmark.jit import callee

__all__ = ["first_step"]


@callee
def first_step(sx, sy, ex, ey):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return a line's first and last column and row, its steps, and at which share of it the next ones begin.

    Args:
        sx: where it begins, in cells from the grid's corner,
        sy: likewise.
        ex: where it ends,
        ey: likewise.

    Returns:
        First column and row, last column and row, steps of either (1 or -1), shares of the line at which the next
        column and row begin, and shares from one to the next; infinite along an axis on which the line stays.
    """
    dx, dy = ex - sx, ey - sy
    i, j, last_i, last_j = floor(sx), floor(sy), floor(ex), floor(ey)
    step_i, step_j = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    each_i, each_j = (abs(1.0 / dx) if dx != 0.0 else inf), (abs(1.0 / dy) if dy != 0.0 else inf)
    next_i = ((i + (dx > 0.0)) - sx) / dx if dx != 0.0 else inf
    next_j = ((j + (dy > 0.0)) - sy) / dy if dy != 0.0 else inf
    return i, j, last_i, last_j, step_i, step_j, next_i, next_j, each_i, each_j
