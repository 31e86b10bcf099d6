"""What is left to be seen, and from where: the survey on which a choice rests, or the proof that nothing is left."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.exploration.candidates import MOST_TRIES, Search, middles_of
from trailmark.exploration.cells import quarters
from trailmark.exploration.frontiers import Frontiers, frontiers_of
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.reachability import CERTAIN, Reach
from trailmark.exploration.result import Status
from trailmark.exploration.strategies import Outlook
from trailmark.exploration.travel import Travel, expected_falls
from trailmark.exploration.views import expected_areas, nearest_looks
from trailmark.planning.planner import LandmarkPlanner
from trailmark.se2 import FloatArray
from trailmark.world.robot import Robot

__all__ = ["EXCLUDED", "Memory", "Survey", "survey"]

NEARER = 0.5
"""Share of the sensor's range: a cell that stays unknown although it was in sight from nearer cannot be told; one that
was in sight from farther away is looked at again from this share of the distance at most."""

SMALL = 4
"""Cells of a frontier up to which one look is enough, from wherever; it is aimed from so near, at once."""

APART = 6.0
"""Cells between places that the robot sensed at, at which it is told what was in sight."""

MOST_PLACES = 60
"""Of them, since the last survey."""

TRIES = 2
"""Landmarks that the robot came to in order to see a cell that stayed unknown, before it is given up."""

ARRIVED = 2.0
"""Cells from a landmark at which the robot has come to it."""

MOSTLY = 0.6
"""Share of a frontier that has to be in sight for it to count as seen, if there is a landmark that sees as much."""

EXCLUDED = 254
"""In place of how often no way was found: it is proven that there is none."""

RAYS = 180
"""By which expected areas are found."""


class Memory:
    """What an exploration found out about its map that the map does not tell.

    Args:
        known: the map.

    Attributes:
        sensed: readings of the sensor up to the last survey.
        been: cells where the robot's reference point was.
        looked: metres from which each cell was looked at and stayed unknown, infinite if never.
        tries: how often the robot came to a landmark to see a cell, and it stayed unknown.
        aim: the last landmark, x, y, and rows and columns of the cells that it was to show.
        refused: how often no way to a cell was found, since changes around it were last taken into account.
        never: cells to which no way leads whatever is where nothing is known yet, as the surfaces known then go.
        again: cells around which the map has changed since then.
        outdated: cells of which it was proven that no way leads there before the robot last drove.
        refusal: why there is no way to the last landmark, in words.
        failed: landmarks in a row to which no way was found.
        closed_in: whether, as the map is, no way leads back to where the robot came from.
        confirmed: whether all that was refused has been tried again since the robot last drove.
        levels: where the robot gets to, from NOWHERE to CERTAIN, as of the last survey.
        reach: tells that; None before the first survey.
    """

    def __init__(self, known: KnownMap) -> None:
        shape = known.state.shape
        self.sensed = 0
        self.been = np.zeros(shape, np.bool_)
        self.looked = np.full(shape, np.inf, np.float32)
        self.tries = np.zeros(shape, np.int32)
        self.aim: tuple[FloatArray, tuple[NDArray[np.intp], NDArray[np.intp]]] | None = None
        self.refused = np.zeros(shape, np.uint8)
        self.never, self.again, self.outdated = (np.zeros(shape, np.bool_) for _ in range(3))
        self.refusal = ""
        self.failed, self.closed_in, self.confirmed = 0, False, False
        self.levels = np.full(shape, CERTAIN, np.uint8)
        self.reach: Reach | None = None

    def find_levels(self, known: KnownMap, robot: Robot) -> NDArray[np.bool_]:
        """Find out where the robot gets to; return around which cells that may have changed, shape (rows, columns).

        Args:
            known: the map.
            robot: with the clearance that it keeps.
        """
        if self.reach is None:
            self.reach = Reach(robot, known.cell)
        self.levels, changed = self.reach.levels(known.state, self.been)
        return np.asarray(changed | self.reach.in_rooms_of(changed))

    def main_room(self) -> NDArray[np.bool_]:
        """Return the cells of the largest room that the robot was in (:class:`Reach`), shape (rows, columns)."""
        if self.reach is None:
            return np.zeros(self.been.shape, np.bool_)
        sizes = np.bincount(self.reach.rooms[self.levels == CERTAIN], minlength=1)
        sizes[0] = 0
        return np.asarray((self.reach.rooms == sizes.argmax()) & (self.reach.rooms > 0))

    def divided(self, state: NDArray[np.uint8], known: KnownMap) -> Memory:
        """Return what holds as well in a map of cells of half the side; where ways lead is to be asked anew.

        What was known before counts as looked at, although beams may lie too far apart to show all quarters.

        Args:
            state: of the cells before, UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
            known: the map.
        """
        finer, shape = Memory(known), known.state.shape
        finer.sensed, finer.been = self.sensed, quarters(self.been, shape)
        finer.looked = np.where(quarters(state, shape) == UNKNOWN, quarters(self.looked, shape), np.float32(0.0))
        finer.tries = quarters(self.tries, shape)
        return finer

    def forget_failures(self) -> None:
        """Forget to where no way was found, without proof that there is none: the robot stood where none leads out."""
        self.refused[self.refused <= MOST_TRIES] = self.failed = 0


class Survey(NamedTuple):
    """What is left to be seen."""

    outlook: Outlook
    """What to choose from; without landmarks if nothing is left."""
    ended: str
    """Why nothing is left, in a sentence; empty as long as something is."""
    status: Status
    """``complete`` where nothing is left: nothing is in sight from the centre of any cell that the robot gets to, but
    through gaps of a cell or two, and what stayed unknown although it was looked at. That no way leads elsewhere was
    proven since the robot last drove: what opens while it stands is not looked at again. ``stuck`` where something
    would be in sight from a place to which no way was found, nor is it proven that there is none."""
    expected: tuple[tuple[NDArray[np.intp], NDArray[np.intp]], ...]
    """For each landmark, rows and columns of the unknown cells at the frontiers that it is to show."""
    any_heading: NDArray[np.bool_]
    """Which landmarks may be come to with any heading, shape (n,)."""
    narrow: bool
    """Whether something would be in sight from a place to which, as the surfaces were measured, it is proven that no
    way leads, but to which one may lead as far as the cells tell."""


def survey(
    known: KnownMap,
    planner: LandmarkPlanner,
    robot: Robot,
    pose: FloatArray,
    home: FloatArray | None,
    sensor_range: float,
    rng: np.random.Generator,
    memory: Memory,
    sensed: FloatArray | None = None,
    looked_around: bool = True,
    visited: FloatArray | None = None,
) -> Survey:
    """Return what is left to be seen, after the robot has sensed where it is.

    Args:
        known: the map; the planner's world follows it.
        planner: that plans in it.
        robot: with the clearance that it keeps.
        pose: where it is, shape (3,).
        home: where the exploration has to end, shape (3,), or None.
        sensor_range: metres.
        rng: draws the places that are clustered.
        memory: of the exploration.
        sensed: where the sensor was read so far, as is known now, in the order of time, shape (n, 3); None: here alone.
        looked_around: whether the sensor has looked into all directions here.
        visited: where the robot was, the last where it is: x, y and their standard deviation, metres, shape (m, 3).
    """
    state, cell = known.state, known.cell
    frontiers = frontiers_of(state, state == UNKNOWN, 0.5 * sensor_range / cell)
    _note_looked(memory, known, frontiers, np.asarray(pose) if looked_around else None, sensed, sensor_range)
    looked = memory.looked[frontiers.unknown[:, 0], frontiers.unknown[:, 1]]
    small = (np.bincount(frontiers.group, minlength=frontiers.groups) <= SMALL)[frontiers.group]
    left = np.where(small, np.isinf(looked), looked > NEARER * sensor_range)
    frontiers, looked, small = frontiers.subset(left), looked[left].astype(np.float64), small[left]
    away = np.minimum(np.where(small, NEARER, 1.0) * sensor_range, NEARER * looked) / cell
    _update_levels(known, robot, pose, memory)
    levels = memory.levels
    here = (np.asarray(pose)[:2] - np.asarray(known.origin)) / cell
    search = Search(known, planner.checker, levels, memory.refused, frontiers, away, here)
    found = search.candidates(sensor_range / cell, rng)
    if not len(found.cells) and not memory.confirmed and (memory.again | memory.outdated).any():
        # What has changed elsewhere may have opened a way. Once, as long as the robot stands: with noise each reading
        # changes the map, and the same would be proven again and again.
        _try_again(memory, memory.again | memory.outdated)
        memory.confirmed = True
        search = replace(search)  # what it found out no longer holds
        found = search.candidates(sensor_range / cell, rng)
    seen = found.sees.any(axis=0)
    frontiers, far, near = frontiers.subset(np.asarray(seen)), found.sees[:, seen], found.near[:, seen]
    # An edge counts as seen from afar only where no landmark sees it from near.
    sees = near | (far & ~near.any(axis=0))
    n = len(found.cells)
    ends = np.asarray([pose, pose if home is None else home], dtype=np.float64)
    ways = Travel(levels, robot.reference_radius / cell).between(
        np.concatenate([np.column_stack(known.cells_of(ends[:, :2])), found.cells])
    )
    ways *= cell
    centres = middles_of(found.cells)
    areas = expected_areas(state, centres, sensor_range / cell, _free_path(state), RAYS) * cell**2
    landmarks = np.column_stack([known.centres(*found.cells.T), np.nan_to_num(found.headings)])
    falls = np.zeros(n)
    if visited is not None:
        falls = expected_falls(landmarks[:, :2], visited[:, :2], visited[:, 2], 0.5 * sensor_range)
    outlook = Outlook(
        here=np.asarray(pose, dtype=np.float64),
        home=home,
        landmarks=landmarks,
        costs=np.array(ways[0, 2:]),
        between=np.array(ways[2:, 2:]),
        home_costs=np.zeros(n) if home is None else np.array(ways[1, 2:]),
        areas=areas,
        certainty=falls,
        frontiers=frontiers.lengths(cell),
        sees=_groups_seen(sees, frontiers),
        sensor_range=sensor_range,
    )
    ended = "" if n else "everything has been seen that can be seen from where the robot can get to"
    status: Status = "complete"
    if ended and search.shows_more(MOST_TRIES):
        # No proof, so not complete.
        status = "stuck"
        undecided = float(((memory.refused > 0) & (memory.refused <= MOST_TRIES)).sum()) * cell**2
        ended = (
            f"no way was found to {undecided:.2g} m² of free space, nor is it proven that there is none; what can be "
            "seen from elsewhere has been seen"
        )
    unknown = frontiers.unknown
    # A landmark all of whose edges others see from near is to show those that it sees from afar.
    shown = np.asarray(np.where(np.asarray(sees.any(axis=1))[:, None], sees, far))
    expected = tuple((unknown[row, 0], unknown[row, 1]) for row in shown)
    narrow = bool(ended) and search.shows_more(EXCLUDED)
    if narrow and status == "complete":
        ended += f", as far as cells of {cell:.3g} m tell where it fits"
    return Survey(outlook, ended, status, expected, np.isnan(found.headings), narrow)


def _update_levels(known: KnownMap, robot: Robot, pose: FloatArray, memory: Memory) -> None:
    """Find out where the robot gets to; where that has changed, what was refused is to be tried again."""
    memory.been[known.cells_of(np.asarray(pose)[None, :2])] = True
    memory.again |= memory.find_levels(known, robot)
    if memory.failed == 0:
        # Not between failures: noise changes the map with each reading, and other places are to get their turn.
        _try_again(memory, memory.again & ~memory.never)


def _try_again(memory: Memory, cells: NDArray[np.bool_]) -> None:
    """Forget that no way to cells, shape (rows, columns), was found, or leads there."""
    memory.refused[cells] = 0
    memory.never[cells] = memory.again[cells] = memory.outdated[cells] = False


def _groups_seen(sees: NDArray[np.bool_], frontiers: Frontiers) -> NDArray[np.bool_]:
    """Return which landmarks see most of which group, or as much of it as any landmark does, shape (n, groups)."""
    counts = np.zeros((len(sees), frontiers.groups))
    for i, row in enumerate(sees):
        counts[i] = np.bincount(frontiers.group[row], minlength=frontiers.groups)
    sizes = np.bincount(frontiers.group, minlength=frontiers.groups)
    return np.asarray((counts > 0) & (counts >= np.minimum(MOSTLY * sizes, counts.max(axis=0, initial=0))))


def _note_looked(
    memory: Memory,
    known: KnownMap,
    frontiers: Frontiers,
    pose: FloatArray | None,
    sensed: FloatArray | None,
    sensor_range: float,
) -> None:
    """Note the unknown cells that were wholly in sight since the last survey: they were looked at, and stayed unknown.

    So were those that the last landmark was to show, if the robot has come there as often as that.
    """
    here = np.empty((0, 2)) if pose is None else pose[None, :2]
    places = here
    if sensed is not None:
        places = np.concatenate([_spaced(sensed[memory.sensed :, :2], known.cell), here])
        memory.sensed = len(sensed)
    cells = np.unique(frontiers.unknown, axis=0)
    rows, columns = known.state.shape
    places = np.clip((places - np.asarray(known.origin)) / known.cell, 0.0, np.array([columns, rows]) - 1e-9)
    away = nearest_looks(
        known.state,
        known.surface_boxes(),
        np.ascontiguousarray(places),
        np.ascontiguousarray(cells, np.int64),
        sensor_range / known.cell,
    )
    np.minimum.at(memory.looked, tuple(cells.T), (away * known.cell).astype(np.float32))
    if memory.aim is not None and pose is not None:
        place, expected = memory.aim
        if np.hypot(*(place - pose[:2])) <= ARRIVED * known.cell:
            memory.tries[expected] += 1
            memory.looked[memory.tries >= TRIES] = 0.0
            memory.aim = None


def _spaced(points: FloatArray, cell: float) -> FloatArray:
    """Return some of the points along a way, about APART cells from one to the next, and no more than MOST_PLACES."""
    if len(points) == 0:
        return points
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    wanted = np.arange(0.0, along[-1], max(APART * cell, along[-1] / MOST_PLACES))
    return np.asarray(points[np.unique(np.searchsorted(along, wanted))])


def _free_path(state: NDArray[np.uint8]) -> float:
    """Return how far a ray goes in free space on average (Cauchy: pi times area over perimeter), in cells."""
    free, occupied = state == FREE, state == OCCUPIED
    walls = sum(int((a & b).sum()) for a, b in ((free[1:], occupied[:-1]), (free[:-1], occupied[1:])))
    walls += sum(int((a & b).sum()) for a, b in ((free[:, 1:], occupied[:, :-1]), (free[:, :-1], occupied[:, 1:])))
    # Cells' edges overstate the length of walls that run at odd angles by 4/pi on average.
    return float(max(pi * free.sum() / max(walls * pi / 4.0, 1.0), 4.0))
