"""Cells: obstacle grid and clearance field of a world, and what it takes to bring them up to date after changes."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.edits import Blocks, Window, replace_items, spread_rows, update_field, window_of
from trailmark.collision.field import ClearanceField, field_of, occupied_cells, vertical_steps
from trailmark.collision.obstacles import (
    ObstacleGrid,
    add_winding,
    build_grid,
    is_crowded,
    shape_segments,
    touched_cells,
)
from trailmark.formats.grid import cells_of
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Shape
from trailmark.world import World

__all__ = ["Cells"]

Int32Array = NDArray[np.int32]

REMEMBERED = 4
"""Versions before the present one whose memory is used again without copying all that it holds."""

ROOM = 64
"""Items that a row of the grid has room for, beside half as many again as it has."""


NO_ITEMS, NO_CELLS = np.empty(0, np.int32), np.empty(0, np.int64)


class _Arrays(NamedTuple):
    """What has elements for each row of the grid and differs between versions (arguments of the kernels)."""

    cell_start: Int32Array
    items: Int32Array
    winding: Int32Array
    steps: Int32Array
    distance: NDArray[np.float32]
    row_max: NDArray[np.float32]


class _Placed(NamedTuple):
    """An obstacle in the grid: its numbers among the items, segments (m, 4), discs (k, 3), and what it touches."""

    items: Int32Array
    segments: FloatArray
    discs: FloatArray
    window: Window


class _Touched(NamedTuple):
    """The windows of the grid, of ``steps`` and of ``distance`` outside of which a change left all as it was."""

    grid: Window
    steps: Window
    distance: Window


class Cells:
    """Obstacle grid and clearance field of a world, of which :meth:`edited` makes further versions.

    A version never changes. Each obstacle's items are known, and the rows of the grid have room for more of them; of
    the field only what the changed cells reach is computed anew.

    Args:
        world: whose obstacles they are.
        grid: of that world, newly built.
        field: of that grid.

    Attributes:
        grid: the obstacle grid.
        field: the clearance field.
    """

    def __init__(self, world: World, grid: ObstacleGrid, field: ClearanceField) -> None:
        self.grid, self.field = grid, field
        self._items = _items_of(world, len(grid.segments))
        self._free_segments: list[int] = []
        self._free_discs: list[int] = []
        self._history: tuple[tuple[object, tuple[_Touched, ...]], ...] = ()
        self._changes: list[_Touched] = []
        steps, row_max = vertical_steps(occupied_cells(grid)), field.distance.max(axis=1)
        self._arrays = _Arrays(grid.cell_start, grid.items, grid.winding, steps, field.distance, row_max)
        self._make_room(np.zeros(grid.rows, np.int64))
        self._end_version()

    @classmethod
    def of(cls, world: World, grid: ObstacleGrid, field: ClearanceField) -> Cells:
        """Return them for a world, its grid and field, whatever the grid leaves out."""
        cells = cells_of(world)
        if cells is not None or is_crowded(grid.discs, grid.size, grid.rows * grid.columns):
            # It was built without knowing which of the sides belong to which obstacle, or without all discs.
            world = world if cells is None else replace(world, obstacles=cells.shapes)
            grid = build_grid(world, grid.size, whole=True)
        return cls(world, grid, field)

    def edited(self, changes: Iterable[tuple[Shape | None, Shape | None]]) -> Cells:
        """Return a new version, for a world in which some obstacles are replaced by others.

        Args:
            changes: pairs of an obstacle and what replaces it; None stands for no obstacle.
        """
        new = copy(self)
        new._items = self._items.copy()
        new._free_segments, new._free_discs = self._free_segments.copy(), self._free_discs.copy()
        new.grid = self.grid._replace(segments=self.grid.segments.copy(), discs=self.grid.discs.copy())
        new._begin_version()
        for before, after in changes:
            gone = None if before is None else new._take_out(before)
            come = None if after is None else new._put_in(after)
            if gone is not None and come is not None and not _overlap(gone.window, come.window):
                new._replace(gone, None)
                gone = None
            new._replace(gone, come)
        new._end_version()
        return new

    def _begin_version(self) -> None:
        """Get memory for the arrays, and copy those of the version before to where it does not hold the same."""
        self._version = object()
        known = [version for version, _ in self._history]
        arrays, content = self._blocks.take(self._version, known)
        mine = _Arrays(*arrays)
        if content is None:
            for array, source in zip(mine, self._arrays, strict=True):
                array[...] = source
        else:
            for _, changes in self._history[: known.index(content)]:
                for touched in changes:
                    _copy_touched(mine, self._arrays, self._row_start, touched)
        mine.row_max[...] = self._arrays.row_max
        self._arrays, self._changes = mine, []

    def _end_version(self) -> None:
        """Publish the arrays as grid and field."""
        arrays = self._arrays
        self._history = ((self._version, tuple(self._changes)), *self._history[: REMEMBERED - 1])
        self.grid = self.grid._replace(cell_start=arrays.cell_start, items=arrays.items, winding=arrays.winding)
        self.field = field_of(self.grid, arrays.distance, float(arrays.row_max.max(initial=0.0)))

    def _take_out(self, shape: Shape) -> _Placed:
        """Forget an obstacle's items, whose numbers are free from now on."""
        items, *others = self._items.pop(shape)
        if others:
            self._items[shape] = tuple(others)
        segments, discs = self.grid.segments[items[items >= 0]], self.grid.discs[-1 - items[items < 0]]
        if isinstance(shape, Disc):
            self._free_discs += (-1 - items).tolist()
        else:
            self._free_segments += items.tolist()
        return _Placed(items, segments, discs, self._window(segments, discs))

    def _put_in(self, shape: Shape) -> _Placed:
        """Give an obstacle numbers for its items."""
        grid = self.grid
        segments, discs = np.empty((0, 4)), np.empty((0, 3))
        if isinstance(shape, Disc):
            discs = np.array([[*shape.center, shape.radius]])
            all_discs, numbers = _with_rows(grid.discs, discs, self._free_discs)
            self.grid, items = grid._replace(discs=all_discs), -1 - numbers
        else:
            segments = shape_segments(shape)
            all_segments, items = _with_rows(grid.segments, segments, self._free_segments)
            self.grid = grid._replace(segments=all_segments)
        self._items[shape] = (*self._items.get(shape, ()), items)
        return _Placed(items, segments, discs, self._window(segments, discs))

    def _window(self, segments: FloatArray, discs: FloatArray) -> Window:
        grid = self.grid
        return window_of(segments, discs, grid.x0, grid.y0, grid.size, grid.columns, grid.rows)

    def _replace(self, gone: _Placed | None, come: _Placed | None) -> None:
        """Bring grid and field up to date where an obstacle was replaced by another; None stands for no obstacle."""
        grid, arrays = self.grid, self._arrays
        windows = [placed.window for placed in (gone, come) if placed is not None]
        if not windows or _empty(windows[0]):
            return
        window = windows[0] if len(windows) == 1 else _union(*windows)
        place = grid.x0, grid.y0, grid.size
        removed = NO_ITEMS if gone is None else gone.items
        cells, owners = NO_CELLS, NO_ITEMS
        if come is not None:
            cells, owners = touched_cells(
                come.segments, come.discs, *place, grid.columns, grid.rows, np.empty(0, np.int32)
            )
            # Segments count from 0; the one disc is item -1.
            owners = come.items[np.maximum(owners, 0)]
        if not replace_items(arrays.cell_start, arrays.items, self._row_start, removed, cells, owners, window):
            self._make_room(np.bincount(cells // grid.columns, minlength=grid.rows))
            arrays = self._arrays
            replace_items(arrays.cell_start, arrays.items, self._row_start, removed, cells, owners, window)
        if gone is not None:
            add_winding(arrays.winding, gone.segments, -1, *place, *window)
        if come is not None:
            add_winding(arrays.winding, come.segments, 1, *place, *window)
        steps, distance = update_field(
            arrays.cell_start, arrays.winding, arrays.steps, arrays.distance, arrays.row_max, grid.size, window
        )
        self._changes.append(_Touched(window, steps, distance))

    def _make_room(self, more: NDArray[np.int64]) -> None:
        """Give every row of the grid room for more items, at least ``more`` (rows,) of them, in new memory."""
        arrays = self._arrays
        used = (arrays.cell_start[:, -1] - arrays.cell_start[:, 0]).astype(np.int64)
        self._row_start = np.concatenate([[0], np.cumsum(used + used // 2 + more + ROOM)])
        items = np.empty(self._row_start[-1], np.int32)
        self._blocks = Blocks(arrays._replace(items=items))
        # The memory of versions before holds rows in other places.
        self._version, self._history, self._changes = object(), (), []
        self._arrays = _Arrays(*self._blocks.take(self._version, [])[0])
        for array, source in zip(self._arrays[2:], arrays[2:], strict=True):
            array[...] = source
        spread_rows(arrays.cell_start, arrays.items, self._row_start, self._arrays.cell_start, self._arrays.items)


def _items_of(world: World, segments: int) -> dict[Shape, tuple[Int32Array, ...]]:
    """Return the items of each obstacle, of a grid newly built with some number of segments.

    Equal obstacles share an entry, with items for each of them.
    """
    items: dict[Shape, tuple[Int32Array, ...]] = {}
    sizes = [_segment_count(shape) for shape in world.obstacles]
    # Those of bounds and boundary come first.
    segment, disc = segments - sum(sizes), 0
    for shape, size in zip(world.obstacles, sizes, strict=True):
        if size == 0:
            own = np.array([-1 - disc], np.int32)
            disc += 1
        else:
            own = np.arange(segment, segment + size, dtype=np.int32)
            segment += size
        items[shape] = (*items.get(shape, ()), own)
    return items


def _segment_count(shape: Shape) -> int:
    if isinstance(shape, Disc):
        return 0
    return len(shape.vertices) + sum(map(len, shape.holes)) if isinstance(shape, Polygon) else 4


def _with_rows(table: FloatArray, rows: FloatArray, free: list[int]) -> tuple[FloatArray, Int32Array]:
    """Return a table with ``rows`` written to free places, which are used up, and where they are, shape (n,)."""
    short = len(rows) - len(free)
    if short > 0:
        more = short + len(table) // 4
        free += range(len(table), len(table) + more)
        table = np.concatenate([table, np.zeros((more, table.shape[1]))])
    places = np.array(free[len(free) - len(rows) :], np.int32)
    del free[len(free) - len(rows) :]
    table[places] = rows
    return table, places


def _copy_touched(arrays: _Arrays, source: _Arrays, row_start: NDArray[np.int64], touched: _Touched) -> None:
    first, end, left, right = touched.grid
    arrays.cell_start[first:end, left:] = source.cell_start[first:end, left:]
    items = slice(row_start[first], row_start[end])
    arrays.items[items] = source.items[items]
    for array, other, window in (
        (arrays.winding, source.winding, touched.grid),
        (arrays.steps, source.steps, touched.steps),
        (arrays.distance, source.distance, touched.distance),
    ):
        first, end, left, right = window
        array[first:end, left:right] = other[first:end, left:right]


def _empty(window: Window) -> bool:
    return window[0] >= window[1] or window[2] >= window[3]


def _overlap(a: Window, b: Window) -> bool:
    """Return whether two windows have cells in common."""
    return max(a[0], b[0]) < min(a[1], b[1]) and max(a[2], b[2]) < min(a[3], b[3])


def _union(a: Window, b: Window) -> Window:
    """Return the smallest window that holds two."""
    return min(a[0], b[0]), max(a[1], b[1]), min(a[2], b[2]), max(a[3], b[3])
