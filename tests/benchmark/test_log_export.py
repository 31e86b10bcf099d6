"""Export as OMPL's log: read back by OMPL's own script."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from ompl.tools import readBenchmarkLog
from tests.benchmark.conftest import experiment, solved

from trailmark.benchmark.errors import StoreError
from trailmark.benchmark.log_export import export_log
from trailmark.benchmark.schema import MEASURED
from trailmark.benchmark.store import Store

NUMBERS = [name for name, kind in MEASURED.items() if kind != "TEXT"]


def rows(file: Path, query: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(file)) as db:
        return db.execute(query).fetchall()


def test_ompls_script_reads_the_same_numbers(
    database: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], recwarn: pytest.WarningsRecorder
) -> None:
    log, theirs = tmp_path / "results.log", tmp_path / "theirs.db"
    assert export_log(database, log) == [log]
    readBenchmarkLog(str(theirs), [str(log)], False)
    assert "PRM" in capsys.readouterr().out
    runs = (
        f"SELECT p.name, {', '.join('r.' + name for name in NUMBERS)} FROM runs r "  # noqa: S608  # our own columns' names
        "JOIN plannerConfigs p ON p.id = plannerid ORDER BY p.name, r.seed"
    )
    assert rows(theirs, runs) == rows(database, runs)
    curves = "SELECT r.seed, g.time, g.best_cost FROM progress g JOIN runs r ON r.id = runid ORDER BY 1, 2"
    assert rows(theirs, curves) == rows(database, curves)
    assert rows(theirs, "SELECT * FROM enums") == rows(database, "SELECT * FROM enums")
    settings = "SELECT name, timelimit, memorylimit, runcount, totaltime, hostname, seed FROM experiments"
    assert rows(theirs, settings) == rows(database, settings)
    assert rows(theirs, "SELECT version FROM experiments") == [("trailmark 0.1.0",)]
    # The script leaves its own file open.
    assert all(issubclass(warning.category, ResourceWarning) for warning in recwarn)


def test_more_experiments_are_more_logs(database: Path, tmp_path: Path) -> None:
    with Store(database) as store:
        other = store.experiment(experiment(name="room-around", identity={"problem": "def"}))
        store.add(other, store.planner("PRM", "discrete"), solved(0))
    written = export_log(database, tmp_path / "all.log")
    assert [file.name for file in written] == ["all.log", "all-2.log"]
    assert [file.read_text().splitlines()[1] for file in written] == ["Experiment room-ahead", "Experiment room-around"]


def test_no_database(tmp_path: Path) -> None:
    (tmp_path / "text.db").write_text("no database at all\n" * 10)
    for name in ("text.db", "nowhere.db"):
        with pytest.raises(StoreError, match="expected a database of trailmark benchmark"):
            export_log(tmp_path / name, tmp_path / "out.log")
    assert not (tmp_path / "out.log").exists()
