"""A grid that counts, for each cell, how many laser beams ended in it and how many went through it.

Beams are walked from cell to cell: Amanatides & Woo 1987, "A fast voxel traversal algorithm for ray tracing".
"""

from __future__ import annotations

from math import floor, hypot, inf

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import WorldError
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray


@callee
def first_step(sx, sy, ex, ey):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return a line's first and last column and row, its steps, and at which share of it the next ones begin.

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


BoolArray = NDArray[np.bool_]

MAX_CELLS = 64_000_000  # Cells of a grid; each takes 12 bytes.


class EvidenceGrid:
    """Hits and passes of beams, cell by cell: what a thing of the past leaves behind, later beams go through.

    Arrays have the shape (rows, columns); row 0 has the smallest y. ``hits`` and ``passes`` count the beams that ended
    in a cell and that went through it, ``variance`` sums the variances (square metres) that the poses' errors gave the
    former.

    Args:
        bounds: xmin, ymin, xmax, ymax to cover, metres; the grid is rounded up to whole cells.
        cell: side of a cell, metres.
    """

    def __init__(self, bounds: tuple[float, float, float, float], cell: float) -> None:
        xmin, ymin, xmax, ymax = bounds
        columns, rows = (xmax - xmin) / cell, (ymax - ymin) / cell
        if not (min(columns, rows) > 0.0 and columns * rows <= MAX_CELLS):
            raise WorldError(
                f"expected a grid of 1 to {MAX_CELLS:,} cells, got {list(bounds)} with cells of {cell:g} m"
            )
        shape = int(np.ceil(rows)), int(np.ceil(columns))
        self.origin = (float(xmin), float(ymin))
        self.cell = float(cell)
        self.hits = np.zeros(shape, dtype=np.int32)
        self.passes = np.zeros(shape, dtype=np.int32)
        self.variance = np.zeros(shape, dtype=np.float32)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """xmin, ymin, xmax, ymax of the cells, metres."""
        (x, y), (rows, columns) = self.origin, self.hits.shape
        return x, y, x + columns * self.cell, y + rows * self.cell

    def add(
        self,
        start: FloatArray,
        ends: FloatArray,
        met: BoolArray,
        margin: float = 1.0,
        pose_sigma: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Count the beams of one scan.

        Args:
            start: where the scanner stands, shape (2,).
            ends: where the beams end, shape (n, 2).
            met: shape (n,), whether something was met there; if not, the beam only went through.
            margin: cells before a hit, along the beam, that count as neither: a beam that grazes a wall on its way
                to a hit farther along it goes through the cells of the wall.
            pose_sigma: standard deviation of the scanner's place along x and y each (metres) and of its heading
                (radians).
        """
        place, points = (np.ascontiguousarray(given, dtype=np.float64) for given in (start, ends))
        _trace(
            self.hits, self.passes, self.variance, *self.origin, self.cell, place, points,
            np.ascontiguousarray(met, dtype=np.bool_), float(margin), pose_sigma[0] ** 2, pose_sigma[1] ** 2,
        )  # fmt: skip

    def occupied(self, min_hits: int = 2, share: float = 0.2) -> BoolArray:
        """Return the cells that at least so many beams met, and this share of those that came there."""
        return np.asarray((self.hits >= min_hits) & (self.hits >= share * (self.hits + self.passes)))

    def cells(self, points: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return rows and columns, shape (n,) each, of the cells nearest to points, shape (n, 2)."""
        rows, columns = self.hits.shape
        place = np.floor((points - np.asarray(self.origin)) / self.cell).astype(np.intp)
        return np.clip(place[:, 1], 0, rows - 1), np.clip(place[:, 0], 0, columns - 1)

    def centres(self, mask: BoolArray) -> FloatArray:
        """Return the centres of the cells in a mask, shape (n, 2)."""
        rows, columns = np.nonzero(mask)
        return np.asarray(np.asarray(self.origin) + self.cell * (np.column_stack([columns, rows]) + 0.5))


@njit
def _trace(hits, passes, variance, x0, y0, cell, start, ends, met, margin, place, heading):  # type: ignore[no-untyped-def]  # numba infers the types
    """Count in the cells along each beam."""
    rows, columns = hits.shape
    sx, sy = (start[0] - x0) / cell, (start[1] - y0) / cell
    for k in range(len(ends)):
        ex, ey = (ends[k, 0] - x0) / cell, (ends[k, 1] - y0) / cell
        length = hypot(ex - sx, ey - sy)
        if length < 1e-300:  # its inverse would be infinite
            continue
        i, j, last_i, last_j, step_i, step_j, next_i, next_j, each_i, each_j = first_step(sx, sy, ex, ey)
        if met[k] and 0 <= last_i < columns and 0 <= last_j < rows:
            hits[last_j, last_i] += 1
            variance[last_j, last_i] += place + heading * (length * cell) ** 2
        until = 1.0 - margin / length if met[k] else 1.0
        at = 0.0
        for _ in range(abs(last_i - i) + abs(last_j - j) + 1):
            if at > until or (met[k] and i == last_i and j == last_j):
                break
            if 0 <= i < columns and 0 <= j < rows:
                passes[j, i] += 1
            if next_i < next_j:
                at = next_i
                next_i += each_i
                i += step_i
            else:
                at = next_j
                next_j += each_j
                j += step_j
