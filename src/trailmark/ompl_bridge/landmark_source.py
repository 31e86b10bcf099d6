"""LandmarkSource: landmarks round by round, those given or those made for a query, as samplers request them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.arguments import one_of, whole
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.landmarks import Relaxation, free_samples, k_means_landmarks
from trailmark.landmarks.band import Band
from trailmark.ompl_bridge.errors import LandmarkError

__all__ = ["LandmarkSource"]

WIDENINGS = (0.02, 0.05, 0.12, 0.3, 0.7, 1.5)
"""How much longer than the relaxed shortest path the paths of a round's band may be; after that without limit."""

SAMPLES_PER_LANDMARK, LLOYD_STEPS = 5, 3
FIRST, GROWTH, MAX_LANDMARKS = 120, 1.4, 600
"""Landmarks of the first round, growth from round to round, and maximum: a callback must not take long."""

MAX_GUIDES = 240
"""Maximum of guides in a round: of more valid ones, the K-means centres are taken."""

STEPS_PER_GRID, MAX_REFINEMENTS = 2, 3
"""Bands after which the relaxed problem is solved on a grid twice as fine, with new guides; and how many times."""


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
        checker: as given.
        bounds: as given.
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
    def made(self) -> int:
        """How many rounds were made so far."""
        return len(self._rounds)

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
        wrong = np.flatnonzero(~self.checker.valid(q))
        if len(wrong):
            try:
                self.checker.require_valid(q[wrong[0]], f"landmark {wrong[0]}")
            except ConfigurationError as error:
                raise LandmarkError(str(error)) from None
        return q
