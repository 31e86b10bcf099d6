"""The source method as published: Algorithm 1 (K-means) and Algorithm 2 (landmarks from refined readings).

It is implemented to the letter, weaknesses included: obstacles count as boxes, a centre may lie in one, and headings
and the robot's shape play no part. The planner uses :func:`trailmark.landmarks.k_means_landmarks` instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import number
from trailmark.errors import ConfigurationError, expected_name
from trailmark.landmarks.enclosed import Rectangle, enclosed_points
from trailmark.landmarks.kmeans import one_thread
from trailmark.landmarks.sampling import RandomState, generator

__all__ = [
    "INITIALISATIONS",
    "Clusters",
    "Initialisation",
    "PaperLandmarks",
    "algorithm_1",
    "algorithm_2",
    "boxes_of",
    "initial_centres",
    "points_in_boxes",
    "require_count",
]

FloatArray = NDArray[np.float64]

Initialisation = Literal["forgy", "random-partition", "k-means++"]
INITIALISATIONS: tuple[Initialisation, ...] = get_args(Initialisation)

MAX_ITERATIONS = 100_000
"""More than Lloyd's algorithm needs on any data but constructed ones; a bound so that it always ends."""

MINI_BATCHES_FROM = 20_000_000
"""Algorithm 2 uses mini-batches for more points times clusters than this: Lloyd's algorithm would take minutes."""


BATCH, FIRST_FROM = 10_000, 100_000
"""Points of a mini-batch, and of which the first centres of mini-batches are chosen."""


class Clusters(NamedTuple):
    """The result of K-means.

    Attributes:
        centres: shape (k, d).
        labels: shape (n,), each sample's cluster, 0 to k − 1: the one whose centre is nearest.
        inertia: sum of the squared distances of the samples to their centres.
        iterations: steps of Lloyd's algorithm, or batches.
    """

    centres: FloatArray
    labels: NDArray[np.int32]
    inertia: float
    iterations: int


class PaperLandmarks(NamedTuple):
    """The result of Algorithm 2; metres.

    Attributes:
        samples: shape (n, 2), all points drawn, forbidden ones too.
        forbidden: shape (n,), which of them are not clustered: those in boxes and the enclosed ones.
        enclosed: shape (n,), those in no box, but in a region that boxes enclose.
        boxes: shape (m, 4), rows xmin, ymin, xmax, ymax; obstacles without a reading have none.
        centres: shape (k, 2), the landmarks.
        labels: shape (v,), the cluster of each of the v valid samples.
        inertia: sum of their squared distances to their centres, square metres.
        iterations: steps of Lloyd's algorithm, or batches.
        mini_batches: whether mini-batches were used instead of Lloyd's algorithm.
    """

    samples: FloatArray
    forbidden: NDArray[np.bool_]
    enclosed: NDArray[np.bool_]
    boxes: FloatArray
    centres: FloatArray
    labels: NDArray[np.int32]
    inertia: float
    iterations: int
    mini_batches: bool


def algorithm_1(
    samples: ArrayLike, k: int, init: Initialisation = "forgy", random_state: RandomState = None
) -> Clusters:
    """Return k clusters by Lloyd's algorithm, run until no sample changes its cluster (Lloyd 1982).

    The iterations are scikit-learn's; a cluster that loses all its samples restarts at the sample farthest from its
    centre.

    Args:
        samples: shape (n, d).
        k: how many clusters, 1 to the number of different samples.
        init: the first centres, see :func:`initial_centres`.
        random_state: seed or generator; the same one gives the same clusters.

    Raises:
        ConfigurationError: another shape, values that are not finite, an unknown ``init``, k out of range.
    """
    from sklearn.cluster import KMeans

    points = _points(samples, "samples")
    first = initial_centres(points, k, init, random_state)
    with one_thread():
        lloyd = KMeans(k, init=first, n_init=1, max_iter=MAX_ITERATIONS, tol=0.0, algorithm="lloyd").fit(points)
    return Clusters(lloyd.cluster_centers_, lloyd.labels_, float(lloyd.inertia_), int(lloyd.n_iter_))


def initial_centres(
    samples: ArrayLike, k: int, init: Initialisation = "forgy", random_state: RandomState = None
) -> FloatArray:
    """Return the centres to start from, shape (k, d).

    Args:
        samples: shape (n, d).
        k: 1 to the number of different samples.
        init: ``forgy`` takes k different samples (Forgy 1965); ``random-partition`` puts each sample into a random
            cluster and takes the centroids (a cluster that gets none is given one from a cluster of several);
            ``k-means++`` takes samples far from one another (Arthur & Vassilvitskii 2007, scikit-learn).
        random_state: seed or generator.

    Raises:
        ConfigurationError: another shape, values that are not finite, an unknown ``init``, k out of range.
    """
    points = _points(samples, "samples")
    if init not in INITIALISATIONS:
        raise ConfigurationError(f"init: {expected_name(str(init), INITIALISATIONS)}")
    if not 1 <= k <= len(points):
        raise ConfigurationError(f"k: expected 1 to {len(points)}, the number of samples, got {k}")
    rng = generator(random_state)
    # Equal samples always share a cluster. A few samples mostly show that there are enough different ones.
    different = _different(points[: 4 * k])
    if len(different) < k:
        different = _different(points)
    if len(different) < k:
        raise ConfigurationError(f"k: expected 1 to {len(different)}, the number of different samples, got {k}")
    if init == "random-partition":
        return _centroids(points, _partition(len(points), k, rng), k)
    if init == "k-means++":
        from sklearn.cluster import kmeans_plusplus

        # Relative to their mean, since distances lose digits far from the origin.
        middle = points.mean(axis=0)
        with one_thread():
            chosen = kmeans_plusplus(points - middle, k, random_state=int(rng.integers(2**31)))[1]
    else:
        chosen = rng.choice(len(points), k, replace=False)
    if len(_different(points[chosen])) == k:
        return np.array(points[chosen])
    different = _different(points)
    return np.array(different[rng.choice(len(different), k, replace=False)])


def algorithm_2(
    readings: Sequence[ArrayLike],
    rectangle: Rectangle,
    n: int = 1000,
    k: int = 12,
    init: Initialisation = "forgy",
    random_state: RandomState = None,
    *,
    robot: ArrayLike | None = None,
    margin: float = 0.0,
) -> PaperLandmarks:
    """Return k landmarks: the centres of the points of a rectangle that lie in no obstacle's box.

    The readings are refined already, as by :func:`trailmark.estimation.refine_points`. For more points times clusters
    than MINI_BATCHES_FROM, scikit-learn's mini-batches replace Algorithm 1; their inertia is about a tenth larger.

    Args:
        readings: the refined readings of each obstacle, shape (r, 2), r >= 0; metres.
        rectangle: Xmin, Ymin, Xmax, Ymax in metres.
        n: how many points to draw, >= 1.
        k: how many landmarks, 1 to the number of valid points.
        init: see :func:`initial_centres`.
        random_state: seed or generator; the same one gives the same landmarks.
        robot: where the robot stands, shape (2,). What boxes separate from there is enclosed; without it, only what
            boxes separate from the rectangle's edge.
        margin: metres by which each box is grown on all sides, >= 0: with the robot's radius, points in the C-obstacle
            are left out too.

    Raises:
        ConfigurationError: an argument out of range, or fewer valid points than k.
    """
    low, high = _corners(rectangle)
    if n < 1:
        raise ConfigurationError(f"n: expected 1 or more, got {n}")
    if k < 1:
        raise ConfigurationError(f"k: expected 1 or more, got {k}")
    margin = number(margin, "margin:", minimum=0.0)
    position = None if robot is None else _points(np.atleast_2d(np.asarray(robot, dtype=np.float64)), "robot")[0, :2]
    rng = generator(random_state)

    samples = rng.uniform(low, high, (n, 2))
    boxes = boxes_of(readings) + np.array([-margin, -margin, margin, margin])
    inside = points_in_boxes(samples, boxes)
    enclosed = ~inside & enclosed_points(samples, boxes, rectangle, position)
    forbidden = inside | enclosed
    valid = samples[~forbidden]
    require_count(k, len(valid), f"{n} points")
    mini_batches = len(valid) * k > MINI_BATCHES_FROM
    clusters = _mini_batch_clusters(valid, k, init, rng) if mini_batches else algorithm_1(valid, k, init, rng)
    return PaperLandmarks(samples, forbidden, enclosed, boxes, *clusters, mini_batches)


def _mini_batch_clusters(points: FloatArray, k: int, init: Initialisation, rng: np.random.Generator) -> Clusters:
    """Return k clusters by scikit-learn's mini-batches; the first centres are chosen among a part of the points."""
    from sklearn.cluster import MiniBatchKMeans

    some = points[rng.choice(len(points), min(len(points), max(FIRST_FROM, 10 * k)), replace=False)]
    first, seed = initial_centres(some, k, init, rng), int(rng.integers(2**31))
    with one_thread():
        found = MiniBatchKMeans(k, init=first, n_init=1, batch_size=BATCH, random_state=seed).fit(points)
    labels = np.asarray(found.labels_, dtype=np.int32)
    return Clusters(np.asarray(found.cluster_centers_, dtype=np.float64), labels, float(found.inertia_), found.n_steps_)


def boxes_of(readings: Sequence[ArrayLike]) -> FloatArray:
    """Return the smallest and largest x and y of each obstacle's readings.

    Args:
        readings: shape (r, 2) each, metres; obstacles without readings have no box.

    Returns:
        Shape (m, 4), rows xmin, ymin, xmax, ymax.

    Raises:
        ConfigurationError: another shape, or values that are not finite.
    """
    boxes = []
    for i, obstacle in enumerate(readings):
        points = np.asarray(obstacle, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
            raise ConfigurationError(f"readings[{i}]: expected shape (r, 2), finite numbers, got {points.shape}")
        if len(points):
            boxes.append([*points.min(axis=0), *points.max(axis=0)])
    return np.array(boxes, dtype=np.float64).reshape(-1, 4)


def points_in_boxes(points: FloatArray, boxes: FloatArray) -> NDArray[np.bool_]:
    """Return which points (n, 2) lie in any of the boxes (m, 4), edges included; shape (n,)."""
    order = np.argsort(points[:, 0])
    x, y = points[order].T
    hit = np.zeros(len(points), dtype=np.bool_)
    for xmin, ymin, xmax, ymax in boxes:
        between = slice(np.searchsorted(x, xmin), np.searchsorted(x, xmax, side="right"))
        hit[between] |= (y[between] >= ymin) & (y[between] <= ymax)
    found = np.empty_like(hit)
    found[order] = hit
    return found


def require_count(k: int, valid: int, drawn: str) -> None:
    """Raise a ConfigurationError unless there are k valid samples or more among those drawn."""
    if not 1 <= k <= valid:
        expected = f"expected 1 to {valid}, got {k}" if valid else "empty free space"
        raise ConfigurationError(f"k: {expected}: {valid} of {drawn} drawn are valid")


def _partition(n: int, k: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return a random cluster for each of n samples, none of the k clusters empty; shape (n,)."""
    labels = rng.integers(k, size=n)
    count = np.bincount(labels, minlength=k)
    for empty in np.flatnonzero(count == 0):
        moved = rng.choice(np.flatnonzero(count[labels] > 1))
        count[labels[moved]] -= 1
        labels[moved] = empty
        count[empty] = 1
    return labels


def _centroids(points: FloatArray, labels: NDArray[np.int64], k: int) -> FloatArray:
    sums = [np.bincount(labels, weights=column, minlength=k) for column in points.T]
    return np.column_stack(sums) / np.bincount(labels, minlength=k)[:, None]


def _different(points: FloatArray) -> FloatArray:
    return np.unique(points, axis=0)


def _points(values: ArrayLike, name: str) -> FloatArray:
    points = np.asarray(values, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] < 1:
        raise ConfigurationError(f"{name}: expected shape (n, d), got {points.shape}")
    if not np.isfinite(points).all():
        raise ConfigurationError(f"{name}: hold a value that is not a finite number")
    return np.ascontiguousarray(points)


def _corners(rectangle: Rectangle) -> tuple[FloatArray, FloatArray]:
    values = np.asarray(rectangle, dtype=np.float64)
    if values.shape != (4,) or not (np.isfinite(values).all() and (values[:2] < values[2:]).all()):
        got = ", ".join(f"{v:g}" for v in values.ravel()[:8])
        raise ConfigurationError(f"rectangle: expected xmin, ymin, xmax, ymax with min < max, got {got}")
    return values[:2], values[2:]
