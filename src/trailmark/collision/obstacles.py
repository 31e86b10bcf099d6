"""Obstacles as flat arrays: boundary segments and discs in a uniform grid, for the compiled kernels.

Free space is the inside of ``bounds`` and ``boundary`` less all obstacles. Every blocked region
is described by its oriented boundary, blocked side on the left; the winding number of those boundaries, plus one for
each enclosing region, is the number of blocked regions that a point lies in.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.formats.grid import cells_of
from trailmark.jit import callee, njit
from trailmark.shapes import LIMIT, Disc, Polygon, Rectangle
from trailmark.world import World

__all__ = [
    "ObstacleGrid",
    "boundary_segments",
    "build_grid",
    "cell_size_for",
    "obstacle_discs",
]

FloatArray = NDArray[np.float64]

MAX_CELLS = 1 << 18
"""Usual upper limit on the number of grid cells, which bounds the time and memory of the set-up."""

CROWDED = 8.0
"""Discs over a cell, on average, from which on they are crowded."""


class ObstacleGrid(NamedTuple):
    """All that blocks the robot, sorted by square cells.

    Attributes:
        segments: (m, 4) boundary segments x1, y1, x2, y2 in metres, blocked side on the left.
        discs: (k, 3) disc obstacles x, y, radius in metres.
        cell_start: (rows, columns + 1) where each cell's items begin in ``items``, and at the end of a row where those
            of its last cell end.
        items: what touches the cells: the index of a segment, or -1 - index of a disc.
        winding: (rows, columns) number of blocked regions without the discs over the cell's centre.
        x0: left edge of the first column, metres.
        y0: lower edge of the first row, metres.
        size: edge of a cell, metres.
        columns: number of columns.
        rows: number of rows.
    """

    segments: FloatArray
    discs: FloatArray
    cell_start: NDArray[np.int32]
    items: NDArray[np.int32]
    winding: NDArray[np.int32]
    x0: float
    y0: float
    size: float
    columns: int
    rows: int


def boundary_segments(world: World) -> tuple[FloatArray, int]:
    """Return all boundary segments, shape (m, 4), blocked side on the left, and the number of enclosing regions.

    Discs are left out (:func:`obstacle_discs`). The outside of ``bounds`` and of ``boundary`` is blocked.
    """
    xmin, ymin, xmax, ymax = world.bounds
    # Clockwise, so that the outside lies on the left.
    rings = [np.array([[xmin, ymin], [xmin, ymax], [xmax, ymax], [xmax, ymin]])]
    if world.boundary is not None:
        rings.append(world.boundary.rings()[0][::-1])
    enclosing = len(rings)
    if (cells := cells_of(world)) is not None:
        return np.concatenate([_ring_segments(rings), cells.sides()]), enclosing
    for shape in world.obstacles:
        if not isinstance(shape, Disc):
            rings.extend(_rings_of(shape))
    return _ring_segments(rings), enclosing


def _rings_of(shape: Rectangle | Polygon) -> list[FloatArray]:
    if isinstance(shape, Rectangle):
        largest = max(map(abs, shape.bounding_box()))
        # A polygon checks itself, which takes ten times as long: only where rounding might make it no polygon.
        if largest <= LIMIT and min(shape.length, shape.width) > 1e-9 * largest:
            return [shape.corners()]
    return shape.polygon().rings()


def _ring_segments(rings: list[FloatArray]) -> FloatArray:
    begin = np.concatenate(rings)
    ends = np.cumsum([len(ring) for ring in rings])
    following = np.concatenate([begin[1:], begin[:1]])
    following[ends - 1] = begin[np.concatenate([[0], ends[:-1]])]
    return np.hstack([begin, following])


def obstacle_discs(world: World) -> FloatArray:
    """Return the disc obstacles as rows x, y, radius (metres), shape (k, 3)."""
    if cells_of(world) is not None:
        return np.empty((0, 3))
    rows = [(*shape.center, shape.radius) for shape in world.obstacles if isinstance(shape, Disc)]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def cell_size_for(world: World, wanted: float, largest: float = 0.0) -> float:
    """Return the cell size (metres) for a world.

    Args:
        world: only its bounds matter.
        wanted: the size unless it makes more than MAX_CELLS cells, which are made larger then.
        largest: cells larger than this would be too coarse; up to four times MAX_CELLS are made to avoid them.
    """
    width, height = world.bounds[2] - world.bounds[0], world.bounds[3] - world.bounds[1]
    smallest = 1.01 * max(width, height) / 8192
    size = max(wanted, 1.01 * float(np.sqrt(width * height / MAX_CELLS)), smallest)
    return max(size / 2.0, smallest) if largest < size <= 2.0 * largest else size


def build_grid(world: World, size: float) -> ObstacleGrid:
    """Sort the world's segments and discs by cells of ``size`` metres.

    The grid covers the bounds with a margin of a little more than one cell on every side. Where discs are crowded,
    cells that lie in one of them list no other disc: what touches such a cell is blocked anyway, and depths are those
    of single discs, never too large.

    Args:
        world: obstacles, bounds, boundary.
        size: edge of a cell, metres.
    """
    segments, enclosing = boundary_segments(world)
    discs = obstacle_discs(world)
    # A margin that is no simple fraction of the cell keeps cell centres off the round coordinates of maps.
    margin = 1.3137 * size
    x0, y0 = world.bounds[0] - margin, world.bounds[1] - margin
    columns = int(np.ceil((world.bounds[2] + margin - x0) / size))
    rows = int(np.ceil((world.bounds[3] + margin - y0) / size))
    cover = np.empty(0, np.int32)
    if np.pi * ((discs[:, 2] / size) ** 2).sum() > CROWDED * rows * columns:
        order = np.argsort(-discs[:, 2], kind="stable")
        cover = _covering(discs, order, x0, y0, size, columns, rows)
    cells, owners = _touched_cells(segments, discs, x0, y0, size, columns, rows, cover)
    start, items = _sorted_by_cell(cells, owners, columns, rows)
    winding = _winding(segments, enclosing, x0, y0, size, columns, rows)
    return ObstacleGrid(segments, discs, start, items, winding, float(x0), float(y0), float(size), columns, rows)


@callee
def _cell_of(value: float, origin: float, size: float, count: int) -> int:
    """Return the index of the column or row that holds a coordinate, -1 below the grid and ``count`` above it."""
    # Clipped while it is still a float: an obstacle may reach so far that no integer holds the index.
    return int(min(max(np.floor((value - origin) / size), -1.0), float(count)))


@njit
def _covering(
    discs: FloatArray, order: NDArray[np.int64], x0: float, y0: float, size: float, columns: int, rows: int
) -> NDArray[np.int32]:
    """Return for each cell (row * columns + column) the first disc in an order that all of it lies in, or -1."""
    cover = np.full(rows * columns, -1, np.int32)
    # The half diagonal of a cell, with more to spare than rounding takes.
    half = 0.5 * np.sqrt(2.0) * size * (1.0 + 1e-5)
    for disc in order:
        x, y, r = discs[disc, 0], discs[disc, 1], discs[disc, 2] * (1.0 - 1e-9) - half
        if r <= 0.0:
            break
        for row in range(max(0, _cell_of(y - r, y0, size, rows)), min(rows - 1, _cell_of(y + r, y0, size, rows)) + 1):
            dy = y0 + (row + 0.5) * size - y
            if abs(dy) > r:
                continue
            across = np.sqrt(r * r - dy * dy)
            left = max(0, _cell_of(x - across, x0, size, columns))
            for column in range(left, min(columns - 1, _cell_of(x + across, x0, size, columns)) + 1):
                dx = x0 + (column + 0.5) * size - x
                if cover[row * columns + column] < 0 and dx * dx + dy * dy <= r * r:
                    cover[row * columns + column] = disc
    return cover


@njit
def _touched_cells(
    segments: FloatArray,
    discs: FloatArray,
    x0: float,
    y0: float,
    size: float,
    columns: int,
    rows: int,
    cover: NDArray[np.int32],
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return (cell, item) pairs of every item with every cell that it touches; cells grown by 1e-6 of their size.

    Cells that lie in a disc by ``cover`` (:func:`_covering`; empty for none) are paired with no other disc.
    """
    count = 0
    capacity = 4 * (len(segments) + len(discs)) + 64
    cells = np.empty(capacity, np.int64)
    owners = np.empty(capacity, np.int32)
    slack = 1e-6 * size
    for item in range(len(segments) + len(discs)):
        disc = item >= len(segments)
        if disc:
            cx, cy, r = discs[item - len(segments)]
            low_y, high_y = cy - r, cy + r
            x1 = y1 = x2 = y2 = 0.0
        else:
            x1, y1, x2, y2 = segments[item]
            cx = cy = r = 0.0
            low_y, high_y = min(y1, y2), max(y1, y2)
        first = max(0, _cell_of(low_y - slack, y0, size, rows))
        last = min(rows - 1, _cell_of(high_y + slack, y0, size, rows))
        for row in range(first, last + 1):
            bottom, top = y0 + row * size - slack, y0 + (row + 1) * size + slack
            if disc:
                # Widest chord of the disc within this row.
                dy = max(0.0, max(bottom - cy, cy - top))
                if dy > r:
                    continue
                half = np.sqrt(max(0.0, r * r - dy * dy))
                low_x, high_x = cx - half, cx + half
            elif y1 == y2:
                low_x, high_x = min(x1, x2), max(x1, x2)
            else:
                # The part of the segment between the row's lower and upper edge.
                t1 = min(1.0, max(0.0, (bottom - y1) / (y2 - y1)))
                t2 = min(1.0, max(0.0, (top - y1) / (y2 - y1)))
                xa, xb = x1 + t1 * (x2 - x1), x1 + t2 * (x2 - x1)
                low_x, high_x = min(xa, xb), max(xa, xb)
            left = max(0, _cell_of(low_x - slack, x0, size, columns))
            right = min(columns - 1, _cell_of(high_x + slack, x0, size, columns))
            for column in range(left, right + 1):
                if disc and len(cover) > 0 and cover[row * columns + column] not in (-1, item - len(segments)):
                    continue
                if count == capacity:
                    capacity *= 2
                    more_cells = np.empty(capacity, np.int64)
                    more_cells[:count] = cells
                    more_owners = np.empty(capacity, np.int32)
                    more_owners[:count] = owners
                    cells, owners = more_cells, more_owners
                cells[count] = row * columns + column
                owners[count] = -1 - (item - len(segments)) if disc else item
                count += 1
    return cells[:count], owners[:count]


@njit
def _sorted_by_cell(
    cells: NDArray[np.int64], owners: NDArray[np.int32], columns: int, rows: int
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return where each cell's items begin, shape (rows, columns + 1), and the items of all cells."""
    start = np.zeros((rows, columns + 1), np.int32)
    for cell in cells:
        start[cell // columns, cell % columns + 1] += 1
    total = 0
    for row in range(rows):
        start[row, 0] = total
        for column in range(1, columns + 1):
            total += start[row, column]
            start[row, column] = total
    items, end = np.empty(len(owners), np.int32), start.copy()
    for k in range(len(cells)):
        row, column = cells[k] // columns, cells[k] % columns
        items[end[row, column]] = owners[k]
        end[row, column] += 1
    return start, items


@njit
def _winding(
    segments: FloatArray, enclosing: int, x0: float, y0: float, size: float, columns: int, rows: int
) -> NDArray[np.int32]:
    """Return how many blocked regions lie over each cell's centre, discs left out, shape (rows, columns).

    Along the line through a row's centres every segment that crosses it changes the number by one for all
    centres to its right. Half-open rule: a segment spans y if min <= y < max.

    Args:
        segments: all those of closed rings, (m, 4), blocked side on the left.
        enclosing: number of regions that enclose everything.
        x0: left edge of the first column, metres.
        y0: lower edge of the first row, metres.
        size: edge of a cell, metres.
        columns: of the grid.
        rows: of the grid.
    """
    change = np.zeros((rows, columns + 1), np.int32)
    for x1, y1, x2, y2 in segments:
        if y1 == y2:
            continue
        # Left of an edge that runs upwards is blocked: crossing it to the right leaves the blocked side.
        step = -1 if y2 > y1 else 1
        low, high = min(y1, y2), max(y1, y2)
        first = max(0, _cell_of(low - 0.5 * size, y0, size, rows))
        last = min(rows - 1, _cell_of(high + 0.5 * size, y0, size, rows))
        for row in range(first, last + 1):
            y = y0 + (row + 0.5) * size
            if not (low <= y < high):
                continue
            x = x1 + (y - y1) / (y2 - y1) * (x2 - x1)
            # First column whose centre lies at or right of the crossing. The comparison must have the same result as
            # the one in distances._blocked_regions, despite rounding: so the first guess is corrected.
            column = max(0, _cell_of(x + 0.5 * size, x0, size, columns))
            while column > 0 and x <= x0 + (column - 1 + 0.5) * size:
                column -= 1
            while column < columns and x > x0 + (column + 0.5) * size:
                column += 1
            change[row, column] += step
    winding = np.empty((rows, columns), np.int32)
    for row in range(rows):
        total = enclosing
        for column in range(columns):
            total += change[row, column]
            winding[row, column] = total
    return winding
