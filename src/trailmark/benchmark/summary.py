"""A few figures for each planner, for the shell; the report has them all."""

from __future__ import annotations

import itertools
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from statistics import median

from trailmark.benchmark.labels import differences

__all__ = ["summary_rows"]

HEADER = ("planner", "correct", "refused", "first solution", "cost", "simplified")


def summary_rows(database: Path, planners: Sequence[str]) -> list[tuple[str, ...]]:
    """Return a header and a row for each planner, over all runs in a database.

    ``correct`` counts what the referee let pass, ``refused`` what the planner called a solution and is none. Of the
    correct runs: the median time to the first solution, and the medians of cost and of cost after the simplifier, each
    as a multiple of the problem's best known. Experiments of one name that differ, in their time limit say, have
    rows of their own.
    """
    query = (
        "SELECT p.name, r.experimentid, r.solved, r.correct_solution, r.time_to_first_solution, r.solution_length, "
        "r.simplified_solution_length FROM runs r JOIN plannerConfigs p ON p.id = r.plannerid"
    )
    with closing(sqlite3.connect(f"{database.resolve().as_uri()}?mode=ro", uri=True)) as db:
        runs = db.execute(query).fetchall()
        apart = differences(db.execute("SELECT id, name, setup FROM experiments ORDER BY id"))
    best: dict[int, float] = {}
    for _, problem, _, correct, _, *costs in runs:
        for cost in costs:
            if correct and cost is not None:
                best[problem] = min(cost, best.get(problem, cost))
    rows: list[tuple[str, ...]] = [HEADER]
    for planner, which in itertools.product(planners, dict.fromkeys(apart.values())):
        mine = [run for run in runs if run[0] == planner and apart[run[1]] == which]
        if which and not mine:
            continue
        right = [run for run in mine if run[3]]
        rows.append(
            (
                planner + (which and f" ({which})"),
                f"{len(right)}/{len(mine)}",
                str(sum(bool(run[2]) for run in mine) - len(right)),
                _middle([run[4] for run in right if run[4] is not None], "{:.3f} s"),
                _middle([run[5] / best[run[1]] for run in right if run[5] is not None], "x {:.3f}"),
                _middle([run[6] / best[run[1]] for run in right if run[6] is not None], "x {:.3f}"),
            )
        )
    return rows


def _middle(values: Sequence[float], form: str) -> str:
    return form.format(median(values)) if values else "-"
