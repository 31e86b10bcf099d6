"""CellIndex: the edges of bounds, boundary and a grid map's occupied cells, for the final check of paths."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit
from trailmark.formats.cell_obstacles import CellObstacles
from trailmark.planning.edge_index import IntArray, closed
from trailmark.se2 import FloatArray
from trailmark.shapes import Polygon, Shape
from trailmark.world import World

__all__ = ["CellIndex"]

Int32Array = NDArray[np.int32]


class CellIndex:
    """What :class:`trailmark.planning.edge_index.EdgeIndex` is, of cells, whose places need no tree to be found.

    A run is the bounds' and boundary's edges, each alone, or the four edges of an occupied cell beside a free one.

    Args:
        world: bounds and boundary.
        cells: all its obstacles.

    Attributes:
        edges: (e, 5), metres: x and y of either end, and 0.
        runs: (r + 1,) where each run of edges begins.
    """

    def __init__(self, world: World, cells: CellObstacles) -> None:
        xmin, ymin, xmax, ymax = world.bounds
        frames = [closed(np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]]))]
        if world.boundary is not None:
            frames.append(closed(world.boundary.vertices))
        fixed = np.concatenate(frames)
        occupied = self._occupied = cells.occupied
        rows, columns = occupied.shape
        # The same products that the polygons' corners are.
        self._x = np.arange(columns + 1) * cells.cell + cells.origin[0]
        self._y = np.arange(rows + 1) * cells.cell + cells.origin[1]
        inner = np.pad(occupied, 1)
        inner = inner[1:-1, :-2] & inner[1:-1, 2:] & inner[:-2, 1:-1] & inner[2:, 1:-1]
        row, column = np.nonzero(occupied & ~inner)
        self._run = np.full(occupied.shape, -1, np.int32)
        self._run[row, column] = len(fixed) + np.arange(len(row))
        x1, x2, y1, y2 = self._x[column], self._x[column + 1], self._y[row], self._y[row + 1]
        around = np.column_stack([x1, y1, x2, y1, x2, y1, x2, y2, x2, y2, x1, y2, x1, y2, x1, y1]).reshape(-1, 4)
        edges = np.concatenate([fixed, around])
        self.edges = np.column_stack([edges, np.zeros(len(edges))])
        ends = len(fixed) + 4 * np.arange(len(row) + 1, dtype=np.int64)
        self.runs = np.concatenate([np.arange(len(fixed), dtype=np.int64), ends])
        self._fixed = len(fixed)

    def near(self, low: FloatArray, high: FloatArray, groups: IntArray, count: int) -> tuple[IntArray, IntArray]:
        """Return where each group's runs begin, (count + 1,), and the runs near any of a group's boxes, each once.

        Args:
            low: lower left corners of the boxes, (n, 2), metres; the boxes of a group follow one another.
            high: their upper right corners, (n, 2).
            groups: which group each box is of, (n,).
            count: how many groups there are.
        """
        first = [np.maximum(np.searchsorted(line, low[:, i]) - 1, 0) for i, line in enumerate((self._x, self._y))]
        last = [np.searchsorted(line, high[:, i], side="right") for i, line in enumerate((self._x, self._y))]
        windows = np.column_stack([first[0], last[0], first[1], last[1]])
        return _near(self._run, windows, groups, count, self._fixed, np.full(len(self.runs), -1))

    def shapes_near(self, low: FloatArray, high: FloatArray) -> list[Shape]:
        """Return the occupied cells that meet the box from ``low`` to ``high``, shapes (2,)."""
        columns, rows = (
            slice(max(0, int(np.searchsorted(line, low[i])) - 1), int(np.searchsorted(line, high[i], side="right")))
            for i, line in enumerate((self._x, self._y))
        )
        found: list[Shape] = []
        for row, column in np.argwhere(self._occupied[rows, columns]):
            i, j = row + rows.start, column + columns.start
            x1, x2, y1, y2 = self._x[j], self._x[j + 1], self._y[i], self._y[i + 1]
            found.append(Polygon.unchecked(np.array([[x1, y1], [x2, y1], [x2, y2], [x1, y2]])))
        return found


@njit(cache=True)
def _near(
    run: Int32Array, windows: IntArray, groups: IntArray, count: int, fixed: int, seen: IntArray
) -> tuple[IntArray, IntArray]:
    """Return what :meth:`CellIndex.near` does, for windows of cells (n, 4): columns from and to, rows from and to."""
    rows, columns = run.shape
    first = np.zeros(count + 1, np.int64)
    runs, kept, box = np.empty(1024, np.int64), 0, 0
    for group in range(count):
        first[group] = kept
        for k in range(fixed):
            if kept == len(runs):
                runs = np.concatenate((runs, np.empty_like(runs)))
            runs[kept] = k
            kept += 1
        while box < len(windows) and groups[box] == group:
            for row in range(windows[box, 2], min(rows, windows[box, 3])):
                for column in range(windows[box, 0], min(columns, windows[box, 1])):
                    found = run[row, column]
                    if found >= 0 and seen[found] != group:
                        seen[found] = group
                        if kept == len(runs):
                            runs = np.concatenate((runs, np.empty_like(runs)))
                        runs[kept] = found
                        kept += 1
            box += 1
    first[count] = kept
    return first, runs[:kept]
