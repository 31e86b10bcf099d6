"""How many landmarks a sensor needs so that, wherever the robot is, one of them is likely to be within range."""

from __future__ import annotations

from math import acos, ceil, isfinite, pi, sqrt

import numpy as np

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.certify import motions_certified
from trailmark.collision.footprint import build_footprint
from trailmark.collision.kernels import FREE
from trailmark.errors import ConfigurationError
from trailmark.landmarks.kmeans import k_means_landmarks
from trailmark.landmarks.sampling import RandomState, free_samples, generator
from trailmark.world import Robot

__all__ = ["MAX_LANDMARKS", "distances_to_landmarks", "landmarks_for_area", "landmarks_for_range"]

MAX_LANDMARKS = 10_000
"""Maximum number of landmarks: clustering more takes minutes."""

MAX_PROBABILITY = 0.9999
"""A higher probability could only be measured with millions of places."""

SAMPLES, SAMPLES_PER_LANDMARK = 1000, 10
"""Samples that are clustered by default: n as published, or so many for each landmark if that is more."""

STEPS = 20
"""Steps of K-means in a trial. More would spread the landmarks a little better: the count may be slightly too large."""

TRIALS, FEW_TRIALS, MANY = 8, 3, 500
"""Clusterings, each with samples and places of its own, that a count is tried with; fewer from MANY landmarks on, where
the share varies less between clusterings than with the choice of places."""

PLACES = 8_000
"""Places at which the range is tested in all trials together; more where the probability is close to 1."""

SIGMA = 2.33
"""Standard errors by which the share must exceed the probability: one count in a hundred is too small by chance."""

GROWTH = 1.5
"""Largest factor between a count that was too small and the next."""

SPECK = 1e-6
"""Radius (metres) of the disc in place of a line of sight: closer obstacles hide what lies behind them."""

VISIBLE = 8
"""Nearest landmarks that are tried along a line of sight."""


def landmarks_for_area(area: float, sensor_range: float, probability: float = 0.95) -> int:
    """Return how many landmarks an open area takes at least, by a closed form; see :func:`landmarks_for_range`.

    K-means centres of k uniform samples are, for large k, the centres of nearly regular hexagons of a = A/k each,
    which tile the area. No other k places bring a larger share of a convex polygon of up to six sides within a given
    range. A hexagon with inradius ρ, a = 2√3·ρ², has within r of its centre the area

        a(r) = π·r²                                               for r <= ρ
        a(r) = π·r² − 6·(r²·arccos(ρ/r) − ρ·√(r² − ρ²))           for ρ <= r <= 2ρ/√3, where a(r) = a

    (six segments of the circle lie outside). Scaled to area 1, the share within range c is F(c), and c_p = F⁻¹(p)
    is how far a share p of the area lies from the nearest centre at most; lengths grow as √a. Hence

        c_p·√(A/k) <= r   ⇔   k >= A·(c_p/r)².

    c_p is 0.556 at p = 0.95 and 0.620 at p = 1. Independent uniform places, by comparison, take
    k = −ln(1 − p)·A/(π·r²), three times as many at p = 0.95.

    Source: hexagons are best, by the moment theorem of L. Fejes Tóth, "Lagerungen in der Ebene, auf der Kugel und im
    Raum" (1953), which holds for every falling function of the distance; K-means tends to them, Newman, "The hexagon
    theorem", IEEE Trans. Inf. Theory 28 (1982), and Gersho, "Asymptotically optimal block quantization", same 25
    (1979). Measured in open squares, K-means takes 1.5 to 1.8 times as many at p = 0.95: it ends in a local optimum.

    Args:
        area: free area, square metres, > 0.
        sensor_range: metres, > 0.
        probability: share of the area within range of a landmark, above 0 and below 1.

    Raises:
        ConfigurationError: an argument out of range.
    """
    _check(sensor_range, probability)
    if not (isfinite(area) and area > 0.0):
        raise ConfigurationError(f"area: expected a finite number of m² above 0, got {area}")
    # The quotient of lengths first: it may be too large for a float, its square even more so.
    lengths = sqrt(area) * _hexagon_quantile(probability) / sensor_range
    if lengths > 1e100:
        raise ConfigurationError(f"sensor range: expected a larger one for {area:g} m², got {sensor_range:g} m")
    return max(1, ceil(lengths**2))


def landmarks_for_range(
    checker: StateChecker,
    sensor_range: float,
    probability: float = 0.95,
    *,
    line_of_sight: bool = False,
    samples: int | None = None,
    radius: float = 0.0,
    reachable_from: se2.FloatArray | None = None,
    random_state: RandomState = None,
) -> int:
    """Return how many K-means landmarks bring a random free place within the sensor's range of one of them.

    The place is that of a random valid configuration, the landmarks are those of
    :func:`trailmark.landmarks.k_means_landmarks` for random valid samples: the probability is over both. For a
    disc robot it is the share of the free area within range, on average over the landmarks' randomness.

    The closed form of :func:`landmarks_for_area` says where to begin. It asks for too few landmarks where free
    space is narrow against the range (along a corridor of length L they grow as L/r, not as A/r²), where obstacles
    cut cells apart, where K-means settles in a local optimum or has few samples for each centre, and where
    headings count. So each count is tried as it will be used: samples are clustered, and the share of other random
    places within range is measured, in several independent clusterings. It is accepted if the mean exceeds
    ``probability`` by SIGMA standard errors, taken over the clusterings or from the binomial distribution, whichever
    is larger. Else it grows by the factor by which the distance that a share ``probability`` of the places keeps
    exceeds the range: that distance falls as k^(−1/2) in the open and as 1/k along corridors, so the count closes in
    from below in either case. A count that overshot nevertheless is bisected, to 5 %.

    Args:
        checker: decides what is valid; its world's obstacles hide what lies behind them.
        sensor_range: metres, > 0.
        probability: above 0, at most MAX_PROBABILITY.
        line_of_sight: a landmark counts only where the straight line to it meets no obstacle (of the eight
            nearest).
        samples: how many valid samples will be clustered, as in the caller's own use; by default 1,000, or ten for
            each landmark if that is more. With few samples for each landmark it takes more landmarks.
        radius: R of the embedding in which they will be clustered, metres; 0 clusters positions only.
        reachable_from: shape (3,): places that obstacles wholly enclose, seen from here, do not count.
        random_state: seed or generator; the same one gives the same count.

    Raises:
        ConfigurationError: an argument out of range, no free space, or a range so small that it takes more than
            MAX_LANDMARKS landmarks or more than there are samples.
    """
    _check(sensor_range, probability)
    if probability > MAX_PROBABILITY:
        raise ConfigurationError(f"probability: expected above 0 and at most {MAX_PROBABILITY}, got {probability}")
    if samples is not None and samples < 1:
        raise ConfigurationError(f"samples: expected 1 or more, got {samples}")
    trials = _Trials(
        checker,
        probability,
        line_of_sight=line_of_sight,
        samples=samples,
        radius=radius,
        reachable_from=reachable_from,
        random_state=random_state,
    )
    k, too_few = landmarks_for_area(trials.area(), sensor_range, probability), 0
    limit = MAX_LANDMARKS if samples is None else min(samples, MAX_LANDMARKS)
    while k <= limit:
        enough, excess = trials.run(k, sensor_range)
        if enough:
            return _least_between(trials, sensor_range, too_few, k)
        # At least a hundredth more: near the end, noise would have it go on one by one.
        too_few, k = k, max(k + 1, ceil(k * min(max(excess, 1.01), GROWTH)))
    what = "samples" if limit == samples else "landmarks, the limit,"
    raise ConfigurationError(
        f"sensor range: expected a larger one for world {checker.world.name!r}, where {limit} {what} do not bring a "
        f"place within range of one with probability {probability:g}, got {sensor_range:g} m"
    )


def _least_between(trials: _Trials, sensor_range: float, too_few: int, enough: int) -> int:
    """Return the least number of landmarks that is enough, to 5 %; ``too_few`` = 0 means that none was too small."""
    while too_few and enough > max(too_few + 1, 1.05 * too_few):
        middle = ceil(sqrt(too_few * enough))
        if trials.run(middle, sensor_range)[0]:
            enough = middle
        else:
            too_few = middle
    return enough


def distances_to_landmarks(
    checker: StateChecker, places: se2.FloatArray, landmarks: se2.FloatArray, *, line_of_sight: bool = False
) -> se2.FloatArray:
    """Return the distance (metres) from each place to the nearest landmark, shape (n,).

    Args:
        checker: its world's obstacles hide what lies behind them.
        places: configurations (n, 3) or positions (n, 2).
        landmarks: configurations (k, 3) or positions (k, 2), k >= 1.
        line_of_sight: to the nearest one that can be seen, of the eight nearest; infinite where there is none.

    Raises:
        ConfigurationError: no landmarks.
    """
    from scipy.spatial import cKDTree

    if len(landmarks) == 0:
        raise ConfigurationError("landmarks: expected 1 or more, got none")
    count = min(VISIBLE if line_of_sight else 1, len(landmarks))
    found = cKDTree(landmarks[:, :2]).query(places[:, :2], np.arange(1, count + 1))
    gaps, nearest = np.asarray(found[0], dtype=np.float64), np.asarray(found[1])
    if not line_of_sight:
        return gaps[:, 0]
    speck = build_footprint(Robot.disc(SPECK))
    distance = np.full(len(places), np.inf)
    for column in range(count):
        rest = np.flatnonzero(np.isinf(distance))
        ends = np.zeros((2, len(rest), 3))
        ends[0, :, :2], ends[1, :, :2] = places[rest, :2], landmarks[nearest[rest, column], :2]
        seen = motions_certified(checker.grid, checker.field, speck, ends[0], ends[1], True) == FREE
        distance[rest[seen]] = gaps[rest[seen], column]
    return distance


class _Trials:
    """Places to test and samples to cluster in one world, and what a number of landmarks brings there."""

    def __init__(
        self,
        checker: StateChecker,
        probability: float,
        *,
        line_of_sight: bool,
        samples: int | None,
        radius: float,
        reachable_from: se2.FloatArray | None,
        random_state: RandomState,
    ) -> None:
        self.checker, self.probability = checker, probability
        self.line_of_sight, self.samples, self.radius = line_of_sight, samples, radius
        self.reachable_from, self.rng = reachable_from, generator(random_state)
        self.places = self._draw(max(PLACES, ceil(20.0 / (1.0 - probability))))
        name = f"world {checker.world.name!r}"
        if len(self.places) == 0:
            raise ConfigurationError(f"{name}: no free place for the robot was found")
        # The share's error if the clusterings did not vary.
        self.least_error = sqrt(probability * (1.0 - probability) / len(self.places))
        if probability + SIGMA * self.least_error >= 1.0:
            raise ConfigurationError(
                f"{name}: expected more free places for a probability of {probability:g}, found {len(self.places)}"
            )

    def area(self) -> float:
        """Return an estimate of the free area, square metres."""
        xmin, ymin, xmax, ymax = self.checker.world.bounds
        found = len(self._draw(PLACES, max_draws=PLACES))
        return (xmax - xmin) * (ymax - ymin) * max(found, 1) / PLACES

    def run(self, k: int, sensor_range: float) -> tuple[bool, float]:
        """Return whether k landmarks are enough, and by which factor the distances that count exceed the range."""
        each = max(SAMPLES, SAMPLES_PER_LANDMARK * k) if self.samples is None else self.samples
        shares, distances = [], []
        trials = TRIALS if k < MANY else FEW_TRIALS
        samples = self._draw(trials * each)
        for i in range(trials):
            landmarks = k_means_landmarks(samples[i::trials], k, radius=self.radius, steps=STEPS, random_state=self.rng)
            found = distances_to_landmarks(
                self.checker, self.places[i::trials], landmarks, line_of_sight=self.line_of_sight
            )
            distances.append(found)
            shares.append(float((found <= sensor_range).mean()))
            if len(shares) == 1 and shares[0] < self.probability - 10.0 * self.least_error:
                break  # far off: the other trials would give the same answer
        error = self.least_error
        if len(shares) == trials:
            error = max(error, float(np.std(shares, ddof=1)) / sqrt(trials))
        wanted = self.probability + SIGMA * error
        needed = float(np.quantile(np.concatenate(distances), min(wanted, 1.0), method="higher"))
        return len(shares) == trials and float(np.mean(shares)) >= wanted, needed / sensor_range

    def _draw(self, n: int, max_draws: int | None = None) -> se2.FloatArray:
        # Even a few samples may take many draws where free space is tight.
        draws = 50 * max(n, PLACES) if max_draws is None else max_draws
        return free_samples(self.checker, n, reachable_from=self.reachable_from, random_state=self.rng, max_draws=draws)


def _hexagon_share(c: float) -> float:
    """Return the share of a regular hexagon of area 1 within c of its centre."""
    inner = sqrt(1.0 / (2.0 * sqrt(3.0)))
    if c <= inner:
        return pi * c * c
    if c >= 2.0 * inner / sqrt(3.0):
        return 1.0
    return pi * c * c - 6.0 * (c * c * acos(inner / c) - inner * sqrt(c * c - inner * inner))


def _hexagon_quantile(probability: float) -> float:
    """Return within which distance of its centre a share of a regular hexagon of area 1 lies."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _hexagon_share(middle) < probability else (low, middle)
    return high


def _check(sensor_range: float, probability: float) -> None:
    if not (isfinite(sensor_range) and sensor_range > 0.0):
        raise ConfigurationError(f"sensor range: expected a finite number of metres above 0, got {sensor_range}")
    if not 0.0 < probability < 1.0:
        raise ConfigurationError(f"probability: expected above 0 and below 1, got {probability}")
