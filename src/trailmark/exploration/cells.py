"""What is kept for each cell of a grid that beams fill in."""

from __future__ import annotations

from math import ceil, log2
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import callee, njit

__all__ = [
    "FREE",
    "LOST",
    "MET",
    "NOTHING",
    "OCCUPIED",
    "OCTAVE",
    "SEEN",
    "TILE",
    "TOUCHED",
    "UNKNOWN",
    "WHOLE",
    "Cells",
    "boxes_in_sight",
    "level_of",
    "quarters",
    "rectangles",
]

Kind = TypeVar("Kind", bound=np.generic)

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

TOUCHED: Final = 0
"""The level of a cell in which the robot ran into something: no beam tells that it is gone."""


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
    """Gap between beams with which it was seen (:func:`level_of`), of a free cell the smallest; or TOUCHED."""
    misses: NDArray[np.uint8]
    """What scans count, since its surface was last met, whose beams went through it."""
    readings: NDArray[np.uint8]
    """How often its surface was met since its level was set, as far as that counts."""
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
        return cls(zeros(), zeros(), box, zeros(), zeros(), zeros(), zeros(), stamp, np.ones(tiles, dtype=np.bool_))


@callee
def level_of(gap):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the level of a gap between beams: WHOLE for one of a cell, OCTAVE more for twice that."""
    return min(254, max(TOUCHED + 1, WHOLE + ceil(OCTAVE * log2(gap))))


@njit(nogil=True)
def boxes_in_sight(cells):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the boxes of the surfaces in cells, (rows, columns, 4): all of one where beams lay too far apart."""
    boxes = cells.box.copy()
    for r in range(boxes.shape[0]):
        for c in range(boxes.shape[1]):
            if cells.level[r, c] > WHOLE:
                boxes[r, c, 0], boxes[r, c, 1], boxes[r, c, 2], boxes[r, c, 3] = 0, 0, 255, 255
    return boxes


@njit
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


def quarters(cells: NDArray[Kind], shape: tuple[int, ...]) -> NDArray[Kind]:
    """Return what is kept for cells for each of their quarters, as far as a grid of cells of half the side goes."""
    rows, columns = shape
    return cells.repeat(2, axis=0).repeat(2, axis=1)[:rows, :columns]
