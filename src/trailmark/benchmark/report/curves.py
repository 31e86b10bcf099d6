"""Cost against time: which costs a planner's runs have reached by when."""

# Tested by tests/benchmark/report/test_summary.py.
from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.report.data import Problem, Runs
from trailmark.benchmark.statistics import quantiles, step_values

__all__ = ["cost_quartiles", "time_grid"]

FloatArray = NDArray[np.float64]


def time_grid(problems: Sequence[Problem], moments: int) -> FloatArray:
    """Return moments from the first solution of any planner to the longest limit, shape (moments,).

    They are evenly apart in the logarithm.
    """
    limit = max(problem.time_limit for problem in problems)
    firsts = [runs.first_times.min() for problem in problems for runs in problem.runs.values() if len(runs)]
    begun = min(min(firsts, default=limit), limit)
    return np.geomspace(max(1e-4, 0.8 * min(begun, 0.5 * limit)), limit, moments)


def cost_quartiles(runs: Runs, times: FloatArray) -> FloatArray:
    """Return the quartiles of the best cost of a planner's runs by each moment, shape (3, m).

    Infinity where too few runs have a path; failed runs never have one.
    """
    return quantiles(_costs(runs, times), (0.25, 0.5, 0.75))


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
