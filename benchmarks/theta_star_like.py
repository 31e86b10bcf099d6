"""An any-angle search as nav2's Theta* planner has it, for ``trailmark benchmark -p benchmarks.theta_star_like:plan``.

Lazy Theta* (Nash, Koenig, Tovey, 2010) over the costmap's cells of 5 cm for the disc around the robot, whose heading
is then free: it turns evenly along the way. So for round robots about the shortest way that grids know; other robots
are as large as the disc about them. The costmap is there before the clock starts, as in a running robot. Not for cars.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.costmap import Costmap, cell_of, costmap_of, with_headings
from benchmarks.smac_like import SMALL
from trailmark.clock import CLOCK_EVERY, Deadline, now
from trailmark.collision import StateChecker
from trailmark.compiled import njit
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.se2 import FloatArray

__all__ = ["plan", "prepare"]


def plan(
    checker: StateChecker, start: FloatArray, goal: FloatArray, time_limit: float, seed: int, *, prepared: Costmap
) -> FloatArray | None:
    """Return the states of a path, shape (n, 3), or None; nothing is random."""
    del seed
    if checker.robot.turning_radius is not None:
        return None
    cells = _search(
        prepared, float(checker.robot.circumradius), np.array(start), np.array(goal), Deadline.after(time_limit)
    )
    if not len(cells):
        return None
    middle = np.column_stack(
        [prepared.x0 + (cells[:, 1] + 0.5) * prepared.size, prepared.y0 + (cells[:, 0] + 0.5) * prepared.size]
    )
    return with_headings(np.concatenate([[start[:2]], middle, [goal[:2]]]), start, goal)


def prepare(checker: StateChecker) -> Costmap:
    """Return the costmap, with the kernels loaded."""
    small = StateChecker(SMALL, SMALL.robot)
    plan(small, np.array([1.0, 1.0, 0.0]), np.array([4.0, 1.0, 1.0]), 1.0, 0, prepared=costmap_of(small))
    return costmap_of(checker)


plan.prepare = prepare  # type: ignore[attr-defined]  # what the benchmark calls before its clock starts


@njit(cache=True)
def _sees(costmap: Costmap, radius: float, a: int, b: int) -> bool:
    """Return whether the disc passes straight from cell a to cell b, in steps of half a cell."""
    columns = costmap.distance.shape[1]
    i, j, k, m = a // columns, a % columns, b // columns, b % columns
    steps = int(2.0 * math.hypot(k - i, m - j)) + 1
    for n in range(1, steps + 1):
        t = n / steps
        if costmap.distance[int(i + t * (k - i) + 0.5), int(j + t * (m - j) + 0.5)] <= radius:
            return False
    return True


@njit(cache=True)
def _search(
    costmap: Costmap, radius: float, start: FloatArray, goal: FloatArray, deadline: Deadline
) -> NDArray[np.int64]:
    """Return the cells (row, column) where the way bends, ends included, shape (n, 2); none without a way or time."""
    rows, columns = costmap.distance.shape
    none = np.empty((0, 2), np.int64)
    row, column = cell_of(costmap, start[0], start[1])
    last_row, last_column = cell_of(costmap, goal[0], goal[1])
    for i, j in ((row, column), (last_row, last_column)):
        if i < 0 or j < 0 or i >= rows or j >= columns or costmap.distance[i, j] <= radius:
            return none
    cost, parent = np.full(rows * columns, np.inf, np.float32), np.empty(rows * columns, np.int32)
    closed = np.zeros(rows * columns, np.bool_)
    first, last = row * columns + column, last_row * columns + last_column
    heap_keys, heap_cells, size = np.empty(1 << 12), np.empty(1 << 12, np.int64), 0
    cost[first], parent[first] = 0.0, first
    size = heap_push(heap_keys, heap_cells, size, 0.0, first)
    taken = 0
    while size > 0:
        taken += 1
        if taken % CLOCK_EVERY == 0 and now(deadline.kind) >= deadline.seconds:
            return none
        size = heap_pop(heap_keys, heap_cells, size)
        cell = heap_cells[size]
        if closed[cell]:
            continue
        closed[cell] = True
        row, column = cell // columns, cell % columns
        if cell != first and not _sees(costmap, radius, parent[cell], cell):
            # Lazily: the parent was thought to see it; else the best closed neighbour is the parent.
            cost[cell] = np.inf
            for i in range(max(0, row - 1), min(rows, row + 2)):
                for j in range(max(0, column - 1), min(columns, column + 2)):
                    other = i * columns + j
                    through = cost[other] + math.hypot(i - row, j - column)
                    if other != cell and closed[other] and through < cost[cell]:
                        cost[cell], parent[cell] = through, other
        if cell == last:
            break
        above = parent[cell]
        for i in range(max(0, row - 1), min(rows, row + 2)):
            for j in range(max(0, column - 1), min(columns, column + 2)):
                other = i * columns + j
                if closed[other] or costmap.distance[i, j] <= radius:
                    continue
                through = cost[above] + math.hypot(i - above // columns, j - above % columns)
                if through < cost[other]:
                    cost[other], parent[other] = through, above
                    if size == len(heap_keys):
                        heap_keys, heap_cells = heap_grow(heap_keys, heap_cells)
                    ahead = math.hypot(i - last_row, j - last_column)
                    size = heap_push(heap_keys, heap_cells, size, through + ahead, other)
    if not closed[last]:
        return none
    count, cell = 1, last
    while cell != first:
        count, cell = count + 1, parent[cell]
    cells, cell = np.empty((count, 2), np.int64), last
    for n in range(count - 1, -1, -1):
        cells[n] = cell // columns, cell % columns
        cell = parent[cell]
    return cells
