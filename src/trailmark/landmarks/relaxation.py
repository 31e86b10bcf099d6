"""The relaxed problem: the robot's largest inscribed disc on a grid. Where can it go, and how far is it?

Whatever the robot can do, the disc inside it can do too. A cell that no position of the disc's centre can
lie in is closed; what the open cells do not join, no path of the robot joins (a proof, since every centre
position in a cell is at most half a diagonal from the cell's centre). Costs over the open cells say where
short paths are likely; they guide the placing of landmarks and never decide anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.distances import point_clearance, point_depth
from trailmark.collision.field import ClearanceField
from trailmark.collision.kernels import field_value
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.compiled import njit

__all__ = ["CostMap", "Relaxation"]

FloatArray = NDArray[np.float64]

MAX_CELLS, FINEST_CELLS = 1 << 16, 1 << 20
"""Most cells at first, and most that may be halved once more."""

UNSURE_FACTOR = 3.0
"""How much dearer a step to or from a cell is whose centre is too close to an obstacle for the disc."""

CORNER_FACTOR = 2.0
"""How much dearer a diagonal step past such a cell is: it would likely cut an obstacle's corner."""


@dataclass(frozen=True)
class CostMap:
    """Costs from one configuration's disc centre to all cells within a limit.

    Attributes:
        cost: (rows, columns), metres, dearer through unsure cells; infinite where the disc cannot get, or not within
            ``limit``.
        parent: (rows, columns) int8, the direction (index into the eight neighbours, counter-clockwise from +x)
            that leads back towards the source; -1 at the source and where ``cost`` is infinite.
        limit: metres; every cell through which a way of at most this cost leads has its cost: to the target, if
            the costs were sought until one, else to the cell itself.
    """

    cost: FloatArray
    parent: NDArray[np.int8]
    limit: float


# Columns and rows of the eight neighbours, counter-clockwise from +x: direction k has heading k * 45 degrees.
_STEP_X = np.array([1, 1, 0, -1, -1, -1, 0, 1])
_STEP_Y = np.array([0, 1, 1, 1, 0, -1, -1, -1])


class Relaxation:
    """The inscribed disc's grid for one checker; what a query needs of it is computed once and kept.

    Args:
        checker: gives obstacles, field and robot.
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
        # A large robot still deserves a map: at least a hundred cells along the longer side.
        self.size = min(self.size, max(xmax - xmin, ymax - ymin) / 100.0) / 2.0**fineness
        self.columns = max(1, int(np.ceil((xmax - xmin) / self.size)))
        self.rows = max(1, int(np.ceil((ymax - ymin) / self.size)))
        self.x0, self.y0 = xmin, ymin
        self._finer: Relaxation | None = None

    @cached_property
    def _clearance(self) -> FloatArray:
        """Clearance of the cells' centres; NaN where nobody has asked for it yet."""
        # Not before it is asked for: a first path mostly does without.
        return np.full((self.rows, self.columns), np.nan)

    def finer(self) -> Relaxation | None:
        """Return the relaxation on cells half as large; None if there are more than FINEST_CELLS already."""
        if self._finer is None and self.rows * self.columns <= FINEST_CELLS:
            self._finer = Relaxation(self.checker, self.fineness + 1)
        return self._finer

    def clearance(self, cells: NDArray[np.int64]) -> FloatArray:
        """Return the distance (metres) from cell centres to the nearest obstacle, shape (n,).

        It is exact where it decides whether the disc fits, and right within the field's slack elsewhere. In an
        obstacle it is minus the depth, up to the size of a cell, if cells are larger than the disc's radius.

        Args:
            cells: row * columns + column, shape (n,).
        """
        _fill(self.checker.grid, self.checker.field, self._clearance, cells, self.x0, self.y0, self.size, self.radius)
        return self._clearance.ravel()[cells]

    @property
    def open(self) -> NDArray[np.bool_]:
        """The cells in which the disc's centre may lie, shape (rows, columns)."""
        clearance = self.clearance(np.arange(self.rows * self.columns)).reshape(self.rows, self.columns)
        return np.asarray(clearance >= self._least())

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

    def cells(self, points: FloatArray) -> NDArray[np.int64]:
        """Return the cells (row * columns + column) of points (..., 2), clipped to the grid; shape (...)."""
        column = np.floor((points[..., 0] - self.x0) / self.size).astype(np.int64)
        row = np.floor((points[..., 1] - self.y0) / self.size).astype(np.int64)
        return np.asarray(np.clip(row, 0, self.rows - 1) * self.columns + np.clip(column, 0, self.columns - 1))

    def cell_centers(self, cells: NDArray[np.int64]) -> FloatArray:
        """Return the centres of cells (n,), shape (n, 2), metres."""
        rows, columns = np.divmod(cells, self.columns)
        return np.column_stack([self.x0 + (columns + 0.5) * self.size, self.y0 + (rows + 0.5) * self.size])

    def costs_from(
        self,
        q: FloatArray,
        *,
        limit: float = np.inf,
        until: FloatArray | None = None,
        widening: float = np.inf,
        onward: CostMap | None = None,
    ) -> CostMap:
        """Return the costs from the disc's centre at configuration q, shape (3,), to the cells (Dijkstra).

        Args:
            q: the source.
            limit: metres; cells farther off may be left out.
            until: shape (3,): once it is reached, go on to (1 + ``widening``) times as far, and no farther.
            widening: see ``until``.
            onward: costs from elsewhere; cells whose costs in both maps add up to more than ``limit`` may be left out.
        """
        target = -1 if until is None else int(self.cells(self.disc_centers(until)))
        ahead = np.empty((0, 0)) if onward is None else onward.cost
        cost, parent, reached = _dijkstra(
            self.checker.grid,
            self.checker.field,
            self._clearance,
            self.x0,
            self.y0,
            self.size,
            self.radius,
            self._least(),
            int(self.cells(self.disc_centers(q))),
            target,
            limit,
            widening,
            ahead,
        )
        return CostMap(cost, parent, reached)

    def component(self, q: FloatArray) -> NDArray[np.bool_]:
        """Return the cells, shape (rows * columns,), that the disc may reach from configuration q.

        It is a superset of what the robot can reach.
        """
        return np.isfinite(self.costs_from(q).cost).ravel()

    def onward(self, costs: CostMap, cells: NDArray[np.int64], steps: int) -> NDArray[np.int64]:
        """Return the cells that lie some steps nearer to the costs' source, shape (n,)."""
        parent = costs.parent.ravel()
        for _ in range(steps):
            k = parent[cells].astype(np.int64)
            cells = np.where(k >= 0, cells + _STEP_Y[k] * self.columns + _STEP_X[k], cells)
        return cells

    def shortest_path(self, costs: CostMap, q: FloatArray) -> NDArray[np.int64]:
        """Return the cells, shape (n,), from q's disc centre back to the costs' source."""
        cell = int(self.cells(self.disc_centers(q)))
        parent = costs.parent.ravel()
        cells = [cell]
        while (k := int(parent[cell])) >= 0:
            cell += int(_STEP_Y[k]) * self.columns + int(_STEP_X[k])
            cells.append(cell)
        return np.array(cells)

    def _least(self) -> float:
        """Return the clearance of a cell's centre below which no centre position in the cell leaves room."""
        # Contact is allowed up to 1e-7 m; ten times that is left open.
        return self.radius - self.size * sqrt(0.5) - 1e-6


@njit(cache=True)
def _cell_clearance(grid: ObstacleGrid, field: ClearanceField, x: float, y: float, size: float, radius: float) -> float:
    """Return the clearance of a point, exact up to the radius, by the field beyond it; in an obstacle minus its depth.

    Depths matter only where a cell is so large that a disc centred on its rim may fit although none at its middle does.
    """
    value = field_value(field, x, y)
    if value - field.slack < radius and value + field.slack + size >= radius:
        exact = point_clearance(grid, x, y, radius)
        if exact == 0.0 and radius < size:
            return -point_depth(grid, x, y, size)
        # A value at the cap says only that there is room enough: keep the field's.
        return exact if exact < radius else max(exact, value)
    return value


@njit(cache=True)
def _fill(
    grid: ObstacleGrid,
    field: ClearanceField,
    clearance: FloatArray,
    cells: NDArray[np.int64],
    x0: float,
    y0: float,
    size: float,
    radius: float,
) -> None:
    """Compute the clearance of cells that nobody has asked for yet."""
    columns = clearance.shape[1]
    for cell in cells:
        row, column = cell // columns, cell % columns
        if np.isnan(clearance[row, column]):
            x, y = x0 + (column + 0.5) * size, y0 + (row + 0.5) * size
            clearance[row, column] = _cell_clearance(grid, field, x, y, size, radius)


@njit(cache=True)
def _straight(target: int, goal_row: int, goal_column: int, row: int, column: int) -> float:
    """Return the straight distance to the target, in cells; 0 without a target."""
    return hypot(row - goal_row, column - goal_column) if target >= 0 else 0.0


@njit(cache=True, nogil=True)
def _dijkstra(
    grid: ObstacleGrid,
    field: ClearanceField,
    clearance: FloatArray,
    x0: float,
    y0: float,
    size: float,
    radius: float,
    least: float,
    source: int,
    target: int,
    limit: float,
    widening: float,
    ahead: FloatArray,
) -> tuple[FloatArray, NDArray[np.int8], float]:
    """Return costs and parents of the cells up to ``limit`` (metres), and that limit.

    A ring of buckets one cell wide serves as the queue (Dial 1969). With a target, cells are taken in the order of
    cost plus straight distance to the target (A*), so that those that lie on no way within the limit are never
    looked at; a cell improved within its own bucket is taken again.
    """
    rows, columns = clearance.shape
    cost = np.full((rows, columns), np.inf)
    parent = np.full((rows, columns), -1, np.int8)
    waits_at = np.full((rows, columns), -1, np.int32)
    # The dearest step adds 3 * 2 * sqrt(2) cells and sqrt(2) more of straight distance: ten buckets ahead.
    buckets = 16
    head = np.full(buckets, -1, np.int64)
    capacity = 4096
    queued, following = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    free, used, waiting = -1, 1, 1
    _fill(grid, field, clearance, np.array([source]), x0, y0, size, radius)
    cost[source // columns, source % columns] = 0.0
    goal_row, goal_column = target // columns, target % columns
    level = int(_straight(target, goal_row, goal_column, source // columns, source % columns))
    queued[0], following[0], head[level % buckets] = source, -1, 0
    waits_at[source // columns, source % columns] = level
    while waiting > 0 and level * size <= limit:
        slot = level % buckets
        while head[slot] >= 0:
            entry = head[slot]
            head[slot] = following[entry]
            cell = queued[entry]
            following[entry], free = free, entry
            waiting -= 1
            r, c = cell // columns, cell % columns
            key = cost[r, c]
            if waits_at[r, c] != level:
                continue
            waits_at[r, c] = -1
            if cell == target and key > 0.0:
                limit = min(limit, (1.0 + widening) * key + 8.0 * size)
            for j in range(8):
                # Straight neighbours first: they tell whether a diagonal cuts a corner.
                k = 2 * j if j < 4 else 2 * j - 7
                nr, nc = r + _STEP_Y[k], c + _STEP_X[k]
                if not (0 <= nr < rows and 0 <= nc < columns):
                    continue
                room = clearance[nr, nc]
                if np.isnan(room):
                    room = _cell_clearance(grid, field, x0 + (nc + 0.5) * size, y0 + (nr + 0.5) * size, size, radius)
                    clearance[nr, nc] = room
                if room < least:
                    continue
                step = size * (sqrt(2.0) if k % 2 else 1.0)
                # Alike in both directions, so that costs from the start and from the goal add up.
                if room < radius or clearance[r, c] < radius:
                    step *= UNSURE_FACTOR
                if k % 2 and min(clearance[r, nc], clearance[nr, c]) < radius:
                    step *= CORNER_FACTOR
                if len(ahead) and key + step + ahead[nr, nc] > limit:
                    continue
                if key + step < cost[nr, nc]:
                    cost[nr, nc] = key + step
                    parent[nr, nc] = (k + 4) % 8
                    if free >= 0:
                        entry, free = free, following[free]
                    else:
                        if used == capacity:
                            capacity *= 2
                            more_queued, more_following = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
                            more_queued[:used], more_following[:used] = queued, following
                            queued, following = more_queued, more_following
                        entry, used = used, used + 1
                    # Never an earlier bucket: straight towards the target the sum stays the same but for rounding.
                    at = max(level, int((key + step) / size + _straight(target, goal_row, goal_column, nr, nc)))
                    waits_at[nr, nc] = at
                    slot_of = at % buckets
                    queued[entry], following[entry], head[slot_of] = nr * columns + nc, head[slot_of], entry
                    waiting += 1
        level += 1
    return cost, parent, limit
