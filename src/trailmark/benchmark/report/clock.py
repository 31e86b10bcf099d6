"""What is in a planner's time and what is not, planner by planner, and the ranking with all of it."""

# Tested by tests/benchmark/report/test_clock.py.
from __future__ import annotations

import math

import numpy as np

from trailmark.benchmark.report.data import Results
from trailmark.benchmark.report.digits import NOTHING, factor, milliseconds
from trailmark.benchmark.report.palette import family_of
from trailmark.benchmark.report.summary import Summary
from trailmark.benchmark.report.tables import Table

__all__ = ["clock_table", "cold_table"]

_PYTHON = "before: trailmark's, with its clearance field"
_COMPILED = "before: compiled, or loaded from the cache"
_SETTLED = "before: the problem itself, 20 ms"
_OMPL = "within: OMPL's set-up, roadmap or tree"
_WORDS = {
    "landmark": (_PYTHON, _COMPILED, _SETTLED, "within: landmarks and roadmap", "within: its own; after: the common"),
    "discrete": (_PYTHON, _COMPILED, _SETTLED, _OMPL, "after: the common"),
    "certified": (_PYTHON, _COMPILED, _SETTLED, _OMPL, "after: the common"),
    "native": (
        "before: its own, of FCL",
        "none: C++",
        _SETTLED,
        _OMPL,
        "after: OMPL's, in C++",
    ),
    "own": (_PYTHON, "before: trailmark's; within: the user's", "none", "within", "after: the common"),
}
"""By family: checker, kernels, settling in, what is built for the query, simplification."""


def clock_table(results: Results) -> Table:
    """Return for each planner what is before, within and after its planning time; with medians where measured."""
    columns = ["planner", "start of the process, imports", "world's file and checker", "[ms]", "kernels", "settling in"]
    columns += ["built for the query", "roadmaps of earlier queries", "simplification", "[ms]"]
    rows = []
    for name in results.planners:
        checker, kernels, settled, built, simplified = _WORDS[family_of(name)]
        medians = (_median(results, name, column) for column in ("setup_time", "simplification_time"))
        setup, simplifying = (milliseconds(value) for value in medians)
        rows.append([name, "before", checker, setup, kernels, settled, built, "none", simplified, simplifying])
    caption = "Before, within or after the time that counts as planning; medians over all runs"
    return Table(caption, columns, rows, frozenset({1, 2, 4, 5, 6, 7, 8}))


def cold_table(results: Results, summary: Summary) -> Table:
    """Return the planners in the order of the time from the world's file to the first path."""
    rank = {s.planner: i for i, s in enumerate(summary.planners, 1)}
    ordered = sorted(summary.planners, key=lambda s: (math.isnan(s.cold_mean), s.cold_mean))
    best = ordered[0].cold_mean
    rows = [
        [
            *(s.planner, milliseconds(s.cold_mean), factor(s.cold_mean / best)),
            *(milliseconds(_median(results, s.planner, "setup_time")), milliseconds(s.first_mean)),
            *(NOTHING if math.isnan(s.cold_mean) else str(i), str(rank[s.planner])),
        ]
        for i, s in enumerate(ordered, 1)
    ]
    columns = ["planner", "from the file: mean [ms]", "over the first", "loading and building: median [ms]"]
    columns += ["planning: mean [ms]", "rank from the file", "rank by planning"]
    caption = (
        "Time to the first path from the world's file on: reading it, building the checker, planning; no start of a "
        "process, no compiling. Shifted geometric means, a failure at the limit."
    )
    return Table(caption, columns, rows)


def _median(results: Results, planner: str, column: str) -> float:
    values = np.concatenate([p.runs[planner][column] for p in results.problems if planner in p.runs])
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else math.nan
