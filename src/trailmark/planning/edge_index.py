"""EdgeIndex: the edges of all that blocks, in an R-tree that need not be made anew when obstacles come, go or move."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from itertools import accumulate, pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.formats.grid import CellObstacles
from trailmark.jit import njit
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import World

__all__ = ["CellIndex", "EdgeIndex", "closed"]

RUN = 16
"""Consecutive edges of a ring that share a box in the tree."""

MAX_ADDED, ADDED_SHARE = 64, 0.125
"""Runs beside the tree, which every query goes through: with more of them the tree is made anew, which takes longer the
more there are in it."""

FIXED = -1
"""The owner of the edges of bounds and boundary."""

NOWHERE = (np.inf, np.inf, -np.inf, -np.inf)
"""The bounding box of nothing."""

IntArray = NDArray[np.int64]


class EdgeIndex:
    """The edges of bounds, boundary and obstacles in runs of a few, and which runs are near.

    An index does not change, nor does its tree: in an edited one, the runs of obstacles that went are left out of what
    the tree finds, and those of obstacles that came lie beside it.

    Args:
        world: obstacles, bounds, boundary.

    Attributes:
        edges: (e, 5), metres: x and y of either end, and by how much the edge is thickened; a disc is one edge of
            length 0.
        runs: (r + 1,) where each run of edges begins.
        obstacles: in any order; None where one went.
        boxes: (4, n) xmin, ymin, xmax, ymax of each of them.
    """

    def __init__(self, world: World) -> None:
        xmin, ymin, xmax, ymax = world.bounds
        frames = [np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]])]
        if world.boundary is not None:
            frames.append(world.boundary.vertices)
        self.obstacles: list[Shape | None] = list(world.obstacles)
        # Where each obstacle is among them; known once one of them goes.
        self._places: dict[Shape, tuple[int, ...]] | None = None
        self._free: list[int] = []
        fixed, fixed_runs = _edges_of_rings(frames)
        edges, runs, owners = _edges_of(world.obstacles)
        self.edges = np.concatenate([fixed, edges])
        self.runs = np.concatenate([fixed_runs, fixed_runs[-1] + runs[1:]])
        # The place of the obstacle that each run belongs to, and whether it is still there.
        self._owners = np.concatenate([np.full(len(fixed_runs) - 1, FIXED), owners])
        self._there = np.ones(len(self._owners), np.bool_)
        boxes = self._make_tree()
        self.boxes = _boxes_around(boxes[:, len(fixed_runs) - 1 :], owners, len(self.obstacles))

    def edited(self, changes: Iterable[tuple[Shape | None, Shape | None]]) -> EdgeIndex:
        """Return the index in which obstacles are replaced by others.

        Args:
            changes: pairs of an obstacle of this index and what replaces it; None stands for no obstacle.
        """
        new = copy(self)
        new.obstacles, new.boxes = self.obstacles.copy(), self.boxes.copy()
        new._places, new._free = self._places_of_obstacles().copy(), self._free.copy()
        new._there, new._added = self._there.copy(), self._added.copy()
        pairs = list(changes)
        for before, _ in pairs:
            if before is not None:
                new._take_out(before)
        if come := [after for _, after in pairs if after is not None]:
            new._put_in(come)
        most = max(MAX_ADDED, ADDED_SHARE * len(new._there))
        if new._added.shape[1] > most or 2 * np.count_nonzero(new._there) < len(new._there):
            new._make_tree()
        return new

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
        first, items = _grouped(box, run, self._there, low, high, self._added, groups, count)
        return first, items, self.runs, self.edges

    def shapes_near(self, low: FloatArray, high: FloatArray) -> list[Shape]:
        """Return the obstacles whose bounding boxes meet the box from ``low`` to ``high``, shapes (2,)."""
        left, bottom, right, top = self.boxes
        near = (left <= high[0]) & (right >= low[0]) & (bottom <= high[1]) & (top >= low[1])
        return [shape for i in np.flatnonzero(near) if (shape := self.obstacles[i]) is not None]

    def _make_tree(self) -> FloatArray:
        """Make the tree of all runs, and forget those of obstacles that went; return the runs' boxes, shape (4, r)."""
        sizes = np.diff(self.runs)
        self.edges = np.ascontiguousarray(self.edges[np.repeat(self._there, sizes)])
        self.runs = np.concatenate([[0], np.cumsum(sizes[self._there])]).astype(np.int64)
        self._owners = self._owners[self._there]
        self._there = np.ones(len(self._owners), np.bool_)
        self._added = np.empty((4, 0))
        boxes = _boxes_of(self.edges, self.runs)
        self._tree = shapely.STRtree(shapely.box(*boxes))
        # It is made by the first query: now, not within a query's time.
        self._tree.query(shapely.box(0.0, 0.0, 0.0, 0.0))
        return boxes

    def _places_of_obstacles(self) -> dict[Shape, tuple[int, ...]]:
        """Return where each obstacle is; equal ones are in several places."""
        if self._places is None:
            # Known once all are in it, whatever exception comes before.
            places: dict[Shape, tuple[int, ...]] = {}
            for place, shape in enumerate(self.obstacles):
                if shape is not None:
                    places[shape] = (*places.get(shape, ()), place)
            self._places = places
        return self._places

    def _take_out(self, shape: Shape) -> None:
        """Leave an obstacle out."""
        places = self._places_of_obstacles()
        place, *others = places.pop(shape)
        if others:
            places[shape] = tuple(others)
        self._free.append(place)
        self.obstacles[place], self.boxes[:, place] = None, NOWHERE
        gone = self._owners == place
        self._there[gone] = False
        self._added[:, gone[len(gone) - self._added.shape[1] :]] = np.array(NOWHERE)[:, None]

    def _put_in(self, shapes: Sequence[Shape]) -> None:
        """Add obstacles beside the tree."""
        short = len(shapes) - len(self._free)
        if short > 0:
            self._free += range(len(self.obstacles), len(self.obstacles) + short)
            self.obstacles += [None] * short
            self.boxes = np.hstack([self.boxes, np.tile(NOWHERE, (short, 1)).T])
        places, known = [self._free.pop() for _ in shapes], self._places_of_obstacles()
        for place, shape in zip(places, shapes, strict=True):
            self.obstacles[place] = shape
            known[shape] = (*known.get(shape, ()), place)
        edges, runs, owners = _edges_of(shapes)
        boxes = _boxes_of(edges, runs)
        self.boxes[:, places] = _boxes_around(boxes, owners, len(shapes))
        self.runs = np.concatenate([self.runs, self.runs[-1] + runs[1:]])
        self.edges = np.concatenate([self.edges, edges])
        self._owners = np.concatenate([self._owners, np.array(places)[owners]])
        self._there = np.concatenate([self._there, np.ones(len(owners), np.bool_)])
        self._added = np.hstack([self._added, boxes])


@njit
def _grouped(
    box: IntArray,
    run: IntArray,
    there: NDArray[np.bool_],
    low: FloatArray,
    high: FloatArray,
    added: FloatArray,
    groups: IntArray,
    count: int,
) -> tuple[IntArray, IntArray]:
    """Return what :meth:`EdgeIndex.near` does, from the pairs of a box and a run that the tree found."""
    first = np.zeros(count + 1, np.int64)
    for k in range(len(box)):
        first[groups[box[k]] + 1] += 1
    capacity = len(low) * added.shape[1]
    other_box, other_run, others = np.empty(capacity, np.int64), np.empty(capacity, np.int64), 0
    for k in range(added.shape[1]):
        left, bottom, right, top = added[0, k], added[1, k], added[2, k], added[3, k]
        for i in range(len(low)):
            # Without a branch for each comparison, which nobody could foresee.
            if (left <= high[i, 0]) & (right >= low[i, 0]) & (bottom <= high[i, 1]) & (top >= low[i, 1]):
                other_box[others], other_run[others] = i, len(there) - added.shape[1] + k
                first[groups[i] + 1] += 1
                others += 1
    for group in range(count):
        first[group + 1] += first[group]
    runs, end = np.empty(first[count], np.int64), first[:-1].copy()
    for k in range(len(box) + others):
        i, found = (box[k], run[k]) if k < len(box) else (other_box[k - len(box)], other_run[k - len(box)])
        runs[end[groups[i]]] = found
        end[groups[i]] += 1
    seen, kept = np.full(len(there), -1), 0
    for group in range(count):
        begin, first[group] = first[group], kept
        for k in range(begin, end[group]):
            if there[runs[k]] and seen[runs[k]] != group:
                seen[runs[k]] = group
                runs[kept] = runs[k]
                kept += 1
    first[count] = kept
    return first, runs[:kept]


def closed(ring: FloatArray) -> FloatArray:
    """Return the edges of a ring, shape (n, 4)."""
    return np.hstack([ring, np.concatenate([ring[1:], ring[:1]])])


def _edges_of(shapes: Sequence[Shape]) -> tuple[FloatArray, IntArray, IntArray]:
    """Return the edges of obstacles, (e, 5), where each run begins, (r + 1,), and of which obstacle it is, (r,)."""
    rectangles = [(i, shape) for i, shape in enumerate(shapes) if isinstance(shape, Rectangle)]
    owners = [i for i, _ in rectangles]
    corners = _corners([shape for _, shape in rectangles])
    boxes = np.concatenate([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 4)
    rings = list[FloatArray]()
    for i, shape in enumerate(shapes):
        if isinstance(shape, Polygon):
            rings += [shape.vertices, *shape.holes]
            owners += [i] * (1 + len(shape.holes))
    edges, runs = _edges_of_rings(rings)
    edges = np.concatenate([np.column_stack([boxes, np.zeros(len(boxes))]), edges])
    runs = np.concatenate([4 * np.arange(len(rectangles)), len(boxes) + runs])
    per_ring = [1] * len(rectangles) + [-(-len(ring) // RUN) for ring in rings]
    discs = [(i, shape) for i, shape in enumerate(shapes) if isinstance(shape, Disc)]
    rows = np.array([(*disc.center, *disc.center, disc.radius) for _, disc in discs]).reshape(-1, 5)
    return (
        np.concatenate([edges, rows]),
        np.concatenate([runs, runs[-1] + 1 + np.arange(len(rows))]),
        np.concatenate([np.repeat(owners, per_ring), [i for i, _ in discs]]).astype(np.int64),
    )


def _edges_of_rings(rings: Sequence[FloatArray]) -> tuple[FloatArray, IntArray]:
    """Return the edges of rings, (e, 5), and where each run of them begins, (r + 1,)."""
    ends = list(accumulate(map(len, rings), initial=0))
    edges = np.zeros((ends[-1], 5))
    if rings:
        vertices = np.concatenate(rings)
        after = np.arange(1, len(vertices) + 1)
        after[np.array(ends[1:]) - 1] = ends[:-1]
        edges[:, :2], edges[:, 2:4] = vertices, vertices[after]
    runs = [start for begin, end in pairwise(ends) for start in range(begin, end, RUN)]
    return edges, np.array([*runs, ends[-1]], np.int64)


def _corners(rectangles: Sequence[Rectangle]) -> FloatArray:
    """Return the corners of each rectangle, shape (n, 4, 2)."""
    rows = np.array([(*s.center, s.length, s.width, s.heading) for s in rectangles]).reshape(-1, 5)
    half = 0.5 * rows[:, None, 2:4] * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    c, s = np.cos(rows[:, 4, None]), np.sin(rows[:, 4, None])
    x, y = half[..., 0], half[..., 1]
    return np.stack([rows[:, :1] + c * x - s * y, rows[:, 1:2] + s * x + c * y], axis=-1)


def _boxes_of(edges: FloatArray, runs: IntArray) -> FloatArray:
    """Return xmin, ymin, xmax, ymax of each run of edges, shape (4, r)."""
    low = np.minimum(edges[:, :2], edges[:, 2:4]) - edges[:, 4:]
    high = np.maximum(edges[:, :2], edges[:, 2:4]) + edges[:, 4:]
    return np.hstack([np.minimum.reduceat(low, runs[:-1]), np.maximum.reduceat(high, runs[:-1])]).T


def _boxes_around(boxes: FloatArray, owners: IntArray, count: int) -> FloatArray:
    """Return the box around all of each owner's boxes, shape (4, count), from boxes (4, r) and their owners, (r,)."""
    around = np.tile(np.array([NOWHERE]).T, (1, count))
    for side, extend in enumerate((np.minimum, np.minimum, np.maximum, np.maximum)):
        extend.at(around[side], owners, boxes[side])
    return around


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


@njit
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
