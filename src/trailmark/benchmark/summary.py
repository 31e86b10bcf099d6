"""A few figures for each planner, for the shell; the report has them all."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from trailmark.benchmark.results import Problem, Results
from trailmark.se2 import FloatArray

__all__ = ["failure_lines", "summary_rows"]

HEADER = ("planner", "correct", "refused", "first solution", "cost", "simplified")


def summary_rows(results: Results, planners: Sequence[str]) -> list[tuple[str, ...]]:
    """Return a header and a row for each planner, over all its runs.

    ``correct`` counts what the referee accepts, ``refused`` what the planner called a solution and is none. Of the
    correct runs: the median time to the first solution, and the medians of cost and of cost after the simplifier, each
    as a multiple of the problem's best known. Experiments of one name that differ, in their time limit say, have
    rows of their own.
    """
    groups: dict[str, list[Problem]] = {}
    for problem in results.problems:
        groups.setdefault(problem.difference, []).append(problem)
    rows: list[tuple[str, ...]] = [HEADER]
    for planner, (difference, problems) in itertools.product(planners, groups.items()):
        found = [
            (problem.runs[planner], problem.best_cost or math.nan) for problem in problems if planner in problem.runs
        ]
        if not found:
            continue
        correct, count = sum(int(runs.success.sum()) for runs, _ in found), sum(len(runs) for runs, _ in found)
        rows.append(
            (
                planner + (difference and f" ({difference})"),
                f"{correct}/{count}",
                str(sum(runs.refused for runs, _ in found)),
                _median([runs.first_times for runs, _ in found], "{:.3f} s"),
                _median([_ratios(runs.costs, best) for runs, best in found], "x {:.3f}"),
                _median([_ratios(runs.simplified_costs, best) for runs, best in found], "x {:.3f}"),
            )
        )
    return rows


def failure_lines(results: Results, planners: Sequence[str]) -> list[str]:
    """Return a line for each planner whose runs gave reasons for failing: the most frequent reason, and how often."""
    lines = []
    for planner in planners:
        found = [problem.runs[planner] for problem in results.problems if planner in problem.runs]
        reasons = Counter(" ".join(reason.split()) for runs in found for reason in runs.failures if reason)
        for reason, count in reasons.most_common(1):
            lines.append(f"{planner}: {count} of {sum(len(runs) for runs in found)} runs: {reason}")
    return lines


def _ratios(costs: FloatArray, best: float) -> FloatArray:
    return costs[np.isfinite(costs)] / best


def _median(values: Sequence[FloatArray], form: str) -> str:
    """Return the median of the finite values as words."""
    known = np.concatenate(values)
    known = known[np.isfinite(known)]
    return form.format(np.median(known)) if len(known) else "-"
