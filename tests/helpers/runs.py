"""What the tests of the benchmark share: small problems, a worker, records of runs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from trailmark import Disc, Query, Rectangle, Robot, World
from trailmark.benchmark.planners import spacing_of
from trailmark.benchmark.problems import Job, Problem, problems_of
from trailmark.benchmark.record import RunRecord, Status
from trailmark.benchmark.workers import Worker

ROOT = Path(__file__).resolve().parents[2]
START, GOAL = (1.0, 1.0, 0.0), (9.0, 1.0, 0.0)


def small_world() -> World:
    """A room of 10 x 6 m: straight ahead from start to goal is free, ``around`` has to go around a disc."""
    return World(
        "room",
        (0.0, 0.0, 10.0, 6.0),
        (Disc((5.0, 4.0), 1.0), Rectangle((2.0, 5.0), 1.0, 0.5, 0.3)),
        Robot.rectangle(0.8, 0.4),
        queries=(Query("ahead", START, GOAL), Query("around", (3.0, 4.0, 0.0), (7.0, 4.0, 1.0))),
    )


@pytest.fixture(scope="session")
def ahead() -> Problem:
    return next(problems_of(small_world(), queries=["ahead"]))


@pytest.fixture(scope="session")
def around() -> Problem:
    return next(problems_of(small_world(), queries=["around"]))


@pytest.fixture(scope="session")
def worker() -> Iterator[Worker]:
    """One worker for all tests of this process: starting one takes seconds."""
    with pytest.MonkeyPatch.context() as patch:
        # So that it finds tests.helpers.rogues wherever the tests are started.
        patch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "src")]))
        made = Worker()
        yield made
        made.stop()


def job(problem: Problem, planner: str, seed: int = 0, limit: float = 0.2, memory: float = 2048.0) -> Job:
    return {
        "text": problem.text,
        "planner": planner,
        "seed": seed,
        "time_limit": limit,
        "memory_limit": memory,
        "resolution": spacing_of(planner, problem.robot),
    }


def experiment(**changes: Any) -> dict[str, Any]:
    row: dict[str, Any] = {
        "name": "room-ahead",
        "identity": {"problem": "abc", "time_limit": 1.0},
        "conditions": {"ompl": "2.0.1"},
        "facts": {"text": "trailmark: 1"},
        "timelimit": 1.0,
        "memorylimit": 512.0,
        "version": "trailmark 0.1.0, OMPL 2.0.1",
        "hostname": "here",
        "cpuinfo": "one",
        "date": "2026-01-01 00:00:00+00:00",
        "seed": 0,
        "runcount": 2,
    }
    return row | changes


def solved(seed: int = 0, **changes: Any) -> RunRecord:
    """A run that went well; its numbers are easily told apart."""
    record = RunRecord(
        status=int(Status.EXACT_SOLUTION),
        seed=seed,
        solved=True,
        correct_solution=True,
        solution_difference=0.0,
        time=1.0 + seed,
        time_to_first_solution=0.25,
        first_solution_length=12.5,
        solution_length=9.0,
        simplified_solution_length=8.5,
        simplification_time=0.125,
        states_checked=100,
        motions_checked=20,
        graph_states=30,
        graph_motions=40,
        memory=1.5,
        setup_time=0.5,
        overhead=0.0625,
        curve=[(0.25, 12.5), (0.75, 9.0)],
        path=[[1.0, 1.0, 0.0], [9.0, 1.0, 0.0]],
        simplified_path=[[1.0, 1.0, 0.0], [9.0, 1.0, 0.0]],
    )
    for name, value in changes.items():
        setattr(record, name, value)
    return record
