"""Shut off: places to which no path leads, with whatever heading, proven for many of them at once.

What an enclosure (:mod:`trailmark.planning.proofs.enclosure`) shuts in around one configuration it shuts in for all
that lie in the same cells. A place is shut off if all headings there are, in one enclosure or in several, or collide.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, sin
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.compiled import njit
from trailmark.planning.proofs.cell_kinds import decided, room_for_cores
from trailmark.planning.proofs.cell_search import INSIDE
from trailmark.planning.proofs.cells import BLOCKED, LEVELS, Division, leaf_at
from trailmark.planning.proofs.enclosure import DEPTH, SHARES, Space, enclosure_between
from trailmark.se2 import FloatArray

__all__ = ["shut_off"]

TURNS = 32
"""Headings at a place that enclosures are looked for around."""


def shut_off(
    checker: StateChecker,
    start: FloatArray,
    around: FloatArray,
    places: FloatArray,
    *,
    seconds: float = np.inf,
    stop: Callable[[], bool] | None = None,
    budget: int = 2_000_000,
) -> NDArray[np.bool_]:
    """Return the places to which, proven, no path of whatever continuous motions leads from the start, shape (n,).

    Args:
        checker: the world and the robot; for round ones nothing is proven here.
        start: valid, shape (3,).
        around: a place, x, y, shape (2,): what is shut in around it is looked at, with all headings with which the
            robot fits there.
        places: x, y, shape (n, 2): where the robot's reference point would be.
        seconds: time at most, kept to about 10 ms.
        stop: asked every few milliseconds whether to end early.
        budget: cells taken at most for each heading.
    """
    deadline = perf_counter() + seconds
    if checker.robot.sweep_radius == 0.0:
        return np.zeros(len(places), np.bool_)
    # About the reference point, so that a place is a column of cells.
    space = Space(checker, np.zeros(2))
    level = min(space.first + DEPTH, LEVELS) - 1
    finest = space.division(level, SHARES[0])
    at = np.ascontiguousarray(np.vstack([around, places]), dtype=np.float64)
    covered = np.zeros((len(at), space.headings(level)), np.bool_)
    headings = np.asarray(se2.wrap(np.arange(TURNS) * 2.0 * np.pi / TURNS))
    goals = np.column_stack([np.tile(around, (TURNS, 1)), headings])
    for goal in goals[np.asarray(checker.valid(goals), dtype=bool)]:
        if covered[0, int((goal[2] + np.pi) / (2.0 * np.pi) * covered.shape[1]) % covered.shape[1]]:
            continue
        left = deadline - perf_counter()
        ends = np.array([start, goal])
        found = enclosure_between(checker, space, ends, seconds=left, stop=stop, budget=budget)
        if found is None:
            break
        _cover(*space.parts, finest, found.flood.cells, found.side, level, at, found.of_goal, covered)
        if covered[1:].all():
            break
    return np.asarray(covered[1:].all(axis=1))


@njit(cache=True, nogil=True)
def _cover(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    division: Division,
    cells: NDArray[np.int32],
    side: NDArray[np.uint8],
    level: int,
    places: FloatArray,
    of_goal: bool,
    covered: NDArray[np.bool_],
) -> None:
    """Note with which headings, in parts of a turn, the robot collides at places, or is on the goal's side there."""
    half, placed = division.half[level], room_for_cores(division)
    for p in range(len(places)):
        i = min(max(int((places[p, 0] - division.x0) / (2.0 * half)), 0), (division.columns << level) - 1)
        j = min(max(int((places[p, 1] - division.y0) / (2.0 * half)), 0), (division.rows << level) - 1)
        inside = False
        for k in range(covered.shape[1]):
            here = side[leaf_at(cells, division, level, i, j, k)] == INSIDE
            inside = inside or here
            covered[p, k] = covered[p, k] or here == of_goal
        # Collisions are looked for where they matter: elsewhere another enclosure has to tell.
        if inside != of_goal:
            continue
        x, y = division.x0 + (2 * i + 1) * half, division.y0 + (2 * j + 1) * half
        for k in range(covered.shape[1]):
            if covered[p, k]:
                continue
            theta = (2 * k + 1) * pi / covered.shape[1] - pi
            kind = decided(level, level, x, y, cos(theta), sin(theta), division, grid, field, robot, placed)
            covered[p, k] = kind == BLOCKED
