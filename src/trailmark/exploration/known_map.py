"""What is known of the world: cells that are free, occupied, or not known yet."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from trailmark.se2 import FloatArray
from trailmark.shapes import Rectangle
from trailmark.world import World

__all__ = ["FREE", "OCCUPIED", "UNKNOWN", "KnownMap"]

UNKNOWN: Final = 0
FREE: Final = 1
OCCUPIED: Final = 2

TILE = 16
"""Cells: side of the squares by which the planner's world follows the map. What changes is replaced tile by tile."""


class KnownMap:
    """A grid of cells, each unknown, free or occupied, and the planner's world that follows it.

    Attributes:
        origin: x, y of the outer corner of cell (0, 0), metres.
        cell: side of a cell, metres.
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns), uint8; row 0 has the smallest y.
        revision: grows whenever ``state`` changes.

    Args:
        bounds: xmin, ymin, xmax, ymax, metres, of what is to be explored: known beforehand, as the start is.
        cell: side of a cell, metres.
    """

    def __init__(self, bounds: tuple[float, float, float, float], cell: float) -> None:
        xmin, ymin, xmax, ymax = bounds
        self.bounds, self.cell, self.origin = bounds, float(cell), (float(xmin), float(ymin))
        shape = int(np.ceil((ymax - ymin) / cell - 1e-9)), int(np.ceil((xmax - xmin) / cell - 1e-9))
        self.state: NDArray[np.uint8] = np.full(shape, UNKNOWN, dtype=np.uint8)
        self.revision = 0
        self._drawn = np.full(shape, FREE, dtype=np.uint8)  # as the planner's world has it
        self._obstacles = dict[tuple[int, int], list[str]]()  # ids by tile
        self._count = 0

    def set_state(self, state: NDArray[np.uint8]) -> None:
        """Take over the state of all cells."""
        if not np.array_equal(state, self.state):
            self.state = state
            self.revision += 1

    def cells_of(self, points: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return rows and columns, shape (n,) each, of the cells that hold points, shape (n, 2), or the nearest."""
        rows, columns = self.state.shape
        place = np.floor((np.asarray(points) - np.asarray(self.origin)) / self.cell).astype(np.intp)
        return np.clip(place[..., 1], 0, rows - 1), np.clip(place[..., 0], 0, columns - 1)

    def centres(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> FloatArray:
        """Return the centres of cells, shape (n, 2), metres."""
        return np.asarray(np.asarray(self.origin) + self.cell * (np.column_stack([columns, rows]) + 0.5))

    @property
    def free_area(self) -> float:
        """Square metres of the cells that are free."""
        return float((self.state == FREE).sum()) * self.cell**2

    def follow(self, world: World) -> World:
        """Return the world with the obstacles of the tiles that changed since the last call replaced.

        Its obstacles have ids: ``occupied-…`` and ``unknown-…``. Cells that are not free are obstacles, so that no
        valid path leads through what is not known.
        """
        changed = self.state != self._drawn
        rows, columns = changed.shape
        tiles = np.logical_or.reduceat(
            np.logical_or.reduceat(changed, np.arange(0, rows, TILE), 0), np.arange(0, columns, TILE), 1
        )
        remove, add = list[str](), dict[str, Rectangle]()
        for i, j in np.argwhere(tiles).tolist():
            remove += self._obstacles.pop((i, j), [])
            own = self._tile_obstacles(i, j)
            self._obstacles[i, j] = list(own)
            add |= own
        self._drawn = self.state.copy()
        return world.edited(add=add, remove=remove) if add or remove else world

    def _tile_obstacles(self, i: int, j: int) -> dict[str, Rectangle]:
        """Return the obstacles of a tile by their ids, which are new ones each time."""
        part = self.state[i * TILE : (i + 1) * TILE, j * TILE : (j + 1) * TILE]
        corner = self.origin[0] + j * TILE * self.cell, self.origin[1] + i * TILE * self.cell
        found = dict[str, Rectangle]()
        for kind, name in ((OCCUPIED, "occupied"), (UNKNOWN, "unknown")):
            for shape in rectangles(part == kind, corner, self.cell):
                self._count += 1
                found[f"{name}-{self._count}"] = shape
        return found


def rectangles(mask: NDArray[np.bool_], origin: tuple[float, float], cell: float) -> list[Rectangle]:
    """Return rectangles that cover the cells of a mask exactly: runs of a row, joined to the equal ones below."""
    found, open_runs = list[tuple[int, int, int, int]](), dict[tuple[int, int], int]()
    for r in range(len(mask) + 1):
        runs = set[tuple[int, int]]()
        if r < len(mask):
            edges = np.flatnonzero(np.diff(np.concatenate([[False], mask[r], [False]]).astype(np.int8))).tolist()
            runs = set(zip(edges[::2], edges[1::2], strict=True))
        for run in [run for run in open_runs if run not in runs]:
            found.append((run[0], open_runs.pop(run), run[1], r))
        for run in runs:
            open_runs.setdefault(run, r)
    x, y = origin
    return [
        Rectangle((x + 0.5 * (c0 + c1) * cell, y + 0.5 * (r0 + r1) * cell), (c1 - c0) * cell, (r1 - r0) * cell)
        for c0, r0, c1, r1 in found
    ]
