"""Comparison: the runs of one planner against those of another, how far ahead it is and how certainly."""

# Tested by tests/benchmark/report/test_summary.py.
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.report.data import Problem, Runs
from trailmark.benchmark.statistics import Interval, bootstrap_log_means, holm, quantiles, rank_test

__all__ = [
    "LEVEL",
    "MIN_RUNS",
    "REPLICATES",
    "SHIFT",
    "Comparison",
    "Sample",
    "adjusted",
    "at_limit",
    "compare",
    "cost_sample",
    "over_best",
    "time_sample",
]

FloatArray = NDArray[np.float64]

SHIFT = 0.01
"""Seconds, of the shifted geometric means of times."""

LEVEL = 0.05
"""A planner is called ahead of another where the adjusted probability of the test is below this."""

REPLICATES = 1000
MIN_RUNS = 5  # of each planner on each problem, for a bootstrap interval


@dataclass(frozen=True)
class Comparison:
    """One planner against another on the problems that both ran on.

    Attributes:
        a: a planner.
        b: another.
        problems: that both ran on.
        factor: b's mean over a's: above 1, a is the better.
        interval: 95 %, bootstrap over runs; None where the runs are too few.
        p: of the rank test, adjusted by Holm for all pairs.
        superiority: probability that a run of a beats one of b.
    """

    a: str
    b: str
    problems: int
    factor: float
    interval: Interval | None
    p: float
    superiority: float

    @property
    def winner(self) -> str | None:
        """Who is ahead; None where the test cannot tell."""
        if not self.p < LEVEL or self.superiority == 0.5:
            return None
        return self.a if self.superiority > 0.5 else self.b

    def seen_from(self, planner: str) -> Comparison:
        """Return the same comparison with ``planner`` as a."""
        if planner == self.a:
            return self
        turned = None if self.interval is None else Interval(1.0 / self.interval.high, 1.0 / self.interval.low)
        return Comparison(self.b, self.a, self.problems, 1.0 / self.factor, turned, self.p, 1.0 - self.superiority)


@dataclass(frozen=True)
class Sample:
    """The runs of a planner on one problem, as they are compared.

    Attributes:
        ranked: what ranks them, shape (n,); infinity for failures.
        logs: the mean logarithm of what is averaged and, where the runs suffice, of its bootstrap replicates, shape
            (1 + REPLICATES,) or (1,); None where nothing can be averaged.
        shift: what was added before taking logarithms.
    """

    ranked: FloatArray
    logs: FloatArray | None
    shift: float = 0.0


def time_sample(problem: Problem, runs: Runs, generator: np.random.Generator) -> Sample:
    """Return the seconds to the first solution; in means a failure counts as the limit."""
    return Sample(runs.first_times, _logs(at_limit(problem, runs) + SHIFT, generator), SHIFT)


def cost_sample(problem: Problem, runs: Runs, generator: np.random.Generator, best: float | None = None) -> Sample:
    """Return the final costs; means are of the runs that succeeded, over ``best`` or the best known of the problem."""
    ratios = over_best(runs.costs, problem.best_cost if best is None else best)
    return Sample(runs.costs, _logs(ratios[np.isfinite(ratios)], generator))


def at_limit(problem: Problem, runs: Runs) -> FloatArray:
    """Return the seconds to the first solution, a failure counting as the limit, whenever it happened."""
    first = runs.first_times
    return np.where(np.isinf(first), problem.time_limit, first)


def over_best(costs: FloatArray, best: float) -> FloatArray:
    """Return costs over the best known one; infinity for those not known, and for all but 0 if the best is 0."""
    ratios = np.full(len(costs), np.inf)
    known = np.isfinite(costs)
    ratios[known] = costs[known] / best if best > 0.0 else np.where(costs[known] == 0.0, 1.0, np.inf)
    return ratios


def compare(a: str, b: str, first: Mapping[int, Sample], second: Mapping[int, Sample]) -> Comparison:
    """Return how a's samples compare with b's on the problems that both have; p is not adjusted yet."""
    shared = [key for key in first if key in second]
    test = rank_test([(first[key].ranked, second[key].ranked) for key in shared])
    pairs = [(x, y) for key in shared if (x := first[key].logs) is not None and (y := second[key].logs) is not None]
    if not pairs:
        return Comparison(a, b, len(shared), math.nan, None, test.p, test.superiority)
    shift = first[shared[0]].shift
    # Where the runs on one problem are too few for replicates, there is no interval.
    size = min(len(logs) for pair in pairs for logs in pair)
    ours, theirs = (np.exp(np.mean([x[:size] for x in logs], axis=0)) - shift for logs in zip(*pairs, strict=True))
    # The shift may eat up a mean far below it.
    ratios = np.maximum(theirs, 1e-9) / np.maximum(ours, 1e-9)
    interval = None
    if size > 1:
        low, high = quantiles(ratios[1:], (0.025, 0.975))
        interval = Interval(float(low), float(high))
    return Comparison(a, b, len(shared), float(ratios[0]), interval, test.p, test.superiority)


def adjusted(found: Sequence[Comparison]) -> list[Comparison]:
    """Return comparisons with their probabilities adjusted by Holm for testing all of them."""
    return [replace(c, p=float(p)) for c, p in zip(found, holm([c.p for c in found]), strict=True)]


def _logs(averaged: FloatArray, generator: np.random.Generator) -> FloatArray | None:
    if len(averaged) == 0:
        return None
    mean = [float(np.log(averaged).mean())]
    if len(averaged) < MIN_RUNS:
        return np.array(mean)
    return np.concatenate([mean, bootstrap_log_means(averaged, REPLICATES, generator)])
