"""The way to a landmark; where there is none, or none is found, what that says of the places around."""

# Tested by tests/exploration/test_survey.py.

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.known_map import UNKNOWN_ID, KnownMap
from trailmark.exploration.reachability import CERTAIN, NOWHERE, excluded_with
from trailmark.exploration.survey import EXCLUDED, MOST_TRIES, Memory, Survey
from trailmark.goals import Goal
from trailmark.planning.planner import LandmarkPlanner
from trailmark.planning.result import PlanProgress, PlanResult
from trailmark.se2 import FloatArray

__all__ = ["plan_to"]

FIRST, LAST = 0.15, 4.0
"""Of the planning time, where it is not certain that there is a way: at first, twice as long after each landmark in a
row to which none was found, and when all else has been seen."""

GAP = 0.02
"""Share by which a way may be longer than the shortest."""

PATIENCE = 0.05
"""Seconds after which a way is good enough, if one has been found."""

REFUSED = 2
"""Cells on all sides of one to which no way was found, to which none is looked for then either; where it is not certain
that there is a way, twice as many after each landmark in a row, so that what can be reached gets its turn."""

FARTHEST = 8
"""Times that this doubles: by then all of a map is refused."""


def plan_to(
    known: KnownMap,
    planner: LandmarkPlanner,
    surveyed: Survey,
    index: int,
    settings: ExplorationSettings,
    memory: Memory,
    stopped: Callable[[], bool] = lambda: False,
) -> PlanResult:
    """Return the way to a landmark; where there is none, or none is found, the memory keeps that.

    Args:
        known: the map, of which only the place is asked.
        planner: that plans in it.
        surveyed: tells the landmarks.
        index: of the landmark.
        settings: of the exploration.
        memory: of the exploration.
        stopped: asked between steps whether to end early.
    """
    outlook = surveyed.outlook
    x, y, theta = outlook.landmarks[index].tolist()
    row, column = (int(place[0]) for place in known.cells_of(np.array([[x, y]])))
    goal = Goal(pose=(x, y)) if surveyed.any_heading[index] else Goal(pose=(x, y, theta))
    share = LAST if memory.refused[row, column] > 0 else min(FIRST * 2**memory.failed, LAST)
    seconds = settings.planning_time * (1.0 if surveyed.any_heading[index] else share)
    found, begin = list[float](), perf_counter()

    def stop() -> bool:
        return stopped() or (bool(found) and perf_counter() - begin > PATIENCE)

    def note(progress: PlanProgress) -> None:
        if progress.cost is not None:
            found.append(progress.cost)

    result = planner.plan(outlook.here, goal, seconds, gap=GAP, stop=stop, on_progress=note)
    memory.aim = None if result.path is None else (outlook.landmarks[index, :2], surveyed.expected[index])
    if result.path is not None:
        memory.failed = 0
        return result
    perhaps = (memory.levels > NOWHERE) & (memory.levels < CERTAIN)
    refused = np.zeros(known.state.shape, np.bool_)
    # What is so for one place of a room is so for all of it.
    refused[_around(row, column, REFUSED)] = True
    if memory.reach is not None:
        refused |= memory.reach.in_rooms_of(refused)
    around = _around(row, column, REFUSED * 2 ** min(memory.failed, FARTHEST))
    refused[around] |= perhaps[around]
    memory.refused[refused & (memory.refused < MOST_TRIES)] += 1
    memory.failed += 1
    memory.refusal = "none was found in time"
    if result.status == "infeasible":
        theta_free = bool(surveyed.any_heading[index])
        excluded = _excluded(known, planner, perhaps | refused, row, column, theta_free)
        memory.refused[excluded] = EXCLUDED
        memory.refusal = "not reachable yet, which is proven: what is unknown would have to be free"
        if _is_never_reached(planner, outlook.here, goal, seconds, stopped):
            memory.refusal = "not reachable at all, which is proven by the surfaces that are known"
            cells = np.argwhere(excluded)
            places = np.column_stack([known.centres(*cells.T), np.full(len(cells), theta)])
            memory.never[tuple(cells[np.asarray(planner.checker.valid(places), dtype=bool)].T)] = True
    return result


def _is_never_reached(
    planner: LandmarkPlanner, here: FloatArray, goal: Goal, seconds: float, stopped: Callable[[], bool]
) -> bool:
    """Return whether it is proven that no way would lead to a goal even if all that is unknown were free."""
    names = [name for name in planner.world.ids if name is not None and name.startswith(UNKNOWN_ID)]
    if not names:
        return True
    world = planner.world.edited(remove=names)
    found = list[float]()
    result = LandmarkPlanner(world, planner.robot, seed=planner.seed).plan(
        here,
        goal,
        seconds,
        stop=lambda: stopped() or bool(found),
        on_progress=lambda progress: None if progress.cost is None else found.append(progress.cost),
    )
    return result.status == "infeasible"


def _around(row: int, column: int, cells: int) -> tuple[slice, slice]:
    """Return so many rows and columns to all sides of a cell."""
    return slice(max(row - cells, 0), row + cells + 1), slice(max(column - cells, 0), column + cells + 1)


def _excluded(
    known: KnownMap, planner: LandmarkPlanner, among: NDArray[np.bool_], row: int, column: int, any_heading: bool
) -> NDArray[np.bool_]:
    """Return the cells to which there is no way since there is none to a landmark, shape (rows, columns)."""
    if planner.checker.footprint.is_disc and planner.robot.drive != "car":
        # Its heading makes no difference, and it comes back on any motion.
        return excluded_with(known, planner.checker, among, row, column)
    found = np.zeros(among.shape, np.bool_)
    found[row, column] = any_heading
    return found
