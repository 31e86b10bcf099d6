"""Results databases made up for tests and measurements of the report, runs drawn by chance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.benchmark.record import RunRecord, Status
from trailmark.benchmark.store import Store

START, GOAL = [1.0, 1.0, 0.0], [9.0, 5.0, 1.5]
SETUP: dict[str, Any] = {
    "conditions": {"Python": "3.11.7", "ompl": "2.0.1", "processor": "a processor, 2 cores"},
    "facts": {"world": "yard", "robot": "rectangle 0.8 x 0.4 m", "start": START, "goal": GOAL, "text": "trailmark: 1"},
}


def run(seed: int, first: float | None, cost: float | None = None, **more: Any) -> RunRecord:
    """One run: solved after ``first`` seconds at ``cost``, or not at all."""
    solved = first is not None
    record = RunRecord(
        seed=seed,
        status=int(Status.EXACT_SOLUTION if solved else Status.TIMEOUT),
        solved=solved,
        correct_solution=solved,
        time=1.0,
        time_to_first_solution=first,
        first_solution_length=None if cost is None else 1.2 * cost,
        solution_length=cost,
        simplified_solution_length=cost,
        setup_time=0.05,
        overhead=0.01,
        curve=[] if first is None or cost is None else [(first, 1.2 * cost), (0.9, cost)],
        path=[START, GOAL] if solved else None,
    )
    return replace(record, **more)


def write_results(file: Path, problems: Mapping[str, Mapping[str, Sequence[RunRecord]]]) -> Path:
    """Write a database that holds, for each problem, runs by planner."""
    with Store(file) as store:
        store._db.execute("PRAGMA synchronous = OFF")  # nobody takes the power away
        planners = list(dict.fromkeys(name for runs in problems.values() for name in runs))
        keys = {name: store.planner(name, f"settings of {name}") for name in planners}
        for number, (name, runs) in enumerate(problems.items()):
            experiment = store.experiment(
                {"problem": f"{number:064x}", "objective": "path length", "resolution": 0.1, "time_limit": 1.0},
                **SETUP,
                name=name,
                timelimit=1.0,
                memorylimit=2048.0,
                runcount=max((len(rows) for rows in runs.values()), default=0),
                version="trailmark 0.1.0, OMPL 2.0.1",
                hostname="somewhere",
                cpuinfo="a processor, 2 cores",
                date="2026-11-21 05:00:00+00:00",
                seed=0,
            )
            for planner, rows in runs.items():
                for row in rows:
                    store.add(experiment, keys[planner], row)
    return file


def random_results(file: Path, planners: Sequence[str], problems: int, runs: int) -> Path:
    """Write a database of any size; planners later in the list are slower and fail more often."""
    generator = np.random.default_rng(0)
    made: dict[str, dict[str, list[RunRecord]]] = {}
    for number in range(problems):
        hard, best = generator.uniform(0.5, 3.0), generator.uniform(10.0, 12.0)
        made[f"world{number}-across"] = {
            name: [_random_run(generator, i / max(1, len(planners) - 1), seed, hard, best) for seed in range(runs)]
            for i, name in enumerate(planners)
        }
    return write_results(file, made)


def _random_run(generator: np.random.Generator, place: float, seed: int, hard: float, best: float) -> RunRecord:
    first = float(0.01 * hard * 10 ** (1.8 * place + generator.normal(0.0, 0.2)))
    if first > 1.0 or generator.random() < 0.12 * place:
        crash = generator.random() < 0.2
        return run(seed, None, status=int(Status.CRASH), failure="killed") if crash else run(seed, None)
    final = best * float(1.0 + abs(generator.normal(0.02 + 0.2 * place, 0.03)))
    start = final * float(1.1 + abs(generator.normal(0.0, 0.4)))
    costs = final + (start - final) * np.linspace(1.0, 0.0, 12) ** 2
    curve = list(zip(np.geomspace(first, 1.0, 12).tolist(), costs.tolist(), strict=True))
    correct = bool(generator.random() > 0.02 * place)
    return run(seed, first, final, first_solution_length=start, curve=curve, correct_solution=correct)
