"""Summary: the figures of each planner over all its runs, and which planner is ahead of which, how certainly."""

# Tested by tests/benchmark/report/test_summary.py.
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.report.data import Problem, Results, Runs
from trailmark.benchmark.statistics import (
    Interval,
    bootstrap_log_means,
    holm,
    quantiles,
    rank_test,
    shifted_geometric_mean,
    wilson,
)

__all__ = [
    "LEVEL",
    "MIN_RUNS",
    "REPLICATES",
    "SHIFT",
    "Comparison",
    "PlannerSummary",
    "Summary",
    "summarise",
    "summarise_runs",
]

FloatArray = NDArray[np.float64]

SHIFT = 0.01
"""Seconds, of the shifted geometric means of times."""

LEVEL = 0.05
"""A planner is called ahead of another where the adjusted probability of the test is below this."""

FIVE = (0.05, 0.25, 0.5, 0.75, 0.95)
REPLICATES = 1000
MIN_RUNS = 5  # of each planner on each problem, for a bootstrap interval


@dataclass(frozen=True)
class PlannerSummary:
    """The figures of a planner's runs, on one problem or on all.

    Attributes:
        planner: its name.
        problems: how many it ran on.
        runs: in all.
        claimed: how many of them the planner calls solved.
        success: how many of those the referee calls correct.
        interval: Wilson's, 95 %, of success over runs.
        first_mean: shifted geometric mean of the seconds to the first solution, failures at the limit; over problems
            the mean of the problems' means.
        cold_mean: the same from the world's file on: what loading it and building the checker took is added to each
            run; NaN where that is not known of all.
        first: quantiles 5, 25, 50, 75 and 95 % of the seconds to the first solution; infinity: failed.
        first_ratio: quantiles of the first solution's cost over the best known.
        ratio: quantiles of the final cost over the best known; infinity: failed.
        mean_ratio: geometric mean of the final cost over the best known, of the runs that succeeded.
        endings: how the runs without success ended.
    """

    planner: str
    problems: int
    runs: int
    claimed: int
    success: int
    interval: Interval
    first_mean: float
    cold_mean: float
    first: FloatArray
    first_ratio: FloatArray
    ratio: FloatArray
    mean_ratio: float
    endings: Mapping[str, int]

    @property
    def missing(self) -> float:
        """Share of the runs without success."""
        return 1.0 - self.success / self.runs


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
class Summary:
    """A whole results database in numbers.

    Attributes:
        planners: in the order of ``first_mean``, the quickest first.
        times: time to the first solution, of every pair of planners.
        costs: final cost, of every pair of planners.
    """

    planners: Sequence[PlannerSummary]
    times: Mapping[frozenset[str], Comparison]
    costs: Mapping[frozenset[str], Comparison]

    def by_cost(self) -> list[PlannerSummary]:
        """Return the planners in the order of the final cost's median, then of the share of failures."""
        return sorted(self.planners, key=lambda s: (s.ratio[2], s.missing, s.mean_ratio))


def summarise(results: Results) -> Summary:
    """Return the figures of all runs. The same database gives the same numbers: the bootstrap has a fixed seed."""
    planners = sorted((_overall(results, planner) for planner in results.planners), key=lambda s: s.first_mean)
    names = [s.planner for s in planners]
    return Summary(planners, _compare(results, names, "first"), _compare(results, names, "cost"))


def summarise_runs(problem: Problem, planner: str) -> PlannerSummary:
    """Return the figures of a planner's runs on one problem."""
    return _summary(planner, [(problem, problem.runs[planner])])


def _overall(results: Results, planner: str) -> PlannerSummary:
    return _summary(planner, [(p, p.runs[planner]) for p in results.problems if planner in p.runs])


def _summary(planner: str, parts: Sequence[tuple[Problem, Runs]]) -> PlannerSummary:
    runs = sum(len(r) for _, r in parts)
    success = sum(int(r.success.sum()) for _, r in parts)
    first_costs = [np.where(r.success, r["first_solution_length"], np.inf) for _, r in parts]
    first_ratios = [_over_best(p, cost) for cost, (p, _) in zip(first_costs, parts, strict=True)]
    ratios = [_over_best(p, r.costs) for p, r in parts]
    endings: dict[str, int] = {}
    for _, r in parts:
        for how, n in r.endings().items():
            endings[how] = endings.get(how, 0) + n
    solved = [np.log(ratio[np.isfinite(ratio)]).mean() for ratio in ratios if np.isfinite(ratio).any()]
    return PlannerSummary(
        planner=planner,
        problems=len(parts),
        runs=runs,
        claimed=sum(int(r.claimed.sum()) for _, r in parts),
        success=success,
        interval=wilson(success, runs),
        first_mean=_mean([_at_limit(p, r) for p, r in parts]),
        cold_mean=_mean([_at_limit(p, r) + r["setup_time"] for p, r in parts]),
        first=quantiles(np.concatenate([r.first_times for _, r in parts]), FIVE),
        first_ratio=quantiles(np.concatenate(first_ratios), FIVE),
        ratio=quantiles(np.concatenate(ratios), FIVE),
        mean_ratio=math.exp(float(np.mean(solved))) if solved else math.nan,
        endings=dict(sorted(endings.items(), key=lambda item: (-item[1], item[0]))),
    )


def _mean(times: Sequence[FloatArray]) -> float:
    """Return the shifted geometric mean of the problems' shifted geometric means."""
    return shifted_geometric_mean([shifted_geometric_mean(some, SHIFT) for some in times], SHIFT)


def _at_limit(problem: Problem, runs: Runs) -> FloatArray:
    """Return the seconds to the first solution, a failure counting as the limit, whenever it happened."""
    first = runs.first_times
    return np.where(np.isinf(first), problem.time_limit, first)


def _over_best(problem: Problem, costs: FloatArray) -> FloatArray:
    """Return costs over the best known one; infinity for those not known, and for all but 0 if the best is 0."""
    best = problem.best_cost
    ratios = np.full(len(costs), np.inf)
    known = np.isfinite(costs)
    ratios[known] = costs[known] / best if best > 0.0 else np.where(costs[known] == 0.0, 1.0, np.inf)
    return ratios


def _compare(results: Results, names: Sequence[str], what: str) -> dict[frozenset[str], Comparison]:
    generator = np.random.default_rng(6)
    values: dict[str, dict[int, FloatArray]] = {name: {} for name in names}
    logs: dict[str, dict[int, FloatArray]] = {name: {} for name in names}
    for problem in results.problems:
        for name, runs in problem.runs.items():
            ranked = runs.first_times if what == "first" else runs.costs
            values[name][problem.key] = ranked
            if what == "first":
                averaged = _at_limit(problem, runs) + SHIFT
            else:
                ratios = _over_best(problem, runs.costs)
                averaged = ratios[np.isfinite(ratios)]
            if len(averaged):
                mean = float(np.log(averaged).mean())
                few = len(averaged) < MIN_RUNS
                spread = np.full(REPLICATES, np.nan) if few else bootstrap_log_means(averaged, REPLICATES, generator)
                logs[name][problem.key] = np.concatenate([[mean], spread])
    pairs = list(combinations(names, 2))
    found = [_pair(a, b, values, logs, SHIFT if what == "first" else 0.0) for a, b in pairs]
    adjusted = holm([c.p for c in found]) if found else np.empty(0)
    return {
        frozenset((c.a, c.b)): Comparison(c.a, c.b, c.problems, c.factor, c.interval, float(p), c.superiority)
        for c, p in zip(found, adjusted, strict=True)
    }


def _pair(
    a: str,
    b: str,
    values: Mapping[str, Mapping[int, FloatArray]],
    logs: Mapping[str, Mapping[int, FloatArray]],
    shift: float,
) -> Comparison:
    shared = [key for key in values[a] if key in values[b]]
    test = rank_test([(values[a][key], values[b][key]) for key in shared])
    both = [key for key in shared if key in logs[a] and key in logs[b]]
    if not both:
        return Comparison(a, b, len(shared), math.nan, None, test.p, test.superiority)
    first, second = (np.exp(np.mean([logs[name][key] for key in both], axis=0)) - shift for name in (a, b))
    # The shift may eat up a mean far below it.
    ratios = np.maximum(second, 1e-9) / np.maximum(first, 1e-9)
    interval = None
    if np.isfinite(ratios[1:]).all():
        low, high = quantiles(ratios[1:], (0.025, 0.975))
        interval = Interval(float(low), float(high))
    return Comparison(a, b, len(shared), float(ratios[0]), interval, test.p, test.superiority)
