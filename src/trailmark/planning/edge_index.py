"""EdgeIndex: the edges of all that blocks, and which of them are near."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.compiled import njit
from trailmark.formats.grid import CellObstacles
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import World

__all__ = ["CellIndex", "EdgeIndex", "closed"]

RUN = 16
"""Consecutive edges of a ring that share a box in the tree."""

IntArray = NDArray[np.int64]


class EdgeIndex:
    """The edges of bounds, boundary and obstacles in runs of a few, and which runs are near.

    Args:
        world: obstacles, bounds, boundary.

    Attributes:
        edges: (e, 5), metres: x and y of either end, and by how much the edge is thickened; a disc is one edge of
            length 0.
        runs: (r + 1,) where each run of edges begins.
    """

    def __init__(self, world: World) -> None:
        xmin, ymin, xmax, ymax = world.bounds
        rings = [np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]])]
        if world.boundary is not None:
            rings.append(world.boundary.vertices)
        discs = []
        for shape in world.obstacles:
            if isinstance(shape, Disc):
                discs.append((*shape.center, *shape.center, shape.radius))
            elif isinstance(shape, Rectangle):
                rings.append(shape.corners())
            else:
                rings += [shape.vertices, *shape.holes]
        edges, runs = _edges_of_rings(rings)
        self.edges = np.concatenate([edges, np.array(discs).reshape(-1, 5)])
        self.runs = np.concatenate([runs, runs[-1] + 1 + np.arange(len(discs))])
        self._obstacles = world.obstacles
        self._boxes = np.array([shape.bounding_box() for shape in world.obstacles]).reshape(-1, 4).T
        self._tree = shapely.STRtree(shapely.box(*_boxes_of(self.edges, self.runs)))
        # It is made by the first query: now, not within a query's time.
        self._tree.query(shapely.box(0.0, 0.0, 0.0, 0.0))

    def near(
        self, low: FloatArray, high: FloatArray, groups: IntArray, count: int
    ) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
        """Return where each group's runs begin, (count + 1,), and the runs near any of a group's boxes, each once.

        Behind them ``runs`` and ``edges``, which they are runs of.

        Args:
            low: lower left corners of the boxes, (n, 2), metres.
            high: their upper right corners, (n, 2).
            groups: which group each box is of, (n,).
            count: how many groups there are.
        """
        box, run = self._tree.query(shapely.box(*low.T, *high.T))
        group, runs = np.divmod(np.unique(groups[box] * len(self.runs) + run), len(self.runs))
        return np.searchsorted(group, np.arange(count + 1)), runs, self.runs, self.edges

    def shapes_near(self, low: FloatArray, high: FloatArray) -> list[Shape]:
        """Return the obstacles whose bounding boxes meet the box from ``low`` to ``high``, shapes (2,)."""
        left, bottom, right, top = self._boxes
        near = (left <= high[0]) & (right >= low[0]) & (bottom <= high[1]) & (top >= low[1])
        return [self._obstacles[i] for i in np.flatnonzero(near)]


def closed(ring: FloatArray) -> FloatArray:
    """Return the edges of a ring, shape (n, 4)."""
    return np.hstack([ring, np.concatenate([ring[1:], ring[:1]])])


def _edges_of_rings(rings: Sequence[FloatArray]) -> tuple[FloatArray, IntArray]:
    """Return the edges of rings, (e, 5), and where each run of them begins, (r + 1,)."""
    ends = list(accumulate(map(len, rings), initial=0))
    vertices = np.concatenate(rings)
    after = np.arange(1, len(vertices) + 1)
    after[np.array(ends[1:]) - 1] = ends[:-1]
    runs = [start for begin, end in pairwise(ends) for start in range(begin, end, RUN)]
    edges = np.column_stack([vertices, vertices[after], np.zeros(len(vertices))])
    return edges, np.array([*runs, ends[-1]], np.int64)


def _boxes_of(edges: FloatArray, runs: IntArray) -> FloatArray:
    """Return xmin, ymin, xmax, ymax of each run of edges, shape (4, r)."""
    low = np.minimum(edges[:, :2], edges[:, 2:4]) - edges[:, 4:]
    high = np.maximum(edges[:, :2], edges[:, 2:4]) + edges[:, 4:]
    return np.hstack([np.minimum.reduceat(low, runs[:-1]), np.maximum.reduceat(high, runs[:-1])]).T


# --- CellIndex: the edges of bounds, boundary and a grid map's occupied cells, for the final check of paths.

Int32Array = NDArray[np.int32]


class CellIndex:
    """What :class:`trailmark.planning.edge_index.EdgeIndex` is, of cells, whose places need no tree to be found.

    A run is an edge of bounds or boundary, or the four edges of an occupied cell beside a free one.

    Args:
        world: bounds and boundary.
        cells: all its obstacles.
    """

    def __init__(self, world: World, cells: CellObstacles) -> None:
        xmin, ymin, xmax, ymax = world.bounds
        frames = [closed(np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]]))]
        if world.boundary is not None:
            frames.append(closed(world.boundary.vertices))
        self._fixed = np.concatenate(frames)
        occupied = self._occupied = cells.occupied
        rows, columns = occupied.shape
        # The same products that the polygons' corners are.
        self._x = np.arange(columns + 1) * cells.cell + cells.origin[0]
        self._y = np.arange(rows + 1) * cells.cell + cells.origin[1]
        wide = np.pad(occupied, 1)
        self._rim = occupied & ~(wide[1:-1, :-2] & wide[1:-1, 2:] & wide[:-2, 1:-1] & wide[2:, 1:-1])

    def near(
        self, low: FloatArray, high: FloatArray, groups: IntArray, count: int
    ) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
        """Return what :meth:`trailmark.planning.edge_index.EdgeIndex.near` does; boxes of a group follow one another.

        The runs and edges are those of the cells that are near any box only.
        """
        first = [np.maximum(np.searchsorted(line, low[:, i]) - 1, 0) for i, line in enumerate((self._x, self._y))]
        last = [np.searchsorted(line, high[:, i], side="right") for i, line in enumerate((self._x, self._y))]
        windows = np.column_stack([first[0], last[0], first[1], last[1]])
        number = np.full(self._rim.shape, -1, np.int32)
        fixed = len(self._fixed)
        begin, items, cells = _near(self._rim, windows, groups, count, fixed, number)
        row, column = np.divmod(cells, self._rim.shape[1])
        x1, x2, y1, y2 = self._x[column], self._x[column + 1], self._y[row], self._y[row + 1]
        around = np.column_stack([x1, y1, x2, y1, x2, y1, x2, y2, x2, y2, x1, y2, x1, y2, x1, y1]).reshape(-1, 4)
        edges = np.concatenate([self._fixed, around])
        runs = np.concatenate([np.arange(fixed), fixed + 4 * np.arange(len(cells) + 1)]).astype(np.int64)
        return begin, items, runs, np.column_stack([edges, np.zeros(len(edges))])

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
    rim: NDArray[np.bool_], windows: IntArray, groups: IntArray, count: int, fixed: int, number: Int32Array
) -> tuple[IntArray, IntArray, IntArray]:
    """Return where each group's runs begin, the runs, and the cells (row * columns + column) from run ``fixed`` on.

    Args:
        rim: cells that are runs.
        windows: of cells, (n, 4): columns from and to, rows from and to.
        groups: of each window.
        count: of groups.
        fixed: runs that belong to every group, and come first.
        number: memory for the number of each cell's run, -1 everywhere.
    """
    rows, columns = rim.shape
    first = np.zeros(count + 1, np.int64)
    runs, kept, box = np.empty(1024, np.int64), 0, 0
    cells, seen, known = np.empty(1024, np.int64), np.empty(1024, np.int64), 0
    for group in range(count):
        first[group] = kept
        while kept + fixed > len(runs):
            runs = np.concatenate((runs, np.empty_like(runs)))
        for k in range(fixed):
            runs[kept + k] = k
        kept += fixed
        while box < len(windows) and groups[box] == group:
            for row in range(windows[box, 2], min(rows, windows[box, 3])):
                for column in range(windows[box, 0], min(columns, windows[box, 1])):
                    if not rim[row, column]:
                        continue
                    if number[row, column] < 0:
                        if known == len(cells):
                            cells = np.concatenate((cells, np.empty_like(cells)))
                            seen = np.concatenate((seen, np.empty_like(seen)))
                        number[row, column], cells[known], seen[known] = known, row * columns + column, -1
                        known += 1
                    if seen[number[row, column]] == group:
                        continue
                    seen[number[row, column]] = group
                    if kept == len(runs):
                        runs = np.concatenate((runs, np.empty_like(runs)))
                    runs[kept] = fixed + number[row, column]
                    kept += 1
            box += 1
    first[count] = kept
    return first, runs[:kept], cells[:known]
