"""Statistics of repeated runs: intervals of shares, means of times with failures, rank tests, their correction.

A run that failed has no time and no cost: in means of times it counts as the time limit, in ranks and quantiles as
infinity, that is, as worse than every run that succeeded.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

__all__ = [
    "EXACT_RUNS",
    "Interval",
    "RankTest",
    "bootstrap_log_means",
    "holm",
    "least_probability",
    "quantiles",
    "rank_test",
    "runs_needed",
    "shifted_geometric_mean",
    "step_values",
    "wilson",
]

FloatArray = NDArray[np.float64]
Ranks = dict[tuple[int, int], FloatArray]
"""For each pair of numbers of runs, n of a and m of b, the ranks on each problem with so many, shape (s, n + m)."""

EXACT_RUNS = 40
"""Up to so many runs in all, a rank test counts every permutation; above, it takes the normal distribution."""

_EXACT_SUMS = 20_000  # no exact test over more different rank sums than this


class Interval(NamedTuple):
    """An interval that holds the true value with a stated confidence."""

    low: float
    high: float


class RankTest(NamedTuple):
    """What a rank test says of planner a against planner b, smaller values being better.

    Attributes:
        p: two-sided probability of ranks as uneven as these if the two do not differ.
        superiority: share of pairs in which the run of a is the smaller, ties counting half; over several
            problems the mean with the weights of the test, so that the two agree on who is ahead.
    """

    p: float
    superiority: float


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
        shift: in the unit of the values, 0 or more.
    """
    array = np.asarray(values, dtype=np.float64)
    if not array.size:
        return math.nan
    if shift == 0.0:
        return float(np.exp(np.log(array).mean()))
    return float(np.expm1(np.log1p(array / shift).mean()) * shift)


def quantiles(values: ArrayLike, shares: Sequence[float]) -> FloatArray:
    """Return quantiles along the first axis; values may be infinite.

    Definition 2 of R. J. Hyndman and Y. Fan (1996), Sample quantiles in statistical packages: a value of the sample,
    or the mean of two neighbours. Interpolating ones would mix infinity into quantiles far from it.

    Args:
        values: shape (n, ...), without NaN, n >= 1.
        shares: m numbers from 0 to 1.

    Returns:
        Shape (m, ...).
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64), axis=0)
    n = len(ordered)
    found = []
    for share in shares:
        at = share * n
        whole = abs(at - round(at)) < 1e-9
        upper = min(n - 1, round(at) if whole else math.floor(at))
        lower = max(0, upper - 1) if whole and 0 < round(at) < n else upper
        # Halves first: the sum of two large numbers is not one.
        found.append(0.5 * ordered[lower] + 0.5 * ordered[upper] if lower != upper else ordered[upper])
    return np.array(found)


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


def rank_test(pairs: Sequence[tuple[ArrayLike, ArrayLike]]) -> RankTest:
    """Test whether two planners differ, by the ranks of their runs within each problem.

    With one problem this is the Mann–Whitney test (Wilcoxon's rank sum); with more, van Elteren's: the rank sums of
    the problems, each divided by its number of runs plus 1, added up. Up to :data:`EXACT_RUNS` runs in all the
    probability is exact (every way to share out the ranks, ties included); above, it is normal with the variance
    that the ties leave.

    Source: P. H. van Elteren (1960), On the combination of independent two-sample tests of Wilcoxon, Bull. Inst.
    Internat. Statist. 37.

    Args:
        pairs: for each problem the values of a, shape (n,), and of b, shape (m,); failures are infinity. Problems in
            which either has none are left out.
    """
    strata = [(np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)) for a, b in pairs]
    strata = [(a, b) for a, b in strata if len(a) and len(b)]
    if not strata:
        return RankTest(1.0, 0.5)
    # Problems with the same numbers of runs are ranked at once: there may be thousands.
    alike: dict[tuple[int, int], list[FloatArray]] = {}
    for a, b in strata:
        alike.setdefault((len(a), len(b)), []).append(np.concatenate([a, b]))
    ranks = {sizes: np.asarray(stats.rankdata(np.array(values), axis=1)) for sizes, values in alike.items()}
    wins = weight = 0.0
    for (n, m), rows in ranks.items():
        share = n * m / (n + m + 1)
        wins += share * float((1.0 - (rows[:, :n].sum(axis=1) - n * (n + 1) / 2.0) / (n * m)).sum())
        weight += share * len(rows)
    p = _exact(ranks)
    return RankTest(_normal(ranks) if p is None else p, wins / weight)


def holm(p: ArrayLike) -> FloatArray:
    """Return probabilities adjusted for testing them all, shape (n,): S. Holm (1979), Scand. J. Statist. 6."""
    array = np.asarray(p, dtype=np.float64)
    order = np.argsort(array, kind="stable")
    steps = np.maximum.accumulate(array[order] * (len(array) - np.arange(len(array))))
    adjusted = np.empty_like(array)
    adjusted[order] = np.minimum(steps, 1.0)
    return adjusted


def least_probability(sizes: Sequence[tuple[int, int]]) -> float:
    """Return the lowest probability :func:`rank_test` can give: every run of one planner beats all of the other.

    Args:
        sizes: for each problem, how many runs a and b have on it.
    """
    return rank_test([(np.arange(n), np.arange(n, n + m)) for n, m in sizes]).p


def runs_needed(tests: int, problems: int, level: float) -> int:
    """Return how many runs of each planner on each problem it takes for a difference to be shown at all.

    With fewer, even the lowest probability is not below the level after Holm's correction, which multiplies the lowest
    of them by the number of tests.

    Args:
        tests: that are adjusted together, 1 or more.
        problems: that every test adds up, 1 or more.
        level: of the adjusted probability, above 0.
    """
    return next(n for n in itertools.count(1) if tests * least_probability([(n, n)] * problems) < level)


def bootstrap_log_means(values: ArrayLike, replicates: int, generator: np.random.Generator) -> FloatArray:
    """Return the mean logarithm of resampled values, shape (replicates,).

    Args:
        values: shape (n,), n >= 1, positive.
        replicates: how often n values are drawn with replacement.
        generator: draws them.
    """
    logs = np.log(np.asarray(values, dtype=np.float64))
    return np.asarray(logs[generator.integers(len(logs), size=(replicates, len(logs)))].mean(axis=1))


def _normal(ranks: Ranks) -> float:
    difference = variance = 0.0
    for (n, m), rows in ranks.items():
        weight = 1.0 / (n + m + 1)
        difference += weight * float((rows[:, :n].sum(axis=1) - n * (n + m + 1) / 2.0).sum())
        # Of a sum of n ranks drawn without putting back: with ties it is smaller than without.
        variance += weight**2 * n * m / (n + m) * float(rows.var(axis=1, ddof=1).sum())
    if variance <= 0.0:
        return 1.0
    # A rank sum goes in steps of half a rank with ties, of one without: half a step of slack for one problem.
    (n, m), rows = next(iter(ranks.items()))
    slack = 0.5 / (n + m + 1) if len(ranks) == len(rows) == 1 else 0.0
    return math.erfc(max(0.0, abs(difference) - slack) / math.sqrt(2.0 * variance))


def _exact(ranks: Ranks) -> float | None:
    """Return the exact probability, or None where there are too many ways to count."""
    if sum(rows.size for rows in ranks.values()) > EXACT_RUNS:
        return None
    common = math.lcm(*(n + m + 1 for n, m in ranks))
    whole = np.ones(1)
    observed = 0
    for n, m, rank in ((n, m, rank) for (n, m), rows in ranks.items() for rank in rows):
        step = common // (n + m + 1)
        doubled = np.round(2.0 * rank).astype(np.int64)  # midranks are halves
        counts = _rank_sums(doubled, n)
        if (len(whole) + step * len(counts)) > _EXACT_SUMS:
            return None
        spread = np.zeros(step * (len(counts) - 1) + 1)
        spread[::step] = counts / counts.sum()
        whole = np.convolve(whole, spread)
        observed += step * int(doubled[:n].sum())
    sums = np.arange(len(whole))
    middle = float(whole @ sums)
    extreme = np.abs(sums - middle) >= abs(observed - middle) - 1e-6 * max(1.0, middle)
    return min(1.0, float(whole[extreme].sum()))


def _rank_sums(ranks: NDArray[np.int64], n: int) -> FloatArray:
    """Return in how many ways n of the ranks add up to each whole number from 0."""
    ways = np.zeros((n + 1, int(ranks.sum()) + 1))
    ways[0, 0] = 1.0
    for rank in ranks:
        for k in range(n, 0, -1):
            ways[k, rank:] += ways[k - 1, : ways.shape[1] - rank]
    return np.asarray(ways[n])
