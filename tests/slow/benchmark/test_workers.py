"""Worker, host and child as one: honest runs, rogues, limits, and processes that die."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from tests.helpers.rogues import PREPARING
from tests.helpers.runs import job

from trailmark import Path, Polygon, Query, Robot, World
from trailmark.benchmark.errors import WorkerError
from trailmark.benchmark.problems import Problem
from trailmark.benchmark.record import Status
from trailmark.benchmark.workers import Worker

ROGUES = "tests.helpers.rogues:"


def check_curve(answer: dict[str, Any]) -> None:
    times, costs = zip(*answer["curve"], strict=True)
    assert list(times) == sorted(set(times))
    assert list(costs) == sorted(set(costs), reverse=True)
    assert answer["time_to_first_solution"] == times[0] <= answer["time"]
    assert answer["first_solution_length"] == costs[0]
    assert answer["solution_length"] == costs[-1]


@pytest.mark.parametrize("planner", ["landmark", "lattice", "PRM", "RRTConnect+certified", "BITstar+certified"])
def test_planners_solve_and_are_measured(planner: str, worker: Worker, around: Problem) -> None:
    answer = worker.run(job(around, planner, seed=5, limit=0.2))
    assert (answer["status"], answer["solved"], answer["seed"]) == (Status.EXACT_SOLUTION, True, 5), answer
    assert answer["correct_solution"], answer["failure"]
    check_curve(answer)
    cost = Path(answer["path"]).cost
    if answer["time"] <= 0.22:
        assert cost == pytest.approx(answer["solution_length"], rel=1e-5)
    else:  # on a busy machine what was found last is no cost in time
        assert cost <= answer["solution_length"] * (1.0 + 1e-5)
    assert Path(answer["simplified_path"]).cost == pytest.approx(answer["simplified_solution_length"])
    assert answer["simplified_solution_length"] < 1.05 * answer["solution_length"]
    for name in ("graph_states", "graph_motions", "setup_time"):
        assert answer[name] > 0, name
    assert answer["memory"] >= 0.0
    assert (answer["states_checked"] is None) == (planner in ("landmark", "lattice"))
    if planner != "RRTConnect+certified":
        assert answer["time"] > 0.05
    assert 0.0 < answer["overhead"] < 5.0


def test_planners_of_the_users_own_report_what_they_come_by_and_prepare_before_the_clock(
    worker: Worker, ahead: Problem
) -> None:
    answer = worker.run(job(ahead, ROGUES + "better"))
    detours = [2.0 * math.hypot(4.0, height - 1.0) for height in (4.0, 2.0)]
    assert [cost for _, cost in answer["curve"]] == pytest.approx([*detours, 8.0])
    check_curve(answer)
    late = worker.run(job(ahead, ROGUES + "dawdle"))
    assert late["correct_solution"], late
    assert late["solution_length"] == pytest.approx(detours[1])
    assert late["path"][1] == [5.0, 2.0, 0.0]
    prepared = worker.run(job(ahead, ROGUES + "prepared_plan", limit=0.1))
    assert prepared["correct_solution"], prepared
    assert prepared["setup_time"] >= PREPARING > prepared["time"]


@pytest.mark.parametrize(
    ("planner", "reverse"),
    [("landmark", True), ("landmark", False), ("RRTConnect", False), ("RRTConnect+certified", True)],
)
def test_planners_solve_for_cars(planner: str, reverse: bool, worker: Worker, around: Problem) -> None:
    car = Problem(around.world.with_robot(Robot.rectangle(0.8, 0.4).steered(0.6, reverse)))
    # The first job of a worker compiles what cars need, if no cache holds it.
    answer = worker.run(job(car, planner, seed=2, limit=0.3))
    assert answer["solved"], answer
    assert answer["correct_solution"], answer["failure"]
    check_curve(answer)
    found = car.path(answer["path"])
    # What makes the path better in its last moments may come after the limit, and counts in no cost.
    assert found.cost <= answer["solution_length"] * (1.0 + 1e-5)
    shorter = car.path(answer["simplified_path"])
    assert shorter.cost == pytest.approx(answer["simplified_solution_length"])
    # OMPL's splines lengthen paths of curves, by a sixth at times.
    assert shorter.cost < 2.0 * found.cost


def test_what_is_proven_infeasible_is_no_approximate_solution(worker: Worker) -> None:
    # Landmarks are placed before headings prove that the rod cannot get round the bend: some path leads nearer.
    inner = np.array([[0, 1], [7, 1], [7, 8], [0, 8]], dtype=float)
    ends = Query("round", (2.5, 0.5, 0.0), (7.5, 5.5, math.pi / 2))
    bend = World("bend", (0, 0, 8, 8), (Polygon(inner),), Robot.rectangle(4.0, 0.6), queries=(ends,))
    answer = worker.run(job(Problem(bend), "landmark", limit=20.0))
    assert (answer["status"], answer["solved"]) == (Status.INFEASIBLE, False), answer
    assert not answer["approximate_solution"]


def test_no_run_knows_of_those_before_it(worker: Worker, around: Problem) -> None:
    first, other, again = (worker.run(job(around, "RRTConnect", seed=seed)) for seed in (1, 2, 1))
    assert first["path"] == again["path"] != other["path"]
    assert first["states_checked"] == again["states_checked"]
    assert first["graph_states"] == again["graph_states"]


@pytest.mark.parametrize(
    ("rogue", "status", "why"),
    [
        ("abort", Status.ABORT, "SIGABRT"),
        ("crash", Status.CRASH, "SIGSEGV"),
        ("leave", Status.CRASH, "ended with status 7 and no answer"),
        ("fail", Status.ABORT, "ValueError: no idea at all"),
        ("nothing", Status.ABORT, "AttributeError"),
        ("shout", Status.TIMEOUT, ""),
        ("hang", Status.TIMEOUT, "did not end by itself"),
    ],
)
def test_whatever_becomes_of_a_run_is_its_result(
    rogue: str, status: Status, why: str, worker: Worker, ahead: Problem
) -> None:
    answer = worker.run(job(ahead, ROGUES + rogue, seed=3))
    assert (answer["status"], answer["solved"], answer["correct_solution"]) == (status, False, False)
    assert (answer["seed"], answer["path"]) == (3, None)
    assert why in (answer["failure"] or "")
    assert "\n" not in (answer["failure"] or "")
    # The worker is none the worse for it.
    assert worker.run(job(ahead, ROGUES + "honest"))["correct_solution"]


def test_memory_is_limited(worker: Worker, ahead: Problem) -> None:
    answer = worker.run(job(ahead, ROGUES + "eat", memory=64.0, limit=5.0))
    assert answer["status"] == Status.ABORT
    assert answer["failure"].startswith("out of memory (limit 64 MB)")


@pytest.mark.parametrize(("rogue", "why"), [("lie", "is not the goal"), ("stray", "out of bounds")])
def test_the_referee_has_the_last_word(rogue: str, why: str, worker: Worker, ahead: Problem) -> None:
    answer = worker.run(job(ahead, ROGUES + rogue))
    assert (answer["solved"], answer["correct_solution"]) == (True, False)
    assert answer["failure"].startswith("refused: ")
    assert why in answer["failure"]
    assert answer["path"] is not None, "kept for replay"


@pytest.mark.parametrize("rogue", ["turn_back", "run_ahead"])
def test_times_are_held_against_the_clock_outside(rogue: str, worker: Worker, ahead: Problem) -> None:
    answer = worker.run(job(ahead, ROGUES + rogue, limit=1.0))
    assert (answer["solved"], answer["correct_solution"]) == (True, False)
    assert "expected a time from 0 to the 0.0" in answer["failure"]
    assert answer["time_to_first_solution"] is None
    assert answer["curve"] == []
    assert 0.0 <= answer["time"] < 0.9
    assert worker.run(job(ahead, ROGUES + "honest"))["correct_solution"]


def test_ends_that_are_not_valid(worker: Worker, around: Problem) -> None:
    inside, free = (5.0, 4.0, 0.0), (9.0, 1.0, 0.0)
    for start, goal, status in ((inside, free, Status.INVALID_START), (free, inside, Status.INVALID_GOAL)):
        problem = Problem(replace(around.world, queries=(Query("bad", start, goal),)))
        assert worker.run(job(problem, "PRM"))["status"] == status


def test_a_host_that_dies_takes_its_run_with_it_and_is_replaced(worker: Worker, ahead: Problem) -> None:
    worker.run(job(ahead, ROGUES + "honest"))
    before = worker.pid
    assert before is not None
    runs: list[str] = []

    def kill() -> None:
        runs[:] = children(worker)
        os.kill(before, signal.SIGKILL)

    killer = threading.Timer(0.3, kill)
    killer.start()
    with pytest.raises(ConnectionResetError):
        worker.run(job(ahead, ROGUES + "hang", limit=60.0))
    killer.join()
    assert worker.run(job(ahead, ROGUES + "honest"))["correct_solution"]
    assert worker.pid not in (None, before)
    assert len(runs) == 1
    stat = FilePath(f"/proc/{runs[0]}/stat")
    assert not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] == "Z"


def test_a_users_file_takes_no_librarys_place_and_a_stopped_worker_ends_its_process_and_run(
    ahead: Problem, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "random.py").write_text("raise SystemExit('mine')\n")
    (tmp_path / "my_planner.py").write_text("def plan(checker, start, goal, limit, seed): return [start, goal]\n")
    monkeypatch.chdir(tmp_path)
    made = Worker()
    try:
        assert made.run(job(ahead, "my_planner:plan"))["correct_solution"]
        pid = made.pid
        with ThreadPoolExecutor() as threads:
            under_way = threads.submit(made.run, job(ahead, "RRTstar", limit=30.0))
            deadline = time.perf_counter() + 20.0
            while not children(made) and time.perf_counter() < deadline:
                time.sleep(0.05)
            made.stop()
            with pytest.raises(WorkerError):
                under_way.result(10.0)
        assert not FilePath(f"/proc/{pid}").exists()
    finally:
        made.stop()


def test_a_worker_that_does_not_start_says_why(ahead: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.executable", "/bin/cat")
    with pytest.raises(WorkerError, match=r"a worker process does not start: .+; expected an environment"):
        Worker().run(job(ahead, "landmark"))


def children(worker: Worker) -> list[str]:
    """Return the processes that a worker's process has forked."""
    pid = worker.pid
    listed = FilePath(f"/proc/{pid}/task/{pid}/children")
    return listed.read_text().split() if listed.exists() else []
