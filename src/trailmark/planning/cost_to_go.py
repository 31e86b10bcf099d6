"""Costs to go for a search over configurations: the inscribed disc's on a coarse grid, dearer where it is tight.

The disc's shortest way leads through gaps that the robot fits through in few headings or none; a search that follows it
floods what lies before each of them. Ways with room are nearly as short and found at once, so tight cells are dearer
here. Nothing is proven by these costs: a cell counts as open if the disc may fit somewhere in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor, inf, sqrt

import numpy as np
from numba import njit

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.collision.kernels import field_value
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.se2 import FloatArray

__all__ = ["TIGHTNESS", "CostToGo"]

TIGHTNESS = 6.0
"""How many times dearer a cell is in which the disc hardly fits."""

ROOMY = 0.5
"""Where between the inscribed disc's radius and the circumradius a clearance counts as room enough."""

_STEP_X = np.array([1, 1, 0, -1, -1, -1, 0, 1])
_STEP_Y = np.array([0, 1, 1, 1, 0, -1, -1, -1])


@dataclass(frozen=True)
class CostToGo:
    """What is left to a configuration, as far as a grid of cells knows.

    Attributes:
        cost: (rows, columns), metres; infinite where nothing leads there. Empty: the straight distance counts.
        x0: left edge of the first column, metres.
        y0: lower edge of the first row, metres.
        size: edge of a cell, metres.
    """

    cost: FloatArray
    x0: float = 0.0
    y0: float = 0.0
    size: float = 1.0

    @classmethod
    def straight(cls) -> CostToGo:
        """Return the straight distance."""
        return cls(np.empty((0, 0)))

    @classmethod
    def of(cls, checker: StateChecker, goal: FloatArray, cells: int, tightness: float = TIGHTNESS) -> CostToGo:
        """Return the costs to a configuration.

        Args:
            checker: gives field and robot.
            goal: shape (3,).
            cells: about how many.
            tightness: how many times dearer a cell is in which the disc hardly fits.
        """
        xmin, ymin, xmax, ymax = checker.world.bounds
        size = sqrt((xmax - xmin) * (ymax - ymin) / cells)
        columns, rows = max(1, ceil((xmax - xmin) / size)), max(1, ceil((ymax - ymin) / size))
        disc = checker.robot.inscribed_disc
        x, y = se2.transform(goal, np.array(disc.center)[None])[0]
        roomy = disc.radius + ROOMY * max(checker.footprint.circumradius - disc.radius, 0.1 * disc.radius)
        cost = _costs(checker.field, xmin, ymin, size, rows, columns, disc.radius, roomy, tightness, x, y)
        return cls(cost, xmin, ymin, size)


@njit(cache=True)
def _room(field: ClearanceField, x: float, y: float, size: float, radius: float, roomy: float) -> float:
    """Return the largest clearance at some places of the cell around (x, y), no closer than need be."""
    best = field_value(field, x, y)
    if best >= roomy or best + 0.71 * size + field.slack < radius:
        return best
    places = max(1, round(size / (2.0 * field.size)))
    for i in range(places):
        for j in range(places):
            u, v = (i + 0.5) / places - 0.5, (j + 0.5) / places - 0.5
            best = max(best, field_value(field, x + u * size, y + v * size))
    return best


@njit(cache=True, nogil=True)
def _costs(
    field: ClearanceField,
    x0: float,
    y0: float,
    size: float,
    rows: int,
    columns: int,
    radius: float,
    roomy: float,
    tightness: float,
    x: float,
    y: float,
) -> FloatArray:
    """Return the costs of all cells to the one of (x, y), shape (rows, columns), by Dijkstra's algorithm."""
    # A closed border spares the search its checks of the bounds.
    width = columns + 2
    dear = np.full((rows + 2) * width, inf)
    for row in range(rows):
        for column in range(columns):
            room = _room(field, x0 + (column + 0.5) * size, y0 + (row + 0.5) * size, size, radius, roomy)
            # Half of the slack: where the field cannot tell, the disc may fit.
            if room + 0.5 * field.slack >= radius:
                lack = min(1.0, max(0.0, (roomy - room) / (roomy - radius)))
                dear[(row + 1) * width + column + 1] = size * (1.0 + tightness * lack)
    cost = np.full((rows + 2) * width, inf)
    steps = _STEP_Y * width + _STEP_X
    column, row = min(columns - 1, max(0, floor((x - x0) / size))), min(rows - 1, max(0, floor((y - y0) / size)))
    source = (row + 1) * width + column + 1
    dear[source] = min(dear[source], size * (1.0 + tightness))
    cost[source] = 0.0
    keys, values = np.empty(4096), np.empty(4096, np.int64)
    waiting = heap_push(keys, values, 0, 0.0, source)
    while waiting > 0:
        waiting = heap_pop(keys, values, waiting)
        key, cell = keys[waiting], values[waiting]
        if key > cost[cell]:
            continue
        for j in range(8):
            other = cell + steps[j]
            # The border's cells are infinitely dear: nothing is reached there.
            reached = key + 0.5 * (dear[other] + dear[cell]) * (1.4142135623730951 if j % 2 else 1.0)
            if reached < cost[other]:
                cost[other] = reached
                if waiting == len(keys):
                    keys, values = heap_grow(keys, values)
                waiting = heap_push(keys, values, waiting, reached, other)
    return cost.reshape(rows + 2, width)[1:-1, 1:-1].copy()
