"""The source method as published: Algorithm 1 (K-means) and Algorithm 2 (landmarks from refined readings).

It is implemented to the letter, weaknesses included: obstacles count as boxes, a centre may lie in one, and headings
and the robot's shape play no part. The planner uses :func:`trailmark.landmarks.k_means_landmarks` instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from functools import lru_cache
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import number
from trailmark.errors import ConfigurationError, expected_name
from trailmark.landmarks.sampling import RandomState, generator
from trailmark.se2 import FloatArray

__all__ = [
    "INITIALISATIONS",
    "Clusters",
    "Initialisation",
    "PaperLandmarks",
    "Rectangle",
    "algorithm_1",
    "algorithm_2",
    "enclosed_cells",
    "enclosed_points",
    "initial_centres",
    "points_in_boxes",
    "require_count",
]

Rectangle = tuple[float, float, float, float]
"""xmin, ymin, xmax, ymax in metres."""

Initialisation = Literal["forgy", "random-partition", "k-means++"]
INITIALISATIONS: tuple[Initialisation, ...] = get_args(Initialisation)

MAX_ITERATIONS = 100_000
"""More than Lloyd's algorithm needs on any data but constructed ones; a bound so that it always ends."""

MINI_BATCHES_FROM = 20_000_000
"""Algorithm 2 uses mini-batches for more points times clusters than this: Lloyd's algorithm would take minutes."""

BATCH, FIRST_FROM = 10_000, 100_000
"""Points of a mini-batch, and of which the first centres of mini-batches are chosen."""

MAX_LINES = 4096
"""Maximum number of grid lines at the edges of boxes, along either axis; more are replaced by equally spaced lines."""


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
    with _one_thread():
        found = KMeans(k, init=first, n_init=1, max_iter=MAX_ITERATIONS, tol=0.0, algorithm="lloyd").fit(points)
    return Clusters(found.cluster_centers_, found.labels_, float(found.inertia_), int(found.n_iter_))


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
    points, rng = _points(samples, "samples"), generator(random_state)
    if init not in INITIALISATIONS:
        raise ConfigurationError(f"init: {expected_name(str(init), INITIALISATIONS)}")
    if not 1 <= k <= len(points):
        raise ConfigurationError(f"k: expected 1 to {len(points)}, the number of samples, got {k}")
    # Equal samples always share a cluster. A few samples mostly show that there are enough different ones.
    if len(np.unique(points[: 4 * k], axis=0)) < k and (count := len(np.unique(points, axis=0))) < k:
        raise ConfigurationError(f"k: expected 1 to {count}, the number of different samples, got {k}")
    if init == "random-partition":
        labels = _partition(len(points), k, rng)
        sums = [np.bincount(labels, weights=column, minlength=k) for column in points.T]
        return np.column_stack(sums) / np.bincount(labels, minlength=k)[:, None]
    if init == "k-means++":
        from sklearn.cluster import kmeans_plusplus

        with _one_thread():
            # Relative to their mean, since distances lose digits far from the origin.
            seed = int(rng.integers(2**31))
            chosen = kmeans_plusplus(points - points.mean(axis=0), k, random_state=seed)[1]
    else:
        chosen = rng.choice(len(points), k, replace=False)
    if len(np.unique(points[chosen], axis=0)) == k:
        return np.array(points[chosen])
    different = np.unique(points, axis=0)
    return np.array(different[rng.choice(len(different), k, replace=False)])


def _partition(n: int, k: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return a random cluster for each of n samples, none of the k clusters empty; shape (n,)."""
    labels = rng.integers(k, size=n)
    count = np.bincount(labels, minlength=k)
    for empty in np.flatnonzero(count == 0):
        moved = rng.choice(np.flatnonzero(count[labels] > 1))
        count[labels[moved]] -= 1
        labels[moved], count[empty] = empty, 1
    return labels


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
    corners = np.asarray(rectangle, dtype=np.float64)
    if corners.shape != (4,) or not (np.isfinite(corners).all() and (corners[:2] < corners[2:]).all()):
        got = ", ".join(f"{v:g}" for v in corners.ravel()[:8])
        raise ConfigurationError(f"rectangle: expected xmin, ymin, xmax, ymax with min < max, got {got}")
    for name, count in (("n", n), ("k", k)):
        if count < 1:
            raise ConfigurationError(f"{name}: expected 1 or more, got {count}")
    margin = number(margin, "margin:", minimum=0.0)
    position = None if robot is None else _points(np.atleast_2d(np.asarray(robot, dtype=np.float64)), "robot")[0, :2]
    rng = generator(random_state)

    samples = rng.uniform(corners[:2], corners[2:], (n, 2))
    boxes = _boxes_of(readings) + np.array([-margin, -margin, margin, margin])
    inside = points_in_boxes(samples, boxes)
    enclosed = ~inside & enclosed_points(samples, boxes, rectangle, position)
    valid = samples[~(inside | enclosed)]
    require_count(k, len(valid), f"{n} points")
    mini_batches = len(valid) * k > MINI_BATCHES_FROM
    clusters = (_mini_batch_clusters if mini_batches else algorithm_1)(valid, k, init, rng)
    return PaperLandmarks(samples, inside | enclosed, enclosed, boxes, *clusters, mini_batches)


def _mini_batch_clusters(points: FloatArray, k: int, init: Initialisation, rng: np.random.Generator) -> Clusters:
    """Return k clusters by scikit-learn's mini-batches; the first centres are chosen among a part of the points."""
    from sklearn.cluster import MiniBatchKMeans

    some = points[rng.choice(len(points), min(len(points), max(FIRST_FROM, 10 * k)), replace=False)]
    first, seed = initial_centres(some, k, init, rng), int(rng.integers(2**31))
    with _one_thread():
        found = MiniBatchKMeans(k, init=first, n_init=1, batch_size=BATCH, random_state=seed).fit(points)
    labels = np.asarray(found.labels_, dtype=np.int32)
    return Clusters(np.asarray(found.cluster_centers_, dtype=np.float64), labels, float(found.inertia_), found.n_steps_)


def _boxes_of(readings: Sequence[ArrayLike]) -> FloatArray:
    """Return the smallest and largest x and y of each obstacle's readings, shape (m, 4); none without readings."""
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


def _points(values: ArrayLike, name: str) -> FloatArray:
    points = np.asarray(values, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] < 1:
        raise ConfigurationError(f"{name}: expected shape (n, d), got {points.shape}")
    if not np.isfinite(points).all():
        raise ConfigurationError(f"{name}: hold a value that is not a finite number")
    return np.ascontiguousarray(points)


def _one_thread() -> AbstractContextManager[object]:
    """Return a context in which scikit-learn computes in one thread: in more, its sums change from run to run."""
    context: AbstractContextManager[object] = _thread_pools().limit(limits=1)
    return context


@lru_cache(maxsize=1)
def _thread_pools() -> Any:
    import sklearn.cluster  # noqa: F401  # loads the thread pools that the controller then finds
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


# --- Regions that occupied cells enclose completely: the robot cannot reach them, so they count as occupied.


def enclosed_cells(occupied: NDArray[np.bool_], robot: tuple[int, int] | None = None) -> NDArray[np.bool_]:
    """Return which free or unknown cells are enclosed by occupied ones.

    Cells are connected by their sides only: between two occupied cells that meet in a corner there is no passage.

    Args:
        occupied: shape (rows, columns); all other cells are free or unknown.
        robot: the robot's row and column. The robot does not leave the grid, so that every cell not connected to its
            own is enclosed. If this is None, or the cell is occupied, regions at the grid's edge are not enclosed.

    Returns:
        Shape (rows, columns), True only where ``occupied`` is False.
    """
    from scipy import ndimage

    labels, count = ndimage.label(~np.asarray(occupied, dtype=np.bool_))
    reached = np.zeros(count + 1, dtype=np.bool_)
    if robot is not None and labels[robot]:
        reached[labels[robot]] = True
    else:
        for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
            reached[edge] = True
    reached[0] = True  # the label of the occupied cells
    return np.asarray(~reached[labels])


def enclosed_points(
    points: FloatArray, boxes: FloatArray, rectangle: Rectangle, robot: FloatArray | None = None
) -> NDArray[np.bool_]:
    """Return which points lie in regions of a rectangle that boxes enclose.

    The grid's lines are the edges of the boxes, so that boxes cover its cells completely or not at all: there is no
    resolution to choose. Boxes less than a billionth of the rectangle apart leave no gap.

    Args:
        points: shape (n, 2), metres, in the rectangle.
        boxes: shape (m, 4), rows xmin, ymin, xmax, ymax in metres; they may overlap and extend beyond the rectangle.
        rectangle: the region that the robot does not leave.
        robot: its position, shape (2,); see :func:`enclosed_cells`.

    Returns:
        Shape (n,).
    """
    if len(boxes) == 0:
        return np.zeros(len(points), dtype=np.bool_)
    low, high = np.array(rectangle[:2]), np.array(rectangle[2:])
    slack = 1e-9 * float((high - low).max())
    lower, upper = np.clip(boxes[:, :2] - slack, low, high), np.clip(boxes[:, 2:] + slack, low, high)
    x, y = (np.unique([*lower[:, axis], *upper[:, axis], low[axis], high[axis]]) for axis in (0, 1))
    x, y = (v if len(v) <= MAX_LINES else np.linspace(v[0], v[-1], MAX_LINES) for v in (x, y))
    first = np.column_stack([np.searchsorted(x, lower[:, 0], "right"), np.searchsorted(y, lower[:, 1], "right")]) - 1
    last = np.column_stack([np.searchsorted(x, upper[:, 0]), np.searchsorted(y, upper[:, 1])])
    occupied = np.zeros((len(y) - 1, len(x) - 1), dtype=np.bool_)
    for (i0, j0), (i1, j1) in zip(first, last, strict=True):
        occupied[j0:j1, i0:i1] = True

    def cells(at: FloatArray) -> tuple[Any, Any]:
        row, column = np.searchsorted(y, at[..., 1], "right") - 1, np.searchsorted(x, at[..., 0], "right") - 1
        return np.clip(row, 0, len(y) - 2), np.clip(column, 0, len(x) - 2)

    home = None if robot is None else cells(np.asarray(robot))
    return np.asarray(enclosed_cells(occupied, home)[cells(points)])
