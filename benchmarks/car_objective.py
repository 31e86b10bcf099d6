"""What a car's objective changes: changes of direction by length alone and by default. Writes results/car_objective.*.

Each problem of ``benchmarks.car`` is planned with both objectives and the same seeds; a run counts as solved only if
its path passes that benchmark's referee.

    python -m benchmarks.car_objective [--seeds 5] [--time-limit 3] [--problem parking/bay ...] [--no-write]
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.car import PROBLEMS, RESULTS, Problem, by_landmarks, judged
from benchmarks.machine import describe_machine, markdown_table
from trailmark.curves import CurvePath, Steering
from trailmark.formats.files import write_atomically

OBJECTIVES: dict[str, str | None] = {"length": "length", "default": None}

HEADER = [
    "problem, turning radius",
    "objective",
    "solved",
    "changes of direction (median / max)",
    "length (median), m",
    "in reverse (median), m",
    "first path s (median / max)",
]


def measured(problem: Problem, objective: str | None, seeds: Sequence[int], limit: float) -> list[dict[str, Any]]:
    """Return the runs of one problem with one objective, judged, with metres in reverse."""
    runs = by_landmarks(problem, seeds, limit, objective)
    steering = Steering(problem.radius, problem.reverse)
    for run in runs:
        path = CurvePath(np.array(run["knots"]), steering) if run["knots"] else None
        run["reverse"] = None if path is None else path.reverse_length
    return judged(problem, runs)


def row(name: str, objective: str, runs: list[dict[str, Any]]) -> list[str]:
    """Return one row of the table."""
    solved = [run for run in runs if run["solved"]]
    cells = [name, objective, f"{len(solved)}/{len(runs)}"]
    if not solved:
        return cells + [""] * (len(HEADER) - len(cells))
    values = {key: np.array([run[key] for run in solved]) for key in ("cusps", "cost", "reverse", "first")}
    return [
        *cells,
        f"{np.median(values['cusps']):.0f} / {values['cusps'].max()}",
        f"{np.median(values['cost']):.2f}",
        f"{np.median(values['reverse']):.2f}",
        f"{np.median(values['first']):.2f} / {values['first'].max():.2f}",
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--time-limit", type=float, default=3.0)
    parser.add_argument("--problem", nargs="*", help="world/query; default: all of cars that reverse")
    parser.add_argument("--no-write", action="store_true")
    given = parser.parse_args(arguments)
    record: dict[str, Any] = {"machine": describe_machine(), "time_limit": given.time_limit, "problems": {}}
    rows = []
    for problem in PROBLEMS:
        if not problem.reverse or (given.problem and f"{problem.world}/{problem.query}" not in given.problem):
            continue
        record["problems"][problem.name] = {}
        for name, objective in OBJECTIVES.items():
            runs = measured(problem, objective, range(given.seeds), given.time_limit)
            record["problems"][problem.name][name] = runs
            rows.append(row(problem.name, name, runs))
            print("  ".join(rows[-1]), flush=True)
    if not given.no_write:
        RESULTS.mkdir(exist_ok=True)
        write_atomically(RESULTS / "car_objective.json", json.dumps(record, indent=1) + "\n")
        lines = [
            "# What a car's objective changes",
            "",
            f"Written by `python -m benchmarks.car_objective`: {given.seeds} runs each of at most",
            f"{given.time_limit:g} s; every path passed a referee of its own. `default`: a change of direction costs",
            "as much as 3 m, a metre in reverse as much as 1.5 m.",
            "",
            markdown_table(HEADER, rows),
            "",
            record["machine"],
            "",
        ]
        write_atomically(RESULTS / "car_objective.md", "\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
