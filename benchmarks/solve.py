"""How many queries does the landmark planner solve, how soon, and at what cost? Writes results/solve.{json,md}.

Every run is a fresh planner with its own seed; a run counts as solved only if the path passes a referee that
shares no code with the planner (benchmarks/oracle.py: shapely, dense sampling).

    python -m benchmarks.solve [--group worlds ...] [--seeds 10] [--rows 200] [--time-limit 2] [--workers 1]
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.oracle import Oracle, motion_states
from benchmarks.suite import GROUPS, Problem, data_folder, problems
from trailmark.collision import StateChecker
from trailmark.formats.files import write_atomically
from trailmark.planning import LandmarkPlanner

RESULTS = Path(__file__).resolve().parent / "results"

SAMPLES = 200
"""Configurations that the referee looks at along each motion of a path."""

_checkers: dict[tuple[int, int], tuple[StateChecker, Oracle, float]] = {}


def run(problem: Problem, seed: int, time_limit: float) -> dict[str, Any]:
    """Return the figures of one run; checker and referee of a world are built once per process and timed."""
    key = (hash(problem.world), hash(problem.world.robot))
    if key not in _checkers:
        LandmarkPlanner(problem.world, seed=0)  # loads the kernels
        begin = perf_counter()
        checker = StateChecker(problem.world)
        elapsed = perf_counter() - begin
        _checkers.clear()
        _checkers[key] = (checker, Oracle(problem.world, checker.robot), elapsed)
    checker, oracle, build = _checkers[key]
    planner = LandmarkPlanner(problem.world, seed=seed, checker=checker)
    result = planner.plan(problem.query.start, problem.query.goal, time_limit=time_limit)
    correct = result.path is not None and path_is_right(oracle, problem, result.path.states)
    return {
        "group": problem.group,
        "world": problem.world.name,
        "robot": checker.robot.describe(),
        "query": problem.query.name,
        "seed": seed,
        "feasible": problem.feasible,
        "optimum": problem.optimum,
        "status": result.status,
        "correct": bool(correct),
        "build": build + (result.time["build"] or 0.0),
        "first": result.time["first_solution"],
        "total": result.time["total"],
        "first_cost": result.first_cost,
        "cost": result.cost,
        "lower_bound": result.lower_bound,
        "landmarks": result.landmarks,
    }


def path_is_right(oracle: Oracle, problem: Problem, states: np.ndarray) -> bool:
    """Return whether the path joins the query's ends and no configuration sampled along it collides."""
    if not np.array_equal(states[[0, -1]], np.array([problem.query.start, problem.query.goal])):
        return False
    return not oracle.collides(motion_states(states[:-1], states[1:], SAMPLES).reshape(-1, 3)).any()


def summary(runs: list[dict[str, Any]]) -> list[list[str]]:
    """Return one table row per world: runs, solved, wrong, times and costs."""
    by_world: dict[tuple[str, str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in runs:
        by_world[row["group"], row["world"], row["robot"]].append(row)
    table = []
    for (group, world, robot), rows in sorted(by_world.items()):
        feasible = [row for row in rows if row["feasible"]]
        solved = [row for row in feasible if row["correct"]]
        first = [row["first"] for row in solved] or [np.nan]
        total = [row["total"] for row in solved] or [np.nan]
        ratio = [row["cost"] / row["optimum"] for row in solved if row["optimum"]]
        proven = sum(row["status"] == "infeasible" for row in rows if not row["feasible"])
        table.append(
            [
                group,
                world,
                robot,
                str(len({row["query"] for row in feasible})),
                f"{len(solved)}/{len(feasible)}",
                str(sum(row["status"] == "solved" and not row["correct"] for row in rows)),
                f"{np.median([row['build'] for row in rows]):.3f}",
                f"{np.median(first):.3f}",
                f"{np.quantile(first, 0.95):.3f}",
                f"{np.max(first):.3f}",
                f"{np.median(total):.2f}",
                f"{np.median(ratio):.4f} / {np.max(ratio):.4f}" if ratio else "",
                f"{proven}/{len(rows) - len(feasible)}" if len(rows) > len(feasible) else "",
            ]
        )
    return table


HEADER = [
    "group",
    "world",
    "robot",
    "queries",
    "solved",
    "wrong",
    "build s",
    "first s (median)",
    "first s (95 %)",
    "first s (max)",
    "settled s",
    "cost / optimum (median / max)",
    "proven infeasible",
]


def write(runs: list[dict[str, Any]], settings: str) -> None:
    """Put the rows of the groups that were run in place of their old ones in results/solve.{json,md}."""
    RESULTS.mkdir(exist_ok=True)
    file = RESULTS / "solve.json"
    record = json.loads(file.read_text()) if file.exists() else {"rows": [], "runs": {}}
    rows = summary(runs)
    groups = {row[0] for row in rows}
    kept = [row for row in record["rows"] if row[0] not in groups]
    record = {"header": HEADER, "rows": sorted(kept + rows), "runs": record["runs"]}
    record["runs"].update({group: f"{settings}; {describe_machine()}" for group in groups})
    write_atomically(file, json.dumps(record, indent=1) + "\n")
    lines = [
        "# Queries solved",
        "",
        "Written by `python -m benchmarks.solve`; every path passed a referee of its own.",
        "",
    ]
    lines += [markdown_table(HEADER, record["rows"]), ""]
    lines += ["`build`: checker with its field; `first`: time to the first path; `settled`: time until no better one"]
    lines += [
        "was found; `wrong`: paths that the referee refused; `cost / optimum`: against the published optimal cost"
    ]
    lines += ["of paths on the grid, which keep to eight directions.", ""]
    lines += [f"- {group}: {text}" for group, text in sorted(record["runs"].items())]
    write_atomically(RESULTS / "solve.md", "\n".join(lines) + "\n")


def main() -> int:
    """Run the suite and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--group", action="append", choices=sorted(GROUPS))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--rows", type=int, default=None, help="queries per scenario or map; default: all / 200")
    parser.add_argument("--time-limit", type=float, default=2.0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--no-write", action="store_true", help="print only")
    options = parser.parse_args()
    groups = options.group or (sorted(GROUPS) if data_folder().is_dir() else ["worlds"])
    jobs = [
        (problem, seed, options.time_limit)
        for group in groups
        for problem in problems(group, options.rows)
        for seed in range(options.seeds)
    ]
    runs: list[dict[str, Any]] = []
    with ProcessPoolExecutor(options.workers) as pool:
        chunks = max(1, min(100, len(jobs) // (4 * options.workers)))
        for done, row in enumerate(pool.map(run, *zip(*jobs, strict=True), chunksize=chunks), 1):
            runs.append(row)
            if done % 50 == 0 or done == len(jobs):
                print(f"{done}/{len(jobs)}", file=sys.stderr, flush=True)
    table = markdown_table(HEADER, summary(runs))
    print(table)
    bad = [r for r in runs if (r["feasible"] and not r["correct"]) or (not r["feasible"] and r["status"] == "solved")]
    for row in bad:
        print("not solved:", row["world"], row["robot"], row["query"], "seed", row["seed"], row["status"])
    if not options.no_write:
        write(runs, f"{options.seeds} seeds, {options.time_limit:g} s per query, {options.workers} worker(s)")
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
