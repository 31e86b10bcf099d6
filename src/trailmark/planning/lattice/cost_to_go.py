"""Costs to go for a search over configurations: the inscribed disc's on a coarse grid, dearer where it is tight.

The disc's shortest path leads through gaps that the robot fits through in few headings or none; a search that follows
it floods what lies before each of them. Paths with room are nearly as short and found at once, so tight cells are
dearer here. Nothing is proven by these costs: a cell counts as open if the disc may fit somewhere in it.
"""

from __future__ import annotations

from math import ceil, floor, inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.jit import array_callee, njit
from trailmark.landmarks.grid_search import CLOSED, UNIT, flood
from trailmark.motion.density import Density, densities
from trailmark.se2 import FloatArray

__all__ = ["TIGHTNESS", "CostToGo"]

TIGHTNESS = 6.0
"""How many times dearer a cell is in which the disc hardly fits."""

ROOMY = 0.5
"""Where between the inscribed disc's radius and the circumradius a clearance counts as room enough."""

MAX_RATIO = 1000.0
"""Between the costs of a metre in two cells: more is not told apart, since a queue of buckets needs one for each."""

NO_CELLS = np.empty((0, 0), np.float32)


class CostToGo(NamedTuple):
    """What is left to a configuration, as far as a grid of cells knows.

    Attributes:
        cost: (rows, columns), metres; infinite where nothing leads there. Empty: the straight distance counts.
        x0: left edge of the first column, metres.
        y0: lower edge of the first row, metres.
        size: edge of a cell, metres.
        density: what a metre costs in each cell, (rows, columns); empty where that is its length.
        least: what it costs at least.
    """

    cost: NDArray[np.float32]
    x0: float = 0.0
    y0: float = 0.0
    size: float = 1.0
    density: NDArray[np.float32] = NO_CELLS
    least: float = 1.0

    @classmethod
    def straight(cls) -> CostToGo:
        """Return the straight distance."""
        return cls(NO_CELLS)

    @classmethod
    def of(
        cls,
        checker: StateChecker,
        goal: FloatArray,
        cells: int,
        tightness: float = TIGHTNESS,
        window: tuple[float, float, float, float] | None = None,
        density: Density | None = None,
    ) -> CostToGo:
        """Return the costs to a configuration.

        Args:
            checker: gives field and robot.
            goal: shape (3,).
            cells: about how many.
            tightness: how many times dearer a cell is in which the disc hardly fits.
            window: xmin, ymin, xmax, ymax (metres) that the cells cover; by default the bounds.
            density: what a metre costs; its length by default.
        """
        xmin, ymin, xmax, ymax = checker.world.bounds if window is None else window
        size = sqrt((xmax - xmin) * (ymax - ymin) / cells)
        columns, rows = max(1, ceil((xmax - xmin) / size)), max(1, ceil((ymax - ymin) / size))
        radius = checker.robot.inscribed_disc.radius
        roomy = radius + ROOMY * max(checker.footprint.circumradius - radius, 0.1 * radius)
        dear = _dear(checker.field, xmin, ymin, size, rows, columns, radius, roomy, tightness)
        weights, least = NO_CELLS, 1.0
        if density is not None:
            weights, least = densities(density, checker.field, xmin, ymin, size, rows, columns), density.least
            dear[1:-1, 1:-1] = np.rint(dear[1:-1, 1:-1] * np.minimum(weights / least, MAX_RATIO))
        x, y = checker.disc_center(goal)
        row, column = (
            min(rows - 1, max(0, floor((y - ymin) / size))),
            min(columns - 1, max(0, floor((x - xmin) / size))),
        )
        if dear[row + 1, column + 1] == CLOSED:
            # The goal's own cell is open in any case.
            dear[row + 1, column + 1] = round(UNIT * (1.0 + tightness))
        cost = flood(dear, (row + 1) * (columns + 2) + column + 1, -1, 1)[0][1:-1, 1:-1]
        return cls(
            np.ascontiguousarray(cost * np.float32(size * least)), float(xmin), float(ymin), size, weights, float(least)
        )

    def at(self, x: float, y: float) -> float:
        """Return the cost (metres) of the cell of a place; infinite beyond the grid."""
        row, column = floor((y - self.y0) / self.size), floor((x - self.x0) / self.size)
        inside = 0 <= row < self.cost.shape[0] and 0 <= column < self.cost.shape[1]
        return float(self.cost[row, column]) if inside else inf


@njit(nogil=True)
def _dear(
    field: ClearanceField,
    x0: float,
    y0: float,
    size: float,
    rows: int,
    columns: int,
    radius: float,
    roomy: float,
    tightness: float,
) -> NDArray[np.int32]:
    """Return what crossing each cell costs, CLOSED if the disc fits nowhere in it, with a closed border all around.

    The room in a cell is the largest clearance at some places in it, looked at no closer than need be.
    """
    dear = np.full((rows + 2, columns + 2), CLOSED, np.int32)
    down, across = _under(y0 - field.y0, size, rows, field.size), _under(x0 - field.x0, size, columns, field.size)
    distance, slack = field.distance, field.slack
    for row in range(rows):
        for column in range(columns):
            i, j = down[row, 0], across[column, 0]
            room = distance[i, j] if 0 <= i < distance.shape[0] and 0 <= j < distance.shape[1] else 0.0
            if radius - 0.71 * size - slack <= room < roomy:
                for u in range(1, down.shape[1]):
                    for v in range(1, across.shape[1]):
                        i, j = down[row, u], across[column, v]
                        if 0 <= i < distance.shape[0] and 0 <= j < distance.shape[1]:
                            room = max(room, distance[i, j])
            # Half of the slack: where the field cannot tell, the disc may fit.
            if room + 0.5 * slack >= radius:
                lack = min(1.0, max(0.0, (roomy - room) / (roomy - radius)))
                dear[row + 1, column + 1] = round(UNIT * (1.0 + tightness * lack))
    return dear


@array_callee
def _under(begin: float, size: float, count: int, edge: float) -> NDArray[np.int64]:
    """Return the field's rows (or columns) under the middle of each of ``count`` cells, then under its other places."""
    places = max(1, round(size / (2.0 * edge)))
    found = np.empty((count, places + 1), np.int64)
    for k in range(count):
        found[k, 0] = floor((begin + (k + 0.5) * size) / edge)
        for u in range(places):
            found[k, u + 1] = floor((begin + (k + (u + 0.5) / places) * size) / edge)
    return found
