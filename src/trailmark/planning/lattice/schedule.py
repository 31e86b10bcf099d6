"""LatticeSchedule: first paths over finer and finer lattices, and paths in other homotopy classes."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple

import numpy as np

from trailmark.motion import Motion
from trailmark.planning.lattice.cost_to_go import TIGHTNESS, CostToGo, corridor
from trailmark.planning.lattice.search import Lattice
from trailmark.planning.shortening import EFFORT, without_needless
from trailmark.se2 import FloatArray

__all__ = ["AT_FIRST", "AT_MOST", "AT_SECOND", "LatticeSchedule"]

WEIGHT = 2.0
"""Of the cost to go: paths are sought that are soon found, and shortened afterwards."""

PATIENCE = 24
"""Nodes after which the straight distance, that came no nearer to the goal, is no guide here."""

GUIDING = 2.5e-7
"""Seconds for each cell of the costs to go, rather too many."""


class Level(NamedTuple):
    """One search: how fine its lattice is and how much it may cost.

    Attributes:
        cells: of the cost-to-go grid that guides it; 0 for the straight distance, which needs none.
        fineness: size of the relaxed problem's cells in units of the distance between neighbouring positions.
        headings: how many.
        nodes: maximum number expanded.
        group: the mechanism (:mod:`trailmark.planning.settings`) that it belongs to.
    """

    cells: int
    fineness: float
    headings: int
    nodes: int


LEVELS = (
    Level(0, 0.35, 8, 64),
    Level(1 << 14, 0.7, 8, 800),
    Level(1 << 16, 1.0, 8, 1_000),
    Level(1 << 16, 0.5, 8, 10_000),
    Level(1 << 16, 1.0, 16, 20_000),
    Level(1 << 16, 2.0, 32, 100_000),
    Level(1 << 16, 4.0, 64, 1_000_000),
)
"""Searched in turn: small searches first, since which lattice leads through soon is a matter of luck."""

LARGE = 10_000
"""Nodes from which on a search counts as large: it is left out where one from the other end has run dry."""


class View(NamedTuple):
    """One search for a path in another homotopy class.

    Attributes:
        tightness: how many times dearer tight cells are.
        weight: of the cost to go.
        headings: how many.
        nodes: maximum number expanded.
    """

    tightness: float
    weight: float
    headings: int
    nodes: int


VIEWS = (
    View(1.0, 1.2, 32, 50_000),
    View(0.0, 1.2, 16, 50_000),
    View(1.0, 1.0, 16, 100_000),
)
"""Searched in turn, from one end and the other."""

STRETCH = (0.75, 1.25)
"""Factor on the lattice's size from the second turn on: which gaps a lattice hits is a matter of luck."""

CORRIDOR, MARCHING = 0.03, 10.0
"""How much dearer than the cheapest a way in its corridor may be, and times as long fast marching takes as a flood."""

DETOUR = 1.15
"""Times the limit: over a lattice of eight directions a path is so much longer than its shortened self at most."""

AT_FIRST, AT_SECOND, AT_MOST = 3, 4, 5
"""Levels searched before all else; for distant ends, also before and after infeasibility is tried to be proven."""


class LatticeSchedule:
    """Searches for a first path, level by level.

    Args:
        motion: of the robot: straight motions or translations.
        ends: start and goal, valid configurations, shape (2, 3).
        cell: metres between neighbouring positions of the coarsest lattice.
        seconds_left: asked before each search.
        without: mechanisms that are switched off.
        window: xmin, ymin, xmax, ymax (metres) that searches guided by costs to go do not leave; by default the bounds.

    Attributes:
        expanded: number of nodes expanded so far.
        shut_in: whether a large search has run dry, which few do where there is a path.
        guides: costs to go made so far: by their cells, whether they lead to the goal, and their tightness. Those from
            the start may be shared with another that has the same.
    """

    def __init__(
        self,
        motion: Motion,
        ends: FloatArray,
        cell: float,
        seconds_left: Callable[[], float],
        without: Collection[str] = (),
        window: tuple[float, float, float, float] | None = None,
    ) -> None:
        self.motion, self.checker, self.ends, self.without = motion, motion.checker, ends, without
        # Without headings to tell apart, closer positions cost little.
        self.cell = cell if motion.turns else 0.5 * cell
        self.seconds_left = seconds_left
        # Who drives ahead alone does not come the way back.
        self._both_ways = motion.moves_anywhere or not motion.directed
        self.window = self.checker.world.bounds if window is None else window
        xmin, ymin, xmax, ymax = self.window
        self.cells = max(1, round((xmax - xmin) * (ymax - ymin) / self.cell**2))
        self.guides: dict[tuple[int, bool, float], CostToGo] = {}
        self.level = self.views = self.expanded = 0
        self.shut_in = False
        self._exhausted: set[tuple[float, int, bool, bool]] = set()
        # Whether to search from the start first: not if the last search that ran dry was from the goal.
        self._from_start = True

    @property
    def exhausted(self) -> bool:
        """Whether all levels have been searched."""
        return self.level >= len(LEVELS)

    def first_path(self, levels: int = 1) -> FloatArray:
        """Return a path of certified motions, shape (n, 3), sought on the next levels; (0, 3) if none was found."""
        for level in LEVELS[self.level : self.level + levels]:
            self.level += 1
            for forward in self._directions(level):
                path = self._search(level, forward)
                if len(path):
                    return path
                if level.nodes >= LARGE and self._key(level, forward) in self._exhausted:
                    # A large search from the other end would most likely find no more than this one.
                    self.shut_in = True
                    break
        return np.empty((0, 3))

    def other_path(self, rng: np.random.Generator, limit: float) -> FloatArray:
        """Return a path of certified motions, shape (n, 3), maybe of another homotopy class; (0, 3) if none was found.

        Args:
            rng: source of randomness.
            limit: metres, cost of a path that it should better.
        """
        if self.views == 0 and self.motion.weighted:
            self.views += 1
            return self._cheapest(self.motion)
        view, forward = VIEWS[self.views % len(VIEWS)], self.views // len(VIEWS) % 2 == 0 or not self._both_ways
        self.views += 1
        if not self._has_time(LEVELS[-1].cells, forward, view.tightness):
            return np.empty((0, 3))
        size = self.cell * (1.0 if self.views <= 2 * len(VIEWS) else rng.uniform(*STRETCH))
        lattice = Lattice(self.checker, size, view.headings if self.motion.turns else 1, self.motion)
        begin, end = self.ends if forward else self.ends[::-1]
        to_go = self.to_go(LEVELS[-1].cells, forward, view.tightness)
        path, expanded = lattice.find_path(
            begin,
            end,
            to_go,
            weight=view.weight,
            budget=view.nodes,
            limit=DETOUR * limit,
            retracts="node-retraction" not in self.without,
            seconds=self.seconds_left(),
        )
        self.expanded += expanded
        return self._shortened(path, forward)

    def _cheapest(self, motion: Motion) -> FloatArray:
        """Return a path in the homotopy class that is cheapest by far finer directions than a lattice's."""
        if self.seconds_left() < 2.0 * MARCHING * GUIDING * min(LEVELS[-1].cells, self.cells):
            return np.empty((0, 3))
        to_go = corridor(self.checker, motion.density, self.ends, min(LEVELS[-1].cells, self.cells), CORRIDOR)
        lattice = Lattice(self.checker, self.cell, VIEWS[0].headings if motion.turns else 1, motion)
        path, expanded = lattice.find_path(
            self.ends[0],
            self.ends[1],
            to_go,
            weight=VIEWS[0].weight,
            budget=VIEWS[0].nodes,
            retracts=True,
            seconds=self.seconds_left(),
        )
        self.expanded += expanded
        return self._shortened(path, forward=True)

    def _directions(self, level: Level) -> tuple[bool, ...]:
        """Return from which ends to search, True being the start: who is shut in is found out soonest from inside."""
        if not (level.cells and self._both_ways):
            return (True,)
        return (self._from_start, not self._from_start)

    def _key(self, level: Level, forward: bool) -> tuple[float, int, bool, bool]:
        """Return what tells searches of one lattice from one end from others."""
        return level.fineness, level.headings if self.motion.turns else 1, level.cells > 0, forward

    def _search(self, level: Level, forward: bool) -> FloatArray:
        kind = self._key(level, forward)
        if kind in self._exhausted or not self._has_time(level.cells, forward, TIGHTNESS):
            return np.empty((0, 3))
        lattice = Lattice(self.checker, self.cell / level.fineness, kind[1], self.motion)
        begin, end = self.ends if forward else self.ends[::-1]
        to_go = self.to_go(level.cells, forward)
        seconds = self.seconds_left()
        path, expanded = lattice.find_path(
            begin,
            end,
            to_go,
            weight=WEIGHT,
            budget=level.nodes,
            patience=None if level.cells else PATIENCE,
            multi_steps="multi-steps" not in self.without,
            retracts=level.cells > 0 and "node-retraction" not in self.without,
            seconds=seconds,
        )
        self.expanded += expanded
        if len(path) == 0:
            # A search that was given up for want of progress tells nothing.
            if level.cells and expanded < level.nodes and self.seconds_left() > 0.0:
                self._exhausted.add(kind)
                self._from_start = forward
            return path
        return self._shortened(path, forward)

    def _has_time(self, cells: int, forward: bool, tightness: float) -> bool:
        """Return whether there is time for the costs to go, and some of it left for a search."""
        known = (cells, forward, tightness) in self.guides
        return self.seconds_left() > (0.0 if known else GUIDING * min(cells, self.cells))

    def _shortened(self, path: FloatArray, forward: bool) -> FloatArray:
        """Return the path from start to goal without needless vertices; (0, 3) if there is none."""
        if len(path) == 0:
            return path
        path = path if forward else np.ascontiguousarray(path[::-1])
        path = np.asarray(without_needless(self.motion.kind, path, EFFORT))
        # Once more, as the path is: the reverse of exactly half a turn is another motion, and the lattice's own idea
        # of the start is a rounding away from it.
        return path if self.motion.motions_between_valid(path[:-1], path[1:]).all() else np.empty((0, 3))

    def to_go(self, cells: int, forward: bool, tightness: float = TIGHTNESS) -> CostToGo:
        """Return the costs to go on a grid of so many cells, 0 for the straight distance, from one end or the other."""
        if cells == 0:
            return CostToGo.straight()
        key = (cells, forward, tightness)
        if key in self.guides:
            return self.guides[key]
        count = min(cells, self.cells)
        density = self.motion.density if self.motion.weighted else None
        to_go = CostToGo.of(self.checker, self.ends[int(forward)], count, tightness, self.window, density)
        self.guides[key] = to_go
        return to_go
