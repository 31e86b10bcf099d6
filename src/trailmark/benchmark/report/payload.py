"""What the page's charts are drawn from: the times and costs of all runs, in few characters.

Times and costs are kept as whole steps of their logarithms, sorted, each as its difference to the one before: three
significant digits in a byte or two once the whole is compressed. Costs are relative to the best known of the problem.
"""

# Tested by tests/benchmark/report/test_payload.py.
from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.report.comparison import SHIFT
from trailmark.benchmark.report.curves import cost_quartiles, time_grid
from trailmark.benchmark.report.data import Problem, Results, Runs
from trailmark.benchmark.report.palette import FAMILIES, Style, family_of

__all__ = ["STEPS", "compressed", "cost_steps", "payload", "stairs"]

FloatArray = NDArray[np.float64]

STEPS = 2048
"""Steps for a factor of e: half of one is 0.024 %."""

SOONEST = 1e-7  # seconds: a time of 0 has no logarithm
MAX_CURVES = 120_000  # numbers that all curves of cost over time take together
MOMENTS = (6, 32)  # at least and at most, of such a curve


def payload(results: Results, styles: Mapping[str, Style]) -> dict[str, Any]:
    """Return what the charts need, as plain lists and numbers.

    ``problems`` has for each its name, its limit, its best known cost (null without any), and a cell for each planner:
    null, or the number of runs, how many of them the planner calls solved, and of those that are solved and correct
    the times to the first path, the same with what loading and building took (null where unknown), the costs, and
    the median cost at each of ``moments`` (see :func:`stairs`); last the median seconds of loading and building.
    """
    cells = sum(len(problem.runs) for problem in results.problems)
    moments = time_grid(results.problems, int(np.clip(MAX_CURVES // cells, *MOMENTS)))
    planners = [{"name": n, "family": family_of(n), **asdict(styles[n])} for n in results.planners]
    return {
        "steps": STEPS,
        "shift": SHIFT,
        "moments": [float(f"{t:.4g}") for t in moments],
        "families": FAMILIES,
        "planners": planners,
        "problems": [_problem(problem, results.planners, moments) for problem in results.problems],
    }


def compressed(value: object) -> str:
    """Return a value as compressed JSON in base64: nothing in it can end the element that it stands in."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return base64.b64encode(gzip.compress(text.encode(), 9, mtime=0)).decode()


def cost_steps(problem: Problem, costs: FloatArray) -> FloatArray:
    """Return costs as steps above the best known one; infinity for those not known, and for any above a best of 0."""
    best = problem.best_cost
    found = np.full(costs.shape, np.inf)
    known = np.isfinite(costs)
    if 0.0 < best < np.inf:
        found[known] = np.rint(np.log(np.maximum(costs[known] / best, 1e-3)) * STEPS)
    else:
        found[known & (costs == 0.0)] = 0.0
    return found


def stairs(steps: FloatArray) -> list[int]:
    """Return a curve that only falls: how many moments have no value, then the first one, then by how much it falls.

    Moments at the end at which it falls no more are left out.
    """
    known = steps[np.isfinite(steps)].astype(np.int64)
    found = [len(steps) - len(known), *known[:1].tolist(), *(-np.diff(known)).tolist()]
    while len(found) > 2 and found[-1] == 0:
        found.pop()
    return found


def _problem(problem: Problem, planners: Sequence[str], moments: FloatArray) -> list[Any]:
    cells = [_cell(problem, problem.runs[name], moments) if name in problem.runs else None for name in planners]
    best = float(f"{problem.best_cost:.7g}") if np.isfinite(problem.best_cost) else None
    return [problem.name, problem.time_limit, best, cells]


def _cell(problem: Problem, runs: Runs, moments: FloatArray) -> list[Any]:
    first, setup = runs.first_times[runs.success], runs["setup_time"]
    median = cost_steps(problem, cost_quartiles(runs, moments)[1])
    cold = None if np.isnan(setup).any() else _sorted(_log(first + setup[runs.success]))
    return [
        *(len(runs), int(runs.claimed.sum()), _sorted(_log(first)), cold),
        *(_sorted(cost_steps(problem, runs.costs)), stairs(median)),
        None if cold is None else float(f"{np.median(setup):.4g}"),
    ]


def _log(seconds: FloatArray) -> FloatArray:
    return np.asarray(np.rint(np.log(np.maximum(seconds, SOONEST)) * STEPS))


def _sorted(steps: FloatArray) -> list[int]:
    known = np.sort(steps[np.isfinite(steps)]).astype(np.int64)
    found: list[int] = np.diff(known, prepend=0).tolist()
    return found
