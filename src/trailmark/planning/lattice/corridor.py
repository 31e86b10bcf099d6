"""Corridor: costs to go of the cells on nearly the cheapest way alone, where places differ in cost.

A search over a lattice knows eight directions, which makes ways longer by up to 8 %: enough to lead it round the other
side of an obstacle. Within a corridor about the cheapest way by the fast marching method it cannot.
"""

from __future__ import annotations

import numpy as np

from trailmark.collision import StateChecker
from trailmark.motion.density import Density
from trailmark.planning.fast_marching import march
from trailmark.planning.lattice.cost_to_go import CostToGo
from trailmark.se2 import FloatArray

__all__ = ["corridor"]


def corridor(checker: StateChecker, density: Density, ends: FloatArray, cells: int, widening: float) -> CostToGo:
    """Return the costs to the goal, infinite outside of the corridor.

    Args:
        checker: gives field and robot.
        density: what a metre costs.
        ends: start and goal, shape (2, 3).
        cells: of the grid, about.
        widening: how much dearer than the cheapest a way through a cell may be, as a share.
    """
    plain = CostToGo.of(checker, ends[1], cells, 0.0, density=density)
    # Where the disc fits somewhere in the cell, by costs that are not shy of tight places.
    open_ = np.isfinite(plain.cost)
    metre = np.where(open_, plain.density, np.inf).astype(np.float64)
    rows, columns = metre.shape
    sums = np.zeros((rows, columns))
    to_goal = sums
    for q in ends:
        x, y = checker.disc_center(q)
        column = min(columns - 1, max(0, int((x - plain.x0) / plain.size)))
        row = min(rows - 1, max(0, int((y - plain.y0) / plain.size)))
        metre[row, column] = min(metre[row, column], plain.density[row, column])
        vertices = march(metre, plain.size, row, column)
        to_goal = 0.25 * (vertices[1:, 1:] + vertices[1:, :-1] + vertices[:-1, 1:] + vertices[:-1, :-1])
        sums = sums + to_goal
    cheapest = float(np.min(sums, initial=np.inf, where=np.isfinite(metre)))
    near = np.isfinite(metre) & (sums <= (1.0 + widening) * cheapest)
    cost = np.where(near, to_goal, np.inf).astype(np.float32)
    return CostToGo(cost, plain.x0, plain.y0, plain.size, plain.density, plain.least)
