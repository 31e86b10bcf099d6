"""``trailmark benchmark`` and ``report``: whole runs, killed ones, and what is left of them."""

from __future__ import annotations

import itertools
import json
import math
import os
import re
import secrets
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.affinity import affine_transform, rotate
from tests.helpers.made_results import random_results

Shell = Callable[..., Any]
Terminal = Callable[..., Any]
ROOT = Path(__file__).resolve().parents[2]
COMMAND = [sys.executable, "-m", "trailmark.cli", "benchmark"]
BLOCK = rotate(shapely.box(1.5, 4.75, 2.5, 5.25), 0.3, use_radians=True)
HONEST = "tests.helpers.rogues:honest"


@pytest.fixture(autouse=True)
def _rogues_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "src")]))


def rows(file: Path, query: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(file)) as db:
        return db.execute(query).fetchall()


def count(file: Path) -> int:
    try:
        return int(rows(file, "SELECT count(*) FROM runs")[0][0]) if file.exists() else 0
    except sqlite3.OperationalError:  # its tables are not made yet
        return 0


@pytest.mark.slow
def test_planners_on_problems_and_again(shell: Shell, yard: Path, tmp_path: Path) -> None:
    results = tmp_path / "results.db"
    words = ["benchmark", yard, "-p", "landmark", "-p", "RRTConnect+certified", "--runs", 1, "--time-limit", 0.2]
    words += ["--seed", 4, "--output", results]
    run = shell(*words)
    assert (run.status, run.err) == (0, "")
    first, *table, last = run.out.splitlines()
    assert first == "4 runs made, 0 of them without a correct solution"
    assert [row.split()[:2] for row in table] == [
        ["planner", "solved"],
        ["landmark", "2/2"],
        ["RRTConnect+certified", "2/2"],
    ]
    assert last == f"written: {results}"
    found = rows(
        results,
        "SELECT e.name, p.name, r.seed, r.correct_solution FROM runs r JOIN experiments e ON e.id = experimentid "
        "JOIN plannerConfigs p ON p.id = plannerid ORDER BY 1, 2",
    )
    assert found == [(f"yard-{q}", p, 4, 1) for q in ("across", "back") for p in ("RRTConnect+certified", "landmark")]
    setup = json.loads(rows(results, "SELECT setup FROM experiments")[0][0])
    assert "trailmark: 1\nname: yard" in setup["facts"]["text"]
    assert setup["facts"]["robot"] == "rectangle 0.8 x 0.4 m"
    assert len(setup["identity"]["problem"]) == 64
    assert {"ompl", "numpy", "Python", "processor"} <= set(setup["conditions"])
    before = results.read_bytes()
    again = shell(*words, "--json")
    assert json.loads(again.out) == {"database": str(results), "runs": 4, "made": 0, "without_solution": 0}
    assert rows(results, "SELECT count(*) FROM runs") == [(4,)]
    assert len(before) == len(results.read_bytes())


@pytest.mark.slow
def test_a_differential_drive_and_why_ompl_has_no_plan_for_it(shell: Shell, yard: Path, tmp_path: Path) -> None:
    results = tmp_path / "results.db"
    words = ["benchmark", yard, "-p", "landmark", "-p", "RRTConnect", "--runs", 1, "--time-limit", 0.2]
    run = shell(*words, "--drive", "differential", "--output", results)
    assert (run.status, run.err) == (0, "")
    assert re.search(r"^  landmark +2/2 ", run.out, re.MULTILINE)
    assert re.search(r"^RRTConnect: 2 abort: .*omnidirectional one or a car in OMPL", run.out, re.MULTILINE)
    # There is nothing to shorten by in OMPL, and no complaint about it.
    assert rows(results, "SELECT count(*) FROM runs WHERE solved AND failure IS NOT NULL") == [(0,)]


@pytest.mark.slow
def test_all_planners_keep_a_clearance(shell: Shell, yard: Path, tmp_path: Path) -> None:
    results = tmp_path / "results.db"
    words = ["benchmark", yard, "--query", "across", "-p", "landmark", "-p", "RRTConnect+certified", "-p", HONEST]
    run = shell(*words, "--runs", 1, "--time-limit", 0.5, "--clearance", 0.3, "--output", results)
    assert (run.status, run.err) == (0, "")
    chosen = "SELECT p.name, r.path FROM runs r JOIN plannerConfigs p ON p.id = plannerid WHERE correct_solution"
    found = rows(results, chosen)
    assert {name for name, _ in found} == {"landmark", "RRTConnect+certified"}  # the honest one goes straight
    blocks = shapely.union_all([shapely.Point(5, 3).buffer(1.0, 256), BLOCK])
    for _, path in found:
        states = np.array(json.loads(path))
        for (x0, y0, t0), (x1, y1, t1) in itertools.pairwise(states):
            turned = math.remainder(t1 - t0, 2.0 * math.pi)
            for s in np.linspace(0.0, 1.0, 400):
                cos, sin = math.cos(t0 + s * turned), math.sin(t0 + s * turned)
                place = [cos, -sin, sin, cos, x0 + s * (x1 - x0), y0 + s * (y1 - y0)]
                body = affine_transform(shapely.box(-0.4, -0.2, 0.4, 0.2), place)
                assert body.distance(blocks) > 0.3 - 1e-4
                assert shapely.box(0.3, 0.3, 9.7, 5.7).buffer(1e-6).covers(body)
    plain = shell(*words, "--runs", 1, "--time-limit", 0.5, "--output", results, "--json")
    assert json.loads(plain.out)["made"] == 3  # another problem


@pytest.mark.slow
def test_a_suite_with_words_that_override_it(shell: Shell, yard: Path, tmp_path: Path) -> None:
    suite = tmp_path / "suite.yaml"
    suite.write_text(
        f"planners: [{HONEST!r}]\nruns: 5\ntime_limit: 0.2\nworlds:\n"
        "  - {world: yard.yaml, queries: [{name: along, start: [1, 1, 0], goal: [9, 1, 0]}]}\n"
        '  - {world: "data:nowhere.map"}\n'
    )
    run = shell("benchmark", "--suite", suite, "--runs", 2, "--output", tmp_path / "results.db")
    assert (run.status, run.err) == (0, "")
    assert rows(tmp_path / "results.db", "SELECT name, runcount, timelimit FROM experiments") == [
        ("yard-along", 2, 0.2)
    ]


def words_for(yard: Path, results: Path, runs: int) -> list[str]:
    words = [yard, "--query", "across", "-p", HONEST, "--runs", runs, "--time-limit", "5", "--output", results]
    return list(map(str, words))


def wait_for(results: Path, runs: int, process: subprocess.Popen[str]) -> None:
    while count(results) < runs and process.poll() is None:
        time.sleep(0.01)


def left_behind(mark: str) -> list[int]:
    """Return the processes whose environment holds a mark."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/environ"):
        try:
            if mark.encode() in entry.read_bytes():
                found.append(int(entry.parent.name))
        except OSError:  # ended meanwhile, or another user's
            continue
    return [pid for pid in found if pid != os.getpid()]


@pytest.mark.slow
def test_stopped_at_once_killed_and_continued_on_a_terminal(
    terminal: Terminal, yard: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results, runs, mark = tmp_path / "results.db", 24, secrets.token_hex(16)
    words = words_for(yard, results, runs)
    monkeypatch.setenv("TRAILMARK_TEST_MARK", mark)
    there = 0
    for number in (signal.SIGINT, signal.SIGKILL):
        with subprocess.Popen([*COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            wait_for(results, there + 2, process)
            kept = count(results)
            process.send_signal(number)
            out, err = process.communicate(timeout=120)
        there = count(results)
        assert kept <= there < runs
        if number == signal.SIGINT:
            assert process.returncode == 130
            said = f"{there} of {runs} runs are in {results}; the same command makes the others\n"
            assert err == said + "trailmark: error: interrupted\n"
            assert out == ""
    run = terminal(*COMMAND, *words)
    assert run.status == 0
    assert f"{runs - there} runs made" in run.out
    assert "starting workers" in run.err
    assert " left" in run.err
    assert f" of {runs} " in run.err
    assert sorted(rows(results, "SELECT seed FROM runs")) == [(seed,) for seed in range(runs)]
    assert rows(results, "PRAGMA integrity_check") == [("ok",)]
    assert sorted(file.name for file in tmp_path.iterdir()) == [results.name, yard.name]
    assert_nothing_is_left(mark)


def assert_nothing_is_left(mark: str) -> None:
    deadline = time.perf_counter() + 5.0
    while left_behind(mark) and time.perf_counter() < deadline:
        time.sleep(0.05)
    assert left_behind(mark) == []


@pytest.mark.slow
def test_a_run_that_hangs_ends_with_a_killed_benchmark(
    yard: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mark = secrets.token_hex(16)
    monkeypatch.setenv("TRAILMARK_TEST_MARK", mark)
    words = [word.replace("honest", "hang") for word in words_for(yard, tmp_path / "results.db", 1)]
    with subprocess.Popen([*COMMAND, *words], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        deadline = time.perf_counter() + 60.0
        while len(left_behind(mark)) < 3 and time.perf_counter() < deadline:  # itself, the host, the run
            time.sleep(0.05)
        assert len(left_behind(mark)) == 3
        process.kill()
    assert_nothing_is_left(mark)


def test_the_public_suites_are_listed_with_where_they_are_published(shell: Shell) -> None:
    run = shell("benchmark", "--list-suites")
    assert (run.status, run.err) == (0, "")
    listed = [line for line in run.out.splitlines() if not line.startswith(" ")]
    assert listed == [*("movingai", "omplapp", "nav2", "barn", "bench-mr", "families", "clutter", "passages")]
    assert run.out.count("  published: ") == 6
    assert "github.com/Daffan/the-barn-challenge" in run.out


@pytest.mark.slow
def test_a_part_of_a_public_suite_is_run(shell: Shell, shared_data: Path, tmp_path: Path) -> None:
    results = tmp_path / "results.db"
    words = ["benchmark", "--suite", "barn", "--data", shared_data / "barn", "-p", HONEST, "--runs", 1]
    run = shell(*words, "--problems", 2, "--time-limit", 0.1, "--output", results)
    assert (run.status, run.err) == (0, "")
    assert rows(results, "SELECT name FROM experiments ORDER BY id") == [
        ("barn-world_0-ahead",),
        ("barn-world_299-ahead",),
    ]


@pytest.fixture
def results(tmp_path: Path) -> Path:
    return random_results(tmp_path / "results.db", ["landmark", "PRM"], problems=1, runs=3)


def test_the_summary_is_printed_and_the_page_written(shell: Shell, results: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    before = results.read_bytes()
    run = shell("report", results)
    assert (run.status, run.err) == (0, "")
    assert [line.split()[0] for line in run.out.splitlines()[:3]] == ["planner", "landmark", "PRM"]
    again = shell("report", results, "--html", page)
    assert again.out == run.out + f"written: {page} (1 problem, 2 planners, 6 runs)\n"
    assert page.read_text().startswith("<!DOCTYPE html>")
    assert results.read_bytes() == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["report.html", "results.db"]
