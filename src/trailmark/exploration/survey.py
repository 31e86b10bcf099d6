"""What is left to be seen, and from where: the survey on which a choice rests, or the proof that nothing is left."""

# Tested by tests/exploration/test_survey.py.

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.exploration.candidates import candidates_of, middles_of
from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.frontiers import Frontiers, frontiers_of
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.outlook import Outlook
from trailmark.exploration.reachability import NOWHERE, passable
from trailmark.exploration.result import Status
from trailmark.exploration.travel import costs_from
from trailmark.exploration.views import expected_areas, sight
from trailmark.goals import Goal
from trailmark.planning.planner import LandmarkPlanner
from trailmark.planning.result import PlanResult
from trailmark.robot import Robot
from trailmark.se2 import FloatArray

__all__ = ["Memory", "Survey", "plan_to", "survey"]

TIGHT = 3.0
"""Times as much that a metre costs where it is not certain that the robot fits."""

NEARER = 0.5
"""Share of the distance from which a place was looked at in vain: it is looked at again from there at most."""

TRIES = 3
"""Surveys from right beside a place that count as one from there: the robot does not get there to the hair."""

RAYS = 180
"""By which expected areas are found."""


class Memory:
    """What an exploration found out about its map that the map does not tell.

    Args:
        known: the map.

    Attributes:
        looked: metres from which each cell was looked at and stayed unknown, infinite if never.
        tries: surveys at places from right beside which a cell was in sight and stayed unknown.
        refused: revision of the map at which no way to a cell was found, or proven not to exist; -1 for none.
    """

    def __init__(self, known: KnownMap) -> None:
        self.looked = np.full(known.state.shape, np.inf, np.float32)
        self.tries = np.zeros(known.state.shape, np.int32)
        self.refused = np.full(known.state.shape, -1, np.int64)


class Survey(NamedTuple):
    """What is left to be seen."""

    outlook: Outlook
    """What to choose from; without landmarks if nothing is left."""
    ended: str
    """Why nothing is left, in a sentence; empty as long as something is."""
    status: Status
    """``complete`` where nothing is left: it is proven that nothing more can be seen, at the map's resolution."""
    expected: tuple[tuple[NDArray[np.intp], NDArray[np.intp]], ...]
    """For each landmark, rows and columns of the unknown cells at the frontiers that are in sight from it."""


def survey(
    known: KnownMap,
    planner: LandmarkPlanner,
    robot: Robot,
    pose: FloatArray,
    home: FloatArray | None,
    sensor_range: float,
    settings: ExplorationSettings,
    rng: np.random.Generator,
    memory: Memory,
) -> Survey:
    """Return what is left to be seen, after the robot has sensed where it is.

    Args:
        known: the map; the planner's world follows it.
        planner: that plans in it.
        robot: with the clearance that it keeps.
        pose: where it is, shape (3,).
        home: where the exploration has to end, shape (3,), or None.
        sensor_range: metres.
        settings: of the exploration.
        rng: draws the places that are clustered.
        memory: of the exploration.
    """
    state, cell = known.state, known.cell
    here = np.array([known.cells_of(np.asarray(pose)[None, :2])]).reshape(2)
    frontiers = frontiers_of(state, _large_enough(state, settings.min_area / cell**2), 0.5 * sensor_range / cell)
    _note_looked(memory, known, frontiers, pose, sensor_range)
    away = np.minimum(sensor_range, NEARER * memory.looked[frontiers.unknown[:, 0], frontiers.unknown[:, 1]]) / cell
    frontiers, away = frontiers.subset(np.asarray(away > 1.0)), np.asarray(away[away > 1.0])
    fits = passable(known, robot)
    fits[memory.refused >= known.revision] = NOWHERE
    costs = costs_from(fits, int(here[0]), int(here[1]), TIGHT)
    found = candidates_of(state, fits, costs, frontiers, away, sensor_range / cell, rng)
    seen = found.sees.any(axis=0)
    frontiers, sees = frontiers.subset(np.asarray(seen)), found.sees[:, seen]
    n = len(found.cells)
    between = np.zeros((n, n))
    for i, (r, c) in enumerate(found.cells.tolist()):
        between[i] = costs_from(fits, r, c, TIGHT)[found.cells[:, 0], found.cells[:, 1]]
    home_costs = np.zeros(n)
    if home is not None:
        row, column = (int(place[0]) for place in known.cells_of(np.asarray(home)[None, :2]))
        home_costs = (
            costs_from(fits, row, column, TIGHT)[found.cells[:, 0], found.cells[:, 1]].astype(np.float64) * cell
        )
    centres = middles_of(found.cells)
    areas = expected_areas(state, centres, sensor_range / cell, _free_path(state), RAYS) * cell**2
    outlook = Outlook(
        here=np.asarray(pose, dtype=np.float64),
        home=home,
        landmarks=np.column_stack([known.centres(*found.cells.T), np.zeros(n)]),
        costs=costs[found.cells[:, 0], found.cells[:, 1]].astype(np.float64) * cell,
        between=between * cell,
        home_costs=home_costs,
        areas=areas,
        certainty=np.zeros(n),
        frontiers=frontiers.lengths(cell),
        sees=np.array([[row[frontiers.group == g].any() for g in range(frontiers.groups)] for row in sees]).reshape(
            n, frontiers.groups
        ),
        sensor_range=sensor_range,
    )
    ended = "" if n else "everything has been seen that can be seen from where the robot can get to"
    unknown = frontiers.unknown
    return Survey(outlook, ended, "complete", tuple((unknown[row, 0], unknown[row, 1]) for row in sees))


def plan_to(
    known: KnownMap,
    planner: LandmarkPlanner,
    surveyed: Survey,
    index: int,
    settings: ExplorationSettings,
    memory: Memory,
) -> PlanResult:
    """Return the way to a landmark; where there is none, or none is found, the memory keeps that."""
    outlook = surveyed.outlook
    x, y = outlook.landmarks[index, :2].tolist()
    goal = Goal(pose=(x, y))
    result = planner.plan(outlook.here, goal, settings.planning_time, gap=0.02)
    if result.status != "solved":
        row, column = (int(place[0]) for place in known.cells_of(np.array([[x, y]])))
        memory.refused[row, column] = known.revision
    return result


def _large_enough(state: NDArray[np.uint8], least: float) -> NDArray[np.bool_]:
    """Return the unknown cells of regions of as many cells at least."""
    unknown = state == UNKNOWN
    if least <= 1.0:
        return np.asarray(unknown)
    from scipy import ndimage

    labels = ndimage.label(unknown)[0]
    large: NDArray[np.bool_] = np.bincount(labels.ravel()) >= least
    large[0] = False
    return np.asarray(np.take(large, labels))


def _note_looked(memory: Memory, known: KnownMap, frontiers: Frontiers, pose: FloatArray, sensor_range: float) -> None:
    """Note the unknown cells that are in sight from here: they were looked at, and stayed unknown."""
    here = (np.asarray(pose)[None, :2] - np.asarray(known.origin)) / known.cell
    around = np.floor(here) + np.array([[i, j] for i in (-0.5, 0.5, 1.5) for j in (-0.5, 0.5, 1.5)])
    rows, columns = known.state.shape
    places = np.clip(np.concatenate([here, around]), 0.0, np.array([columns, rows]) - 1e-9)
    edges, cells = frontiers.edges, frontiers.unknown
    seen = sight(known.state, places, edges, np.full(len(edges), sensor_range / known.cell))
    memory.tries[tuple(cells[seen.any(axis=0)].T)] += 1
    looked = seen[0] | (seen.any(axis=0) & (memory.tries[cells[:, 0], cells[:, 1]] >= TRIES))
    away = np.hypot(*(edges[looked, :2] - here).T) * known.cell
    np.minimum.at(memory.looked, tuple(cells[looked].T), away.astype(np.float32))


def _free_path(state: NDArray[np.uint8]) -> float:
    """Return how far a ray goes in free space on average (Cauchy: pi times area over perimeter), in cells."""
    free, occupied = state == FREE, state == OCCUPIED
    walls = sum(int((a & b).sum()) for a, b in ((free[1:], occupied[:-1]), (free[:-1], occupied[1:])))
    walls += sum(int((a & b).sum()) for a, b in ((free[:, 1:], occupied[:, :-1]), (free[:, :-1], occupied[:, 1:])))
    # Cells' edges overstate the length of walls that run at odd angles by 4/pi on average.
    return float(max(pi * free.sum() / max(walls * pi / 4.0, 1.0), 4.0))
