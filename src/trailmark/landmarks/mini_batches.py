"""K-means of very many samples by mini-batches, in bounded memory, with progress."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from trailmark.landmarks.sampling import RandomState, generator
from trailmark.landmarks.threads import one_thread

if TYPE_CHECKING:
    from trailmark.landmarks.paper import Clusters, Initialisation

__all__ = ["mini_batch_clusters"]

BATCH = 10_000
"""Samples processed at a time; the largest array holds their distances to all centres."""

FIRST = 100_000
"""Maximum number of samples that the first centres are chosen from."""


def mini_batch_clusters(
    samples: ArrayLike,
    k: int,
    init: Initialisation = "forgy",
    random_state: RandomState = None,
    *,
    on_progress: Callable[[int, int], None] | None = None,
) -> Clusters:
    """Return k clusters by mini-batches (Sculley 2010; scikit-learn): one pass over the samples in random order.

    The result is no fixed point of Lloyd's algorithm: its inertia is a few per cent larger.

    Args:
        samples: shape (n, d).
        k: how many clusters, 1 to the number of different samples.
        init: see :func:`~trailmark.landmarks.paper.initial_centres`; on a part of the samples where they are many.
        random_state: seed or generator; the same one gives the same clusters.
        on_progress: called after every batch with the number of samples processed and of all.

    Raises:
        ConfigurationError: as :func:`~trailmark.landmarks.paper.algorithm_1`.
    """
    from scipy.spatial import cKDTree
    from sklearn.cluster import MiniBatchKMeans

    from trailmark.landmarks.paper import Clusters, initial_centres

    points, rng = np.asarray(samples, dtype=np.float64), generator(random_state)
    order = rng.permutation(len(points))
    first = initial_centres(points[order[: max(FIRST, 10 * k)]], k, init, rng)
    seed = int(rng.integers(2**31))
    # Labels are found once, at the end; with compute_labels every batch would be searched twice.
    steps = MiniBatchKMeans(k, init=first, n_init=1, random_state=seed, compute_labels=False)
    batches = 0
    for begin in range(0, len(points), BATCH):
        with one_thread():
            steps.partial_fit(points[order[begin : begin + BATCH]])
        batches += 1
        if on_progress is not None:
            on_progress(min(begin + BATCH, len(points)), len(points))
    centres = np.asarray(steps.cluster_centers_, dtype=np.float64)
    found = cKDTree(centres).query(points)
    distance, labels = np.asarray(found[0], dtype=np.float64), np.asarray(found[1], dtype=np.int32)
    return Clusters(centres, labels, float(distance @ distance), batches)
