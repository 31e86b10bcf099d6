"""Speed against refusals where problems were run at several resolutions of the discrete motion validation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from trailmark.benchmark.planner_name import CERTIFIED
from trailmark.benchmark.report.comparison import SHIFT, at_limit
from trailmark.benchmark.report.conditions import setup_of
from trailmark.benchmark.report.data import Problem, Results
from trailmark.benchmark.report.digits import NOTHING, milliseconds, percent
from trailmark.benchmark.report.palette import FAMILIES, family_of
from trailmark.benchmark.report.tables import Table
from trailmark.benchmark.statistics import shifted_geometric_mean, wilson

__all__ = ["sweep_table"]


def sweep_table(results: Results) -> Table | None:
    """Return a row for each planner with discrete checks and each resolution, and for all of a family together.

    Only problems that were run at all of the resolutions of the sweep count. None without a sweep.
    """
    by_problem: dict[str, dict[float, Problem]] = {}
    for problem in results.problems:
        setup = setup_of(problem)
        share = setup.get("resolution_share")
        if isinstance(share, int | float):
            key = repr((setup.get("problem"), setup.get("time_limit"), setup.get("memory_limit")))
            by_problem.setdefault(key, {})[float(share)] = problem
    shares = sorted({share for found in by_problem.values() if len(found) > 1 for share in found}, reverse=True)
    whole = [found for found in by_problem.values() if set(found) == set(shares)]
    if not shares or not whole:
        return None
    rows = []
    for family in ("discrete", "native"):
        planners = [name for name in results.planners if family_of(name) == family and CERTIFIED not in name]
        groups = [(name, [name]) for name in planners]
        groups += [(f"all: {FAMILIES[family]}", planners)] if len(planners) > 1 else []
        for label, names in groups:
            rows += [_row(label, names, share, [found[share] for found in whole]) for share in shares]
    if not rows:
        return None
    columns = [
        "planner",
        "resolution",
        "[m]",
        "runs",
        "paths found",
        "refused",
        "95 %",
        "correct",
        "first path: mean [ms]",
    ]
    caption = (
        f"Speed against refusals on {len(whole)} problem{'s' if len(whole) > 1 else ''}: how far apart the states are "
        "at which motions are checked, as a share of the robot's inscribed radius. Refused: of the paths found, those "
        "that the referee did not accept. Means are shifted geometric, a failure at the limit."
    )
    return Table(caption, columns, rows, frozenset({6}))


def _row(label: str, planners: list[str], share: float, problems: list[Problem]) -> list[str]:
    parts = [(p, p.runs[name]) for p in problems for name in planners if name in p.runs]
    runs = sum(len(found) for _, found in parts)
    claimed = sum(int(found.claimed.sum()) for _, found in parts)
    refused = sum(found.refused for _, found in parts)
    times = [at_limit(p, found) for p, found in parts]
    metres = sorted({_metres(setup_of(p)) for p in problems})
    low, high = wilson(refused, claimed)
    return [
        label,
        f"{100.0 * share:.3g} %",
        f"{metres[0]:.3g}" if len(metres) == 1 else f"{metres[0]:.3g} to {metres[-1]:.3g}",
        f"{runs:,}",
        f"{claimed:,}",
        percent(refused / claimed) if claimed else NOTHING,
        f"{100.0 * low:.1f} to {100.0 * high:.1f} %" if claimed else NOTHING,
        percent((claimed - refused) / runs) if runs else NOTHING,
        milliseconds(shifted_geometric_mean(np.concatenate(times), SHIFT)) if runs else NOTHING,
    ]


def _metres(setup: Mapping[str, Any]) -> float:
    return float(setup.get("resolution", float("nan")))
