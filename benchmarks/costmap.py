"""Costmap: a world as nav2's users have it, cells of 5 cm that obstacles touch and distances from them."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.collision.field import distance_transform, occupied_cells
from trailmark.collision.obstacles import build_grid
from trailmark.compiled import njit
from trailmark.keep_out import with_keep_outs
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["RESOLUTION", "Costmap", "cell_of", "costmap_of", "goal_distances", "with_headings"]

RESOLUTION = 0.05
"""Metres: the edge of a cell, nav2's default."""


class Costmap(NamedTuple):
    """Cells of a world.

    Attributes:
        distance: from each cell's centre to the nearest occupied cell's, metres, shape (rows, columns).
        x0: of the first cell's outer corner, metres.
        y0: likewise.
        size: of a cell, metres.
    """

    distance: NDArray[np.float32]
    x0: float
    y0: float
    size: float


def costmap_of(checker: StateChecker) -> Costmap:
    """Return the costmap of a checker's world; the same one for the same world."""
    return _costmap(checker.world)


def with_headings(xy: FloatArray, start: FloatArray, goal: FloatArray) -> FloatArray:
    """Return a round robot's way as states, shape (n, 3): it turns evenly from the start's heading to the goal's."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy, axis=0).T))])
    turn = math.remainder(float(goal[2] - start[2]), 2.0 * math.pi)
    theta = start[2] + turn * along / max(float(along[-1]), 1e-9)
    theta[-1] = goal[2]
    return np.column_stack([xy, theta])


@lru_cache(maxsize=2)
def _costmap(world: World) -> Costmap:
    grid = build_grid(with_keep_outs(world), RESOLUTION)
    return Costmap(distance_transform(occupied_cells(grid), grid.size), grid.x0, grid.y0, grid.size)


@njit(cache=True)
def cell_of(costmap: Costmap, x: float, y: float) -> tuple[int, int]:
    """Return row and column of the cell that holds a point, which may lie outside the map."""
    return int(np.floor((y - costmap.y0) / costmap.size)), int(np.floor((x - costmap.x0) / costmap.size))


@njit(cache=True)
def goal_distances(
    free: NDArray[np.bool_], size: float, goal: tuple[int, int], start: tuple[int, int], margin: float
) -> NDArray[np.float64]:
    """Return each cell's shortest way to the goal over free cells and their eight neighbours, metres.

    It is looked for up to ``margin`` times the start's; what is farther, or has no way, gets that much, which is
    infinite if the start has none.
    """
    rows, columns = free.shape
    found = np.full(rows * columns, np.inf)
    # Dial's buckets would be quicker; a circular one of cells by distance in tenths of a cell is as simple as a heap.
    width = 0.2 * size
    count = int(1.5 / 0.2) + 3
    buckets = [[np.int64(0) for _ in range(0)] for _ in range(count)]
    first = goal[0] * columns + goal[1]
    found[first] = 0.0
    buckets[0].append(np.int64(first))
    limit, end, left, level = np.inf, start[0] * columns + start[1], 1, 0
    while left > 0 and level * width <= limit:
        bucket = buckets[level % count]
        while len(bucket) > 0:
            cell = bucket.pop()
            left -= 1
            d = found[cell]
            if int(d / width) < level:
                continue  # it was reached by a shorter way since
            row, column = cell // columns, cell % columns
            if cell == end and not np.isfinite(limit):
                limit = margin * d + 2.0 * size
            for i in range(max(0, row - 1), min(rows, row + 2)):
                for j in range(max(0, column - 1), min(columns, column + 2)):
                    other = i * columns + j
                    step = size * (1.4142135 if i != row and j != column else 1.0)
                    if free[i, j] and d + step < found[other]:
                        found[other] = d + step
                        buckets[int((d + step) / width) % count].append(np.int64(other))
                        left += 1
        level += 1
    return np.minimum(found, limit).reshape(rows, columns)
