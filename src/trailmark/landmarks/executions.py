"""The source method, and trailmark's own, in a known world: from sensing to landmarks that the robot can use.

Which K-means centres it can use and what replaces the others, executions of the whole method, how much their landmarks
differ, and how many landmarks a sensor of some range needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import combinations
from math import acos, ceil, isfinite, pi, sqrt
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.footprint import build_footprint
from trailmark.collision.kernels import FREE, states_free
from trailmark.errors import ConfigurationError
from trailmark.estimation import RangeBearing, sense_obstacles
from trailmark.landmarks.paper import Initialisation, algorithm_2, require_count
from trailmark.landmarks.relaxation import Relaxation
from trailmark.landmarks.sampling import RandomState, draw, free_samples, generator, k_means_landmarks
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc
from trailmark.world import Robot

__all__ = [
    "Execution",
    "Repair",
    "Spread",
    "execute_paper",
    "execute_se2",
    "landmarks_for_area",
    "landmarks_for_range",
    "matched_distances",
    "readings_in",
    "repair_centres",
    "spread_of_runs",
]

# --- Centres that the robot cannot use, and what replaces them: K-means takes no account of obstacles.

HEADINGS = 72
"""Headings tried at a place: one every five degrees."""

SPECK = 1e-6
"""Radius (metres) of the disc that stands for a point."""

BATCH = 1000
"""Places whose headings are tried at a time."""


class Repair(NamedTuple):
    """Which K-means centres a robot can use, and valid configurations in their place.

    Attributes:
        in_obstacle: shape (k,), whether the centre itself lies in an obstacle or out of bounds or boundary.
        invalid: shape (k,), whether the robot can stand there at none of the headings that were tried.
        configurations: shape (k, 3), all valid: the centre at its widest heading, or where that is invalid, the
            sample nearest to it at which the robot can stand.
    """

    in_obstacle: NDArray[np.bool_]
    invalid: NDArray[np.bool_]
    configurations: FloatArray


def repair_centres(checker: StateChecker, centres: ArrayLike, samples: ArrayLike) -> Repair:
    """Return which centres the robot cannot use, and valid configurations in the place of all.

    Args:
        checker: decides what is valid.
        centres: shape (k, 2), metres.
        samples: places that may replace them, shape (n, 2), metres.

    Raises:
        ConfigurationError: other shapes, or no sample at which the robot can stand though a centre needs one.
    """
    from scipy.spatial import cKDTree

    places, others = _places(centres, "centres"), _places(samples, "samples")
    at_zero = np.ascontiguousarray(np.column_stack([places, np.zeros(len(places))]))
    speck = build_footprint(Robot.disc(SPECK))
    in_obstacle = np.asarray(states_free(checker.grid, checker.field, speck, at_zero) != FREE)
    q, valid = _widest_headings(checker, places)
    # Mostly one of the nearest few is suitable; in the end all are looked at.
    for count in (16, 256, len(others)):
        if (wrong := np.flatnonzero(~valid)).size == 0:
            break
        near = np.asarray(cKDTree(others).query(places[wrong], np.arange(1, min(count, len(others)) + 1))[1])
        looked_at, which = np.unique(near, return_inverse=True)
        widest, stands = _widest_headings(checker, others[looked_at])
        suits = stands[which].reshape(near.shape)
        found = np.flatnonzero(suits.any(axis=1))
        q[wrong[found]] = widest[which.reshape(near.shape)[found, suits[found].argmax(axis=1)]]
        valid[wrong[found]] = True
    if not valid.all():
        raise ConfigurationError(
            f"samples: expected one at which the robot ({checker.robot.describe()}) can stand, got {len(others)} at "
            f"which it cannot"
        )
    return Repair(in_obstacle, (q[:, :2] != places).any(axis=1), q)


def _widest_headings(checker: StateChecker, places: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the configuration with the largest clearance at each place (n, 2), shape (n, 3), and whether it is valid.

    HEADINGS headings are tried; for a disc only 0.
    """
    count = 1 if isinstance(checker.robot.footprint, Disc) else HEADINGS
    headings = np.asarray(se2.wrap(2.0 * np.pi * np.arange(count) / count))
    best, valid = np.zeros((len(places), 3)), np.zeros(len(places), dtype=np.bool_)
    cap = 2.0 * checker.robot.circumradius
    for begin in range(0, len(places), BATCH):
        part = slice(begin, begin + BATCH)
        q = np.column_stack([np.repeat(places[part], count, axis=0), np.tile(headings, len(places[part]))])
        clearance = np.where(checker.valid(q), checker.clearance(q, cap=cap), -1.0).reshape(-1, count)
        widest = np.argmax(clearance, axis=1)
        rows = np.arange(len(widest))
        best[part], valid[part] = q.reshape(-1, count, 3)[rows, widest], clearance[rows, widest] >= 0.0
    return best, valid


def _places(values: ArrayLike, name: str) -> FloatArray:
    places = np.asarray(values, dtype=np.float64)
    if places.ndim != 2 or places.shape[1] != 2 or not len(places) or not np.isfinite(places).all():
        raise ConfigurationError(f"{name}: expected shape (n, 2), n >= 1, of finite numbers, got {places.shape}")
    return np.ascontiguousarray(places)


# --- Executions.

SENSOR_RANGE = 12.0
"""Range of the sensor in metres by default: that of a common small laser scanner."""

SIGMA_RANGE, SIGMA_BEARING = 0.05, 0.01
"""Standard deviations (metres, radians) of a reading by default."""

POSES, AREA_PER_POSE = (100, 2000), 20.0
"""Minimum and maximum number of places that the robot senses from, and square metres of the bounds for each: several
are within range of every obstacle."""

POINTS, POINT_SPACING = (24, 240), 3.0
"""Minimum and maximum number of points read of an outline, and the metres of the longest outline for each of them: a
large obstacle needs more to be sensed from everywhere."""


class Execution(NamedTuple):
    """One execution: what was drawn, what was clustered, and the result. Metres and radians.

    The attributes are those of :class:`~trailmark.landmarks.PaperLandmarks` and :class:`Repair`. In trailmark's own
    method samples are configurations (n, 3), and so are centres; there are no boxes; inertia is in its embedding
    (:func:`trailmark.se2.embed`); iterations are not known.

    Attributes:
        repaired: valid configurations in the centres' place, shape (k, 3).
        seconds: time from readings to landmarks, without loading scikit-learn.
    """

    samples: FloatArray
    forbidden: NDArray[np.bool_]
    enclosed: NDArray[np.bool_]
    boxes: FloatArray
    centres: FloatArray
    labels: NDArray[np.int32]
    inertia: float
    iterations: int | None
    mini_batches: bool
    in_obstacle: NDArray[np.bool_]
    invalid: NDArray[np.bool_]
    repaired: FloatArray
    seconds: float


def execute_paper(
    checker: StateChecker,
    n: int = 1000,
    k: int = 12,
    init: Initialisation = "forgy",
    random_state: RandomState = None,
    *,
    start: FloatArray | None = None,
    sensor_range: float = SENSOR_RANGE,
    grown: bool = False,
) -> Execution:
    """Return one execution of Algorithm 2 in the checker's world; the rectangle is the world's bounds.

    The obstacles are sensed (:func:`readings_in`), Algorithm 2 computes landmarks from the readings, and the checker
    finds which of them the robot can use.

    Args:
        checker: world and robot; Algorithm 2 itself uses only where the robot starts.
        n: how many points to draw, >= 1.
        k: how many landmarks.
        init: the first centres, see :func:`~trailmark.landmarks.paper.initial_centres`.
        random_state: seed or generator; the same one gives the same execution.
        start: where the robot starts, shape (3,); what it cannot reach from there counts as occupied. Without a valid
            one, only what obstacles separate from the bounds does.
        sensor_range: metres.
        grown: grow the obstacles' boxes by the radius of the robot's largest inscribed disc, so that points at which it
            can stand at no heading are not clustered.

    Raises:
        ConfigurationError: an argument out of range, fewer valid points than k, no place for the robot.
    """
    rng, home = generator(random_state), start if start is not None and checker.valid(start) else None
    readings = readings_in(checker, rng, start=home, sensor_range=sensor_range)
    robot = None if home is None else home[:2]
    margin = checker.robot.inscribed_disc.radius if grown else 0.0
    _load()
    begin = perf_counter()
    found = algorithm_2(readings, checker.world.bounds, n, k, init, rng, robot=robot, margin=margin)
    seconds = perf_counter() - begin
    return Execution(*found, *repair_centres(checker, found.centres, found.samples[~found.forbidden]), seconds)


def readings_in(
    checker: StateChecker,
    random_state: RandomState = None,
    *,
    start: FloatArray | None = None,
    sensor_range: float = SENSOR_RANGE,
) -> list[FloatArray]:
    """Return the refined readings of each obstacle, shape (r, 2): Algorithm 2's first step, in a known world.

    The robot senses the obstacles' outlines from random valid configurations that it can reach, with SIGMA_RANGE and
    SIGMA_BEARING, and the EKF refines the readings (:func:`trailmark.estimation.sense_obstacles`).

    Args:
        checker: world and robot.
        random_state: seed or generator.
        start: valid configuration, shape (3,), from which the robot reaches the others; None for anywhere.
        sensor_range: metres.

    Raises:
        ConfigurationError: no place for the robot.
    """
    world, rng = checker.world, generator(random_state)
    xmin, ymin, xmax, ymax = world.bounds
    count = int(np.clip((xmax - xmin) * (ymax - ymin) / AREA_PER_POSE, *POSES))
    poses = free_samples(checker, count, reachable_from=start, random_state=rng)
    if len(poses) == 0:
        raise ConfigurationError(f"world {world.name!r}: empty free space: no place for the robot was found")
    longest = max((shape.polygon(1e-2).shapely().length for shape in world.obstacles), default=0.0)
    points = int(np.clip(longest / POINT_SPACING, *POINTS))
    sensor = RangeBearing(SIGMA_RANGE, SIGMA_BEARING)
    return sense_obstacles(world, poses, sensor, points_per_obstacle=points, max_range=sensor_range, random_state=rng)


def execute_se2(
    checker: StateChecker,
    n: int = 1000,
    k: int = 12,
    random_state: RandomState = None,
    *,
    start: FloatArray | None = None,
) -> Execution:
    """Return one execution of trailmark's own method over a whole world: valid samples in SE(2), repaired centres.

    Args:
        checker: decides what is valid.
        n: how many configurations to draw, >= 1.
        k: how many landmarks; fewer are returned where two centres have the same nearest sample.
        random_state: seed or generator.
        start: configuration, shape (3,); if it is valid, what the robot cannot reach from there is left out.

    Raises:
        ConfigurationError: an argument out of range, or fewer valid samples than k.
    """
    from scipy.spatial import cKDTree

    if n < 1:
        raise ConfigurationError(f"n: expected 1 or more, got {n}")
    begin, rng = perf_counter(), generator(random_state)
    samples = draw(checker.world.bounds, n, random_state=rng)
    if isinstance(checker.robot.footprint, Disc):
        samples[:, 2] = 0.0
    valid = np.asarray(checker.valid(samples))
    enclosed = np.zeros(n, dtype=np.bool_)
    if start is not None and checker.valid(start):
        relaxation = Relaxation(checker)
        enclosed = valid & ~relaxation.component(start)[relaxation.cells(relaxation.disc_centers(samples))]
    usable = samples[valid & ~enclosed]
    require_count(k, len(usable), f"{n} samples")
    radius = checker.footprint.sweep_radius
    landmarks = k_means_landmarks(usable, k, radius=radius, random_state=rng)
    found = cKDTree(se2.embed(landmarks, radius)).query(se2.embed(usable, radius))
    distance, labels = np.asarray(found[0]), np.asarray(found[1], dtype=np.int32)
    seconds, none = perf_counter() - begin, np.zeros(len(landmarks), dtype=np.bool_)
    clusters = landmarks, labels, float(distance @ distance), None, False
    return Execution(samples, ~valid | enclosed, enclosed, np.empty((0, 4)), *clusters, none, none, landmarks, seconds)


@cache
def _load() -> None:
    """Load scikit-learn and scipy, which takes a second or two that a first execution's time must not include."""
    algorithm_2([[[0.4, 0.4], [0.6, 0.6]]], (0.0, 0.0, 1.0, 1.0), 50, 2, random_state=0)


# --- How much landmarks differ from one run to the next.


class Spread(NamedTuple):
    """The spread of centres over runs.

    Attributes:
        pairs: shape (p, 2), which two runs, i < j.
        rms: shape (p,), root mean square of the distances (metres) between matched centres.
        mean: mean of ``rms``; 0 for a single run.
        worst: its largest.
    """

    pairs: NDArray[np.int64]
    rms: FloatArray
    mean: float
    worst: float


def matched_distances(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Return the distances (metres) between the centres of two runs, matched one to one.

    The matching is the one with the least sum of squared distances (Hungarian method, Kuhn 1955; scipy). Where one
    run has fewer centres, those of the other that are not matched are left out.

    Args:
        a: shape (k, d).
        b: shape (l, d).

    Returns:
        Shape (min(k, l),).

    Raises:
        ConfigurationError: other shapes, values that are not finite, or no centre at all.
    """
    from scipy.optimize import linear_sum_assignment

    p, q = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if p.ndim != 2 or q.ndim != 2 or p.shape[1] != q.shape[1] or not (len(p) and len(q)):
        raise ConfigurationError(f"centres: expected shapes (k, d) and (l, d), got {p.shape} and {q.shape}")
    if not (np.isfinite(p).all() and np.isfinite(q).all()):
        raise ConfigurationError("centres: hold a value that is not a finite number")
    squared = np.sum((p[:, None] - q[None]) ** 2, axis=2)
    return np.asarray(np.sqrt(squared[linear_sum_assignment(squared)]))


def spread_of_runs(centres: Sequence[ArrayLike]) -> Spread:
    """Return how far matched centres lie apart, for every pair of runs.

    Args:
        centres: one array (k, d) for each run, metres.

    Raises:
        ConfigurationError: no run, or arrays that :func:`matched_distances` refuses.
    """
    if not centres:
        raise ConfigurationError("spread of runs: expected 1 run or more, got none")
    pairs = list(combinations(range(len(centres)), 2))
    rms = np.array([np.sqrt(np.mean(matched_distances(centres[i], centres[j]) ** 2)) for i, j in pairs])
    mean, worst = (float(rms.mean()), float(rms.max())) if pairs else (0.0, 0.0)
    return Spread(np.array(pairs, dtype=np.int64).reshape(-1, 2), rms, mean, worst)


# --- How many landmarks a sensor needs so that, wherever the robot is, one of them is likely to be within range.

MAX_LANDMARKS = 10_000
"""Maximum number of landmarks: clustering more takes minutes."""

MAX_PROBABILITY = 0.9999
"""A higher probability could only be measured with millions of places."""

SAMPLES, SAMPLES_PER_LANDMARK = 1000, 10
"""Samples that are clustered: n as published, or so many for each landmark if that is more."""

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


def landmarks_for_area(area: float, sensor_range: float, probability: float = 0.95) -> int:
    """Return how many landmarks an open area takes at least, by a closed form; see :func:`landmarks_for_range`.

    K-means centres of k uniform samples are, for large k, the centres of nearly regular hexagons of A/k each, which
    tile the area. A hexagon with inradius ρ has within r of its centre the area

        a(r) = π·r²                                               for r <= ρ
        a(r) = π·r² − 6·(r²·arccos(ρ/r) − ρ·√(r² − ρ²))           for ρ <= r <= 2ρ/√3

    (six segments of the circle lie outside). Scaled to area 1, c_p is within which distance of its centre a share p of
    it lies; lengths grow as √(A/k). Hence c_p·√(A/k) <= r if and only if k >= A·(c_p/r)². c_p is 0.556 at p = 0.95.

    Source: no other k places bring a larger share within a given range, by the moment theorem of L. Fejes Tóth,
    "Lagerungen in der Ebene, auf der Kugel und im Raum" (1953); K-means tends to them, Newman, "The hexagon theorem",
    IEEE Trans. Inf. Theory 28 (1982). Measured in open squares, K-means takes 1.5 to 1.8 times as many at p = 0.95.

    Args:
        area: free area, square metres, > 0.
        sensor_range: metres, > 0.
        probability: share of the area within range of a landmark, above 0 and below 1.

    Raises:
        ConfigurationError: an argument out of range.
    """
    for name, value, unit in (("area", area, "m²"), ("sensor range", sensor_range, "metres")):
        if not (isfinite(value) and value > 0.0):
            raise ConfigurationError(f"{name}: expected a finite number of {unit} above 0, got {value}")
    if not 0.0 < probability < 1.0:
        raise ConfigurationError(f"probability: expected above 0 and below 1, got {probability}")
    inner = sqrt(1.0 / (2.0 * sqrt(3.0)))
    low, high = 0.0, 2.0 * inner / sqrt(3.0)
    for _ in range(60):
        c = 0.5 * (low + high)
        outside = c * c * acos(inner / c) - inner * sqrt(c * c - inner * inner) if c > inner else 0.0
        low, high = (c, high) if pi * c * c - 6.0 * outside < probability else (low, c)
    # The quotient of lengths first: it may be too large for a float, its square even more so.
    lengths = sqrt(area) * high / sensor_range
    if lengths > 1e100:
        raise ConfigurationError(f"sensor range: expected a larger one for {area:g} m², got {sensor_range:g} m")
    return max(1, ceil(lengths**2))


def landmarks_for_range(
    checker: StateChecker,
    sensor_range: float,
    probability: float = 0.95,
    *,
    radius: float = 0.0,
    reachable_from: FloatArray | None = None,
    random_state: RandomState = None,
) -> int:
    """Return how many K-means landmarks bring a random free place within the sensor's range of one of them.

    The place is that of a random valid configuration, the landmarks are those of
    :func:`trailmark.landmarks.k_means_landmarks` for random valid samples: the probability is over both. For a
    disc robot it is the share of the free area within range, on average over the landmarks' randomness.

    The closed form of :func:`landmarks_for_area` says where to begin. It asks for too few landmarks where free space is
    narrow against the range, where obstacles cut cells apart and where K-means settles in a local optimum. So each
    count is tried as it will be used: samples are clustered, and the share of other random places within range is
    measured, in several independent clusterings. It is accepted if that exceeds ``probability`` by SIGMA standard
    errors, taken over the clusterings or from the binomial distribution, whichever is larger. Else it grows by the
    factor by which the distance that a share ``probability`` of the places keeps exceeds the range: that distance falls
    as k^(−1/2) in the open and as 1/k along corridors, so the count closes in from below in either case. A count that
    overshot nevertheless is bisected, to 5 %.

    Args:
        checker: decides what is valid.
        sensor_range: metres, > 0.
        probability: above 0, at most MAX_PROBABILITY.
        radius: R of the embedding in which they will be clustered, metres; 0 clusters positions only.
        reachable_from: shape (3,): places that obstacles wholly enclose, seen from here, do not count.
        random_state: seed or generator; the same one gives the same count.

    Raises:
        ConfigurationError: an argument out of range, no free space, or a range so small that it takes more than
            MAX_LANDMARKS landmarks.
    """
    from scipy.spatial import cKDTree

    if probability > MAX_PROBABILITY:
        raise ConfigurationError(f"probability: expected above 0 and at most {MAX_PROBABILITY}, got {probability}")
    landmarks_for_area(1.0, sensor_range, probability)  # says what is wrong
    name, rng = f"world {checker.world.name!r}", generator(random_state)

    def drawn(n: int, draws: int | None = None) -> FloatArray:
        # Even a few samples may take many draws where free space is tight.
        limit = 50 * max(n, PLACES) if draws is None else draws
        return free_samples(checker, n, reachable_from=reachable_from, random_state=rng, max_draws=limit)

    places = drawn(max(PLACES, ceil(20.0 / (1.0 - probability))))[:, :2]
    if len(places) == 0:
        raise ConfigurationError(f"{name}: no free place for the robot was found")
    # The share's error if the clusterings did not vary.
    least_error = sqrt(probability * (1.0 - probability) / len(places))
    if probability + SIGMA * least_error >= 1.0:
        raise ConfigurationError(
            f"{name}: expected more free places for a probability of {probability:g}, found {len(places)}"
        )

    def excess(k: int) -> float:
        """Return by which factor the distances that count exceed the range with k landmarks: if above 1, too few."""
        trials = TRIALS if k < MANY else FEW_TRIALS
        samples = drawn(trials * max(SAMPLES, SAMPLES_PER_LANDMARK * k))
        shares, distances = list[float](), list[FloatArray]()
        for i in range(trials):
            landmarks = k_means_landmarks(samples[i::trials], k, radius=radius, steps=STEPS, random_state=rng)
            distances.append(np.asarray(cKDTree(landmarks[:, :2]).query(places[i::trials])[0]))
            shares.append(float((distances[-1] <= sensor_range).mean()))
            if shares[0] < probability - 10.0 * least_error:
                break  # far off: the other trials would give the same answer
        error = max(least_error, float(np.std(shares, ddof=1)) / sqrt(trials)) if len(shares) > 1 else least_error
        wanted = min(probability + SIGMA * error, 1.0)
        return float(np.quantile(np.concatenate(distances), wanted, method="higher")) / sensor_range

    xmin, ymin, xmax, ymax = checker.world.bounds
    area = (xmax - xmin) * (ymax - ymin) * max(len(drawn(PLACES, PLACES)), 1) / PLACES
    k, too_few = landmarks_for_area(area, sensor_range, probability), 0
    while k <= MAX_LANDMARKS and (factor := excess(k)) > 1.0:
        # At least a hundredth more: near the end, noise would have it go on one by one.
        too_few, k = k, max(k + 1, ceil(k * min(max(factor, 1.01), GROWTH)))
    if k > MAX_LANDMARKS:
        raise ConfigurationError(
            f"sensor range: expected a larger one for {name}, where {MAX_LANDMARKS} landmarks, the limit, do not bring "
            f"a place within range of one with probability {probability:g}, got {sensor_range:g} m"
        )
    while too_few and k > max(too_few + 1, 1.05 * too_few):
        middle = ceil(sqrt(too_few * k))
        too_few, k = (middle, k) if excess(middle) > 1.0 else (too_few, middle)
    return k
