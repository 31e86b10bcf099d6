"""LandmarkStream: configurations to sample, landmarks first, then around and between them, then anywhere.

This module does not use OMPL. Configurations are drawn in batches, checked by compiled kernels and returned one by one.
"""

from __future__ import annotations

from functools import cache
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.landmarks.retraction import retract_all
from trailmark.motion import Kind
from trailmark.ompl_bridge.landmark_source import FIRST, LandmarkSource
from trailmark.planning.warmup import ROBOTS, SMALL, warm_up

__all__ = ["ORIGINS", "ROADMAP_MIXTURE", "LandmarkStream", "Mixture", "Seed", "warm_up_sampling"]

Seed = int | np.random.SeedSequence | None
"""The same one gives the same configurations; None draws one."""

ORIGINS = ("landmark", "around", "between", "uniform", "landmark near", "near")
"""Where a configuration comes from; the last two are drawn near a given one."""

LANDMARK, AROUND, BETWEEN, UNIFORM, LANDMARK_NEAR, NEAR = range(len(ORIGINS))

LANDMARKS_NEAR = 0.25
"""Probability that a landmark is returned near a configuration where there is one."""

POSITION, HEADING = 2.0 / 3.0, 1.0 / 3.0
"""What a metre of distance is to OMPL's own samplers: metres along x and along y each, and radians.

They share it out by the weights of the space's parts, 1 and 0.5.
"""

BATCH = 128
"""Configurations drawn at a time."""

FOLLOWERS = 1
"""Configurations of the mixture for each landmark of a round, before the next round's landmarks are requested."""

NEIGHBOURS = 8
"""Nearest landmarks of each landmark to which its gaps are computed."""


class Mixture(NamedTuple):
    """Shares of what is drawn once a round's landmarks were returned; they are scaled to add up to 1.

    Attributes:
        around: landmarks moved at random at all scales up to the distance of their neighbours, tight ones more often.
        between: places between two neighbouring landmarks that no certified motion joins.
        uniform: over the whole space; above 0, so that every open set of configurations is hit in the end.
    """

    around: float
    between: float
    uniform: float

    def shares(self) -> se2.FloatArray:
        """Return the shares of (around, between, uniform), shape (3,), sum 1.

        Raises:
            ConfigurationError: a share that is negative or not finite, or ``uniform`` not above 0.
        """
        values = np.array([self.around, self.between, self.uniform], dtype=np.float64)
        if not (np.isfinite(values).all() and (values >= 0.0).all() and self.uniform > 0.0):
            raise ConfigurationError(f"mixture: expected finite shares of 0 or more, uniform above 0, got {self}")
        return np.asarray(values / values.sum())


ROADMAP_MIXTURE = Mixture(around=0.35, between=0.35, uniform=0.3)
"""What samplers of valid states draw by default."""


class LandmarkStream:
    """Configurations for one planner's run: each round's landmarks, then a mixture, then the next round's.

    Args:
        source: the landmarks.
        mixture: what is drawn between the rounds.
        seed: of the random choices.
        tally: counts what is returned, by origin as in :data:`ORIGINS`; several streams may share one.

    Attributes:
        source: as given.
        checker: the source's.

    Raises:
        ConfigurationError: a mixture with impossible shares.
    """

    def __init__(
        self,
        source: LandmarkSource,
        mixture: Mixture,
        seed: Seed = None,
        *,
        tally: list[int] | None = None,
    ) -> None:
        self.source = source
        self.checker: StateChecker = source.checker
        self._rng = np.random.default_rng(seed)
        self.tally = [0] * len(ORIGINS) if tally is None else tally
        self._shares = mixture.shares()
        self._round, self._follow = 0, 0
        self._landmarks: se2.FloatArray = np.empty((0, 3))
        self._around: _Around | None = None
        self._rows: list[tuple[float, float, float, int]] = []

    @property
    def landmarks(self) -> se2.FloatArray:
        """The landmarks of the rounds so far, shape (k, 3)."""
        return self._landmarks

    def take(self) -> tuple[float, float, float] | None:
        """Return the next configuration x, y, theta; None if a whole batch held no valid one."""
        if not self._rows:
            q, origins = self._next()
            # Popped from the end.
            self._rows = [(*row, origin) for row, origin in zip(q.tolist(), origins.tolist(), strict=True)][::-1]
            if not self._rows:
                return None
        x, y, theta, origin = self._rows.pop()
        self.tally[origin] += 1
        return x, y, theta

    def near(self, q: tuple[float, float, float], distance: float) -> tuple[float, float, float]:
        """Return a landmark within a distance of q, in OMPL's metric, or else one about q, valid or not.

        The latter is drawn within the bounds as OMPL's own samplers do it.
        """
        if self._rng.random() < LANDMARKS_NEAR and self.source.round(0) is not None:
            landmarks = self.source.landmarks
            close = landmarks[se2.distance(np.array(q), landmarks) <= distance]
            if len(close):
                self.tally[LANDMARK_NEAR] += 1
                x, y, theta = self._rng.choice(close).tolist()
                return x, y, theta
        self.tally[NEAR] += 1
        dx, dy, turn = (distance * self._rng.uniform(-1.0, 1.0, 3) * (POSITION, POSITION, HEADING)).tolist()
        xmin, ymin, xmax, ymax = self.source.bounds
        theta = q[2] + turn
        x, y = min(max(q[0] + dx, xmin), xmax), min(max(q[1] + dy, ymin), ymax)
        return x, y, theta if -pi < theta <= pi else se2.wrap(theta)

    def _next(self) -> tuple[se2.FloatArray, NDArray[np.int64]]:
        """Return the next batch (n, 3) and where each of it comes from (n,)."""
        if self._follow <= 0:
            fresh = self.source.round(self._round)
            self._follow = BATCH if fresh is None else max(BATCH, FOLLOWERS * len(fresh))
            if fresh is not None:
                self._round += 1
            if fresh is not None and len(fresh):
                self._landmarks = np.vstack([self._landmarks, fresh])
                self._around = None
                return fresh, np.full(len(fresh), LANDMARK)
        q, origins = self._mixed(BATCH)
        good = self.source.inside(q)
        good[good] = self.checker.valid(q[good])
        # Where hardly anything is valid, the next landmarks come sooner.
        self._follow -= max(BATCH // 8, int(good.sum()))
        return q[good], origins[good]

    def _mixed(self, n: int) -> tuple[se2.FloatArray, NDArray[np.int64]]:
        """Return n configurations of the mixture in random order, valid or not, and their origins."""
        count = self._rng.multinomial(n, self._shares if len(self._landmarks) else (0.0, 0.0, 1.0))
        parts = [self.source.uniform(count[2], self._rng)]
        if len(self._landmarks):
            # Computed only now, so that a planner that needs no more than the landmarks does not wait for it.
            around = self._around = self._around or _Around(self.checker, self._landmarks)
            parts = [around.around(count[0], self._rng), around.between(count[1], self._rng), *parts]
        order = self._rng.permutation(n)
        return np.vstack(parts)[order], np.repeat([AROUND, BETWEEN, UNIFORM], count)[order]


@cache
def warm_up_sampling(kind: Kind) -> None:
    """Draw from a small world once: kernels and libraries are loaded now, not in the time of a planner that draws.

    Args:
        kind: of the robot's motions.
    """
    warm_up(kind)
    world, query = SMALL
    source = LandmarkSource(StateChecker(world, ROBOTS[kind]), query=query, seed=0)
    stream = LandmarkStream(source, ROADMAP_MIXTURE, 0)
    for _ in range(FIRST + BATCH):  # landmarks, and one batch of the mixture at least
        stream.take()


class _Around:
    """Configurations around and between landmarks.

    Args:
        checker: decides which neighbours no certified motion joins.
        landmarks: valid configurations, shape (k, 3), k >= 1.
    """

    def __init__(self, checker: StateChecker, landmarks: se2.FloatArray) -> None:
        self.checker = checker
        self.landmarks = landmarks
        self._turning = checker.footprint.sweep_radius
        first, second, length = self._neighbours()
        total = np.bincount(first, length, len(landmarks))
        self._spacing = total / np.maximum(1, np.bincount(first, minlength=len(landmarks)))
        if len(landmarks) == 1:
            self._spacing[:] = checker.footprint.circumradius
        # A tighter place needs more configurations.
        size = checker.footprint.circumradius
        room = np.asarray(checker.clearance(landmarks, cap=2.0 * size))
        self._weight = np.cumsum(1.0 / (room + 0.25 * size))
        once = first < second
        first, second, length = first[once], second[once], length[once]
        gap = ~checker.motions_between_valid(landmarks[first], landmarks[second])
        if gap.any():
            first, second, length = first[gap], second[gap], length[gap]
        self._first, self._second, self._length = first, second, length
        # Mostly short gaps: landmarks far apart are usually on two sides of an obstacle.
        self._gap_weight = np.cumsum(1.0 / np.maximum(length, 1e-9))

    def around(self, n: int, rng: np.random.Generator) -> se2.FloatArray:
        """Return n configurations around landmarks, valid or not, shape (n, 3)."""
        if n == 0:
            return np.empty((0, 3))
        picked = np.searchsorted(self._weight, rng.random(n) * self._weight[-1], side="right")
        return self._moved(self.landmarks[picked], self._spacing[picked], rng)

    def between(self, n: int, rng: np.random.Generator) -> se2.FloatArray:
        """Return n configurations between neighbouring landmarks, valid or not, shape (n, 3)."""
        if n == 0:
            return np.empty((0, 3))
        if len(self._first) == 0:
            return self.around(n, rng)
        picked = np.searchsorted(self._gap_weight, rng.random(n) * self._gap_weight[-1], side="right")
        a, b = self.landmarks[self._first[picked]], self.landmarks[self._second[picked]]
        return self._moved(se2.interpolate(a, b, rng.random(n)), 0.5 * self._length[picked], rng)

    def _moved(self, q: se2.FloatArray, reach: se2.FloatArray, rng: np.random.Generator) -> se2.FloatArray:
        """Return configurations moved by 1/32 to 1 times ``reach`` (n,); every other one is retracted to free space."""
        scale = reach[:, None] * 2.0 ** -rng.uniform(0.0, 5.0, (len(q), 1))
        step = rng.standard_normal((len(q), 3)) * scale / (1.0, 1.0, self._turning or 1.0)
        moved = q + step
        moved[:, 2] = se2.wrap(moved[:, 2])
        moved[::2] = retract_all(self.checker, moved[::2], 0.75 * self.checker.robot.inscribed_disc.radius)
        return np.asarray(moved)

    def _neighbours(self) -> tuple[NDArray[np.int64], NDArray[np.int64], se2.FloatArray]:
        """Return each landmark's nearest others: first, second and their distance (metres), shape (m,) each."""
        from scipy.spatial import cKDTree

        points = se2.embed(self.landmarks, self._turning)
        count = min(NEIGHBOURS + 1, len(points))
        if count < 2:
            empty = np.empty(0, dtype=np.int64)
            return empty, empty, np.empty(0)
        length, second = (np.asarray(found)[:, 1:] for found in cKDTree(points).query(points, count))
        first = np.repeat(np.arange(len(points)), count - 1)
        return first, second.ravel(), length.ravel()
