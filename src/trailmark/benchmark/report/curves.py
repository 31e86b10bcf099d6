"""Cost against time: what share of a planner's runs has reached which cost by when."""

# Tested by tests/benchmark/report/test_summary.py.
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.report.data import Problem, Results, Runs
from trailmark.benchmark.statistics import quantiles, step_values

__all__ = ["MOMENTS", "CostCurve", "cost_curves", "overall_curves", "time_grid"]

FloatArray = NDArray[np.float64]

MOMENTS = 48
"""Moments that a curve is read at, evenly apart in the logarithm."""


@dataclass(frozen=True)
class CostCurve:
    """The cost of the best path so far over the runs of a planner.

    Attributes:
        times: seconds, shape (m,).
        quartiles: 25, 50 and 75 %, shape (3, m); infinity where too few runs have a path. Failed runs never have one.
        missing: share of the runs without a path, shape (m,).
    """

    times: FloatArray
    quartiles: FloatArray
    missing: FloatArray


def time_grid(problems: Sequence[Problem]) -> FloatArray:
    """Return moments from the first solution of any planner to the longest limit, shape (MOMENTS,)."""
    limit = max(problem.time_limit for problem in problems)
    firsts = [runs.first_times.min() for problem in problems for runs in problem.runs.values() if len(runs)]
    begun = min(min(firsts, default=limit), limit)
    return np.geomspace(max(1e-4, 0.8 * min(begun, 0.5 * limit)), limit, MOMENTS)


def cost_curves(problem: Problem, ratio: bool = False) -> dict[str, CostCurve]:
    """Return a curve for each planner on a problem.

    Args:
        problem: whose runs.
        ratio: costs over the best known one, instead of metres.
    """
    times = time_grid([problem])
    unit = problem.best_cost if ratio else 1.0
    return {name: _curve(times, [_costs(runs, times) / unit]) for name, runs in problem.runs.items()}


def overall_curves(results: Results) -> dict[str, CostCurve]:
    """Return a curve for each planner over all its runs, in units of each problem's best known cost."""
    times = time_grid(results.problems)
    return {
        name: _curve(times, [_costs(p.runs[name], times) / _unit(p) for p in results.problems if name in p.runs])
        for name in results.planners
    }


def _unit(problem: Problem) -> float:
    return problem.best_cost if 0.0 < problem.best_cost < np.inf else 1.0


def _curve(times: FloatArray, parts: Sequence[FloatArray]) -> CostCurve:
    costs = np.concatenate(parts)
    return CostCurve(times, quantiles(costs, (0.25, 0.5, 0.75)), np.isinf(costs).mean(axis=0))


def _costs(runs: Runs, times: FloatArray) -> FloatArray:
    """Return the best cost of each run at each moment, shape (n, m); infinity before it and for failed runs."""
    costs = np.full((len(runs), len(times)), np.inf)
    first_times, first_costs = runs.first_times, runs["first_solution_length"]
    for i in np.flatnonzero(runs.success).tolist():
        seconds, reached = runs.curves[i]
        if len(seconds) == 0 and np.isfinite(first_costs[i]):
            seconds, reached = np.array([first_times[i]]), np.array([first_costs[i]])
        # The path as returned: known from the end of planning on.
        end, final = runs["time"][i], runs.costs[i]
        if np.isfinite(end) and np.isfinite(final):
            order = np.argsort(np.append(seconds, end), kind="stable")
            seconds, reached = np.append(seconds, end)[order], np.append(reached, final)[order]
        costs[i] = step_values(seconds, reached, times)
    return costs
