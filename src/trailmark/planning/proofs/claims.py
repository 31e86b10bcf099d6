"""Claims about what cannot be, looked at once more by code that shares nothing with what they come from.

The relaxed problem's grid, the region's triangles and the cells of SE(2) each prove that there is no path, or none as
short. The triangles are proven edge by edge as it is (:mod:`trailmark.planning.proofs.separation`); here are the
same for the grid, and a comparison with what is known.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.landmarks.relaxation import CostMap, Relaxation
from trailmark.planning.proofs.separation import Separation
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc
from trailmark.world import World

__all__ = ["contradicted", "grid_separates"]

ROUNDING = 1e-9
"""Metres, and share of a cost, that a lower bound may be above it by rounding."""

HALVINGS = 4
"""Times that a cell's edge is halved where no single part of an obstacle blocks all of it."""


def contradicted(bound: float, cost: float) -> bool:
    """Return whether a lower bound (metres) is above the cost of a path that is known."""
    return bound > cost * (1.0 + ROUNDING) + ROUNDING


def grid_separates(relaxation: Relaxation, to_goal: CostMap, start: FloatArray, goal: FloatArray) -> bool:
    """Return whether the relaxed problem's cells prove that no path joins two configurations.

    Of the grid, only which cells may be the goal's component is taken on trust: the cells around them, by edges and by
    corners, are proven anew to block the disc, and the start lies in none of either.

    Args:
        relaxation: the grid.
        to_goal: what the goal's component is taken from.
        start: valid, shape (3,).
        goal: valid, shape (3,).
    """
    checker = relaxation.checker
    separation = Separation(checker.world, checker.robot.inscribed_disc.radius, checker.grid)
    component = np.isfinite(to_goal.cost)
    first, last = (int(relaxation.cells(relaxation.disc_centers(q))) for q in (start, goal))
    if component.ravel()[first] or not component.ravel()[last]:
        return False
    half = 0.5 * relaxation.size * (1.0 + 1e-9) + 1e-8
    return _block(separation, checker.world, relaxation.cell_centers(_rim(component)), half)


def _rim(inside: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the cells (row * columns + column) that share an edge or a corner with a component, and are not in it."""
    wide = np.pad(inside, 1)
    around = np.zeros_like(inside)
    rows, columns = inside.shape
    for i in range(3):
        for j in range(3):
            around |= wide[i : i + rows, j : j + columns]
    return np.flatnonzero(around & ~inside)


def _block(separation: Separation, world: World, centers: FloatArray, half: float) -> bool:
    """Return whether squares about centres (n, 2), twice ``half`` wide, are all proven to hold no place of the disc."""
    regions = np.array([s.polygon().shapely() for s in world.obstacles if not isinstance(s, Disc)], dtype=object)
    tree = shapely.STRtree(regions)
    for halving in range(HALVINGS + 1):
        corners = centers[:, None] + half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
        centers = centers[~separation.cells_block(corners)]
        boxes = shapely.box(*(centers - half).T, *(centers + half).T)
        within = np.zeros(len(centers), np.bool_)
        within[tree.query(boxes, predicate="covered_by")[0]] = True
        if world.boundary is not None:
            within |= shapely.disjoint(world.boundary.shapely(), boxes)
        centers = centers[~within]
        if len(centers) == 0:
            return True
        if halving < HALVINGS:
            half *= 0.5
            steps = half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
            centers = (centers[:, None] + steps).reshape(-1, 2)
    return False
