"""EdgeIndex, CellIndex: the edges of all that blocks, and which of them are near."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.formats.grid import CellObstacles
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.verify.advance import Close
from trailmark.world import World

__all__ = ["CellIndex", "EdgeIndex", "closed", "edges_of", "frame"]

RUN = 16
"""Consecutive edges of a ring that share a box in the tree."""

IntArray = NDArray[np.int64]


class EdgeIndex:
    """The edges of bounds, boundary and obstacles in runs of a few, in an R-tree.

    Args:
        world: obstacles, bounds, boundary.
    """

    def __init__(self, world: World) -> None:
        self._obstacles = world.obstacles
        boundary = () if world.boundary is None else (world.boundary,)
        self._edges, self._runs = edges_of([frame(world.bounds), *boundary, *world.obstacles])
        self._boxes = np.array([shape.bounding_box() for shape in world.obstacles]).reshape(-1, 4).T
        low = np.minimum(self._edges[:, :2], self._edges[:, 2:4]) - self._edges[:, 4:]
        high = np.maximum(self._edges[:, :2], self._edges[:, 2:4]) + self._edges[:, 4:]
        low, high = np.minimum.reduceat(low, self._runs[:-1]), np.maximum.reduceat(high, self._runs[:-1])
        self._tree = shapely.STRtree(shapely.box(*low.T, *high.T))
        # It is made by the first query: now, not within a query's time.
        self._tree.query(shapely.box(0.0, 0.0, 0.0, 0.0))

    def near(self, low: FloatArray, high: FloatArray, boxes: IntArray, groups: IntArray) -> Close:
        """Return the edges near any of the boxes of each group of motions.

        Args:
            low: lower left corners of the boxes, (n, 2), metres.
            high: their upper right corners, (n, 2).
            boxes: which group each box is of, (n,), rising.
            groups: of the motions, (m,), rising.
        """
        box, run = self._tree.query(shapely.box(*low.T, *high.T))
        first, items = _once_in_each(boxes[box], run, len(self._runs), groups[-1] + 1)
        return Close(groups, first, items, self._runs, self._edges)

    def shapes_near(self, low: FloatArray, high: FloatArray) -> list[Shape]:
        """Return the obstacles whose bounding boxes meet the box from ``low`` to ``high``, shapes (2,)."""
        left, bottom, right, top = self._boxes
        near = (left <= high[0]) & (right >= low[0]) & (bottom <= high[1]) & (top >= low[1])
        return [self._obstacles[i] for i in np.flatnonzero(near)]


class CellIndex:
    """What :class:`EdgeIndex` is, of a grid map's cells, whose places need no tree to be found.

    A run is an edge of bounds or boundary, or the four edges of an occupied cell beside a free one.

    Args:
        world: bounds and boundary.
        cells: all its obstacles.
    """

    def __init__(self, world: World, cells: CellObstacles) -> None:
        boundary = () if world.boundary is None else (world.boundary,)
        self._fixed = edges_of([frame(world.bounds), *boundary])[0]
        occupied = self._occupied = cells.occupied
        rows, columns = occupied.shape
        # The same products that the polygons' corners are.
        self._x = np.arange(columns + 1) * cells.cell + cells.origin[0]
        self._y = np.arange(rows + 1) * cells.cell + cells.origin[1]
        wide = np.pad(occupied, 1)
        self._rim = occupied & ~(wide[1:-1, :-2] & wide[1:-1, 2:] & wide[:-2, 1:-1] & wide[2:, 1:-1])

    def near(self, low: FloatArray, high: FloatArray, boxes: IntArray, groups: IntArray) -> Close:
        """Return what :meth:`EdgeIndex.near` does; the runs and edges are those of the cells near any box only."""
        found, fixed, count = [np.empty(0, np.int64)], len(self._fixed), groups[-1] + 1
        for rows, columns in zip(self._window(self._y, low, high, 1), self._window(self._x, low, high, 0), strict=True):
            row, column = np.nonzero(self._rim[rows, columns])
            found.append((row + rows.start) * self._rim.shape[1] + column + columns.start)
        cells, run = np.unique(np.concatenate(found), return_inverse=True)
        group = np.repeat(boxes, [len(each) for each in found[1:]])
        group = np.concatenate([np.repeat(np.arange(count), fixed), group])
        run = np.concatenate([np.tile(np.arange(fixed), count), fixed + run])
        first, items = _once_in_each(group, run, fixed + len(cells), count)
        row, column = np.divmod(cells, self._rim.shape[1])
        x1, x2, y1, y2 = self._x[column], self._x[column + 1], self._y[row], self._y[row + 1]
        around = np.column_stack([x1, y1, x2, y1, x2, y1, x2, y2, x2, y2, x1, y2, x1, y2, x1, y1]).reshape(-1, 4)
        edges = np.concatenate([self._fixed, np.column_stack([around, np.zeros(len(around))])])
        runs = np.concatenate([np.arange(fixed), fixed + 4 * np.arange(len(cells) + 1)]).astype(np.int64)
        return Close(groups, first, items, runs, edges)

    def shapes_near(self, low: FloatArray, high: FloatArray) -> list[Shape]:
        """Return the occupied cells that meet the box from ``low`` to ``high``, shapes (2,)."""
        ((rows,), (columns,)) = (
            self._window(line, low[None], high[None], i) for i, line in ((1, self._y), (0, self._x))
        )
        found: list[Shape] = []
        for row, column in np.argwhere(self._occupied[rows, columns]):
            i, j = row + rows.start, column + columns.start
            x1, x2, y1, y2 = self._x[j], self._x[j + 1], self._y[i], self._y[i + 1]
            found.append(Polygon.unchecked(np.array([[x1, y1], [x2, y1], [x2, y2], [x1, y2]])))
        return found

    def _window(self, lines: FloatArray, low: FloatArray, high: FloatArray, axis: int) -> list[slice]:
        """Return which cells between lines across an axis meet boxes, shapes (n, 2)."""
        first = np.maximum(np.searchsorted(lines, low[:, axis]) - 1, 0).tolist()
        last = np.searchsorted(lines, high[:, axis], side="right").tolist()
        return [slice(a, b) for a, b in zip(first, last, strict=True)]


def closed(ring: FloatArray) -> FloatArray:
    """Return the edges of a ring, shape (n, 4)."""
    return np.hstack([ring, np.concatenate([ring[1:], ring[:1]])])


def frame(bounds: tuple[float, float, float, float]) -> Polygon:
    """Return bounds as a polygon."""
    xmin, ymin, xmax, ymax = bounds
    return Polygon.unchecked(np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]]))


def edges_of(shapes: Sequence[Shape]) -> tuple[FloatArray, IntArray]:
    """Return the edges of shapes, (e, 5), in any order, and where each run of them begins, (r + 1,)."""
    rings = [shape.corners() for shape in shapes if isinstance(shape, Rectangle)]
    rings += [ring for shape in shapes if isinstance(shape, Polygon) for ring in (shape.vertices, *shape.holes)]
    discs = [(*s.center, *s.center, s.radius) for s in shapes if isinstance(s, Disc)]
    ends = list(accumulate(map(len, rings), initial=0))
    edges = np.zeros((ends[-1], 5))
    if rings:
        vertices = np.concatenate(rings)
        after = np.arange(1, len(vertices) + 1)
        after[np.array(ends[1:]) - 1] = ends[:-1]
        edges[:, :2], edges[:, 2:4] = vertices, vertices[after]
    runs = [start for begin, end in pairwise(ends) for start in range(begin, end, RUN)]
    runs += range(ends[-1], ends[-1] + len(discs) + 1)
    return np.concatenate([edges, np.array(discs).reshape(-1, 5)]), np.array(runs, np.int64)


def _once_in_each(groups: IntArray, runs: IntArray, most: int, count: int) -> tuple[IntArray, IntArray]:
    """Return where each group's runs begin, (count + 1,), and its runs, each once, of pairs of a group and a run."""
    pairs = np.unique(groups * most + runs)
    return np.searchsorted(pairs, np.arange(count + 1) * most).astype(np.int64), pairs % most
