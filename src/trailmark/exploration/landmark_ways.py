"""The way to a landmark; where there is none, or none is found, what that says of the places around."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from trailmark.exploration.candidates import MOST_TRIES
from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.known_map import UNKNOWN_ID, KnownMap
from trailmark.exploration.reachability import CERTAIN, NOWHERE, excluded_with
from trailmark.exploration.survey import EXCLUDED, Memory, Survey
from trailmark.planning.planner import LandmarkPlanner
from trailmark.planning.result import PlanProgress, PlanResult, Status
from trailmark.planning.warmup import warm_up
from trailmark.proofs.enclosure import shut_off
from trailmark.se2 import FloatArray
from trailmark.world.goals import Goal

__all__ = ["plan_to"]

FIRST, LAST, FINAL = 0.15, 4.0, 16.0
"""Of the planning time, where it is not certain that there is a way: at first, twice as long after each landmark in a
row to which none was found; when all else has been seen; and before a place is left undecided."""

DOUBTFUL = 3
"""Landmarks in a row to which none was found, nor proven that there is none, from which on it is asked whether the
robot gets away at all."""

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
    warm_up(use="reachability")  # before time is taken, at the first call
    here, landmark = surveyed.outlook.here, surveyed.outlook.landmarks[index]
    row, column = (int(place[0]) for place in known.cells_of(landmark[None, :2]))
    tried = int(memory.refused[row, column])
    share = FINAL if tried > 1 else LAST if tried else min(FIRST * 2**memory.failed, LAST)
    seconds = settings.planning_time * max(share, 1.0 if surveyed.any_heading[index] else 0.0)
    goal = Goal(pose=tuple(landmark[: 2 if surveyed.any_heading[index] else 3].tolist()))
    result = _way(planner, here, goal, seconds, stopped, PATIENCE)
    memory.aim = None
    if result.path is not None:
        end, time = result.path.states[-1], settings.planning_time
        if not (planner.robot.reverse or _comes_back(known, planner, memory, end, time, stopped)):
            _refuse(memory, row, column)
            memory.refusal = "no way back from there was found, and the robot does not drive backwards"
            return replace(result, status="timeout", path=None)
        memory.aim = landmark[:2], surveyed.expected[index]
        memory.failed = 0
        memory.outdated |= memory.refused == EXCLUDED
        return result
    before = memory.refused.copy()
    among = _refuse(memory, row, column)
    memory.refusal = "none was found in time"
    # A proof shuts off more than this one place: it may take as long as a way elsewhere.
    proving = max(seconds, settings.planning_time)
    excluded = never = _excluded(known, planner, among, here, goal, proving, stopped, result.status)
    doubtful = excluded.any() or memory.failed >= DOUBTFUL
    if doubtful and not _comes_back(known, planner, memory, here, settings.planning_time, stopped):
        # The robot came from there: not those places are shut off, but where it stands.
        memory.closed_in = True
        memory.refusal = "the map closes the robot in where it stands"
    elif excluded.any():
        if excluded[row, column]:
            # That says nothing of the places around for which it is not proven, too: they get their own turn, later.
            memory.refused = np.where(before > 0, before, memory.refused)
        memory.refused[excluded] = EXCLUDED
        memory.refusal = "not reachable yet, which is proven: what is unknown would have to be free"
        names = [name for name in planner.world.ids if name is not None and name.startswith(UNKNOWN_ID)]
        if names:
            beyond = LandmarkPlanner(planner.world.edited(remove=names), planner.robot, seed=planner.seed)
            never = _excluded(known, beyond, excluded, here, goal, proving, stopped)
        memory.never |= never
        if never[row, column]:
            memory.refusal = "not reachable at all, which is proven by the surfaces that are known"
    return result


def _way(
    planner: LandmarkPlanner,
    here: FloatArray,
    goal: Goal,
    seconds: float,
    stopped: Callable[[], bool],
    patience: float,
) -> PlanResult:
    """Return a way that is about the shortest, or after so many seconds the best that there is, if there is one."""
    found, begin = list[float](), perf_counter()

    def stop() -> bool:
        return stopped() or (bool(found) and perf_counter() - begin > patience)

    def note(progress: PlanProgress) -> None:
        if progress.cost is not None:
            found.append(progress.cost)

    return planner.plan(here, goal, seconds, gap=GAP, stop=stop, on_progress=note)


def _comes_back(
    known: KnownMap,
    planner: LandmarkPlanner,
    memory: Memory,
    here: FloatArray,
    seconds: float,
    stopped: Callable[[], bool],
) -> bool:
    """Return whether a way is found to where there is most room of where the robot was.

    Surfaces are known to a cell or so: a passage that just fits may close in the map once the robot is through.
    """
    main = memory.main_room()
    there = np.argwhere(memory.been & main)
    row, column = (int(place[0]) for place in known.cells_of(here[None, :2]))
    if not len(there) or main[row, column]:
        return True
    nearest = there[np.argmin(np.hypot(*(there - [row, column]).T))]
    goal = Goal(pose=tuple(known.centres(*nearest[:, None])[0].tolist()))
    return _way(planner, here, goal, seconds, stopped, 0.0).path is not None


def _refuse(memory: Memory, row: int, column: int) -> NDArray[np.bool_]:
    """Note that no way to a cell was found; return the cells for which that may say something as well."""
    perhaps = (memory.levels > NOWHERE) & (memory.levels < CERTAIN)
    refused = np.zeros(perhaps.shape, np.bool_)
    # What is so for one place of a room is so for all of it.
    refused[_around(row, column, REFUSED)] = True
    if memory.reach is not None:
        refused |= memory.reach.in_rooms_of(refused)
    # At last each place is looked at.
    wider = 0 if memory.refused[row, column] > 1 else min(memory.failed, FARTHEST)
    around = _around(row, column, REFUSED * 2**wider)
    refused[around] |= perhaps[around]
    memory.refused[refused & (memory.refused < MOST_TRIES)] += 1
    memory.failed += 1
    return perhaps | refused


def _around(row: int, column: int, cells: int) -> tuple[slice, slice]:
    """Return so many rows and columns to all sides of a cell."""
    return slice(max(row - cells, 0), row + cells + 1), slice(max(column - cells, 0), column + cells + 1)


def _excluded(
    known: KnownMap,
    planner: LandmarkPlanner,
    among: NDArray[np.bool_],
    here: FloatArray,
    goal: Goal,
    seconds: float,
    stopped: Callable[[], bool],
    status: Status | None = None,
) -> NDArray[np.bool_]:
    """Return the cells to which, proven, no way leads with any heading, among some: shape (rows, columns).

    Args:
        known: the map.
        planner: of which the world and the robot are asked.
        among: cells, shape (rows, columns), the goal's among them.
        here: from where, shape (3,).
        goal: in one of them.
        seconds: for proofs.
        stopped: asked between steps whether to end early.
        status: what became of the way to the goal; None if none was looked for.
    """
    assert goal.pose is not None  # noqa: S101 # the only goals here
    xy, checker = np.array(goal.pose[:2]), planner.checker
    row, column = (int(place[0]) for place in known.cells_of(xy[None]))
    found = np.zeros(among.shape, np.bool_)
    if not checker.footprint.is_disc:
        cells = np.argwhere(among)
        shut = shut_off(checker, here, xy, known.centres(*cells.T), seconds=seconds, stop=stopped)
        found[tuple(cells[shut].T)] = True
        return found
    if status is None:
        status = _way(planner, here, goal, seconds, stopped, 0.0).status
    if status != "infeasible":
        return found
    found[row, column] = len(goal.pose) == 2
    if planner.robot.drive != "car":
        # Its heading makes no difference, and it comes back on any motion.
        found |= excluded_with(known, checker, among, row, column)
    return found
