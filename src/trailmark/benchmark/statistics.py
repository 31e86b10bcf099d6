"""Statistics of repeated runs: intervals of shares, means of times with failures, ratios between planners.

A run that failed has no time and no cost: in means of times it counts as the time limit, in medians as infinity, that
is, as worse than every run that succeeded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

__all__ = ["Interval", "Ratio", "paired_ratio", "shifted_geometric_mean", "step_values", "wilson"]

FloatArray = NDArray[np.float64]

RESAMPLES = 2_000
"""Of the bootstrap."""


class Interval(NamedTuple):
    """An interval that holds the true value with a stated confidence."""

    low: float
    high: float


class Ratio(NamedTuple):
    """A geometric mean of ratios and its 95 % interval; NaN where nothing is known."""

    mean: float
    low: float
    high: float


def wilson(successes: int, n: int, confidence: float = 0.95) -> Interval:
    """Return Wilson's score interval of a share.

    E. B. Wilson (1927), Probable inference, the law of succession, and statistical inference, JASA 22.

    Args:
        successes: 0 to n.
        n: runs; with none the share may be anything from 0 to 1.
        confidence: above 0 and below 1.
    """
    if n == 0:
        return Interval(0.0, 1.0)
    found = stats.binomtest(successes, n).proportion_ci(confidence, method="wilson")
    return Interval(float(found.low), float(found.high))


def shifted_geometric_mean(values: ArrayLike, shift: float) -> float:
    """Return exp(mean log(v + shift)) − shift; NaN of no values.

    The shift keeps values much smaller than it from deciding the mean (H. Mittelmann's benchmarks of solvers).

    Args:
        values: shape (n,), above −shift.
        shift: in the unit of the values, above 0.
    """
    array = np.asarray(values, dtype=np.float64)
    return float(np.expm1(np.log1p(array / shift).mean()) * shift) if array.size else math.nan


def step_values(times: ArrayLike, values: ArrayLike, at: ArrayLike) -> FloatArray:
    """Return the lowest value reached until each moment; infinity before the first.

    Args:
        times: shape (n,), seconds, ascending.
        values: shape (n,), what was reached then.
        at: shape (m,), seconds.

    Returns:
        Shape (m,).
    """
    lowest = np.minimum.accumulate(np.concatenate([[np.inf], np.asarray(values, dtype=np.float64)]))
    return np.asarray(lowest[np.searchsorted(np.asarray(times, dtype=np.float64), at, side="right")])


def paired_ratio(pairs: Sequence[tuple[ArrayLike, ArrayLike]]) -> Ratio:
    """Return the geometric mean of a / b over problems, with a percentile bootstrap interval that resamples problems.

    With a single problem its pairs of runs are resampled.

    Args:
        pairs: for each problem the values of two planners with the same seeds, positive, each of shape (n,).
    """
    logs = [np.log(np.asarray(a, dtype=np.float64)) - np.log(np.asarray(b, dtype=np.float64)) for a, b in pairs]
    logs = [each for each in logs if len(each)]
    if not logs:
        return Ratio(math.nan, math.nan, math.nan)
    units = np.array([each.mean() for each in logs]) if len(logs) > 1 else logs[0]
    mean = math.exp(float(units.mean()))
    if len(units) < 2 or np.ptp(units) == 0.0:
        return Ratio(mean, mean, mean)
    found = stats.bootstrap((units,), np.mean, n_resamples=RESAMPLES, method="percentile", rng=np.random.default_rng(0))
    low, high = found.confidence_interval
    return Ratio(mean, math.exp(float(low)), math.exp(float(high)))
