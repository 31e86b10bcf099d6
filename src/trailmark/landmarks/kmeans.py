"""Landmarks: K-means centres of valid configurations, each replaced by the sample nearest to it."""

from __future__ import annotations

import warnings
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.errors import ConfigurationError
from trailmark.landmarks.sampling import RandomState, generator
from trailmark.nearest import nearest_to

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

__all__ = ["farthest_samples", "k_means_landmarks", "lloyd", "one_thread"]

FloatArray = NDArray[np.float64]


def k_means_landmarks(
    samples: se2.FloatArray,
    k: int,
    *,
    radius: float,
    steps: int | None = None,
    random_state: RandomState = None,
) -> se2.FloatArray:
    """Return k landmarks, shape (m, 3), m <= min(k, n): valid configurations spread as the samples are.

    Lloyd's K-means (Lloyd 1982) in the embedding (x, y, R·cos θ, R·sin θ) of :func:`trailmark.se2.embed`, started
    from k of the samples (Forgy 1965). A centre may lie in an obstacle, so each is replaced by the sample nearest
    to it: landmarks are samples, and all different.

    Args:
        samples: valid configurations, shape (n, 3).
        k: how many landmarks, >= 1; with k >= n every sample is a landmark.
        radius: R of the embedding, metres; 0 leaves headings out.
        steps: maximum number of steps (:func:`lloyd`); the first few bring most of the improvement. None iterates until
            no sample changes its cluster (scikit-learn).
        random_state: seed or generator; the same one gives the same landmarks.

    Raises:
        ConfigurationError: k < 1.
    """
    if k < 1:
        raise ConfigurationError(f"landmarks: expected 1 or more, got {k}")
    if k >= len(samples):
        return np.array(samples)
    points = se2.embed(samples, radius)
    first = points[generator(random_state).choice(len(points), k, replace=False)]
    centres = _converged(points, first) if steps is None else lloyd(points, first, steps)
    return np.array(samples[np.unique(nearest_to(centres, points))])


def farthest_samples(samples: se2.FloatArray, landmarks: se2.FloatArray, k: int, *, radius: float) -> se2.FloatArray:
    """Return the k samples farthest from their nearest landmark, in the samples' order, shape (min(k, n), 3).

    Landmarks that come in parts are each spread evenly within their part, but all together little better than at
    random, unless those to come are clusters of what lies between the others.

    Args:
        samples: valid configurations, shape (n, 3).
        landmarks: those that are there already, shape (m, 3), m >= 1.
        k: how many, >= 1.
        radius: R of the embedding, metres, as in :func:`k_means_landmarks`.
    """
    if k >= len(samples):
        return samples
    points, centres = se2.embed(samples, radius), se2.embed(landmarks, radius)
    apart = ((points - centres[nearest_to(points, centres)]) ** 2).sum(axis=1)
    return np.asarray(samples[np.sort(np.argpartition(-apart, k)[:k])])


def lloyd(points: FloatArray, centres: FloatArray, steps: int) -> FloatArray:
    """Return the centres, shape (k, d), after some steps of Lloyd's algorithm.

    These are scikit-learn's steps. Its import takes longer than most queries, and the distances to all k centres, which
    a k-d tree makes unnecessary here, would take most of a planning round.

    Args:
        points: shape (n, d).
        centres: shape (k, d), at the start; a centre that is nearest to no point is not moved.
        steps: how many, >= 0.
    """
    centres = np.array(centres)
    for _ in range(steps):
        owner = nearest_to(points, centres)
        count = np.bincount(owner, minlength=len(centres))
        used = count > 0
        for axis in range(points.shape[1]):
            total = np.bincount(owner, weights=points[:, axis], minlength=len(centres))
            centres[used, axis] = total[used] / count[used]
    return centres


def _converged(points: FloatArray, first: FloatArray) -> FloatArray:
    from sklearn.cluster import KMeans
    from sklearn.exceptions import ConvergenceWarning

    with one_thread(), warnings.catch_warnings():
        # Fewer distinct samples than clusters are no fault here: there are fewer landmarks then.
        warnings.simplefilter("ignore", ConvergenceWarning)
        k_means = KMeans(len(first), init=first, n_init=1, max_iter=300, tol=0.0, algorithm="lloyd").fit(points)
    return np.asarray(k_means.cluster_centers_)


# --- One thread for scikit-learn, so that the same seed gives the same centres.


def one_thread() -> AbstractContextManager[object]:
    """Return a context in which scikit-learn computes in one thread.

    With more threads its sums are rounded in an order that changes from run to run.
    """
    context: AbstractContextManager[object] = _thread_pools().limit(limits=1)
    return context


@lru_cache(maxsize=1)
def _thread_pools() -> Any:
    import sklearn.cluster  # noqa: F401  # loads the thread pools that the controller then finds
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
