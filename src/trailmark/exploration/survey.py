"""What is left to be seen, and the landmarks to see it from.

These are K-means centres of the free space known so far, and of places that see the frontiers left over.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.exploration.frontiers import Frontiers, frontiers_of, places_in_sight, sight
from trailmark.exploration.known_map import KnownMap
from trailmark.exploration.reachability import CERTAIN, NOWHERE, Reach, Travel, perhaps_reached, reach_of
from trailmark.exploration.strategies import Outlook
from trailmark.landmarks.executions import landmarks_for_area
from trailmark.landmarks.sampling import k_means_landmarks
from trailmark.se2 import FloatArray, wrap
from trailmark.world import Robot

__all__ = ["MOST_TRIES", "Memory", "Survey", "survey"]

# Free places that are clustered, landmarks of them at most, and steps of Lloyd's algorithm: a decision is quick.
SAMPLES, MOST, STEPS = 1000, 40, 5
# Groups of frontiers that no landmark sees, the nearest ones, for which places are looked for while there are any; and
# edges of each of which these are to see one; of all, before the end is proven.
GROUPS, EDGES = 60, 4
# Cells between neighbouring rays where they end: of what is asked first, and so that no cell in sight is left out.
SPARSE, DENSE = 4.0, 0.5
# Places drawn of those that see an edge; as many times more, up to so many, where the robot fits at none of them.
DRAWS, MOST_DRAWS = 4, 64
# Share of the distance up to which an edge can be seen, from which it is looked at if possible; also of the sensor's
# range, nearer than which a look at a cell that stays unknown is the last one. From farther away little of what lies
# behind a frontier is in range, and it has to be driven to again.
NEAR = 0.5
# Edges of a frontier up to which every place that sees it counts as near: little lies behind it, and to come nearer
# takes more of the way than that is worth.
FEW = 12
SMALL = 4  # Edges of a frontier up to which one look is enough, from wherever; it is aimed from so near, at once.
TURNS = 32  # Headings that are tried where the robot does not fit with any.
MOST_TRIES, NO_ROOM = 3, 255  # As often ways to a place are looked for; in place of that where the robot does not fit.
# Cells on all sides of one to which no way was found, to which none is looked for then either; where it is not certain
# that there is a way, twice as many after each landmark in a row, so that what can be reached gets its turn.
REFUSED = 2
# Cells between places that the robot sensed at since the last survey, at which it is told what was in sight; and how
# many of them there are at most.
APART, MOST_PLACES = 6.0, 60
ARRIVED = 2.0  # Cells from a landmark at which the robot has come to it.
# Share of a frontier that has to be in sight for it to count as seen, if there is a landmark that sees as much.
MOSTLY = 0.6
# Points of a cell: what is half hidden may well be seen from elsewhere.
QUARTERS = np.array([[0.25, 0.25], [0.25, 0.75], [0.75, 0.25], [0.75, 0.75]])

Cells = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns."""


@dataclass
class Memory:
    """What an exploration found out that the map does not tell; arrays have its shape (rows, columns)."""

    looked: NDArray[np.float32]  # Metres from which each cell was looked at and stayed unknown, infinite if never.
    # How often no way to a cell was found since something changed around it; NO_ROOM where the robot does not fit.
    refused: NDArray[np.uint8]
    # Where the robot gets to, as of the last survey; ``before``: as of when it was looked at what had changed.
    reach: Reach | None = None
    before: Reach | None = None
    sensed: int = 0  # Readings of the sensor up to the last survey.
    failed: int = 0  # Landmarks in a row to which no way was found.
    aim: tuple[FloatArray, Cells] | None = None  # The last landmark, x, y, and the unknown cells that it was to show.

    @classmethod
    def of(cls, known: KnownMap) -> Memory:
        """Return the memory with which an exploration begins."""
        return cls(np.full(known.state.shape, np.inf, np.float32), np.zeros(known.state.shape, np.uint8))

    def refuse(self, known: KnownMap, place: FloatArray, certainly: bool) -> None:
        """Note that no way to a place x, y was found; certainly: it is proven that there is none."""
        assert self.reach is not None  # noqa: S101 # places come of surveys
        row, column = (int(at[0]) for at in known.cells_of(place[None, :2]))
        refused = np.zeros(self.refused.shape, np.bool_)
        # What is so for one place of a room is so for all of it.
        refused[_around(row, column, REFUSED)] = True
        refused |= self.reach.in_rooms_of(refused)
        wider = _around(row, column, REFUSED * 2 ** min(self.failed, 10))
        refused[wider] |= self.reach.levels[wider] < CERTAIN
        refused &= self.refused < MOST_TRIES
        self.refused[refused] = MOST_TRIES if certainly else self.refused[refused] + 1
        self.failed += 1
        self.aim = None


class Survey(NamedTuple):
    """What is left to be seen."""

    outlook: Outlook  # What to choose from; without landmarks if nothing is left.
    expected: tuple[Cells, ...]  # For each landmark, the unknown cells at the frontiers that it is to show.
    any_heading: NDArray[np.bool_]  # Which landmarks may be come to with any heading, shape (n,).
    # Without landmarks, x, y, metres, from where something would be in sight, and where the robot itself, without a
    # margin, is not proven unable to get to. None is a proof that all has been seen: nothing is in sight from the
    # centre of any cell that it may get to, but through gaps of a cell or two (of SMALL edges), and what stayed unknown
    # although it was looked at.
    doubts: FloatArray | None


def survey(
    known: KnownMap,
    checker: StateChecker,
    pose: FloatArray,
    home: FloatArray | None,
    sensor_range: float,
    rng: np.random.Generator,
    memory: Memory,
    driven: FloatArray,
    sees_around: bool = True,
    looked_around: bool = True,
) -> Survey:
    """Return what is left to be seen, after the robot has sensed where it is.

    Args:
        known: the map; the checker's world follows it.
        checker: of the robot with the clearance that it keeps.
        pose: where it is, shape (3,).
        home: where the exploration has to end, shape (3,), or None.
        sensor_range: metres.
        rng: draws the places that are clustered.
        memory: of the exploration, written to.
        driven: where the sensor was read so far, as is known now, in the order of time, shape (n, 3).
        sees_around: whether the sensor sees all around.
        looked_around: whether it has looked into all directions here.
    """
    state, cell, robot = known.state, known.cell, checker.robot
    near = NEAR * sensor_range
    frontiers = frontiers_of(state, near / cell)
    places = driven[memory.sensed :, :2] if sees_around else np.empty((0, 2))
    memory.sensed = len(driven)
    _note_looks(memory, known, frontiers, _spaced(places, cell), pose[:2] if looked_around else None, sensor_range)
    looked = memory.looked[tuple(frontiers.unknown.T)]
    small = (frontiers.sizes <= SMALL)[frontiers.group]
    left = np.where(small, np.isinf(looked), looked > near)
    frontiers, looked, small = frontiers.subset(left), looked[left].astype(np.float64), small[left]
    farthest = np.minimum(np.where(small, near, sensor_range), NEAR * looked) / cell
    been = np.zeros(state.shape, np.bool_)
    been[known.cells_of(np.vstack([driven[:, :2], pose[None, :2]]))] = True
    memory.reach = reach = reach_of(known, been, robot)
    if memory.failed == 0:
        # Not between failures: noise changes the map with each reading, and other places are to get their turn.
        memory.refused[_changed(memory.before, reach, robot.circumradius / cell + 3.0)] = 0
        memory.before = reach
    here = (pose[:2] - np.asarray(known.origin)) / cell
    found = _Places(known, checker, reach, memory.refused, frontiers, farthest, here, rng).found(sensor_range / cell)
    doubts = None
    if not len(found.cells):
        # From here, and from where there is most room: what lies elsewhere may have been shut since.
        been &= reach.main_room()
        been[known.cells_of(pose[None, :2])] = True
        been |= reach.in_rooms_of(been)
        doubts = _doubts(known, been, robot.keeping(0.0), frontiers.subset(~small), farthest[~small])
    seen = np.asarray(found.far.any(axis=0))
    frontiers, far, close = frontiers.subset(seen), found.far[:, seen], found.near[:, seen]
    # An edge counts as seen from afar only where no landmark sees it from near.
    sees = close | (far & ~close.any(axis=0))
    n = len(found.cells)
    ends = np.asarray([pose, pose if home is None else home], dtype=np.float64)
    travel = Travel(reach.levels, (robot.reference_radius + robot.clearance) / cell)
    ways = cell * travel.between(np.concatenate([np.column_stack(known.cells_of(ends[:, :2])), found.cells]))
    outlook = Outlook(
        here=np.asarray(pose, dtype=np.float64),
        home=home,
        landmarks=np.column_stack([known.centres(*found.cells.T), np.nan_to_num(found.headings)]),
        costs=ways[0, 2:].copy(),
        between=ways[2:, 2:].copy(),
        home_costs=np.zeros(n) if home is None else ways[1, 2:].copy(),
        # Half a range behind each frontier, but no more than half of what is in range.
        areas=np.minimum(far.sum(axis=1) * cell * near, 0.5 * np.pi * sensor_range**2),
        frontiers=np.asarray(frontiers.sizes * cell, np.float64),
        sees=_groups_seen(sees, frontiers),
        sensor_range=sensor_range,
    )
    # A landmark all of whose edges others see from near is to show those that it sees from afar.
    shown = np.where(np.asarray(sees.any(axis=1))[:, None], sees, far)
    expected = tuple((frontiers.unknown[row, 0], frontiers.unknown[row, 1]) for row in shown)
    return Survey(outlook, expected, np.isnan(found.headings), doubts)


def _note_looks(
    memory: Memory,
    known: KnownMap,
    frontiers: Frontiers,
    places: FloatArray,
    here: FloatArray | None,
    sensor_range: float,
) -> None:
    """Note from how near unknown cells were in sight since the last survey: they were looked at, and stayed unknown.

    So were those that the last landmark was to show, if the robot has come there.
    """
    places = places if here is None else np.vstack([places, here])
    cells = np.unique(frontiers.unknown, axis=0)
    rows, columns = known.state.shape
    places = np.clip((places - np.asarray(known.origin)) / known.cell, 0.0, np.array([columns, rows]) - 1e-9)
    points = (cells[:, None, ::-1] + QUARTERS).reshape(-1, 2)
    farthest = np.full(len(points), sensor_range / known.cell)
    seen = sight(known.state, places, np.column_stack([points, np.zeros_like(points)]), farthest)
    whole = np.asarray(seen.reshape(len(places), len(cells), 4).all(axis=2))
    away = np.hypot(*(places[:, None] - (cells[:, ::-1] + 0.5)).transpose(2, 0, 1))
    nearest = np.where(whole, away, np.inf).min(axis=0, initial=np.inf)
    np.minimum.at(memory.looked, tuple(cells.T), (nearest * known.cell).astype(np.float32))
    if memory.aim is not None and here is not None:
        place, expected = memory.aim
        if np.hypot(*(place - here)) <= ARRIVED * known.cell:
            distance = np.hypot(*(known.centres(*expected) - here).T).astype(np.float32)
            # Cells that are in sight by the map alone would be aimed at for ever.
            memory.looked[expected] = np.minimum(memory.looked[expected], distance)
            memory.aim = None


def _spaced(points: FloatArray, cell: float) -> FloatArray:
    """Return some of the points along a way, about APART cells from one to the next, and no more than MOST_PLACES."""
    if len(points) == 0:
        return points
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    wanted = np.arange(0.0, along[-1], max(APART * cell, along[-1] / MOST_PLACES))
    return np.asarray(points[np.unique(np.searchsorted(along, wanted))])


def _changed(before: Reach | None, now: Reach, around: float) -> NDArray[np.bool_]:
    """Return the cells within a distance of which something changed, and all of the rooms that these are in."""
    if before is None:
        return np.zeros(now.levels.shape, np.bool_)
    changed = np.asarray(np.minimum(before.distance, around) != np.minimum(now.distance, around))
    return changed | now.in_rooms_of(changed)


def _around(row: int, column: int, cells: int) -> tuple[slice, slice]:
    """Return so many rows and columns to all sides of a cell."""
    return slice(max(row - cells, 0), row + cells + 1), slice(max(column - cells, 0), column + cells + 1)


def _groups_seen(sees: NDArray[np.bool_], frontiers: Frontiers) -> NDArray[np.bool_]:
    """Return which landmarks see most of which group, or as much of it as any landmark does, shape (n, groups)."""
    sizes = frontiers.sizes
    counts = np.array([np.bincount(frontiers.group[row], minlength=len(sizes)) for row in sees])
    counts = counts.reshape(len(sees), len(sizes))
    return np.asarray((counts > 0) & (counts >= np.minimum(MOSTLY * sizes, counts.max(axis=0, initial=0))))


def _middles(cells: NDArray[np.intp]) -> FloatArray:
    """Return the centres x, y of cells, shape (n, 2), rows and columns, in cells from the grid's corner."""
    return np.ascontiguousarray(cells[:, ::-1] + 0.5, dtype=np.float64)


def _cells_around(allowed: NDArray[np.bool_], edges: FloatArray, farthest: float) -> NDArray[np.intp]:
    """Return the allowed cells, rows and columns, in a box around edges that holds all from which they may be seen."""
    low = np.maximum(np.floor(edges[:, 1::-1].min(axis=0) - farthest).astype(np.intp), 0)
    high = np.ceil(edges[:, 1::-1].max(axis=0) + farthest).astype(np.intp) + 1
    return np.asarray(np.argwhere(allowed[low[0] : high[0], low[1] : high[1]]) + low)


def _doubts(
    known: KnownMap, been: NDArray[np.bool_], robot: Robot, frontiers: Frontiers, farthest: FloatArray
) -> FloatArray | None:
    """Return x, y of a place to which the robot perhaps gets, and sees an edge from there; None if there is none."""
    if not len(frontiers.edges):
        return None
    possible = perhaps_reached(known, been, robot)
    for g in range(len(frontiers.sizes)):
        edges, far = frontiers.edges[frontiers.group == g], farthest[frontiers.group == g]
        cells = _cells_around(possible, edges, float(far.max()))
        sees = sight(known.state, _middles(cells), edges, far).any(axis=1)
        if sees.any():
            return np.asarray(known.centres(*cells[sees][:1].T)[0])
    return None


class _Found(NamedTuple):
    """Places to look from."""

    cells: NDArray[np.intp]  # Rows and columns, shape (n, 2).
    headings: FloatArray  # With which the robot fits there, not a number for any, shape (n,).
    far: NDArray[np.bool_]  # Which place sees which edge, shape (n, m); ``near``: does so from near.
    near: NDArray[np.bool_]


class _Places(NamedTuple):
    """Where places to look from are sought."""

    known: KnownMap
    checker: StateChecker
    reach: Reach
    refused: NDArray[np.uint8]
    frontiers: Frontiers
    farthest: FloatArray  # From which each edge is looked at, in cells, shape (m,).
    here: FloatArray  # Where the robot is, x, y in cells, shape (2,).
    rng: np.random.Generator

    def found(self, sensor_range: float) -> _Found:
        """Return places from which all frontiers are seen that can be seen from where the robot can get to.

        First K-means centres of free places, as many as the sensor's range (in cells) asks for; then, for each group of
        frontiers that none of them sees from near, the middle one of places drawn of those that do. Where nothing at
        all is seen, every edge is asked, near or far, in the end for every place: without places nothing is left.
        """
        edges, every = self.frontiers.edges, len(self.frontiers.edges)
        cells = self._centres(sensor_range)
        headings, sees = np.full(len(cells), np.nan), self._sees(cells)
        few = self.frontiers.sizes <= FEW
        near = self.farthest * np.where(few[self.frontiers.group], 1.0, NEAR)
        stages = [(near, EDGES, SPARSE, 0), (self.farthest, every, SPARSE, 0)]
        stages += [(self.farthest, every, DENSE, refusals) for refusals in range(MOST_TRIES)]
        for farthest, most, spacing, refusals in stages if every else ():
            seen = np.asarray((sees & _is_within(cells, edges, farthest)).any(axis=0))
            more, more_headings = self._seeing(seen, farthest, most, spacing, refusals)
            cells, headings = np.concatenate([cells, more]), np.concatenate([headings, more_headings])
            sees = np.concatenate([sees, self._sees(more)])
            if sees.any():
                break
        useful = sees.any(axis=1)
        cells, sees = cells[useful], sees[useful]
        return _Found(cells, headings[useful], sees, sees & _is_within(cells, edges, near))

    def _centres(self, sensor_range: float) -> NDArray[np.intp]:
        """Return K-means centres of the places where the robot certainly gets to, rows and columns."""
        reached = np.flatnonzero((self.reach.levels == CERTAIN) & (self.refused == 0))
        if not len(reached):
            return np.empty((0, 2), np.intp)
        k = min(landmarks_for_area(float(len(reached)), sensor_range), MOST)
        rows, columns = np.divmod(
            self.rng.choice(reached, min(SAMPLES, len(reached)), replace=False), self.refused.shape[1]
        )
        samples = np.column_stack([columns, rows, np.zeros(len(rows))]).astype(np.float64)
        return k_means_landmarks(samples, k, radius=0.0, steps=STEPS, random_state=self.rng)[:, 1::-1].astype(np.intp)

    def _sees(self, cells: NDArray[np.intp]) -> NDArray[np.bool_]:
        return np.asarray(sight(self.known.state, _middles(cells), self.frontiers.edges, self.farthest))

    def _seeing(
        self, seen: NDArray[np.bool_], farthest: FloatArray, edges: int, spacing: float, refusals: int
    ) -> tuple[NDArray[np.intp], FloatArray]:
        """Return a place for each group of frontiers that no place sees from near enough, and headings there.

        It is found by rays, so many cells apart, from so many edges of a group; a way there may have been refused.
        """
        group, (_, columns), draws = self.frontiers.group, self.known.state.shape, DRAWS
        thorough = edges > EDGES
        left = np.flatnonzero(~np.isin(group, group[seen]))
        if not thorough:
            away = np.full(len(self.frontiers.sizes), np.inf)
            np.minimum.at(away, group[left], np.hypot(*(self.frontiers.edges[left, :2] - self.here).T))
            left = left[np.isin(group[left], np.argsort(away, kind="stable")[:GROUPS])]
        left = _some_of_each(left, group, edges)
        while True:
            ranks = np.where(self.refused <= refusals, self.reach.levels, np.uint8(NOWHERE))
            found = places_in_sight(self.known.state, ranks, self.frontiers.edges[left], farthest[left], draws, spacing)
            places = np.unique(found[found >= 0])
            headings = self._headings(places)
            fits = ~np.isinf(headings)
            self.refused.ravel()[places[~fits]] = NO_ROOM
            if fits.any() or fits.all() or not thorough:
                break
            draws = min(DRAWS * draws, MOST_DRAWS)
        chosen = _middle_places(found, np.isin(found, places[fits]), group[left], columns)
        return np.column_stack(np.divmod(chosen, columns)), headings[np.searchsorted(places, chosen)]

    def _headings(self, places: NDArray[np.int64]) -> FloatArray:
        """Return a heading with which the robot fits at each place: not a number for any, infinite for none."""
        headings = np.where(self.reach.levels.ravel()[places] == CERTAIN, np.nan, np.inf)
        xy = self.known.centres(*np.divmod(places, self.refused.shape[1]))
        for theta in wrap(np.arange(TURNS) * 2.0 * np.pi / TURNS):
            tight = np.flatnonzero(np.isinf(headings))
            valid = self.checker.valid(np.column_stack([xy[tight], np.full(len(tight), theta)]))
            headings[tight[valid]] = theta
        return headings


def _is_within(cells: NDArray[np.intp], edges: FloatArray, farthest: FloatArray) -> NDArray[np.bool_]:
    """Return which edges lie within the distance that each is looked at from, places by edges, shape (n, m)."""
    away = np.hypot(*(_middles(cells)[:, None] - edges[:, :2]).transpose(2, 0, 1))
    return np.asarray(away <= farthest)


def _some_of_each(chosen: NDArray[np.intp], group: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return of the chosen edges at most some of each group."""
    order = chosen[np.argsort(group[chosen], kind="stable")]
    sizes = np.bincount(group[order])
    rank = np.arange(len(order)) - (np.cumsum(sizes) - sizes)[group[order]]
    every = np.maximum(-(-sizes // most), 1)[group[order]]
    return np.asarray(order[rank % every == 0])


def _middle_places(
    found: NDArray[np.int64], good: NDArray[np.bool_], group: NDArray[np.intp], columns: int
) -> NDArray[np.int64]:
    """Return for each group, by edge, the good one of the places found that is nearest to their middle, shape (n,)."""
    chosen = list[int]()
    for g in np.unique(group):
        places = found[group == g][good[group == g]]
        if len(places):
            cells = np.column_stack(np.divmod(places, columns))
            chosen.append(int(places[np.square(cells - cells.mean(axis=0)).sum(axis=1).argmin()]))
    return np.unique(np.array(chosen, dtype=np.int64))
