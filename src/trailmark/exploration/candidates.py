"""Landmarks to choose from: centres of the free space known so far, and of what sees the frontiers left over."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.exploration.frontiers import Frontiers
from trailmark.exploration.known_map import KnownMap
from trailmark.exploration.reachability import CERTAIN, NOWHERE
from trailmark.exploration.views import places_in_sight, sight
from trailmark.landmarks import k_means_landmarks
from trailmark.landmarks.executions import landmarks_for_area
from trailmark.se2 import FloatArray

__all__ = ["MOST_TRIES", "NO_ROOM", "Candidates", "Search", "middles_of"]

SAMPLES = 1000
"""Free places that are clustered."""

MOST = 40
"""Landmarks of the free space at most: a decision has to be quick."""

GROUPS = 60
"""Groups of frontiers that no landmark sees, the nearest ones, for which places are looked for while there are any."""

NEAR = 0.5
"""Share of the distance up to which an edge can be seen, from which it is looked at if possible. From farther away
little of what lies behind it is in range, and it has to be driven to again."""

FEW = 12
"""Edges of a frontier up to which every place that sees it counts as near: little lies behind it, and to come nearer
takes more of the way than that is worth."""

EDGES = 4
"""Of a group that no landmark sees: places are looked for that see one of them; of all, before the end is proven."""

SPARSE, DENSE = 4.0, 0.5
"""Cells between neighbouring rays where they end: of what is asked first, and so that no cell in sight is left out."""

NO_ROOM = 255
"""In place of the number of ways that were not found."""

TURNS = 32
"""Headings that are tried where the robot does not fit with any."""

DRAWS, MOST_DRAWS = 4, 64
"""Places drawn of those that see an edge; as many times more, up to so many, where the robot fits at none of them."""

MOST_TRIES = 3
"""Ways to a place are looked for as often, before it is left undecided whether there is one."""

STEPS = 5
"""Of Lloyd's algorithm."""


def middles_of(cells: NDArray[np.intp]) -> FloatArray:
    """Return the centres x, y of cells, shape (n, 2), rows and columns, in cells from the grid's corner."""
    return np.ascontiguousarray(cells[:, ::-1] + 0.5, dtype=np.float64)


class Candidates(NamedTuple):
    """Places to look from."""

    cells: NDArray[np.intp]
    """Rows and columns, shape (n, 2)."""
    headings: FloatArray
    """With which the robot fits there, shape (n,), radians; not a number where it fits with any."""
    sees: NDArray[np.bool_]
    """Which place sees which edge of the frontiers, shape (n, edges)."""
    near: NDArray[np.bool_]
    """Which place sees which edge from near (:data:`NEAR`, :data:`FEW`), shape (n, edges)."""


@dataclass(frozen=True)
class Search:
    """Where places to look from are sought."""

    known: KnownMap
    """The map."""
    checker: StateChecker
    """Of the planner's world, which follows the map."""
    levels: NDArray[np.uint8]
    """From NOWHERE to CERTAIN, shape (rows, columns)."""
    refused: NDArray[np.uint8]
    """How often no way to a cell was found, shape (rows, columns); NO_ROOM where the robot does not fit. Written to."""
    frontiers: Frontiers
    """What is to be seen."""
    farthest: FloatArray
    """From which each edge is looked at, in cells, shape (m,)."""
    here: FloatArray
    """Where the robot is, x, y in cells, shape (2,)."""

    def candidates(self, sensor_range: float, rng: np.random.Generator) -> Candidates:
        """Return places from which all frontiers are seen that can be seen from where the robot can get to.

        First K-means centres of free places, as many as the sensor's range asks for; then, for each group of frontiers
        that none of them sees from near, the K-means centre of places drawn of those that do. Where nothing at all is
        seen, every edge is asked, near or far, in the end for every place: without candidates there is nothing left to
        be seen.

        Args:
            sensor_range: in cells.
            rng: draws the places.
        """
        cells = self._centres(sensor_range, rng)
        headings, sees = np.full(len(cells), np.nan), self._sees(cells)
        every, nearer = len(self.frontiers.edges), replace(self, farthest=self._near())
        densely = ((self, every, DENSE, refusals) for refusals in range(MOST_TRIES))
        for search, edges, spacing, refusals in ((nearer, EDGES, SPARSE, 0), (self, every, SPARSE, 0), *densely):
            seen = sees & search._is_within(cells)
            more, more_headings = search._seeing(seen, edges, spacing, refusals, until_settled=search is self)
            cells, headings = np.concatenate([cells, more]), np.concatenate([headings, more_headings])
            sees = np.concatenate([sees, self._sees(more)])
            if sees.any():
                break
        useful = sees.any(axis=1)
        cells, sees = cells[useful], sees[useful]
        return Candidates(cells, headings[useful], sees, sees & nearer._is_within(cells))

    def shows_more(self, refusals: int) -> bool:
        """Return whether anything would be seen from a place to which as often no way was found, at most."""
        nothing = np.zeros((0, len(self.frontiers.edges)), np.bool_)
        return len(self._seeing(nothing, len(self.frontiers.edges), DENSE, refusals, until_settled=True)[0]) > 0

    def _centres(self, sensor_range: float, rng: np.random.Generator) -> NDArray[np.intp]:
        """Return K-means centres of the places where the robot certainly gets to, rows and columns."""
        columns = self.levels.shape[1]
        reached = np.flatnonzero((self.levels == CERTAIN) & (self.refused == 0))
        if not len(reached):
            return np.empty((0, 2), np.intp)
        k = min(landmarks_for_area(float(len(reached)), sensor_range), MOST)
        drawn = rng.choice(reached, min(SAMPLES, len(reached)), replace=False)
        samples = np.column_stack([drawn % columns, drawn // columns, np.zeros(len(drawn))]).astype(np.float64)
        return k_means_landmarks(samples, k, radius=0.0, steps=STEPS, random_state=rng)[:, 1::-1].astype(np.intp)

    def _sees(self, cells: NDArray[np.intp]) -> NDArray[np.bool_]:
        return sight(
            self.known.state, self.known.surface_boxes(), middles_of(cells), self.frontiers.edges, self.farthest
        )

    def _near(self) -> FloatArray:
        """Return up to how far from each edge a place is near it, in cells, shape (m,). See NEAR and FEW."""
        few = np.bincount(self.frontiers.group, minlength=self.frontiers.groups) <= FEW
        return self.farthest * np.where(few[self.frontiers.group], 1.0, NEAR)

    def _is_within(self, cells: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which edges lie within the distance that each is looked at from, places by edges, shape (n, edges)."""
        middles = self.frontiers.edges[:, :2]
        away = np.hypot(*(middles_of(cells)[:, None] - middles).transpose(2, 0, 1))
        return np.asarray(away <= self.farthest)

    def _seeing(
        self, sees: NDArray[np.bool_], edges: int, spacing: float, refusals: int, *, until_settled: bool
    ) -> tuple[NDArray[np.intp], FloatArray]:
        """Return a place for each group of frontiers that nothing sees yet, if one is found, and headings there.

        Args:
            sees: what is seen already, shape (n, edges).
            edges: of each group that places are sought for.
            spacing: of rays, in cells.
            refusals: as often no way may have been found to a place.
            until_settled: draw again until one of the places drawn is one where the robot fits, or none is left.
        """
        group, columns = self.frontiers.group, self.known.state.shape[1]
        left = np.flatnonzero(~np.isin(group, group[sees.any(axis=0)]))
        if not until_settled:
            left = left[self._among_nearest(left)]
        left = _some_of_each(left, group, edges)
        if spacing == DENSE:
            least, best = self._least_refused
            left = left[least[left] <= refusals]
            found = best[left, None]
        else:
            found = self._places_seeing(left, refusals, DRAWS, spacing)
        while True:
            places = np.unique(found[found >= 0])
            headings = self._headings(places)
            fits = ~np.isinf(headings)
            self.refused.ravel()[places[~fits]] = NO_ROOM
            if fits.any() or fits.all() or not until_settled:
                break
            found = self._places_seeing(left, refusals, min(DRAWS * found.shape[1], MOST_DRAWS), spacing)
        chosen = _middles(found, np.isin(found, places[fits]), group[left], columns)
        return np.column_stack(np.divmod(chosen, columns)), headings[np.searchsorted(places, chosen)]

    @cached_property
    def _least_refused(self) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
        """How often no way was found to a place that sees an edge, the least number of any, and the best such place.

        Both have shape (m,); NO_ROOM and -1 where no place sees it. Where all has been seen, most edges are seen from
        nowhere, and need not be asked again for each number.
        """
        # Fewer refusals come first, and among as many the places where the robot fits with more headings.
        classes = MOST_TRIES + 1 - np.minimum(self.refused, MOST_TRIES + 1)
        counts = (self.levels != NOWHERE) & (self.refused < NO_ROOM)
        ranks = np.where(counts, classes * (CERTAIN + 1) + self.levels, 0).astype(np.uint8)
        places = self._places_of(np.arange(len(self.frontiers.edges)), ranks, 1, DENSE)[:, 0]
        return np.where(places >= 0, self.refused.ravel()[places], np.uint8(NO_ROOM)), places

    def _places_seeing(self, edges: NDArray[np.intp], refusals: int, draws: int, spacing: float) -> NDArray[np.int64]:
        """Return places drawn of those that see each edge and to which a way was missed at most so often.

        See :meth:`_places_of`.
        """
        reached = np.where(self.refused <= refusals, self.levels, NOWHERE).astype(np.uint8)
        return self._places_of(edges, reached, draws, spacing)

    def _places_of(
        self, edges: NDArray[np.intp], ranks: NDArray[np.uint8], draws: int, spacing: float
    ) -> NDArray[np.int64]:
        """Return places drawn of the best that see each edge, row * columns + column or -1, shape (n, draws).

        Args:
            edges: the edges.
            ranks: of all places, the higher the better, 0 for those that do not count, shape (rows, columns).
            draws: how many places.
            spacing: of rays, in cells.
        """
        boxes, chosen = self.known.surface_boxes(), self.frontiers.edges[edges]
        farthest = self.farthest[edges]
        return np.asarray(places_in_sight(self.known.state, boxes, ranks, chosen, farthest, draws, spacing))

    def _among_nearest(self, edges: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which of some edges are of the groups that have the nearest ones."""
        away = np.hypot(*(self.frontiers.edges[edges, :2] - self.here).T)
        nearest = np.full(self.frontiers.groups, np.inf)
        np.minimum.at(nearest, self.frontiers.group[edges], away)
        return np.asarray(np.isin(self.frontiers.group[edges], np.argsort(nearest, kind="stable")[:GROUPS]))

    def _headings(self, places: NDArray[np.int64]) -> FloatArray:
        """Return a heading with which the robot fits at each place: not a number for any, infinite for none."""
        headings = np.where(self.levels.ravel()[places] == CERTAIN, np.nan, np.inf)
        xy = self.known.centres(*np.divmod(places, self.levels.shape[1]))
        for theta in se2.wrap(np.arange(TURNS) * 2.0 * np.pi / TURNS):
            tight = np.flatnonzero(np.isinf(headings))
            valid = self.checker.valid(np.column_stack([xy[tight], np.full(len(tight), theta)]))
            headings[tight[valid]] = theta
        return headings


def _some_of_each(chosen: NDArray[np.intp], group: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return of the chosen edges at most some of each group."""
    order = chosen[np.argsort(group[chosen], kind="stable")]
    sizes = np.bincount(group[order])
    rank = np.arange(len(order)) - (np.cumsum(sizes) - sizes)[group[order]]
    every = np.maximum(-(-sizes // most), 1)[group[order]]
    return np.asarray(order[rank % every == 0])


def _middles(
    found: NDArray[np.int64], good: NDArray[np.bool_], group: NDArray[np.intp], columns: int
) -> NDArray[np.int64]:
    """Return for each group the good place that is nearest to the K-means centre of its good places, shape (n,).

    Args:
        found: row * columns + column of places, shape (edges, draws).
        good: which of them count, shape (edges, draws).
        group: of each edge.
        columns: of the grid.
    """
    chosen = list[int]()
    for g in np.unique(group):
        places = found[group == g][good[group == g]]
        if len(places):
            cells = np.column_stack(np.divmod(places, columns))
            chosen.append(int(places[np.square(cells - cells.mean(axis=0)).sum(axis=1).argmin()]))
    return np.unique(np.array(chosen, dtype=np.int64))
