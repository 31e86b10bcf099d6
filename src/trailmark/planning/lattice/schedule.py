"""LatticeSchedule: first paths over finer and finer lattices, and paths in other homotopy classes."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any, NamedTuple

import numpy as np

from trailmark.motion import Motion, WeightedMotion
from trailmark.planning.lattice.cost_to_go import TIGHTNESS, CostToGo
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
    """One search for a first path: how fine its lattice is and how much it may cost."""

    cells: int  # of the cost-to-go grid that guides it; 0 for the straight distance, which needs none
    fineness: float  # size of the relaxed problem's cells in units of the distance between neighbouring positions
    headings: int
    nodes: int  # expanded at most


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
    """One search for a path in another homotopy class."""

    tightness: float  # how many times dearer tight cells are
    weight: float  # of the cost to go
    headings: int
    nodes: int  # expanded at most


VIEWS = (
    View(1.0, 1.2, 32, 50_000),
    View(0.0, 1.2, 16, 50_000),
    View(1.0, 1.0, 16, 100_000),
)
"""Searched in turn, from one end and the other."""

STRETCH = (0.75, 1.25)
"""Factor on the lattice's size from the second turn on: which gaps a lattice hits is a matter of luck."""

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
        search_exhausted: whether a large search has run dry, which few do where there is a path.
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
        self.search_exhausted = False
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
            # Who is shut in is found out soonest from inside.
            both = level.cells > 0 and self._both_ways
            for forward in (self._from_start, not self._from_start) if both else (True,):
                path = self._search(level, forward)
                if len(path):
                    return path
                if level.nodes >= LARGE and self._key(level, forward) in self._exhausted:
                    # A large search from the other end would most likely find no more than this one.
                    self.search_exhausted = True
                    break
        return np.empty((0, 3))

    def other_path(self, rng: np.random.Generator, limit: float) -> FloatArray:
        """Return a path of certified motions, shape (n, 3), maybe of another homotopy class; (0, 3) if none was found.

        Args:
            rng: source of randomness.
            limit: metres, cost of a path that it should better.
        """
        turn = self.views
        self.views += 1
        view, forward = VIEWS[turn % len(VIEWS)], turn // len(VIEWS) % 2 == 0 or not self._both_ways
        if not self._has_time(LEVELS[-1].cells, forward, view.tightness):
            return np.empty((0, 3))
        size = self.cell * (1.0 if turn < 2 * len(VIEWS) else rng.uniform(*STRETCH))
        to_go, most = self.to_go(LEVELS[-1].cells, forward, view.tightness), DETOUR * limit
        return self._find(to_go, forward, size, view.headings, weight=view.weight, budget=view.nodes, limit=most)[0]

    def _search(self, level: Level, forward: bool) -> FloatArray:
        key = self._key(level, forward)
        if key in self._exhausted or not self._has_time(level.cells, forward, TIGHTNESS):
            return np.empty((0, 3))
        to_go, multi_steps = self.to_go(level.cells, forward), "multi-steps" not in self.without
        options = {"weight": WEIGHT, "budget": level.nodes, "multi_steps": multi_steps}
        if level.cells == 0:
            # It is to be soon done, or given up.
            options |= {"patience": PATIENCE, "retracts": False}
        path, found, expanded = self._find(to_go, forward, self.cell / level.fineness, level.headings, **options)
        # A search that was given up for want of progress tells nothing.
        if not found and level.cells and expanded < level.nodes and self.seconds_left() > 0.0:
            self._exhausted.add(key)
            self._from_start = forward
        return path

    def _find(
        self, to_go: CostToGo, forward: bool, size: float, headings: int, **options: Any
    ) -> tuple[FloatArray, bool, int]:
        """Return a path from start to goal without needless vertices, (0, 3) if there is none.

        With it: whether one was found at all, and how many nodes were expanded.
        """
        lattice = Lattice(self.checker, size, headings if self.motion.turns else 1, self.motion)
        begin, end = self.ends if forward else self.ends[::-1]
        options = {"retracts": "node-retraction" not in self.without, "seconds": self.seconds_left(), **options}
        path, expanded = lattice.find_path(begin, end, to_go, **options)
        self.expanded += expanded
        if len(path) == 0:
            return path, False, expanded
        path = path if forward else np.ascontiguousarray(path[::-1])
        path = np.asarray(without_needless(self.motion.kind, path, EFFORT))
        # Once more, as the path is: the reverse of exactly half a turn is another motion, and the lattice's own idea
        # of the start is a rounding away from it.
        free = self.motion.motions_between_valid(path[:-1], path[1:]).all()
        return path if free else np.empty((0, 3)), True, expanded

    def _key(self, level: Level, forward: bool) -> tuple[float, int, bool, bool]:
        """Return what tells searches of one lattice from one end from others."""
        return level.fineness, level.headings if self.motion.turns else 1, level.cells > 0, forward

    def _has_time(self, cells: int, forward: bool, tightness: float) -> bool:
        """Return whether there is time for the costs to go, and some of it left for a search."""
        known = (cells, forward, tightness) in self.guides
        return self.seconds_left() > (0.0 if known else GUIDING * min(cells, self.cells))

    def to_go(self, cells: int, forward: bool, tightness: float = TIGHTNESS) -> CostToGo:
        """Return the costs to go on a grid of so many cells, 0 for the straight distance, from one end or the other."""
        if cells == 0:
            return CostToGo.straight()
        key = (cells, forward, tightness)
        if key not in self.guides:
            density = self.motion.density if isinstance(self.motion, WeightedMotion) else None
            self.guides[key] = CostToGo.of(
                self.checker, self.ends[int(forward)], min(cells, self.cells), tightness, self.window, density
            )
        return self.guides[key]
