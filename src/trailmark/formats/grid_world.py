"""The world of an occupancy grid, wherever the grid comes from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import brief, number
from trailmark.errors import WorldError
from trailmark.formats.cell_obstacles import CellObstacles
from trailmark.formats.grid import check_size
from trailmark.shapes import Polygon
from trailmark.world import World

__all__ = ["world_of_grid"]


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
