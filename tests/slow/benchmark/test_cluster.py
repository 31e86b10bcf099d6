"""A real Dask scheduler with two workers, one of which is killed half-way."""

from __future__ import annotations

import json
import os
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from tests.helpers.runs import small_world

from trailmark.benchmark.errors import WorkerError
from trailmark.benchmark.workers import cluster
from trailmark.cli import main

pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")

ROOT = Path(__file__).resolve().parents[3]
RUNS = 12


@contextmanager
def process(*words: object) -> Iterator[subprocess.Popen[bytes]]:
    path = os.pathsep.join([str(ROOT), str(ROOT / "src")])
    environment = os.environ | {"PYTHONPATH": path, "DASK_DISTRIBUTED__DIAGNOSTICS__NVML": "False"}
    command, quiet = [sys.executable, "-W", "ignore", "-m", *map(str, words)], subprocess.DEVNULL
    with subprocess.Popen(command, stdout=quiet, stderr=quiet, env=environment) as started:
        try:
            yield started
        finally:
            started.kill()


def runs_in(file: Path) -> list[tuple[int, int]]:
    with closing(sqlite3.connect(file)) as db:
        try:
            return db.execute("SELECT plannerid, seed FROM runs WHERE correct_solution").fetchall()
        except sqlite3.OperationalError:  # not made yet
            return []


def test_a_killed_worker_only_repeats_its_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    world, results, address = tmp_path / "room.yaml", tmp_path / "results.db", tmp_path / "scheduler.json"
    small_world().save(world)
    worker = ("distributed.cli.dask_worker", "--scheduler-file", address, "--nthreads", 1, "--no-nanny")
    quiet = ("--no-dashboard", "--local-directory", tmp_path)
    with (
        process("distributed.cli.dask_scheduler", "--port", 0, "--scheduler-file", address, "--no-dashboard"),
        process(*worker, *quiet) as first,
        process(*worker, *quiet),
    ):
        deadline = time.perf_counter() + 30.0
        while not address.exists() and time.perf_counter() < deadline:
            time.sleep(0.05)
        words = [
            *("benchmark", str(world), "--query", "ahead"),
            *("-p", "tests.helpers.rogues:honest", "--runs", str(RUNS), "--time-limit", "5"),
            *("--scheduler", json.loads(address.read_text())["address"], "--output", str(results)),
        ]
        killed_after: list[int] = []
        over = threading.Event()

        def kill() -> None:
            while not over.wait(0.02):
                if results.exists() and (made := len(runs_in(results))) >= 3:
                    first.send_signal(signal.SIGKILL)
                    killed_after.append(made)
                    return

        killer = threading.Thread(target=kill)
        killer.start()
        try:
            status = main(words)
        finally:
            over.set()
            killer.join()
    out, err = capsys.readouterr()
    assert killed_after
    assert killed_after[0] < RUNS
    # On a busy machine Dask warns on stderr of event loops that were unresponsive.
    assert status == 0, err
    assert "trailmark" not in err
    assert "Traceback" not in err
    assert f"{RUNS} runs made, 0 of them without" in out
    assert sorted(runs_in(results)) == [(1, seed) for seed in range(RUNS)]


def test_a_scheduler_that_does_not_answer_and_no_dask(monkeypatch: pytest.MonkeyPatch) -> None:
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))  # and nobody listens
        for address in (f"tcp://127.0.0.1:{taken.getsockname()[1]}", "no address"):
            with pytest.raises(WorkerError, match="does not answer"), cluster(address, answer_limit=0.5):
                pass
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(WorkerError, match=r"pip install 'trailmark\[cluster\]'"), cluster("tcp://127.0.0.1:1"):
        pass
