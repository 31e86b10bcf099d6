"""Summary: the figures of each planner over all its runs, and which planner is ahead of which, how certainly."""

# Tested by tests/benchmark/report/test_summary.py.
from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.report.comparison import (
    SHIFT,
    Comparison,
    Sample,
    adjusted,
    at_limit,
    compare,
    cost_sample,
    over_best,
    time_sample,
)
from trailmark.benchmark.report.data import Problem, Results, Runs
from trailmark.benchmark.statistics import Interval, quantiles, shifted_geometric_mean, wilson

__all__ = ["PlannerSummary", "Summary", "summarise", "summarise_runs"]

FloatArray = NDArray[np.float64]

FIVE = (0.05, 0.25, 0.5, 0.75, 0.95)


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
    return Summary(planners, _compare(results, names, time_sample), _compare(results, names, cost_sample))


def summarise_runs(problem: Problem, planner: str) -> PlannerSummary:
    """Return the figures of a planner's runs on one problem."""
    return _summary(planner, [(problem, problem.runs[planner])])


def _overall(results: Results, planner: str) -> PlannerSummary:
    return _summary(planner, [(p, p.runs[planner]) for p in results.problems if planner in p.runs])


def _summary(planner: str, parts: Sequence[tuple[Problem, Runs]]) -> PlannerSummary:
    runs = sum(len(r) for _, r in parts)
    success = sum(int(r.success.sum()) for _, r in parts)
    first_costs = [np.where(r.success, r["first_solution_length"], np.inf) for _, r in parts]
    first_ratios = [over_best(cost, p.best_cost) for cost, (p, _) in zip(first_costs, parts, strict=True)]
    ratios = [over_best(r.costs, p.best_cost) for p, r in parts]
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
        first_mean=_mean([at_limit(p, r) for p, r in parts]),
        cold_mean=_mean([at_limit(p, r) + r["setup_time"] for p, r in parts]),
        first=quantiles(np.concatenate([r.first_times for _, r in parts]), FIVE),
        first_ratio=quantiles(np.concatenate(first_ratios), FIVE),
        ratio=quantiles(np.concatenate(ratios), FIVE),
        mean_ratio=math.exp(float(np.mean(solved))) if solved else math.nan,
        endings=dict(sorted(endings.items(), key=lambda item: (-item[1], item[0]))),
    )


def _mean(times: Sequence[FloatArray]) -> float:
    """Return the shifted geometric mean of the problems' shifted geometric means."""
    return shifted_geometric_mean([shifted_geometric_mean(some, SHIFT) for some in times], SHIFT)


def _compare(results: Results, names: Sequence[str], sample: Callable[..., Sample]) -> dict[frozenset[str], Comparison]:
    generator = np.random.default_rng(6)
    samples: dict[str, dict[int, Sample]] = {name: {} for name in names}
    for problem in results.problems:
        for name, runs in problem.runs.items():
            samples[name][problem.key] = sample(problem, runs, generator)
    found = [compare(a, b, samples[a], samples[b]) for a, b in combinations(names, 2)]
    return {frozenset((c.a, c.b)): c for c in adjusted(found)}
