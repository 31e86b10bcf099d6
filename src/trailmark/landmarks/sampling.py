"""Configurations drawn over a world, and K-means landmarks: those of them that are spread as all are."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError, expected_name
from trailmark.landmarks.relaxation import Relaxation
from trailmark.se2 import FloatArray

__all__ = ["RandomState", "draw", "farthest_samples", "free_samples", "generator", "k_means_landmarks", "lloyd"]

RandomState = int | np.random.Generator | None
"""A seed, a generator to draw from, or None for a random one."""

METHODS = ("uniform", "halton")

STEPS = 300
"""Of K-means at most, where none are asked for: it settles long before."""


def generator(random_state: RandomState) -> np.random.Generator:
    """Return a numpy generator for a seed; a generator is returned as it is."""
    return random_state if isinstance(random_state, np.random.Generator) else np.random.default_rng(random_state)


def draw(
    bounds: tuple[float, float, float, float],
    n: int,
    *,
    method: Literal["uniform", "halton"] = "uniform",
    random_state: RandomState = None,
) -> FloatArray:
    """Return n configurations over ``bounds`` and all headings, valid or not; shape (n, 3).

    Args:
        bounds: xmin, ymin, xmax, ymax in metres.
        n: how many, >= 0.
        method: ``uniform`` (independent) or ``halton`` (scrambled Halton sequence, bases 2, 3, 5; Halton 1960,
            scrambling by Owen 2017, Algorithm 1).
        random_state: seed or generator.

    Raises:
        ConfigurationError: an unknown method or a negative n.
    """
    if method not in METHODS:
        raise ConfigurationError(f"method: {expected_name(str(method), METHODS)}")
    if n < 0:
        raise ConfigurationError(f"n: expected 0 or more, got {n}")
    rng = generator(random_state)
    if method == "uniform":
        unit = rng.random((n, 3))
    else:
        own = rng.spawn(1)[0]
        unit = np.column_stack([_scrambled_digits(n, base, own) for base in (2, 3, 5)])
    low, high = np.array([bounds[0], bounds[1], -np.pi]), np.array([bounds[2], bounds[3], np.pi])
    q = np.asarray(low + unit * (high - low))
    q[:, 2] = se2.wrap(q[:, 2])
    return q


def _scrambled_digits(n: int, base: int, rng: np.random.Generator) -> FloatArray:
    """Return the first n numbers of the van der Corput sequence, each of its digits permuted; shape (n,).

    The same numbers as those of ``scipy.stats.qmc.Halton``, whose import alone takes longer than most plans.
    """
    permutations = [rng.permuted(np.arange(base)) for _ in range(math.ceil(54.0 / math.log2(base)) - 1)]
    numbers, rest, place = np.zeros(n), np.arange(n), 1.0
    for permutation in permutations:
        place /= base
        numbers += permutation[rest % base] * place
        rest //= base
    return numbers


def free_samples(
    checker: StateChecker,
    n: int,
    *,
    method: Literal["uniform", "halton"] = "uniform",
    reachable_from: FloatArray | None = None,
    random_state: RandomState = None,
    max_draws: int | None = None,
) -> FloatArray:
    """Return up to n valid configurations, shape (m, 3), m <= n.

    A disc robot's headings are all 0, unless it is a car.

    Args:
        checker: decides what is valid.
        n: how many are wanted, >= 0.
        method: see :func:`draw`.
        reachable_from: shape (3,): leave out what obstacles separate from this configuration (on the relaxation's
            grid: all that is left out is proven to be out of reach).
        random_state: seed or generator.
        max_draws: maximum number of configurations drawn, by default 50 n; fewer than n are returned if it is reached.

    Raises:
        ConfigurationError: an unknown method or a negative n.
    """
    draw(checker.world.bounds, min(n, 0), method=method)  # says what is wrong, even if none are wanted
    rng, region = generator(random_state), None
    if reachable_from is not None:
        relaxation = Relaxation(checker)
        region = relaxation.component(reachable_from)
    found = [np.empty((0, 3))]
    have, drawn, limit = 0, 0, 50 * n if max_draws is None else max_draws
    while have < n and drawn < limit:
        q = draw(checker.world.bounds, min(max(256, 2 * (n - have)), limit - drawn), method=method, random_state=rng)
        drawn += len(q)
        if not checker.robot.heading_matters:
            q[:, 2] = 0.0
        if region is not None:
            q = q[region[relaxation.cells(relaxation.disc_centers(q))]]
        q = q[checker.valid(q)] if len(q) else q
        found.append(q)
        have += len(q)
    return np.concatenate(found)[:n]


# --- K-means.


def k_means_landmarks(
    samples: FloatArray, k: int, *, radius: float, steps: int | None = None, random_state: RandomState = None
) -> FloatArray:
    """Return k landmarks, shape (m, 3), m <= min(k, n): valid configurations spread as the samples are.

    Lloyd's K-means (Lloyd 1982) in the embedding (x, y, R·cos θ, R·sin θ) of :func:`trailmark.se2.embed`, started
    from k of the samples (Forgy 1965). A centre may lie in an obstacle, so each is replaced by the sample nearest
    to it: landmarks are samples, and all different.

    Args:
        samples: valid configurations, shape (n, 3).
        k: how many landmarks, >= 1; with k >= n every sample is a landmark.
        radius: R of the embedding, metres; 0 leaves headings out.
        steps: maximum number of steps; the first few bring most of the improvement. None iterates until no sample
            changes its cluster.
        random_state: seed or generator; the same one gives the same landmarks.

    Raises:
        ConfigurationError: k < 1.
    """
    from scipy.spatial import cKDTree

    if k < 1:
        raise ConfigurationError(f"landmarks: expected 1 or more, got {k}")
    if k >= len(samples):
        return np.array(samples)
    points = se2.embed(samples, radius)
    first = points[generator(random_state).choice(len(points), k, replace=False)]
    centres = lloyd(points, first, STEPS if steps is None else steps)
    return np.array(samples[np.unique(cKDTree(points).query(centres)[1])])


def farthest_samples(samples: FloatArray, landmarks: FloatArray, k: int, *, radius: float) -> FloatArray:
    """Return the k samples farthest from their nearest landmark, in the samples' order, shape (min(k, n), 3).

    Landmarks that come in parts are each spread evenly within their part, but all together little better than at
    random, unless those to come are clusters of what lies between the others.

    Args:
        samples: valid configurations, shape (n, 3).
        landmarks: those that are there already, shape (m, 3), m >= 1.
        k: how many, >= 1.
        radius: R of the embedding, metres, as in :func:`k_means_landmarks`.
    """
    from scipy.spatial import cKDTree

    if k >= len(samples):
        return samples
    apart = cKDTree(se2.embed(landmarks, radius)).query(se2.embed(samples, radius))[0]
    return np.asarray(samples[np.sort(np.argpartition(-apart, k)[:k])])


def lloyd(points: FloatArray, centres: FloatArray, steps: int) -> FloatArray:
    """Return the centres, shape (k, d), after so many steps of Lloyd's algorithm, or where no point changes cluster.

    These are scikit-learn's steps. Its import takes longer than most queries, and the distances to all k centres, which
    a k-d tree makes unnecessary here, would take most of a planning round.

    Args:
        points: shape (n, d).
        centres: shape (k, d), at the start; a centre that is nearest to no point is not moved.
        steps: how many at most, >= 0.
    """
    from scipy.spatial import cKDTree

    centres, before = np.array(centres), None
    for _ in range(steps):
        owner = np.asarray(cKDTree(centres).query(points)[1])
        if before is not None and np.array_equal(owner, before):
            break
        before, count = owner, np.bincount(owner, minlength=len(centres))
        sums = [np.bincount(owner, weights=values, minlength=len(centres)) for values in points.T]
        used: NDArray[np.bool_] = count > 0
        centres[used] = (np.column_stack(sums) / np.maximum(count, 1)[:, None])[used]
    return centres
