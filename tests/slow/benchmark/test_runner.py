"""Runner: which runs are made, in which order; lost workers; interrupts. Its jobs are answered by a stand-in."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from tests.helpers.runs import solved

from trailmark.benchmark.environment import versions
from trailmark.benchmark.errors import StoreError, WorkerError
from trailmark.benchmark.problems import Problem
from trailmark.benchmark.runner import Benchmark, Tally
from trailmark.benchmark.store import Store
from trailmark.benchmark.workers import Pool


class AtOnce(Executor):
    """Runs what it is given in this thread, when it is given; keeps what it was given."""

    def __init__(self, answer: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        self.answer = answer
        self.given: list[tuple[str, str, int]] = []
        self.resolutions: list[float] = []

    def submit(self, _: Any, /, job: dict[str, Any]) -> Future[dict[str, Any]]:  # type: ignore[override]  # ours alone
        self.given.append((job["text"], job["planner"], job["seed"]))
        self.resolutions.append(job["resolution"])
        future: Future[dict[str, Any]] = Future()
        try:
            future.set_result(self.answer(job))
        except Exception as error:
            future.set_exception(error)
        return future


def well(job: dict[str, Any]) -> dict[str, Any]:
    return solved(job["seed"]).to_json()


def plan(*problems: Problem, runs: int = 2, **changes: Any) -> Benchmark:
    given: dict[str, Any] = {"planners": ["landmark", "PRM"], "time_limit": 0.5, "memory_limit": 512.0} | changes
    return Benchmark(problems=list(problems), runs=runs, **given)


def make(file: Path, benchmark: Benchmark, executor: Executor, **how: Any) -> Tally:
    with Store(file) as store:
        return benchmark.run(store, Pool(executor, lambda: 1), **how)


def runs_in(file: Path) -> list[tuple[str, str, int]]:
    with closing(sqlite3.connect(file)) as db:
        return db.execute(
            "SELECT e.name, p.name, r.seed FROM runs r JOIN experiments e ON e.id = experimentid "
            "JOIN plannerConfigs p ON p.id = plannerid ORDER BY r.id"
        ).fetchall()


def test_problem_by_problem_and_seed_by_seed_through_all_planners(
    tmp_path: Path, ahead: Problem, around: Problem
) -> None:
    executor, file = AtOnce(well), tmp_path / "results.db"
    seen: list[int] = []
    tally = make(file, plan(ahead, around, seed=7), executor, on_progress=lambda tally: seen.append(tally.done))
    assert executor.given == [
        (problem.text, planner, seed)
        for problem in (ahead, around)
        for seed in (7, 8)
        for planner in ("landmark", "PRM")
    ]
    assert len(runs_in(file)) == 8
    assert (tally.total, tally.done, tally.made, tally.failed, tally.left) == (8, 8, 8, 0, 0.0)
    assert seen[0] == 0
    assert seen == sorted(seen)


def test_only_what_is_missing_is_made(tmp_path: Path, ahead: Problem) -> None:
    file = tmp_path / "results.db"
    make(file, plan(ahead), AtOnce(well))
    again = AtOnce(well)
    assert make(file, plan(ahead), again).done == 4
    assert again.given == []
    more = AtOnce(well)
    tally = make(file, plan(ahead, runs=3, planners=["landmark", "PRM", "RRT"]), more)
    assert (tally.total, tally.done, tally.made) == (9, 9, 5)
    assert [(planner, seed) for _, planner, seed in more.given] == [
        ("RRT", 0),
        ("RRT", 1),
        ("landmark", 2),
        ("PRM", 2),
        ("RRT", 2),
    ]


def test_each_planner_has_its_own_resolution_unless_one_is_given(tmp_path: Path, ahead: Problem) -> None:
    done = AtOnce(well)
    make(tmp_path / "own.db", plan(ahead, planners=["PRM", "native:PRM"], runs=1), done)
    assert done.resolutions == pytest.approx([0.02, 0.01], rel=1e-5)
    given = AtOnce(well)
    make(tmp_path / "given.db", plan(ahead, planners=["PRM", "native:PRM"], runs=1, resolution=0.1), given)
    assert given.resolutions == pytest.approx([0.1, 0.1], rel=1e-5)


def test_another_version_is_refused(tmp_path: Path, ahead: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "results.db"
    make(file, plan(ahead), AtOnce(well))
    now = versions() | {"ompl": "9.9"}
    monkeypatch.setattr("trailmark.benchmark.runner.versions", lambda: now)
    with pytest.raises(StoreError, match=r"made with ompl .*, now it is 9\.9"):
        make(file, plan(ahead), AtOnce(well))


@pytest.mark.parametrize("losses", [2, 3])
def test_a_lost_worker_only_repeats_its_runs_and_one_that_costs_every_worker_is_reported(
    losses: int, tmp_path: Path, ahead: Problem
) -> None:
    lost: list[int] = []

    def lossy(job: dict[str, Any]) -> dict[str, Any]:
        if (job["planner"], job["seed"]) == ("PRM", 0) and len(lost) < losses:
            lost.append(1)
            raise ConnectionResetError("worker lost")
        return well(job)

    executor, file = AtOnce(lossy), tmp_path / "results.db"
    if losses < 3:
        assert make(file, plan(ahead), executor).made == 4
        assert len(executor.given) == 4 + losses
        assert len(set(runs_in(file))) == len(runs_in(file)) == 4
    else:
        with pytest.raises(WorkerError, match="planner PRM, seed 0: lost 3 times with its worker: worker lost"):
            make(file, plan(ahead), executor)
        assert ("room-ahead", "landmark", 0) in runs_in(file)


def test_an_interrupt_keeps_what_came_in(tmp_path: Path, ahead: Problem) -> None:
    def interrupt(tally: Tally) -> None:
        if tally.made:
            raise KeyboardInterrupt

    file, executor = tmp_path / "results.db", AtOnce(well)
    with pytest.raises(KeyboardInterrupt):
        make(file, plan(ahead, runs=20), executor, on_progress=interrupt)
    # Those written before, and those that had been handed out and were done by then.
    assert len(runs_in(file)) == len(executor.given) < 40
    assert make(file, plan(ahead, runs=20), AtOnce(well)).made == 40 - len(executor.given)
