"""Reading a results database: small ones counted by hand, and files that are none."""

from __future__ import annotations

import math
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from tests.helpers.made_results import run, write_results
from tests.helpers.runs import experiment, solved

from trailmark.benchmark.errors import StoreError
from trailmark.benchmark.record import Status
from trailmark.benchmark.results import load_results
from trailmark.benchmark.store import Store
from trailmark.errors import FormatError


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """One problem: landmark solves 2 of 2, PRM 1 of 5: one times out, one is refused, one crashes, one is unknown."""
    prm = [
        run(0, 0.5, 12.0, simplified_solution_length=9.5),
        run(1, None),
        run(2, 0.2, 8.0, correct_solution=False, failure="collides"),
        run(3, None, status=int(Status.CRASH), failure="killed by signal 11"),
        run(4, None, status=None),
    ]
    fast = [run(0, 0.1, 10.0), run(1, None, 11.0, solved=True, correct_solution=True, time=0.75)]
    return write_results(tmp_path / "small.db", {"yard": {"landmark": fast, "PRM": prm}})


def test_what_counts_as_success(small: Path) -> None:
    results = load_results(small)
    assert (results.planners, results.runs) == (["landmark", "PRM"], 7)
    (problem,) = results.problems
    assert (problem.name, problem.time_limit, problem.wanted) == ("yard", 1.0, 5)
    prm = problem.runs["PRM"]
    assert prm.claimed.tolist() == [True, False, True, False, False]
    assert prm.success.tolist() == [True, False, False, False, False]
    assert prm.refused == 1
    assert prm.first_times.tolist() == [0.5, *[math.inf] * 4]
    assert prm.costs.tolist() == [12.0, *[math.inf] * 4]
    assert prm.endings() == {"crash": 1, "refused by the referee": 1, "timeout": 1, "unknown status": 1}
    assert problem.runs["landmark"].endings() == {}
    # A planner that tells only of its end had its path then.
    assert problem.runs["landmark"].first_times.tolist() == [0.1, 0.75]
    # The refused path of cost 8 is no path; the simplified one of 9.5 is.
    assert problem.best_cost == 9.5
    times, costs = prm.curves[0]
    assert times.tolist() == [0.5, 0.9]
    assert costs.tolist() == pytest.approx([14.4, 12.0])
    assert prm.curves[1][0].shape == (0,)


def test_what_the_store_writes_is_read_while_it_is_open(tmp_path: Path) -> None:
    file = tmp_path / "r.db"
    with Store(file) as store:
        planner = store.planner("landmark", "default")
        for limit in (1.0, 5.0):
            wanted = experiment(identity={"problem": "ab", "time_limit": limit}, timelimit=limit)
            store.add(store.experiment(**wanted), planner, solved(3, solution_length=limit))
        store.experiment(**experiment(identity={"problem": "cd"}) | {"name": "later"})
        results = load_results(file)
    first, second = results.problems
    assert (first.runs["landmark"].costs.tolist(), second.runs["landmark"].costs.tolist()) == ([1.0], [5.0])
    assert first.facts["setup"]["identity"] == {"problem": "ab", "time_limit": 1.0}
    assert results.settings == {"landmark": "default"}
    assert results.empty == ["later"]
    # Named alike, they are told apart.
    assert (first.name, second.name) == ("room-ahead (no. 1: 1 s, 512 MB)", "room-ahead (no. 2: 5 s, 512 MB)")


def test_a_journal_left_by_a_killed_writer_is_rolled_back(small: Path, tmp_path: Path) -> None:
    db = sqlite3.connect(small, isolation_level=None)
    db.execute("PRAGMA cache_size = 1")
    db.execute("BEGIN IMMEDIATE")
    db.execute("UPDATE runs SET solved = 0, path = hex(randomblob(20000))")
    copy = tmp_path / "copy.db"
    copy.write_bytes(small.read_bytes())
    Path(f"{copy}-journal").write_bytes(Path(f"{small}-journal").read_bytes())
    db.execute("ROLLBACK")
    db.close()
    assert load_results(copy).problems[0].runs["landmark"].success.all()


def test_files_that_are_no_results(small: Path, tmp_path: Path) -> None:
    (tmp_path / "text.db").write_text("not a database, but long enough to be looked at")
    (tmp_path / "empty.db").touch()
    (tmp_path / "torn.db").write_bytes(small.read_bytes()[:9000])
    expected: dict[str, tuple[Any, str]] = {
        "none.db": (FormatError, "does not exist"),
        "": (FormatError, "is no file"),
        "text.db": (StoreError, "no SQLite database"),
        "empty.db": (StoreError, "empty database"),
        "torn.db": (StoreError, "malformed"),
    }
    for name, (kind, problem) in expected.items():
        with pytest.raises(kind, match=problem):
            load_results(tmp_path / name)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ("PRAGMA application_id = 7", "did not write"),
        ("PRAGMA user_version = 9", "expected schema version 1, got version 9"),
        ("DROP TABLE progress", "no such table: progress"),
        ("ALTER TABLE runs DROP COLUMN solution_length", "no such column: solution_length"),
        ("DELETE FROM runs", "no finished run"),
        ("UPDATE runs SET time = ''", r"small\.db: a cell holds what its column does not"),
        ("UPDATE runs SET time = '[['", r"small\.db: a cell holds what its column does not"),
        ("UPDATE runs SET time = x'fffe'", r"small\.db: a cell holds what its column does not"),
    ],
)
def test_databases_of_another_schema_or_damaged(small: Path, change: str, problem: str) -> None:
    with closing(sqlite3.connect(small)) as db, db:
        db.execute(change)
    with pytest.raises(StoreError, match=problem):
        load_results(small)
