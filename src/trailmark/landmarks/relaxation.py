"""The relaxed problem: where the robot's largest inscribed disc can go on a grid, and at what cost.

Wherever the robot can go, the disc inside it can go too. A cell is closed if the disc's centre can be nowhere in it.
If the open cells do not connect two places, no path of the robot does: a proof, since every position in a cell is at
most half a diagonal from the cell's centre. Costs over the open cells show where short paths are likely; they guide the
placing of landmarks and prove nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.landmarks.grid_search import CLOSED, STEP_X, STEP_Y, UNIT, cell_clearances, flood
from trailmark.se2 import FloatArray

__all__ = ["CostMap", "Relaxation"]

MAX_CELLS, FINEST_CELLS = 1 << 16, 1 << 20
"""Maximum number of cells at first, and of cells that may be halved once more."""

UNSURE_FACTOR = 3
"""How many times dearer a cell is whose centre is too close to an obstacle for the disc."""

CORNER_FACTOR = 2
"""Factor on the cost of a diagonal step past such a cell: it would likely cut an obstacle's corner."""


@dataclass(frozen=True)
class CostMap:
    """Costs from one configuration's disc centre to all cells within a limit.

    Attributes:
        cost: (rows, columns), metres, higher through cells whose centre is too close to an obstacle for the disc;
            infinite where the disc cannot get.
        parent: (rows, columns) int8, the direction (index into the eight neighbours, counter-clockwise from +x)
            that leads back towards the source; -1 at the source and where ``cost`` is infinite.
        limit: metres, up to which paths are of interest.
    """

    cost: FloatArray
    parent: NDArray[np.int8]
    limit: float


class Relaxation:
    """The inscribed disc's grid for one checker; clearances are computed once, when a query first needs them.

    Args:
        checker: obstacles, field and robot.
        fineness: how many times the cells are halved.

    Attributes:
        center: the disc's centre in the robot's frame, shape (2,), metres.
        radius: its radius, metres.
        size: edge of a cell, metres.
        rows: number of rows.
        columns: number of columns.
    """

    def __init__(self, checker: StateChecker, fineness: int = 0) -> None:
        self.checker = checker
        self.fineness = fineness
        disc = checker.robot.inscribed_disc
        self.center = np.array(disc.center)
        self.radius = disc.radius
        xmin, ymin, xmax, ymax = checker.world.bounds
        self.size = max(self.radius, sqrt((xmax - xmin) * (ymax - ymin) / MAX_CELLS))
        # For a large robot too, at least a hundred cells along the longer side.
        self.size = min(self.size, max(xmax - xmin, ymax - ymin) / 100.0) / 2.0**fineness
        self.columns = max(1, int(np.ceil((xmax - xmin) / self.size)))
        self.rows = max(1, int(np.ceil((ymax - ymin) / self.size)))
        self.x0, self.y0 = xmin, ymin
        self._finer: Relaxation | None = None

    @cached_property
    def _clearance(self) -> FloatArray:
        """Clearance of the cells' centres; most first paths do without it."""
        checker, corner = self.checker, np.array([self.x0, self.y0], np.float64)
        return np.asarray(
            cell_clearances(checker.grid, checker.field, corner, self.size, self.rows, self.columns, self.radius)
        )

    @cached_property
    def _dear(self) -> NDArray[np.int32]:
        """What crossing each cell costs, closed ones around all."""
        dear = np.where(self._clearance < self.radius, UNSURE_FACTOR * UNIT, UNIT)
        return np.pad(np.where(self.open, dear, CLOSED), 1, constant_values=CLOSED).astype(np.int32)

    def finer(self) -> Relaxation | None:
        """Return the relaxation on cells half as large; None if there are more than FINEST_CELLS already."""
        if self._finer is None and self.rows * self.columns <= FINEST_CELLS:
            self._finer = Relaxation(self.checker, self.fineness + 1)
        return self._finer

    def clearance(self, cells: NDArray[np.int64]) -> FloatArray:
        """Return the distance (metres) from cell centres to the nearest obstacle, shape (n,).

        It is exact where the disc hardly fits, and right within the field's slack elsewhere. In an obstacle it is minus
        the depth, up to the size of a cell, if cells are larger than the disc's radius.

        Args:
            cells: row * columns + column, shape (n,).
        """
        return self._clearance.ravel()[cells]

    @property
    def open(self) -> NDArray[np.bool_]:
        """The cells in which the disc's centre may lie, shape (rows, columns)."""
        return np.asarray(self._clearance >= self._min_clearance())

    def _min_clearance(self) -> float:
        """Return the clearance of a cell's centre below which the disc's centre can be nowhere in the cell."""
        # Contact is allowed up to 1e-7 m; ten times that counts as possible.
        return self.radius - self.size * sqrt(0.5) - 1e-6

    def disc_centers(self, q: FloatArray) -> FloatArray:
        """Return the inscribed disc's centre in the world for configurations (..., 3); shape (..., 2)."""
        return se2.transform(q, self.center[None, :])[..., 0, :]

    def references(self, centers: FloatArray, headings: FloatArray) -> FloatArray:
        """Return the configurations (n, 3) that put the disc's centre at ``centers`` (n, 2) with ``headings`` (n,)."""
        turned = np.column_stack([np.zeros((len(centers), 2)), headings])
        return np.column_stack([centers - self.disc_centers(turned), headings])

    def cells(self, points: FloatArray) -> NDArray[np.int64]:
        """Return the cells (row * columns + column) of points (..., 2), clipped to the grid; shape (...)."""
        column = np.floor((points[..., 0] - self.x0) / self.size).astype(np.int64)
        row = np.floor((points[..., 1] - self.y0) / self.size).astype(np.int64)
        return np.asarray(np.clip(row, 0, self.rows - 1) * self.columns + np.clip(column, 0, self.columns - 1))

    def cell_centers(self, cells: NDArray[np.int64]) -> FloatArray:
        """Return the centres of cells (n,), shape (n, 2), metres."""
        rows, columns = np.divmod(cells, self.columns)
        return np.column_stack([self.x0 + (columns + 0.5) * self.size, self.y0 + (rows + 0.5) * self.size])

    def costs_from(self, q: FloatArray, *, target: FloatArray | None = None, widening: float = np.inf) -> CostMap:
        """Return the costs from the disc's centre at configuration q, shape (3,), to the cells (Dijkstra).

        Args:
            q: the source.
            target: shape (3,): if it is reached at some cost, the limit is (1 + ``widening``) times that cost.
            widening: see ``target``.
        """
        row, column = divmod(int(self.cells(self.disc_centers(q))), self.columns)
        cost, parent = flood(self._dear, (row + 1) * (self.columns + 2) + column + 1, -1, CORNER_FACTOR)
        costs = CostMap(cost[1:-1, 1:-1] * np.float64(self.size), np.ascontiguousarray(parent[1:-1, 1:-1]), np.inf)
        reached = np.inf if target is None else float(self.cost_at(costs, target))
        return replace(costs, limit=(1.0 + widening) * reached + 8.0 * self.size) if reached > 0.0 else costs

    def cost_at(self, costs: CostMap, q: FloatArray) -> FloatArray:
        """Return the costs (metres) of the cells of the disc's centre at configurations (..., 3), shape (...)."""
        return np.asarray(costs.cost.ravel()[self.cells(self.disc_centers(q))])

    def component(self, q: FloatArray) -> NDArray[np.bool_]:
        """Return the cells, shape (rows * columns,), that the disc may reach from configuration q.

        It is a superset of what the robot can reach.
        """
        return np.isfinite(self.costs_from(q).cost).ravel()

    def follow(self, costs: CostMap, cells: NDArray[np.int64], steps: int) -> NDArray[np.int64]:
        """Return the cells some steps farther along the shortest paths from cells (n,) to the costs' source."""
        parent = costs.parent.ravel()
        for _ in range(steps):
            k = parent[cells].astype(np.int64)
            cells = np.where(k >= 0, cells + STEP_Y[k] * self.columns + STEP_X[k], cells)
        return cells

    def shortest_path(self, costs: CostMap, q: FloatArray) -> NDArray[np.int64]:
        """Return the cells, shape (n,), from q's disc centre back to the costs' source."""
        cell = int(self.cells(self.disc_centers(q)))
        parent = costs.parent.ravel()
        cells = [cell]
        while (k := int(parent[cell])) >= 0:
            cell += int(STEP_Y[k]) * self.columns + int(STEP_X[k])
            cells.append(cell)
        return np.array(cells)
