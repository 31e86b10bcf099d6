"""Occupancy grids as obstacles: the occupied cells, exactly, as few simple polygons with holes.

The polygons are made for those who ask for them; a world file may hold the cells themselves, a bit for each.
"""

from __future__ import annotations

import base64
import math
import zlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import brief, number
from trailmark.errors import WorldError
from trailmark.shapes import LIMIT, LazyShapes, Polygon
from trailmark.world import World

if TYPE_CHECKING:
    from trailmark.formats.schema import GridEntry

__all__ = [
    "MAX_CELLS",
    "MAX_CORNERS",
    "CellObstacles",
    "cells_of",
    "check_size",
    "grid_polygons",
    "grid_sides",
    "keeps_order",
    "packed_cells",
    "unpacked_cells",
    "world_of_grid",
]

MAX_CELLS = 64_000_000
"""Largest map, in cells, that is read (8,000 x 8,000)."""

MAX_CORNERS = 1_000_000
"""Largest number of corners in the outlines of a map's occupied cells: noise exceeds it, real maps do not."""

LEAST = 1e-9
"""Metres between two lines of a grid from which on its polygons' areas are far from rounding."""

Vertices = NDArray[np.float64]


def check_size(columns: int, rows: int) -> None:
    """Raise WorldError unless there is at least one cell and at most :data:`MAX_CELLS`."""
    if columns < 1 or rows < 1 or columns * rows > MAX_CELLS:
        raise WorldError(f"expected 1 to {MAX_CELLS:,} cells, got {columns} x {rows}")


def grid_polygons(
    occupied: NDArray[np.bool_], cell: float = 1.0, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> tuple[Polygon, ...]:
    """Return polygons that cover the occupied cells exactly.

    Each polygon is one component of cells joined by their sides. Cells that meet in a corner only do not join
    components; within one component such a corner joins, so that its outline and holes touch there at most: every
    polygon is valid in the sense of the OGC. Vertices stand at corners only, none on straight sides.

    Args:
        occupied: shape (rows, columns); row 0 has the smallest y.
        cell: side of a cell in metres.
        origin: x, y (metres) of the outer corner of cell (0, 0), and the angle (radians) by which the grid is
            turned about it.

    Returns:
        The polygons, by their lowest row; outlines counter-clockwise and holes clockwise in the grid's frame.

    Raises:
        WorldError: more than :data:`MAX_CORNERS` corners.
    """
    from scipy import ndimage

    padded = np.pad(np.asarray(occupied, dtype=bool), 1)
    labels, _ = ndimage.label(padded)
    # A side runs with its occupied cells to the left: to the right below them, upwards at their right, and so on.
    across = _sides(padded.view(np.int8), labels, turned=False)
    upright = _sides(padded.view(np.int8).T, labels.T, turned=True)
    if len(across.label) + len(upright.label) > MAX_CORNERS:
        corners = len(across.label) + len(upright.label)
        raise WorldError(f"map: expected outlines with at most {MAX_CORNERS:,} corners, got {corners:,}")
    sides = _Sides(*(np.concatenate(pair) for pair in zip(across.fields(), upright.fields(), strict=True)))
    corners_xy = _place(sides.start, cell, origin)
    outlines: dict[int, tuple[Vertices, list[Vertices]]] = {}
    for ring in _rings(_successors(sides, padded.shape[1]).tolist(), len(across.label)):
        label, vertices = int(sides.label[ring[0]]), corners_xy[ring]
        # Each ring begins with its lowest side: below occupied cells it belongs to an outline, above to a hole.
        if sides.direction[ring[0]] == 0:
            outlines[label] = (vertices, [])
        else:
            outlines[label][1].append(vertices)
    # Looking whether each of thousands of polygons is valid takes five times as long as making them.
    if keeps_order(occupied.shape, cell, origin):
        return tuple(Polygon.unchecked(*rings) for rings in outlines.values())
    return tuple(Polygon(outline, tuple(holes)) for outline, holes in outlines.values())


def grid_sides(occupied: NDArray[np.bool_], cell: float, origin: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the straight sides x1, y1, x2, y2 of the polygons of :func:`grid_polygons`, shape (n, 4), in any order.

    Arguments are those of :func:`grid_polygons`; the occupied cells lie on the sides' left.
    """
    padded = np.pad(np.asarray(occupied, dtype=bool), 1)
    labels = np.broadcast_to(np.int8(0), padded.shape)
    across = _sides(padded.view(np.int8), labels, turned=False)
    upright = _sides(padded.view(np.int8).T, labels.T, turned=True)
    ends = (np.concatenate(pair) for pair in ((across.start, upright.start), (across.end, upright.end)))
    return np.hstack([_place(corners, cell, origin) for corners in ends])


def keeps_order(shape: tuple[int, ...], cell: float, origin: tuple[float, float, float]) -> bool:
    """Return whether the grid's lines lie apart, in range and in order: rings that are valid in cells remain so."""
    if origin[2] != 0.0:
        return False
    with np.errstate(all="ignore"):
        lines = [np.arange(count + 1) * cell + start for count, start in zip(shape[::-1], origin, strict=False)]
        return all(bool((np.diff(line) > LEAST).all() and (np.abs(line) <= LIMIT).all()) for line in lines)


class _Sides:
    """Directed straight sides of the occupied region.

    Attributes:
        start: shape (n, 2), column and row of the corner where the side begins.
        end: shape (n, 2), where it ends.
        direction: shape (n,), quarter turns from the direction of x.
        label: shape (n,), the component that lies to its left.
    """

    def __init__(
        self, start: NDArray[np.int64], end: NDArray[np.int64], direction: NDArray[np.int64], label: NDArray[np.int64]
    ) -> None:
        self.start, self.end, self.direction, self.label = start, end, direction, label

    def fields(self) -> tuple[NDArray[np.int64], ...]:
        return self.start, self.end, self.direction, self.label


def _sides(cells: NDArray[np.int8], labels: NDArray[Any], turned: bool) -> _Sides:
    """Return the sides along the rows of a padded grid; ``turned`` says that rows stand for columns."""
    step = cells[1:] - cells[:-1]  # +1 where the region begins across this line, -1 where it ends
    line, at = np.nonzero(step[:, 1:] != step[:, :-1])  # the sides' ends, in order along each line
    opens, closes = step[line, at + 1] != 0, step[line, at] != 0
    line, low, high = line[opens], at[opens], at[closes]
    begins = step[line, low + 1] > 0
    label = labels[line + begins, low + 1].astype(np.int64)
    forward = begins != turned
    first, last = np.where(forward, low, high), np.where(forward, high, low)
    start, end = np.column_stack([first, line]), np.column_stack([last, line])
    if turned:
        start, end = start[:, ::-1], end[:, ::-1]
    return _Sides(start, end, np.where(forward, 0, 2) + turned, label)


def _successors(sides: _Sides, width: int) -> NDArray[np.int64]:
    """Return for each side the one that follows it round its component.

    Where two cells of one component meet in a corner, four sides meet: turning right there keeps every ring simple.
    For were both visits to the corner on one ring, that ring would cross a loop through the two cells' interiors.
    """
    begin = (sides.start[:, 1] * width + sides.start[:, 0]) * 4
    order = np.argsort(begin + sides.direction)
    keys = (begin + sides.direction)[order]
    arrive = (sides.end[:, 1] * width + sides.end[:, 0]) * 4

    def side_at(turn: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        wanted = arrive + (sides.direction + turn) % 4
        place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        found = order[place]
        return found, (keys[place] == wanted) & (sides.label[found] == sides.label)

    if not len(keys):
        return np.empty(0, dtype=np.int64)
    right, fits = side_at(-1)
    left, _ = side_at(1)
    return np.where(fits, right, left)


def _rings(following: list[int], across: int) -> list[list[int]]:
    """Return the cycles of ``following``, each from its first side; the first ``across`` sides go in every cycle."""
    seen, rings = bytearray(len(following)), []
    for first in range(across):
        if seen[first]:
            continue
        ring, side = [], first
        while not seen[side]:
            seen[side] = 1
            ring.append(side)
            side = following[side]
        rings.append(ring)
    return rings


def _place(corners: NDArray[np.int64], cell: float, origin: tuple[float, float, float]) -> Vertices:
    x0, y0, yaw = origin
    with np.errstate(over="ignore", invalid="ignore"):  # polygons refuse what is no number after that
        grid = corners * cell
        if yaw == 0.0:  # exactly on the lines of the grid
            return np.asarray(grid + np.array([x0, y0]), dtype=np.float64)
        cos, sin = math.cos(yaw), math.sin(yaw)
        return np.column_stack([x0 + cos * grid[:, 0] - sin * grid[:, 1], y0 + sin * grid[:, 0] + cos * grid[:, 1]])


class CellObstacles(LazyShapes):
    """The occupied cells of a grid, as the polygons of :func:`trailmark.formats.grid.grid_polygons`.

    Args:
        occupied: shape (rows, columns), row 0 with the smallest y; not to be changed.
        cell: side of a cell, metres.
        origin: x, y (metres) of the outer corner of cell (0, 0), and the angle (radians) by which the grid is turned.

    Raises:
        WorldError: more than :data:`trailmark.formats.grid.MAX_CORNERS` corners.
        ShapeError: coordinates beyond what polygons may have.
    """

    def __init__(
        self, occupied: NDArray[np.bool_], cell: float = 1.0, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> None:
        self.occupied, self.cell, self.origin = np.ascontiguousarray(occupied, np.bool_), cell, origin
        self.occupied.flags.writeable = False
        p = np.pad(self.occupied, 1)
        a, b, c, d = p[:-1, :-1], p[:-1, 1:], p[1:, :-1], p[1:, 1:]
        corners = np.count_nonzero(a ^ b ^ c ^ d) + 2 * np.count_nonzero((a == d) & (b == c) & (a != b))
        if corners > MAX_CORNERS:
            raise WorldError(f"map: expected outlines with at most {MAX_CORNERS:,} corners, got {corners:,}")
        self.upright = keeps_order(occupied.shape, cell, origin)
        if not self.upright:
            # Polygons are checked one by one: what is wrong with them is said now.
            self.__dict__["shapes"] = self.make()

    def make(self) -> tuple[Polygon, ...]:
        """Return the polygons."""
        return grid_polygons(self.occupied, self.cell, self.origin)

    def covers_as(self, other: CellObstacles) -> bool:
        """Return whether cells stand for the same places as the other's."""
        return (self.occupied.shape, self.cell, self.origin) == (other.occupied.shape, other.cell, other.origin)

    def sides(self) -> NDArray[np.float64]:
        """Return the polygons' sides x1, y1, x2, y2 (metres) in any order, shape (n, 4), obstacles on their left."""
        return grid_sides(self.occupied, self.cell, self.origin)


def cells_of(world: World) -> CellObstacles | None:
    """Return the cells that all obstacles of a world are, its axes along the world's; None where they are not."""
    obstacles: object = world.obstacles
    return obstacles if isinstance(obstacles, CellObstacles) and obstacles.upright else None


def world_of_grid(cells: ArrayLike, resolution: float, origin: Sequence[float], name: str) -> World:
    """Return the world of a grid; :meth:`trailmark.World.from_grid` describes the arguments.

    Obstacles are the cells that are not free, as polygons. Bounds are the grid's rectangle. If the origin has a yaw,
    the grid is turned about it; then the rectangle is the boundary, and the bounds are its box.

    Raises:
        WorldError: an array of another shape or kind, a resolution that is not above 0, or too many cells.
    """
    masked: Any = np.ma.asarray(cells)  # also of a list of masked rows
    grid = np.asarray(masked.data)
    if grid.ndim != 2 or grid.dtype.kind not in "biu":
        allowed = "truth values or whole numbers of shape (rows, columns)"
        hint = " (compare them with a threshold)" if grid.dtype.kind == "f" else ""
        raise WorldError(f"grid: expected {allowed}, got {grid.dtype} of shape {grid.shape}{hint}")
    rows, columns = grid.shape
    check_size(columns, rows)
    cell = number(resolution, "grid: resolution:", above=0.0, error=WorldError)
    try:
        x, y, *turn = (number(v, "grid: origin:", error=WorldError) for v in origin)
        (yaw,) = turn or (0.0,)
    except (TypeError, ValueError) as error:
        if isinstance(error, WorldError):
            raise
        raise WorldError(f"grid: origin: expected x, y or x, y, yaw, got {brief(origin)}") from None
    obstacles = CellObstacles((grid != 0) | np.ma.getmaskarray(masked), cell, (x, y, yaw)).as_tuple()
    width, height = columns * cell, rows * cell
    if yaw == 0.0:
        return World(name, (x, y, x + width, y + height), obstacles)
    corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    cos, sin = math.cos(yaw), math.sin(yaw)
    corners = np.array([x, y]) + corners @ np.array([[cos, sin], [-sin, cos]])
    (xmin, ymin), (xmax, ymax) = corners.min(axis=0), corners.max(axis=0)
    return World(name, (xmin, ymin, xmax, ymax), obstacles, boundary=Polygon(corners))


def packed_cells(cells: CellObstacles) -> dict[str, Any]:
    """Return the cells as a world file's ``grid``."""
    rows, columns = cells.occupied.shape
    return {
        "rows": rows,
        "columns": columns,
        "cell": float(cells.cell),
        "origin": [float(number) for number in cells.origin],
        "occupied": base64.b64encode(zlib.compress(np.packbits(cells.occupied).tobytes())).decode(),
    }


def unpacked_cells(entry: GridEntry) -> CellObstacles:
    """Return the cells of a world file's ``grid``.

    Raises:
        WorldError: too many cells, or other bits than its rows and columns need.
    """
    rows, columns = entry.rows, entry.columns
    check_size(columns, rows)
    size = -(-rows * columns // 8)
    try:
        unpacked = zlib.decompressobj().decompress(base64.b64decode(entry.occupied, validate=True), size + 1)
    except (ValueError, zlib.error) as error:
        raise WorldError(f"expected occupied to be bits by zlib and base64, got other text ({error})") from error
    if len(unpacked) != size:
        got = f"more than {size:,}" if len(unpacked) > size else f"{len(unpacked):,}"
        raise WorldError(f"expected {size:,} bytes of bits for {rows} rows of {columns} cells, got {got}")
    bits = np.unpackbits(np.frombuffer(unpacked, np.uint8), count=rows * columns)
    x, y, yaw = entry.origin
    return CellObstacles(bits.reshape(rows, columns).astype(np.bool_), entry.cell, (x, y, yaw))
