"""CellObstacles: the occupied cells of a grid map as obstacles, polygons only for those who ask for polygons."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import WorldError
from trailmark.formats.grid import MAX_CORNERS, grid_polygons, grid_sides, keeps_order
from trailmark.lazy_shapes import LazyShapes
from trailmark.shapes import Polygon
from trailmark.world import World

__all__ = ["CellObstacles", "cells_of"]


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

    def sides(self) -> NDArray[np.float64]:
        """Return the polygons' sides x1, y1, x2, y2 (metres) in any order, shape (n, 4), obstacles on their left."""
        return grid_sides(self.occupied, self.cell, self.origin)


def cells_of(world: World) -> CellObstacles | None:
    """Return the cells that all obstacles of a world are, its axes along the world's; None where they are not."""
    obstacles: object = world.obstacles
    return obstacles if isinstance(obstacles, CellObstacles) and obstacles.upright else None
