"""Landmarks round by round, those given or those made for a query, and the configurations that samplers draw from them.

This module does not use OMPL. Configurations are drawn in batches, checked by compiled kernels and returned one by one.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import cache
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from trailmark import se2
from trailmark.arguments import one_of, whole
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.landmarks import Relaxation, free_samples, k_means_landmarks
from trailmark.landmarks.band import Band
from trailmark.landmarks.retraction import retract_all
from trailmark.motion import Kind
from trailmark.ompl_bridge.errors import LandmarkError
from trailmark.planning.warmup import ROBOTS, SMALL, warm_up

__all__ = ["LandmarkSource", "LandmarkStream", "Seed", "warm_up_sampling"]

Seed = int | np.random.SeedSequence | None
"""The same one gives the same configurations; None draws one."""

WIDENINGS = (0.02, 0.05, 0.12, 0.3, 0.7, 1.5)
"""How much longer than the relaxed shortest path the paths of a round's band may be; after that without limit."""

SAMPLES_PER_LANDMARK, LLOYD_STEPS = 5, 3
FIRST, GROWTH, MAX_LANDMARKS = 120, 1.4, 600
"""Landmarks of the first round, growth from round to round, and maximum: a callback must not take long."""

MAX_GUIDES = 240
"""Maximum of guides in a round: of more valid ones, the K-means centres are taken."""

STEPS_PER_GRID, MAX_REFINEMENTS = 2, 3
"""Bands after which the relaxed problem is solved on a grid twice as fine, with new guides; and how many times."""

LANDMARKS_NEAR = 0.25
"""Probability that a landmark is returned near a configuration where there is one."""

SPREAD = (2.0 / 3.0, 2.0 / 3.0, 1.0 / 3.0)
"""What a metre of distance is to OMPL's own samplers: metres along x and along y, and radians.

They share it out by the weights of the space's parts, 1 and 0.5.
"""

BATCH, UNIFORM = 128, 0.3
"""Configurations drawn at a time, and the share of those over the whole space: no place is left out for ever."""

NEIGHBOURS = 8
"""Nearest landmarks whose mean distance tells how far around a landmark configurations are drawn."""


class LandmarkSource:
    """Landmarks in rounds, each made when it is first requested, and stored.

    Made for a query, they are the K-means centres of samples in a band around the relaxed problem's shortest path
    (:class:`trailmark.landmarks.band.Band`), in wider and wider bands, and in between the guides along that path.
    Without a query they are the centres of samples over all free space.

    Args:
        checker: decides what is valid.
        landmarks: shape (k, 3): these and no others. None makes them.
        query: start and goal, shape (2, 3), to make landmarks for.
        bounds: xmin, ymin, xmax, ymax (metres) that samples keep to; the world's by default.
        seed: the same one makes the same landmarks; None draws one.

    Attributes:
        infeasible: whether the relaxed problem proved that no path joins the query's ends; there are no landmarks then.

    Raises:
        LandmarkError: landmarks of another shape, not finite, not valid or out of bounds.
        ConfigurationError: a negative seed.
    """

    def __init__(
        self,
        checker: StateChecker,
        landmarks: ArrayLike | None = None,
        *,
        query: ArrayLike | None = None,
        bounds: tuple[float, float, float, float] | None = None,
        seed: int | None = None,
    ) -> None:
        self.checker = one_of(checker, StateChecker, "checker:")
        self.bounds = checker.world.bounds if bounds is None else bounds
        self.infeasible = False
        self.seed = int(np.random.default_rng().integers(2**31)) if seed is None else whole(seed, "seed:", 0)
        self._rng = np.random.default_rng(self.seed)
        self._rounds: list[se2.FloatArray] = []
        self._more: Iterator[se2.FloatArray]
        if landmarks is not None:
            self._more = iter([self._require(landmarks)])
        elif query is not None:
            start, goal = se2.configurations(query, name="query")
            self._more = self._informed(start, goal)
        else:
            self._more = self._spread()

    @property
    def landmarks(self) -> se2.FloatArray:
        """The landmarks of all rounds made so far, shape (k, 3)."""
        return np.vstack([np.empty((0, 3)), *self._rounds])

    def round(self, i: int) -> se2.FloatArray | None:
        """Return the landmarks of round i, shape (k, 3), or None if there is no such round."""
        while len(self._rounds) <= i:
            fresh = next(self._more, None)
            if fresh is None:
                return None
            self._rounds.append(fresh[self.inside(fresh)])
        return self._rounds[i]

    def inside(self, q: se2.FloatArray) -> NDArray[np.bool_]:
        """Return which configurations (n, 3) lie in the bounds, shape (n,)."""
        low, high = self.bounds[:2], self.bounds[2:]
        return np.asarray(((q[:, :2] >= low) & (q[:, :2] <= high)).all(axis=1))

    def uniform(self, n: int, rng: np.random.Generator) -> se2.FloatArray:
        """Return n configurations over the bounds and all headings, valid or not, shape (n, 3)."""
        xmin, ymin, xmax, ymax = self.bounds
        return rng.uniform((xmin, ymin, -np.pi), (xmax, ymax, np.pi), (n, 3))

    def _informed(self, start: se2.FloatArray, goal: se2.FloatArray) -> Iterator[se2.FloatArray]:
        """Yield the landmarks of each round for a query: centres, which are quick to make, and guides, in turn."""
        band = Band(self.checker, Relaxation(self.checker), start, goal)
        count = float(FIRST)
        for step in itertools.count():
            if step and step % STEPS_PER_GRID == 0 and step // STEPS_PER_GRID <= MAX_REFINEMENTS:
                band.refine()
            if not np.isfinite(band.shortest):
                self.infeasible = True
                return
            widening = WIDENINGS[step] if step < len(WIDENINGS) else np.inf
            # A manoeuvre takes about as much room as the robot, however short the path.
            widening = max(widening, step * self.checker.footprint.circumradius / max(band.shortest, 1e-9))
            samples = band.samples(SAMPLES_PER_LANDMARK * int(count), widening, self._rng)
            yield self._with_headings(self._centres(samples, int(count)), band)
            count = min(GROWTH * count, MAX_LANDMARKS)
            if step % STEPS_PER_GRID:
                continue
            guides, whole = band.guides(self._rng)
            if step == 0 and not whole and band.relaxation.size > band.relaxation.radius and band.refine():
                # Cells larger than the disc may have led to where it does not fit.
                guides = band.guides(self._rng)[0] if np.isfinite(band.shortest) else guides[:0]
            yield self._with_headings(self._centres(guides, MAX_GUIDES), band)

    def _spread(self) -> Iterator[se2.FloatArray]:
        """Yield the landmarks of each round over all free space."""
        count = float(FIRST)
        while True:
            samples = free_samples(
                self.checker, SAMPLES_PER_LANDMARK * int(count), method="halton", random_state=self._rng
            )
            if len(samples) == 0:
                return
            yield self._centres(samples, int(count))
            count = min(GROWTH * count, MAX_LANDMARKS)

    def _centres(self, samples: se2.FloatArray, count: int) -> se2.FloatArray:
        if len(samples) == 0:
            return samples
        # Heading differences count as far as they move the robot.
        radius = self.checker.footprint.sweep_radius
        return k_means_landmarks(samples, count, radius=radius, steps=LLOYD_STEPS, random_state=self._rng)

    def _with_headings(self, q: se2.FloatArray, band: Band) -> se2.FloatArray:
        """Give a disc robot's landmarks, all at heading 0, headings that turn evenly from start to goal."""
        if self.checker.footprint.sweep_radius > 0.0 or len(q) == 0:
            return q
        gone, left = band.costs_to_start(q), band.costs_to_goal(q)
        q = q.copy()
        q[:, 2] = se2.interpolate(band.start, band.goal, gone / np.maximum(gone + left, 1e-9))[:, 2]
        return q

    def _require(self, landmarks: ArrayLike) -> se2.FloatArray:
        try:
            q = se2.configurations(landmarks, name="landmarks")
        except ConfigurationError as error:
            raise LandmarkError(str(error)) from None
        if q.ndim != 2:
            raise LandmarkError(f"landmarks: expected shape (k, 3) for x, y, theta, got {q.shape}")
        outside = np.flatnonzero(~self.inside(q))
        if len(outside):
            raise LandmarkError(
                f"landmark {outside[0]}: expected a place within {list(self.bounds)}, got {q[outside[0]].tolist()}"
            )
        for i in np.flatnonzero(~self.checker.valid(q))[:1]:
            try:
                self.checker.require_valid(q[i], f"landmark {i}")
            except ConfigurationError as error:
                raise LandmarkError(str(error)) from None
        return q


class LandmarkStream:
    """Configurations for one planner's run: a round's landmarks, as many around them and anywhere, then the next round.

    Args:
        source: the landmarks.
        seed: of the random choices.

    Attributes:
        source: as given.
        drawn: how many configurations were returned.
    """

    def __init__(self, source: LandmarkSource, seed: Seed = None) -> None:
        self.source, self.drawn = source, 0
        self._checker: StateChecker = source.checker
        self._rng = np.random.default_rng(seed)
        self._round, self._follow = 0, 0
        self._landmarks: se2.FloatArray = np.empty((0, 3))
        self._around: tuple[se2.FloatArray, se2.FloatArray] | None = None
        self._rows: list[tuple[float, float, float]] = []

    def take(self) -> tuple[float, float, float] | None:
        """Return the next configuration x, y, theta; None if a whole batch held no valid one."""
        if not self._rows:
            self._rows = [(x, y, theta) for x, y, theta in self._next()[::-1].tolist()]  # popped from the end
        self.drawn += bool(self._rows)
        return self._rows.pop() if self._rows else None

    def near(self, q: tuple[float, float, float], distance: float) -> tuple[float, float, float]:
        """Return a landmark within a distance of q, in OMPL's metric, or else one about q, valid or not.

        The latter is drawn within the bounds as OMPL's own samplers do it.
        """
        self.drawn += 1
        if self._rng.random() < LANDMARKS_NEAR and self.source.round(0) is not None:
            landmarks = self.source.landmarks
            close = landmarks[se2.distance(np.array(q), landmarks) <= distance]
            if len(close):
                x, y, theta = self._rng.choice(close).tolist()
                return x, y, theta
        dx, dy, turn = (distance * self._rng.uniform(-1.0, 1.0, 3) * SPREAD).tolist()
        xmin, ymin, xmax, ymax = self.source.bounds
        theta = q[2] + turn
        x, y = min(max(q[0] + dx, xmin), xmax), min(max(q[1] + dy, ymin), ymax)
        return x, y, theta if -pi < theta <= pi else se2.wrap(theta)

    def _next(self) -> se2.FloatArray:
        """Return the next batch, shape (n, 3)."""
        if self._follow <= 0:
            fresh = self.source.round(self._round)
            self._follow = BATCH if fresh is None else max(BATCH, len(fresh))
            self._round += fresh is not None
            if fresh is not None and len(fresh):
                self._landmarks, self._around = np.vstack([self._landmarks, fresh]), None
                return fresh
        count = self._rng.binomial(BATCH, UNIFORM) if len(self._landmarks) else BATCH
        q = self.source.uniform(count, self._rng)
        if count < BATCH:
            q = self._rng.permutation(np.vstack([q, self._near_landmarks(BATCH - count)]))
        q = q[self.source.inside(q)]
        q = q[np.asarray(self._checker.valid(q), dtype=np.bool_)]
        # Where hardly anything is valid, the next landmarks come sooner.
        self._follow -= max(BATCH // 8, len(q))
        return q

    def _near_landmarks(self, n: int) -> se2.FloatArray:
        """Return landmarks moved at random at all scales up to the distance of their neighbours, valid or not.

        Tight ones are drawn more often; every other one is retracted to free space.
        """
        footprint, turning = self._checker.footprint, self._checker.footprint.sweep_radius
        if self._around is None:  # only now: a planner that needs no more than the landmarks does not wait for it
            points, size = se2.embed(self._landmarks, turning), footprint.circumradius
            apart = np.asarray(cKDTree(points).query(points, min(NEIGHBOURS + 1, len(points)))[0])
            spacing = apart.reshape(len(points), -1)[:, 1:].mean(axis=1) if len(points) > 1 else np.array([size])
            room = np.asarray(self._checker.clearance(self._landmarks, cap=2.0 * size))
            self._around = spacing, np.cumsum(1.0 / (room + 0.25 * size))
        spacing, weight = self._around
        picked = np.searchsorted(weight, self._rng.random(n) * weight[-1], side="right")
        scale = spacing[picked, None] * 2.0 ** -self._rng.uniform(0.0, 5.0, (n, 1))
        moved = self._landmarks[picked] + self._rng.standard_normal((n, 3)) * scale / (1.0, 1.0, turning or 1.0)
        moved[:, 2] = se2.wrap(moved[:, 2])
        moved[::2] = retract_all(self._checker, moved[::2], 0.75 * self._checker.robot.inscribed_disc.radius)
        return np.asarray(moved)


@cache
def warm_up_sampling(kind: Kind) -> None:
    """Draw from a small world once: kernels and libraries are loaded now, not in the time of a planner that draws."""
    warm_up(kind)
    world, query = SMALL
    stream = LandmarkStream(LandmarkSource(StateChecker(world, ROBOTS[kind]), query=query, seed=0), 0)
    for _ in range(FIRST + BATCH):  # landmarks, and one batch of what follows at least
        stream.take()
