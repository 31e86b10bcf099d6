"""Costs of a disc's paths over the cells of a grid: compiled Dijkstra search, and the cells' clearances."""

from __future__ import annotations

from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.distances import point_clearance, point_depth
from trailmark.collision.field import ClearanceField
from trailmark.collision.kernels import field_value
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = ["CORNER_FACTOR", "STEP_X", "STEP_Y", "UNSURE_FACTOR", "cell_clearance", "fill_clearance", "grid_costs"]

UNSURE_FACTOR = 3.0
"""Factor on the cost of a step to or from a cell whose centre is too close to an obstacle for the disc."""

CORNER_FACTOR = 2.0
"""Factor on the cost of a diagonal step past such a cell: it would likely cut an obstacle's corner."""

# Columns and rows of the eight neighbours, counter-clockwise from +x: direction k has heading k * 45 degrees.
STEP_X = np.array([1, 1, 0, -1, -1, -1, 0, 1])
STEP_Y = np.array([0, 1, 1, 1, 0, -1, -1, -1])


@callee
def cell_clearance(grid: ObstacleGrid, field: ClearanceField, x: float, y: float, size: float, radius: float) -> float:
    """Return the clearance of a point, exact up to the radius, by the field beyond it; in an obstacle minus its depth.

    Depths matter only where a cell is so large that a disc may fit at its edge although none fits at its centre.
    """
    value = field_value(field, x, y)
    if value - field.slack < radius and value + field.slack + size >= radius:
        exact = point_clearance(grid, x, y, radius)
        if exact == 0.0 and radius < size:
            return -point_depth(grid, x, y, size)
        # A value at the cap is only a lower bound, as the field's is.
        return exact if exact < radius else max(exact, value)
    return value


@njit(numbers=True)
def fill_clearance(
    grid: ObstacleGrid,
    field: ClearanceField,
    clearance: FloatArray,
    cells: NDArray[np.int64],
    x0: float,
    y0: float,
    size: float,
    radius: float,
) -> None:
    """Compute the clearance of cells where it is not known yet (NaN)."""
    columns = clearance.shape[1]
    for cell in cells:
        row, column = cell // columns, cell % columns
        if np.isnan(clearance[row, column]):
            x, y = x0 + (column + 0.5) * size, y0 + (row + 0.5) * size
            clearance[row, column] = cell_clearance(grid, field, x, y, size, radius)


@callee
def _straight_distance(target: int, goal_row: int, goal_column: int, row: int, column: int) -> float:
    """Return the straight distance to the target, in cells; 0 without a target."""
    return hypot(row - goal_row, column - goal_column) if target >= 0 else 0.0


@njit(nogil=True)
def grid_costs(
    grid: ObstacleGrid,
    field: ClearanceField,
    clearance: FloatArray,
    x0: float,
    y0: float,
    size: float,
    radius: float,
    min_clearance: float,
    source: int,
    target: int,
    limit: float,
    widening: float,
    remaining: FloatArray,
) -> tuple[FloatArray, NDArray[np.int8], float]:
    """Return costs and parents of the cells up to ``limit`` (metres), and that limit.

    A ring of buckets one cell wide serves as the queue (Dial 1969). With a target, cells are expanded in the order of
    cost plus straight distance to the target (A*), so that those on no path within the limit are never expanded; a cell
    improved within its own bucket is expanded again.

    Args:
        grid: the obstacles.
        field: their clearance field.
        clearance: (rows, columns), NaN where it is not known yet; filled in as far as the search goes.
        x0: left edge of the cells, metres.
        y0: lower edge of the cells, metres.
        size: edge of a cell, metres.
        radius: of the disc, metres.
        min_clearance: of a cell's centre below which the cell is closed, metres.
        source: cell, row * columns + column.
        target: cell, or -1.
        limit: metres.
        widening: once the target is reached at some cost, the limit is (1 + ``widening``) times that cost.
        remaining: (rows, columns) costs from elsewhere, or (0, 0): cells whose costs add up to more than the limit are
            left out.
    """
    rows, columns = clearance.shape
    cost = np.full((rows, columns), np.inf)
    parent = np.full((rows, columns), -1, np.int8)
    bucket_of = np.full((rows, columns), -1, np.int32)
    # The largest step adds 3 * 2 * sqrt(2) cells and sqrt(2) more of straight distance: ten buckets.
    buckets = 16
    head = np.full(buckets, -1, np.int64)
    capacity = 4096
    queued, next_entry = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    free, used, size_of_queue = -1, 1, 1
    fill_clearance(grid, field, clearance, np.array([source]), x0, y0, size, radius)
    cost[source // columns, source % columns] = 0.0
    goal_row, goal_column = target // columns, target % columns
    level = int(_straight_distance(target, goal_row, goal_column, source // columns, source % columns))
    queued[0], next_entry[0], head[level % buckets] = source, -1, 0
    bucket_of[source // columns, source % columns] = level
    while size_of_queue > 0 and level * size <= limit:
        slot = level % buckets
        while head[slot] >= 0:
            entry = head[slot]
            head[slot] = next_entry[entry]
            cell = queued[entry]
            next_entry[entry], free = free, entry
            size_of_queue -= 1
            r, c = cell // columns, cell % columns
            key = cost[r, c]
            if bucket_of[r, c] != level:
                continue
            bucket_of[r, c] = -1
            if cell == target and key > 0.0:
                limit = min(limit, (1.0 + widening) * key + 8.0 * size)
            for j in range(8):
                # Straight neighbours first: a diagonal step depends on their clearance.
                k = 2 * j if j < 4 else 2 * j - 7
                nr, nc = r + STEP_Y[k], c + STEP_X[k]
                if not (0 <= nr < rows and 0 <= nc < columns):
                    continue
                there = clearance[nr, nc]
                if np.isnan(there):
                    there = cell_clearance(grid, field, x0 + (nc + 0.5) * size, y0 + (nr + 0.5) * size, size, radius)
                    clearance[nr, nc] = there
                if there < min_clearance:
                    continue
                step = size * (sqrt(2.0) if k % 2 else 1.0)
                # The same in both directions, so that costs from the start and from the goal add up.
                if there < radius or clearance[r, c] < radius:
                    step *= UNSURE_FACTOR
                if k % 2 and min(clearance[r, nc], clearance[nr, c]) < radius:
                    step *= CORNER_FACTOR
                if len(remaining) and key + step + remaining[nr, nc] > limit:
                    continue
                if key + step < cost[nr, nc]:
                    cost[nr, nc] = key + step
                    parent[nr, nc] = (k + 4) % 8
                    if free >= 0:
                        entry, free = free, next_entry[free]
                    else:
                        if used == capacity:
                            capacity *= 2
                            more_queued, more_entries = np.empty(capacity, np.int64), np.empty(capacity, np.int64)
                            more_queued[:used], more_entries[:used] = queued, next_entry
                            queued, next_entry = more_queued, more_entries
                        entry, used = used, used + 1
                    # Never an earlier bucket: straight towards the target the sum is the same but for rounding.
                    at = max(
                        level, int((key + step) / size + _straight_distance(target, goal_row, goal_column, nr, nc))
                    )
                    bucket_of[nr, nc] = at
                    slot_of = at % buckets
                    queued[entry], next_entry[entry], head[slot_of] = nr * columns + nc, head[slot_of], entry
                    size_of_queue += 1
        level += 1
    return cost, parent, limit
