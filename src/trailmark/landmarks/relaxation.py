"""The relaxed problem: the robot's largest inscribed disc on a grid. Where can it go, and how far is it?

Whatever the robot can do, the disc inside it can do too. A cell that no position of the disc's centre can
lie in is closed; what the open cells do not join, no path of the robot joins (a proof, since every centre
position in a cell is at most half a diagonal from the cell's centre). Costs over the open cells say where
short paths are likely; they guide the placing of landmarks and never decide anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.collision.kernels import field_value, point_clearance
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.heap import heap_grow, heap_pop, heap_push

__all__ = ["CostMap", "Relaxation"]

FloatArray = NDArray[np.float64]

MAX_CELLS = 1 << 20

UNSURE_FACTOR = 3.0
"""How much dearer a step into a cell is whose centre is too close to an obstacle for the disc."""


@dataclass(frozen=True)
class CostMap:
    """Costs from one configuration's disc centre to all cells.

    Attributes:
        cost: (rows, columns), metres, dearer in unsure cells; infinite where the disc cannot get.
        parent: (rows, columns) int8, the direction (index into DIRECTIONS) that leads back towards the source;
            -1 at the source and where the disc cannot get.
    """

    cost: FloatArray
    parent: NDArray[np.int8]


# Columns and rows of the eight neighbours, counter-clockwise from +x: direction k has heading k * 45 degrees.
_STEP_X = np.array([1, 1, 0, -1, -1, -1, 0, 1])
_STEP_Y = np.array([0, 1, 1, 1, 0, -1, -1, -1])


class Relaxation:
    """The inscribed disc's grid for one checker.

    Args:
        checker: gives obstacles, field and robot.

    Attributes:
        size: edge of a cell, metres.
        rows: number of rows.
        columns: number of columns.
        clearance: (rows, columns), distance (metres) from cell centres to the nearest obstacle; exact where it
            decides whether the disc fits, within the field's slack elsewhere.
        open: (rows, columns) bool, cells in which the disc's centre may lie.
    """

    def __init__(self, checker: StateChecker) -> None:
        self.checker = checker
        disc = checker.robot.inscribed_disc
        self.center = np.array(disc.center)
        self.radius = disc.radius
        xmin, ymin, xmax, ymax = checker.world.bounds
        wanted = 0.7 * self.radius
        self.size = max(wanted, sqrt((xmax - xmin) * (ymax - ymin) / MAX_CELLS))
        # A large robot still deserves a map: at least a hundred cells along the longer side.
        self.size = min(self.size, max(xmax - xmin, ymax - ymin) / 100.0)
        self.columns = max(1, int(np.ceil((xmax - xmin) / self.size)))
        self.rows = max(1, int(np.ceil((ymax - ymin) / self.size)))
        self.x0, self.y0 = xmin, ymin
        self.clearance = _clearances(
            checker.grid, checker.field, self.x0, self.y0, self.size, self.rows, self.columns, self.radius
        )
        # Contact is allowed up to 1e-7 m; ten times that is left open.
        self.open = self.clearance + self.size * sqrt(0.5) >= self.radius - 1e-6

    def disc_centers(self, q: FloatArray) -> FloatArray:
        """Return the inscribed disc's centre in the world for configurations (..., 3); shape (..., 2)."""
        return se2.transform(q, self.center[None, :])[..., 0, :]

    def references(self, centers: FloatArray, headings: FloatArray) -> FloatArray:
        """Return the configurations (n, 3) that put the disc's centre at ``centers`` (n, 2) with ``headings`` (n,)."""
        cos, sin = np.cos(headings), np.sin(headings)
        cx, cy = self.center
        x = centers[:, 0] - cos * cx + sin * cy
        y = centers[:, 1] - sin * cx - cos * cy
        return np.column_stack([x, y, headings])

    def cells(self, points: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return rows and columns of the cells of points (..., 2), clipped to the grid."""
        column = np.floor((points[..., 0] - self.x0) / self.size).astype(np.int64)
        row = np.floor((points[..., 1] - self.y0) / self.size).astype(np.int64)
        return np.clip(row, 0, self.rows - 1), np.clip(column, 0, self.columns - 1)

    def cell_centers(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> FloatArray:
        """Return the centres of cells, shape (n, 2), metres."""
        return np.column_stack([self.x0 + (columns + 0.5) * self.size, self.y0 + (rows + 0.5) * self.size])

    def costs_from(self, q: FloatArray) -> CostMap:
        """Return the costs from the disc's centre at configuration q, shape (3,), to all cells (Dijkstra)."""
        row, column = self.cells(self.disc_centers(q))
        cost, parent = _dijkstra(self.open, self.clearance, self.radius, self.size, int(row), int(column))
        return CostMap(cost, parent)

    def component(self, q: FloatArray) -> NDArray[np.bool_]:
        """Return the cells that the disc may reach from configuration q; a superset of what the robot can reach."""
        from scipy.ndimage import label

        labels, _ = label(self.open, structure=np.ones((3, 3), dtype=np.int8))
        row, column = self.cells(self.disc_centers(q))
        return np.asarray((labels == labels[row, column]) & self.open)

    def way(self, costs: CostMap, q: FloatArray) -> FloatArray:
        """Return the cell centres from q's disc centre back to the costs' source, shape (n, 2)."""
        row, column = (int(v) for v in self.cells(self.disc_centers(q)))
        rows, columns = [row], [column]
        while (k := int(costs.parent[row, column])) >= 0:
            row, column = row + int(_STEP_Y[k]), column + int(_STEP_X[k])
            rows.append(row)
            columns.append(column)
        return self.cell_centers(np.array(rows), np.array(columns))


@njit(cache=True)
def _clearances(
    grid: ObstacleGrid,
    field: ClearanceField,
    x0: float,
    y0: float,
    size: float,
    rows: int,
    columns: int,
    radius: float,
) -> FloatArray:
    """Return the clearance of all cell centres, exact (up to radius + size) where that matters for the disc."""
    result = np.empty((rows, columns))
    margin = size * sqrt(0.5)
    for row in range(rows):
        y = y0 + (row + 0.5) * size
        for column in range(columns):
            x = x0 + (column + 0.5) * size
            value = field_value(field, x, y)
            if value - field.slack < radius and value + field.slack + margin >= radius:
                exact = point_clearance(grid, x, y, radius + size)
                # A value at the cap says only that there is more room: keep the field's.
                value = exact if exact < radius + size else max(exact, value)
            result[row, column] = value
    return result


@njit(cache=True)
def _dijkstra(
    is_open: NDArray[np.bool_], clearance: FloatArray, radius: float, size: float, row: int, column: int
) -> tuple[FloatArray, NDArray[np.int8]]:
    rows, columns = is_open.shape
    cost = np.full((rows, columns), np.inf)
    parent = np.full((rows, columns), -1, np.int8)
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    cost[row, column] = 0.0
    count = heap_push(keys, values, 0, 0.0, row * columns + column)
    while count > 0:
        count = heap_pop(keys, values, count)
        key, cell = keys[count], values[count]
        r, c = cell // columns, cell % columns
        if key > cost[r, c]:
            continue
        for k in range(8):
            nr, nc = r + _STEP_Y[k], c + _STEP_X[k]
            if not (0 <= nr < rows and 0 <= nc < columns) or not is_open[nr, nc]:
                continue
            step = size * (sqrt(2.0) if k % 2 else 1.0)
            if clearance[nr, nc] < radius:
                step *= UNSURE_FACTOR
            if key + step < cost[nr, nc]:
                cost[nr, nc] = key + step
                parent[nr, nc] = (k + 4) % 8
                if count == len(keys):
                    keys, values = heap_grow(keys, values)
                count = heap_push(keys, values, count, key + step, nr * columns + nc)
    return cost, parent
