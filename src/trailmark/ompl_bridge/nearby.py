"""Nearby: configurations near a given one."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np

from trailmark import se2
from trailmark.ompl_bridge.landmark_source import LandmarkSource

__all__ = ["Nearby"]

LANDMARKS_NEAR = 0.25
"""Probability that a landmark is returned where there is one."""

POSITION, HEADING = 2.0 / 3.0, 1.0 / 3.0
"""What a metre of distance is to OMPL's own samplers: metres along x and along y each, and radians.

They share it out by the weights of the space's parts, 1 and 0.5.
"""


class Nearby:
    """Configurations near a given one: landmarks, or distributed as OMPL's own samplers do it.

    Args:
        source: landmarks and bounds.
        rng: source of randomness.
    """

    def __init__(self, source: LandmarkSource, rng: np.random.Generator) -> None:
        self._source, self._rng = source, rng
        self._rounds = 0
        self._all: se2.FloatArray = np.empty((0, 3))
        self._tree: Any = None

    def landmark(self, q: tuple[float, float, float], distance: float) -> tuple[float, float, float] | None:
        """Return a landmark within a distance of q, in OMPL's metric; None if there is none, or by chance."""
        chance = self._rng.random() / LANDMARKS_NEAR
        if chance >= 1.0:
            return None
        self._update()
        if self._tree is None:
            return None
        found = self._tree.query_ball_point(se2.embed(q, se2.ROTATION_WEIGHT), distance)
        if not found:
            return None
        row = self._all[found[int(chance * len(found))]]
        # The tree's distance is Euclidean and along chords, so it finds some that are too far.
        if se2.distance(q, row) > distance:
            return None
        x, y, theta = row.tolist()
        return x, y, theta

    def uniform(self, q: tuple[float, float, float], distance: float) -> tuple[float, float, float]:
        """Return one uniformly distributed in a box about q, cut at the bounds."""
        return self._shifted(q, self._rng.uniform(-1.0, 1.0, 3).tolist(), distance)

    def _shifted(self, q: tuple[float, float, float], step: list[float], by: float) -> tuple[float, float, float]:
        xmin, ymin, xmax, ymax = self._source.bounds
        x = min(max(q[0] + POSITION * by * step[0], xmin), xmax)
        y = min(max(q[1] + POSITION * by * step[1], ymin), ymax)
        theta = q[2] + HEADING * by * step[2]
        return x, y, theta if -pi < theta <= pi else se2.wrap(theta)

    def _update(self) -> None:
        """Add the landmarks that the source has made since the last call, at least the first round."""
        if self._source.made == 0:
            self._source.round(0)
        if self._source.made == self._rounds:
            return
        from scipy.spatial import cKDTree

        self._rounds, self._all = self._source.made, self._source.landmarks
        if len(self._all):
            self._tree = cKDTree(se2.embed(self._all, se2.ROTATION_WEIGHT))
