"""Results databases made up for tests and benchmarks of the report: the benchmark's schema, runs drawn by chance."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.benchmark.record import MEASURED, Status
from trailmark.benchmark.store import APPLICATION, DDL, ENUMS, VERSION

WORLD = """\
trailmark: 1
name: yard
bounds: [0.0, 0.0, 10.0, 6.0]
robot: {shape: rectangle, length: 0.8, width: 0.4}
obstacles:
  - {shape: disc, center: [5.0, 3.0], radius: 1.0}
  - {shape: rectangle, center: [2.0, 4.6], length: 1.0, width: 0.5, heading: 0.3}
  - {shape: polygon, vertices: [[7, 0.4], [8.2, 0.3], [7.9, 1.8], [7.2, 1.5]]}
queries:
  - {name: across, start: [1.0, 1.0, 0.0], goal: [9.0, 5.0, 1.5]}
"""
START, GOAL = [1.0, 1.0, 0.0], [9.0, 5.0, 1.5]

Run = dict[str, Any]


def run(seed: int, first: float | None, cost: float | None = None, **more: Any) -> Run:
    """One run: solved after ``first`` seconds at ``cost``, or not at all."""
    solved = first is not None
    row: Run = {
        "seed": seed,
        "status": int(Status.EXACT_SOLUTION if solved else Status.TIMEOUT),
        "solved": solved,
        "correct_solution": solved,
        "approximate_solution": False,
        "time": 1.0,
        "time_to_first_solution": first,
        "first_solution_length": None if cost is None else 1.2 * cost,
        "solution_length": cost,
        "simplified_solution_length": cost,
        "setup_time": 0.05,
        "overhead": 0.01,
        "curve": [(first, 1.2 * cost), (0.9, cost)] if first is not None and cost is not None else [],
        "path": [START, [4.0, 0.8 + 0.05 * (cost or 0.0), 0.5], GOAL] if solved else None,
    }
    return row | more


def write_results(file: Path, problems: Mapping[str, Mapping[str, Sequence[Run]]], **experiment: Any) -> Path:
    """Write a database that holds, for each problem, runs by planner.

    Args:
        file: to be made.
        problems: runs by planner by problem.
        experiment: columns of ``experiments`` other than the usual, and ``text`` for the world.
    """
    with closing(sqlite3.connect(file)) as db, db:
        for statement in DDL:
            db.execute(statement)
        db.executemany("INSERT INTO enums VALUES (?, ?, ?)", ENUMS)
        db.execute(f"PRAGMA application_id = {APPLICATION}")
        db.execute(f"PRAGMA user_version = {VERSION}")
        planners = list(dict.fromkeys(name for runs in problems.values() for name in runs))
        settings = [(name, f"settings of {name}") for name in planners]
        db.executemany("INSERT INTO plannerConfigs (name, settings) VALUES (?, ?)", settings)
        for key, (name, runs) in enumerate(problems.items(), 1):
            _experiment(db, name, max((len(r) for r in runs.values()), default=0), dict(experiment))
            for planner, rows in runs.items():
                for row in rows:
                    _add(db, key, 1 + planners.index(planner), row)
    return file


def random_results(
    file: Path,
    planners: Sequence[str],
    problems: int,
    runs: int,
    seed: int = 0,
    texts: Sequence[str] = (WORLD,),
    states: int = 5,
) -> Path:
    """Write a database of any size; planners later in the list are slower and fail more often.

    Args:
        file: to be made.
        planners: names.
        problems: how many.
        runs: of each planner on each problem.
        seed: of all that is drawn.
        texts: world files that the problems take turns with.
        states: of each path.
    """
    generator = np.random.default_rng(seed)
    made: dict[str, dict[str, list[Run]]] = {}
    for p in range(problems):
        hard, best = generator.uniform(0.5, 3.0), generator.uniform(10.0, 12.0)
        made[f"world{p}-across"] = {
            name: [
                _random_run(generator, i, k, len(planners), hard, best, name == "landmark", states) for k in range(runs)
            ]
            for i, name in enumerate(planners)
        }
    return write_results(file, made, texts=list(texts))


def _random_run(
    generator: np.random.Generator, rank: int, seed: int, of: int, hard: float, best: float, quick: bool, states: int
) -> Run:
    place = rank / max(1, of - 1)
    first = float(0.01 * hard * 10 ** (1.8 * place + generator.normal(0.0, 0.2)))
    if first > 1.0 or generator.random() < 0.12 * place:
        crash = generator.random() < 0.2
        return run(
            seed,
            None,
            time=1.0,
            status=int(Status.CRASH if crash else Status.TIMEOUT),
            failure="killed" if crash else None,
        )
    final = best * float(1.0 + abs(generator.normal(0.02 + 0.2 * place, 0.03)))
    start = final * float(1.1 + abs(generator.normal(0.0, 0.4)))
    times = np.geomspace(first, 1.0, 12)
    costs = final + (start - final) * np.linspace(1.0, 0.0, 12) ** 2
    bend = float(generator.normal(0.0, 0.25))
    way = np.array([START, [3.0, 1.2 + bend, 0.3], [5.0, 1.3 + bend, 0.2], [6.6, 3.0 + 0.5 * bend, 0.9], GOAL])
    if states > len(way):
        along = np.linspace(0.0, 4.0, states)
        way = np.column_stack([np.interp(along, range(5), column) for column in way.T])
        way[1:-1] += generator.normal(0.0, 0.05, (states - 2, 3))
    return run(
        seed,
        first,
        final,
        first_solution_length=start,
        simplified_solution_length=final * 0.995,
        simplification_time=0.02,
        curve=list(zip(times.tolist(), costs.tolist(), strict=True)),
        path=way.round(4).tolist(),
        states_checked=int(1e4 * (1 + place)),
        motions_checked=int(2e3 * (1 + place)),
        graph_states=900,
        graph_motions=4100,
        memory=12.5 if quick else 31.0,
        correct_solution=bool(generator.random() > 0.02 * (rank % 3 == 1)),
    )


def _experiment(db: sqlite3.Connection, name: str, runs: int, more: dict[str, Any]) -> None:
    texts = more.pop("texts", None) or [more.pop("text", WORLD)]
    count = db.execute("SELECT count(*) FROM experiments").fetchone()[0]
    setup = {
        "identity": {"problem": f"{count:064x}", "objective": "path length", "resolution": 0.1, "time_limit": 1.0},
        "conditions": {"Python": "3.11.7", "ompl": "2.0.1", "processor": "a processor, 2 cores"},
        "facts": {
            "world": "yard",
            "robot": "rectangle 0.8 x 0.4 m",
            "start": START,
            "goal": GOAL,
            "text": texts[count % len(texts)],
        },
    }
    row = {
        "name": name,
        "totaltime": 1.0,
        "timelimit": 1.0,
        "memorylimit": 2048.0,
        "runcount": runs,
        "version": "trailmark 0.1.0, OMPL 2.0.1",
        "hostname": "somewhere",
        "cpuinfo": "a processor, 2 cores",
        "date": "2026-11-21 05:00:00+00:00",
        "seed": "0",
        "setup": json.dumps(setup),
    } | more
    marks = ", ".join("?" * len(row))
    db.execute(f"INSERT INTO experiments ({', '.join(row)}) VALUES ({marks})", list(row.values()))  # noqa: S608  # names of columns


def _add(db: sqlite3.Connection, experiment: int, planner: int, row: Run) -> None:
    cells = [json.dumps(v) if isinstance(v := row.get(name), list) else v for name in MEASURED]
    marks = ", ".join("?" * (2 + len(cells)))
    names = ", ".join(["experimentid", "plannerid", *MEASURED])
    done = db.execute(f"INSERT INTO runs ({names}) VALUES ({marks})", [experiment, planner, *cells])  # noqa: S608  # names of columns
    db.executemany(
        "INSERT OR REPLACE INTO progress VALUES (?, ?, ?)", [(done.lastrowid, t, c) for t, c in row["curve"]]
    )
