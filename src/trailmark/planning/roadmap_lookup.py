"""RoadmapLookup: what the planner's own roadmap knows of a query, within a share of what the other searches take."""

from __future__ import annotations

import numpy as np

from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray

__all__ = ["FIRST_BUDGET", "RoadmapLookup"]

FIRST_BUDGET = 128
"""Nodes expanded before all other searches, over edges known to be free: takes less time than the first lattice."""

SHARE = 0.5
"""Of what the other searches expanded: so much may be expanded beside them."""

REPEAT_FACTOR = 2.0
"""A search that its budget has ended begins again with a budget so many times as large."""

WEIGHT = 1.5
"""Of the lower bound in the search: a first path may cost so many times the roadmap's shortest."""

BUDGET_BEFORE_LANDMARKS = 1_000
"""Nodes and edges expanded before landmarks are placed."""

LAST_BUDGET, LAST_SHARE = 20_000, 0.05
"""Nodes and edges expanded at most for a better path, and the share of the time left that this may take."""

LAST_NEIGHBOURS = 64
"""Nodes near an end that are tried before the roadmap is said to know no path."""


class RoadmapLookup:
    """Searches a roadmap for a query's path, and adds nothing to it.

    Args:
        roadmap: of the queries before.
        start: valid, shape (3,).
        goal: valid, shape (3,).

    Attributes:
        expanded: motions, nodes and undecided edges so far.
        complete: whether all is known that can be: a path was found, or the roadmap has none.
    """

    def __init__(self, roadmap: Roadmap, start: FloatArray, goal: FloatArray) -> None:
        self.roadmap, self.start, self.goal = roadmap, start, goal
        self.expanded = self._last_budget = 0
        self.complete = len(roadmap) == 0

    def search_free_edges(self) -> FloatArray:
        """Return the states of a path over edges known to be free, shape (n, 3); (0, 3) if none was found soon."""
        if self.complete:
            return np.empty((0, 3))
        found = self.roadmap.find_path(self.start, self.goal, weight=WEIGHT, budget=FIRST_BUDGET, checking=False)
        self.expanded, self.complete = found.expanded, found.complete
        return found.states

    def search(self, budget: float) -> FloatArray:
        """Return the states of a path of certified motions, shape (n, 3); (0, 3) if none was found.

        Args:
            budget: nodes and edges expanded at most, all in all.
        """
        left = int(budget) - self.expanded
        if self.complete or left <= REPEAT_FACTOR * self._last_budget:
            return np.empty((0, 3))
        found = self.roadmap.find_path(self.start, self.goal, weight=WEIGHT, budget=left)
        self.expanded, self._last_budget, self.complete = self.expanded + found.expanded, left, found.complete
        return found.states

    def search_beside(self, expanded: int) -> FloatArray:
        """Return what :meth:`search` does, within its share of what the other searches expanded."""
        return self.search(SHARE * expanded)

    def search_before_landmarks(self) -> FloatArray:
        """Return what :meth:`search` does, before landmarks are placed."""
        return self.search(BUDGET_BEFORE_LANDMARKS)

    def search_for_better(self, limit: float, seconds_left: float) -> FloatArray:
        """Return the states of a path that costs ``limit`` (metres) at most, shape (n, 3); (0, 3) if none was found.

        It may take only a share of the time left.
        """
        if len(self.roadmap) == 0 or seconds_left <= 0.0:
            return np.empty((0, 3))
        found = self.roadmap.find_path(
            self.start,
            self.goal,
            limit=limit,
            budget=LAST_BUDGET,
            seconds=LAST_SHARE * seconds_left,
            neighbours=LAST_NEIGHBOURS,
        )
        self.expanded, self.complete = self.expanded + found.expanded, found.complete
        return found.states
