"""How much landmarks differ from one run to the next: centres matched between runs, and their distances."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.errors import ConfigurationError

__all__ = ["Spread", "matched_distances", "spread_of_runs"]

FloatArray = NDArray[np.float64]


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
