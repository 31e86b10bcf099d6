"""Shut off: places to which no path leads, with whatever heading, proven for many of them at once.

What an enclosure (:mod:`trailmark.planning.proofs.enclosure`) shuts in around one configuration it shuts in for all
that lie in the same cells. A place is shut off if all headings there are, in one enclosure or in several, or collide.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, floor, pi, sin
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.jit import array_callee, njit
from trailmark.planning.proofs.cell_kinds import decided, room_for_cores
from trailmark.planning.proofs.cells import BLOCKED, FREE, LEVELS, Division
from trailmark.planning.proofs.enclosure import DEPTH, SHARES, Space, enclosure
from trailmark.se2 import FloatArray

__all__ = ["shut_off"]

ROUNDING = 1e-12
"""Metres beside a cell's edge where rounding may put a place on either side: neither is taken for granted."""

DEEPER = 4
"""Levels by which cells at a place are divided further, to tell whether the robot collides there: each halves what is
left untold."""

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
    order = np.lexsort((places[:, 1], places[:, 0]))
    at = np.ascontiguousarray(places[order], dtype=np.float64)
    covered = np.zeros((len(at), space.headings(level)), np.bool_)
    own = np.zeros((1, covered.shape[1]), np.bool_)
    headings = np.asarray(se2.wrap(np.arange(TURNS) * 2.0 * np.pi / TURNS))
    goals = np.column_stack([np.tile(around, (TURNS, 1)), headings])
    for goal in goals[np.asarray(checker.valid(goals), dtype=bool)]:
        if own[0, int((goal[2] + np.pi) / (2.0 * np.pi) * own.shape[1]) % own.shape[1]]:
            continue
        left = deadline - perf_counter()
        found = enclosure(checker, start, goal, seconds=left, stop=stop, budget=budget, space=space)
        if found is None:
            break
        for some, known in ((at, covered), (goal[None, :2].copy(), own)):
            inside = np.zeros_like(known)
            _note_inside(found.centers, found.extents, -ROUNDING if found.end == 1 else ROUNDING, some, inside)
            known |= inside == (found.end == 1)
        if found.end == 0:
            break  # what it does not hold is shut off, whatever the heading
    # Collisions are looked for where they matter: where no heading is shut in, nothing is told.
    finest = min(level + DEEPER, LEVELS - 1)
    _note_collisions(*space.parts, space.division(finest, SHARES[0]), level, finest, at, covered)
    shut = np.zeros(len(at), np.bool_)
    shut[order] = covered.all(axis=1)
    return shut


@njit(nogil=True)
def _note_inside(
    centers: FloatArray, extents: FloatArray, wider: float, places: FloatArray, inside: NDArray[np.bool_]
) -> None:
    """Note in which parts of a turn, shape (n, parts), places in the order of x are in some box, so much wider."""
    n, parts = inside.shape
    for b in range(len(centers)):
        x, y, theta = centers[b]
        first = round((theta - extents[b, 2] + pi) / (2.0 * pi) * parts)
        last = round((theta + extents[b, 2] + pi) / (2.0 * pi) * parts)
        for p in range(np.searchsorted(places[:, 0], x - extents[b, 0] - wider), n):
            if places[p, 0] > x + extents[b, 0] + wider:
                break
            if abs(places[p, 1] - y) <= extents[b, 1] + wider:
                inside[p, first:last] = True


@njit(nogil=True)
def _note_collisions(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    division: Division,
    level: int,
    finest: int,
    places: FloatArray,
    covered: NDArray[np.bool_],
) -> None:
    """Note in which other parts of a turn the robot collides whatever its heading, where some of them are noted."""
    placed, parts = room_for_cores(division), covered.shape[1]
    for p in range(len(places)):
        if not covered[p].any():
            continue
        for k in range(parts):
            if not covered[p, k]:
                covered[p, k] = _collides(grid, field, robot, division, level, finest, places[p], k, placed)
                if not covered[p, k]:
                    break


@array_callee
def _collides(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    division: Division,
    level: int,
    finest: int,
    place: FloatArray,
    part: int,
    placed: FloatArray,
) -> bool:
    """Return whether the robot, proven, collides at a place with all headings of a part of a level's turn.

    Where a cell around it does not tell, smaller ones do: near to a collision a cell is never blocked as a whole.
    """
    levels, parts, count = np.empty(2 * finest + 2, np.int64), np.empty(2 * finest + 2, np.int64), 1
    levels[0], parts[0] = level, part
    while count > 0:
        count -= 1
        at, k = levels[count], parts[count]
        half, turns = division.half[at], division.turns[at]
        x = division.x0 + (2.0 * floor((place[0] - division.x0) / (2.0 * half)) + 1.0) * half
        y = division.y0 + (2.0 * floor((place[1] - division.y0) / (2.0 * half)) + 1.0) * half
        theta = (2 * k + 1) * pi / (1 << turns) - pi
        kind = decided(at, finest, x, y, cos(theta), sin(theta), division, grid, field, robot, placed)
        if kind == BLOCKED:
            continue
        if kind == FREE or at == finest:
            return False
        for child in range(1 << (division.turns[at + 1] - turns)):
            levels[count], parts[count] = at + 1, (k << (division.turns[at + 1] - turns)) + child
            count += 1
    return True
