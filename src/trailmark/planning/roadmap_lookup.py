"""RoadmapLookup: what the kept roadmap knows of a query, within a share of what the other searches take."""

from __future__ import annotations

import numpy as np

from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray

__all__ = ["AT_ONCE", "RoadmapLookup"]

AT_ONCE = 128
"""Nodes looked at before all other searches, over edges known to be free: less time than a scout's first search."""

SHARE = 0.5
"""Of what the other searches took: so much may be looked at besides."""

WORTHWHILE = 2.0
"""A search that was cut short begins again with a budget so many times as large."""

HASTE = 1.5
"""How many times as long as the roadmap's shortest a first path may be."""

AT_LEISURE = 1_000
"""Nodes and edges looked at before landmarks are placed."""

LONGER = 1.3
"""Times the best path's cost that a path may cost before it is shortened."""

MAX_AGAIN, AGAIN_SHARE = 20_000, 0.05
"""Nodes and edges looked at for a better path at most, and the share of the time left that this may take."""

AT_LENGTH = 64
"""Nodes near an end that are tried before the roadmap is said to know no way."""


class RoadmapLookup:
    """Looks a query up in a roadmap, and adds nothing to it.

    Args:
        roadmap: of the queries before.
        start: valid, shape (3,).
        goal: valid, shape (3,).

    Attributes:
        taken: motions, nodes and undecided edges looked at so far.
        complete: whether all is known that can be: a path was found, or the roadmap has none.
    """

    def __init__(self, roadmap: Roadmap, start: FloatArray, goal: FloatArray) -> None:
        self.roadmap, self.start, self.goal = roadmap, start, goal
        self.taken = self._last = 0
        self.complete = len(roadmap) == 0

    def known_at_once(self) -> FloatArray:
        """Return the states of a path of certified motions, shape (n, 3); (0, 3) if none was found at little cost."""
        if self.complete:
            return np.empty((0, 3))
        found = self.roadmap.find_path(self.start, self.goal, weight=HASTE, budget=AT_ONCE, checking=False)
        self.taken, self.complete = found.expanded, found.complete
        return found.states

    def search(self, budget: float) -> FloatArray:
        """Return the states of a path of certified motions, shape (n, 3); (0, 3) if none was found.

        Args:
            budget: nodes and edges looked at at most, all in all.
        """
        left = int(budget) - self.taken
        if self.complete or left <= WORTHWHILE * self._last:
            return np.empty((0, 3))
        found = self.roadmap.find_path(self.start, self.goal, weight=HASTE, budget=left)
        self.taken, self._last, self.complete = self.taken + found.expanded, left, found.complete
        return found.states

    def search_beside(self, taken: int) -> FloatArray:
        """Return what :meth:`search` does, within its share of what the other searches took."""
        return self.search(SHARE * taken)

    def search_before_landmarks(self) -> FloatArray:
        """Return what :meth:`search` does, before landmarks are placed."""
        return self.search(AT_LEISURE)

    def search_for_better(self, cost: float, seconds_left: float) -> FloatArray:
        """Return a path about as good as one of a cost (metres), shape (n, 3); (0, 3) if none was found.

        It may be longer at first, since it is shortened; and it may take only a share of the time left.
        """
        if len(self.roadmap) == 0 or seconds_left <= 0.0:
            return np.empty((0, 3))
        found = self.roadmap.find_path(
            self.start,
            self.goal,
            limit=LONGER * cost,
            budget=MAX_AGAIN,
            seconds=AGAIN_SHARE * seconds_left,
            neighbours=AT_LENGTH,
        )
        self.taken, self.complete = self.taken + found.expanded, found.complete
        return found.states
