"""Store: Planner Arena's schema, one writer, nothing lost, nothing overwritten; the record of a run."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from ompl import base as ob
from ompl.tools import readBenchmarkLog
from tests.helpers.runs import experiment, solved

from trailmark.benchmark.errors import StoreError
from trailmark.benchmark.record import MEASURED, RunRecord, Status
from trailmark.benchmark.store import Store


def rows(file: Path, query: str) -> list[tuple[Any, ...]]:
    with closing(sqlite3.connect(file)) as db:
        return db.execute(query).fetchall()


def columns(file: Path, table: str) -> dict[str, str]:
    return {name: kind for _, name, kind, *_ in rows(file, f"PRAGMA table_info({table})")}


def test_the_tables_are_those_that_ompls_own_script_makes(database: Path, tmp_path: Path) -> None:
    theirs = tmp_path / "theirs.db"
    readBenchmarkLog(str(theirs), [], False)
    for table in ("experiments", "plannerConfigs", "enums", "runs", "progress"):
        wanted = columns(theirs, table)
        assert wanted, table
        assert wanted.items() <= columns(database, table).items()
    assert columns(database, "runs") == columns(theirs, "runs") | MEASURED
    assert rows(database, "SELECT value, description FROM enums WHERE name = 'status' AND value = 6") == [
        (6, "Exact solution")
    ]


def test_a_run_is_written_with_all_that_it_holds(database: Path) -> None:
    with closing(sqlite3.connect(database)) as db:
        db.row_factory = sqlite3.Row
        row = dict(db.execute("SELECT * FROM runs WHERE plannerid = 1 AND seed = 1").fetchone())
    wanted = solved(1).to_json()
    for name in MEASURED:
        value = row[name] if name not in ("path", "simplified_path") else json.loads(row[name])
        assert value == wanted[name], name
    assert (row["id"], *wanted["curve"][1]) in rows(database, "SELECT runid, time, best_cost FROM progress")
    # 1 + 2 s of the first planner, 1 + 0.5 s of the second, simplifying and overhead.
    assert rows(database, "SELECT totaltime FROM experiments") == [(4.5 + 3 * (0.125 + 0.0625),)]


def test_the_same_again_changes_nothing(database: Path) -> None:
    before = rows(database, "SELECT * FROM runs")
    with Store(database) as store:
        row = store.experiment(**experiment(runcount=1))
        assert row == 1
        planner = store.planner("landmark", "default")
        assert store.finished(row) == {(1, 0), (1, 1), (2, 0), (2, 1)}
        assert not store.add(row, planner, RunRecord(seed=1))
    assert rows(database, "SELECT * FROM runs") == before
    assert rows(database, "SELECT runcount FROM experiments") == [(2,)]


def test_other_limits_are_another_experiment_and_other_conditions_are_not_mixed(database: Path) -> None:
    with Store(database) as store:
        other = store.experiment(**experiment(identity={"problem": "abc", "time_limit": 2.0}))
        assert store.finished(other) == set()
        assert store.planner("landmark", "other settings") == 3
    with Store(database) as store, pytest.raises(StoreError, match=r"made with ompl 2\.0\.1, now it is 3\.0") as caught:
        store.experiment(**experiment(conditions={"ompl": "3.0"}))
    assert "expected the same, or another --output" in str(caught.value)


def test_one_writer_at_a_time_and_readers_at_any(database: Path) -> None:
    with Store(database), pytest.raises(StoreError, match="another benchmark is writing to it"):
        Store(database)
    with Store(database):
        assert rows(database, "SELECT count(*) FROM runs") == [(4,)]
    with closing(sqlite3.connect(database, isolation_level=None)) as db:
        db.execute("BEGIN EXCLUSIVE")
        with pytest.raises(StoreError, match="locked by another program"):
            Store(database, busy=0.05)


def foreign_database(file: Path) -> None:
    with closing(sqlite3.connect(file)) as db, db:
        db.execute("CREATE TABLE runs (id INTEGER)")


def future_database(file: Path) -> None:
    Store(file).close()
    with closing(sqlite3.connect(file)) as db:
        db.execute("PRAGMA user_version = 99")


def damaged_database(file: Path) -> None:
    Store(file).close()
    file.write_bytes(file.read_bytes()[:100] + b"\xff" * 6000)


@pytest.mark.parametrize(
    ("make", "problem"),
    [
        (foreign_database, "that trailmark benchmark did not write"),
        (future_database, "expected schema version 1, got version 99"),
        (damaged_database, "malformed"),
        (lambda file: file.write_text("my thesis\n" * 100), "no SQLite database"),
    ],
)
def test_what_is_no_results_database_is_left_alone(make: Any, problem: str, tmp_path: Path) -> None:
    file = tmp_path / "results.db"
    make(file)
    before = file.read_bytes()
    with pytest.raises(StoreError, match=problem):
        Store(file)
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]


def test_statuses_have_ompls_numbers() -> None:
    for status in Status:
        assert getattr(ob.PlannerStatus, status.name).value == status


def test_a_record_survives_json_and_unknown_names_are_left_out() -> None:
    record = solved(3)
    assert RunRecord.from_json(json.loads(json.dumps(record.to_json() | {"weather": "fine"}))) == record


@pytest.mark.parametrize("answer", [{"status": 77}, {"time": float("nan")}, {"memory": float("inf")}])
def test_what_ompl_or_sqlite_would_not_take_is_refused(answer: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"77|finite"):
        RunRecord.from_json(answer)
