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

if TYPE_CHECKING:
    from trailmark.formats.schema import GridEntry

__all__ = [
    "MAX_CELLS",
    "MAX_CORNERS",
    "CellObstacles",
    "cells_of",
    "check_size",
    "grid_fields",
    "grid_polygons",
    "grid_sides",
    "keeps_order",
    "packed_cells",
    "unpacked_cells",
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
    import shapely

    cells = np.asarray(occupied, dtype=bool)
    sides = _sides(cells)
    _check_corners(len(sides))
    faces = shapely.get_parts(shapely.polygonize(shapely.linestrings(sides.reshape(-1, 2, 2))))
    # Of the faces between the sides those are occupied whose lowest cell, the leftmost of that row, is.
    corners, face = shapely.get_coordinates(shapely.get_exterior_ring(faces), return_index=True)
    order = np.lexsort((corners[:, 0], corners[:, 1], face))
    lowest = corners[order[np.flatnonzero(np.diff(face[order], prepend=-1))]].astype(np.int64)
    solid = cells[lowest[:, 1], lowest[:, 0]]
    by_row = np.lexsort(lowest[solid].T)
    rings, owner = shapely.get_rings(shapely.orient_polygons(faces[solid][by_row]), return_index=True)
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    placed = np.split(_place(corners, cell, origin), np.flatnonzero(np.diff(ring)) + 1)
    outlines: list[list[Vertices]] = [[] for _ in range(len(by_row))]
    for polygon, vertices in zip(owner.tolist(), placed if len(rings) else (), strict=True):
        outlines[polygon].append(vertices[:-1])
    # Looking whether each of thousands of polygons is valid takes five times as long as making them.
    make = Polygon.unchecked if keeps_order(cells.shape, cell, origin) else Polygon
    return tuple(make(outline, tuple(holes)) for outline, *holes in outlines)


def grid_sides(occupied: NDArray[np.bool_], cell: float, origin: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the straight sides x1, y1, x2, y2 of the polygons of :func:`grid_polygons`, shape (n, 4), in any order.

    Arguments are those of :func:`grid_polygons`; the occupied cells lie on the sides' left.
    """
    return _place(_sides(occupied).reshape(-1, 2), cell, origin).reshape(-1, 4)


def _sides(occupied: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the sides of :func:`grid_sides` as columns and rows of the grid's lines."""
    padded, found = np.pad(np.asarray(occupied, dtype=np.int8), 1), []
    for turned, cells in enumerate((padded, padded.T)):
        step = cells[1:] - cells[:-1]  # +1 where the region begins across this line, -1 where it ends
        line, at = np.nonzero(step[:, 1:] != step[:, :-1])  # the sides' ends, in order along each line
        opens, closes = step[line, at + 1] != 0, step[line, at] != 0
        line, low, high = line[opens], at[opens], at[closes]
        forward = (step[line, low + 1] > 0) != turned
        ends = np.column_stack([np.where(forward, low, high), line, np.where(forward, high, low), line])
        found.append(ends[:, [1, 0, 3, 2]] if turned else ends)
    return np.concatenate(found)


def _check_corners(corners: int) -> None:
    if corners > MAX_CORNERS:
        raise WorldError(f"map: expected outlines with at most {MAX_CORNERS:,} corners, got {corners:,}")


def keeps_order(shape: tuple[int, ...], cell: float, origin: tuple[float, float, float]) -> bool:
    """Return whether the grid's lines lie apart, in range and in order: rings that are valid in cells remain so."""
    if origin[2] != 0.0:
        return False
    with np.errstate(all="ignore"):
        lines = [np.arange(count + 1) * cell + start for count, start in zip(shape[::-1], origin, strict=False)]
        return all(bool((np.diff(line) > LEAST).all() and (np.abs(line) <= LIMIT).all()) for line in lines)


def _place(corners: NDArray[Any], cell: float, origin: tuple[float, float, float]) -> Vertices:
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
        _check_corners(int(corners))
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


def cells_of(obstacles: object) -> CellObstacles | None:
    """Return the cells that all obstacles of a world are, their axes along the world's; None where they are not."""
    return obstacles if isinstance(obstacles, CellObstacles) and obstacles.upright else None


def grid_fields(cells: ArrayLike, resolution: float, origin: Sequence[float], name: str) -> dict[str, Any]:
    """Return the arguments of a grid's :class:`trailmark.World`; its ``from_grid`` describes what is given.

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
        return {"name": name, "bounds": (x, y, x + width, y + height), "obstacles": obstacles}
    corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    cos, sin = math.cos(yaw), math.sin(yaw)
    corners = np.array([x, y]) + corners @ np.array([[cos, sin], [-sin, cos]])
    (xmin, ymin), (xmax, ymax) = corners.min(axis=0), corners.max(axis=0)
    bounds = (xmin, ymin, xmax, ymax)
    return {"name": name, "bounds": bounds, "obstacles": obstacles, "boundary": Polygon(corners)}


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
