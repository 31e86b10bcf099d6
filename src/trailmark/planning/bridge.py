"""Bridge: landmarks where the parts of a roadmap that start and goal belong to come closest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.landmarks.band import Band
from trailmark.nearest import nearest_to
from trailmark.roadmap import Roadmap

__all__ = ["Bridge"]

MISSES, TRIES = 6, 40
"""Attempts in a row that bring the parts no closer before it is given up; configurations tried at each place."""

CLOSER = 0.95
"""Share of the smallest distance so far that counts as closer."""


class Bridge:
    """Grows the start's and the goal's parts of a roadmap towards each other.

    Args:
        roadmap: without a path yet.
        band: where short paths are likely.
        nodes: of start and goal.
        rng: source of randomness.
    """

    def __init__(self, roadmap: Roadmap, band: Band, nodes: NDArray[np.int64], rng: np.random.Generator) -> None:
        self.roadmap, self.band, self.rng = roadmap, band, rng
        self.start, self.goal = int(nodes[0]), int(nodes[1])
        self._misses, self._nearest = 0, np.full(3, np.inf)

    @property
    def promising(self) -> bool:
        """Whether the parts have come closer lately."""
        return self._misses < MISSES

    def landmarks(self) -> se2.FloatArray:
        """Return valid configurations, shape (n, 3), around the places where the parts might be joined."""
        q, band = self.roadmap.configurations, self.band
        ahead = q[self.roadmap.reached(self.start)]
        behind = q[self.roadmap.reached(self.goal, reverse=True)]
        near, far, gap = self._closest(ahead, behind)
        first, last = band.nearest_to_goal(ahead), band.nearest_to_start(behind)
        apart = np.array([gap, band.costs_to_goal(ahead[[first]])[0], band.costs_to_start(behind[[last]])[0]])
        self._misses = 0 if (apart < CLOSER * self._nearest).any() else self._misses + 1
        self._nearest = np.minimum(self._nearest, apart)
        # Where the two parts come closest, and where each comes closest to its end on the relaxed way: the first
        # tells of gaps in the headings, the others of gaps in the way.
        places = (ahead[near], behind[far], ahead[first], behind[last])
        reach = band.relaxation.size * 2.0 ** self.rng.uniform(0.0, 4.0)
        return np.concatenate([band.samples_near(place, reach, TRIES, self.rng) for place in places])

    def _closest(self, ahead: se2.FloatArray, behind: se2.FloatArray) -> tuple[int, int, float]:
        """Return the indices of the closest pair of two sets of configurations, and their distance (metres)."""
        one, other = (se2.embed(q, self.roadmap.motion.radius) for q in (ahead, behind))
        pairs = nearest_to(one, other)
        gaps = np.linalg.norm(one - other[pairs], axis=1)
        near = int(np.argmin(gaps))
        return near, int(pairs[near]), float(gaps[near])
