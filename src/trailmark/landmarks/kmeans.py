"""Landmarks: K-means centres of valid configurations, repaired so that each is valid itself."""

from __future__ import annotations

import warnings
from functools import lru_cache
from typing import Any

import numpy as np

from trailmark import se2
from trailmark.errors import ConfigurationError
from trailmark.landmarks.sampling import RandomState, generator

__all__ = ["k_means_landmarks"]


@lru_cache(maxsize=1)
def _threadpools() -> Any:
    import sklearn.cluster  # noqa: F401  # loads the thread pools that the controller then finds
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def k_means_landmarks(
    samples: se2.FloatArray,
    k: int,
    *,
    radius: float,
    steps: int = 3,
    random_state: RandomState = None,
) -> se2.FloatArray:
    """Return k landmarks, shape (min(k, n), 3): valid configurations spread as the samples are.

    Lloyd's K-means (MacQueen 1967; Lloyd 1982) from scikit-learn in the embedding (x, y, R·cos θ, R·sin θ) of
    :func:`trailmark.se2.embed`, started from k of the samples (Forgy). A centre may lie in an obstacle, so each is
    replaced by the sample nearest to it; landmarks are therefore samples, and no two of them are the same one.

    Args:
        samples: valid configurations, shape (n, 3).
        k: how many landmarks, >= 1; with k >= n every sample is a landmark.
        radius: R of the embedding, metres; 0 leaves headings out.
        steps: Lloyd iterations; the first few bring nearly all of the spread, and landmarks need no fixed point.
        random_state: seed or generator; the same one gives the same landmarks.

    Raises:
        ConfigurationError: k < 1.
    """
    if k < 1:
        raise ConfigurationError(f"landmarks: {k} given, allowed: 1 or more")
    if k >= len(samples):
        return np.array(samples)
    from scipy.spatial import cKDTree
    from sklearn.cluster import KMeans
    from sklearn.exceptions import ConvergenceWarning

    rng = generator(random_state)
    points = se2.embed(samples, radius)
    first = points[rng.choice(len(points), k, replace=False)]
    # One thread: with more, sums are rounded in an order that changes from run to run.
    with _threadpools().limit(limits=1), warnings.catch_warnings():
        # A cluster too many for the data is no fault here: it only means one landmark less.
        warnings.simplefilter("ignore", ConvergenceWarning)
        centres = (
            KMeans(k, init=first, n_init=1, max_iter=steps, tol=0.0, algorithm="lloyd").fit(points).cluster_centers_
        )
    nearest = np.unique(cKDTree(points).query(centres)[1])
    return np.array(samples[nearest])
