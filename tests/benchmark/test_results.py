"""Reading a results database: small ones counted by hand, figures for the shell, and files that are none."""

from __future__ import annotations

import math
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from tests.benchmark.conftest import experiment, solved
from tests.helpers.made_results import run, write_results

from trailmark.benchmark.errors import StoreError
from trailmark.benchmark.record import RunRecord, Status
from trailmark.benchmark.results import failure_lines, load_results, summary_rows
from trailmark.benchmark.store import Store
from trailmark.errors import FormatError


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """One problem: landmark solves 2 of 2, PRM 1 of 4: one times out, one is refused, one crashes."""
    prm = [
        run(0, 0.5, 12.0, simplified_solution_length=9.5),
        run(1, None),
        run(2, 0.2, 8.0, correct_solution=False, failure="collides"),
        run(3, None, status=int(Status.CRASH), failure="killed by signal 11"),
    ]
    return write_results(
        tmp_path / "small.db", {"yard": {"landmark": [run(0, 0.1, 10.0), run(1, 0.3, 11.0)], "PRM": prm}}
    )


def test_what_counts_as_success(small: Path) -> None:
    results = load_results(small)
    assert results.planners == ["landmark", "PRM"]
    assert results.runs == 6
    (problem,) = results.problems
    assert (problem.name, problem.time_limit, problem.wanted) == ("yard", 1.0, 4)
    prm = problem.runs["PRM"]
    assert prm.claimed.tolist() == [True, False, True, False]
    assert prm.success.tolist() == [True, False, False, False]
    assert prm.refused == 1
    assert prm.first_times.tolist() == [0.5, math.inf, math.inf, math.inf]
    assert prm.costs.tolist() == [12.0, math.inf, math.inf, math.inf]
    assert prm.endings() == {"crash": 1, "refused by the referee": 1, "timeout": 1}
    assert problem.runs["landmark"].endings() == {}
    # The refused path of cost 8 is no path; the simplified one of 9.5 is.
    assert problem.best_cost == 9.5


def test_curves(small: Path) -> None:
    results = load_results(small)
    prm = results.problems[0].runs["PRM"]
    times, costs = prm.curves[0]
    assert times.tolist() == [0.5, 0.9]
    assert costs.tolist() == pytest.approx([14.4, 12.0])
    assert prm.curves[1][0].shape == (0,)


def test_a_run_without_a_first_time_had_its_path_at_the_end(tmp_path: Path) -> None:
    rows = [run(0, 0.2, 10.0, time_to_first_solution=None, time=0.75)]
    results = load_results(write_results(tmp_path / "r.db", {"yard": {"FMT": rows}}))
    assert results.problems[0].runs["FMT"].first_times.tolist() == [0.75]


def test_what_the_store_writes_is_read(tmp_path: Path) -> None:
    wanted = experiment(identity={"problem": "ab", "resolution": 0.1}, facts={"text": "no world"}, seed=3)
    record = RunRecord(
        status=int(Status.EXACT_SOLUTION), seed=3, solved=True, correct_solution=True, time=1.0, solution_length=5.0
    )
    with Store(tmp_path / "r.db") as store:
        key, planner = store.experiment(**wanted), store.planner("landmark", "default")
        store.add(key, planner, record)
        store.experiment(**wanted | {"name": "later", "identity": {"problem": "cd"}})
    # Also while a benchmark holds the file.
    with Store(tmp_path / "r.db"):
        results = load_results(tmp_path / "r.db")
    assert results.problems[0].runs["landmark"].costs.tolist() == [5.0]
    assert results.problems[0].facts["setup"]["identity"]["resolution"] == 0.1
    assert results.settings == {"landmark": "default"}
    assert results.empty == ["later"]


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
    with pytest.raises(FormatError, match="does not exist"):
        load_results(tmp_path / "none.db")
    with pytest.raises(FormatError, match="is no file"):
        load_results(tmp_path)
    text = tmp_path / "text.db"
    text.write_text("not a database, but long enough to be looked at")
    with pytest.raises(FormatError, match="not an SQLite database"):
        load_results(text)
    empty = tmp_path / "empty.db"
    empty.touch()
    with pytest.raises(StoreError, match="empty database"):
        load_results(empty)
    torn = tmp_path / "torn.db"
    torn.write_bytes(small.read_bytes()[:9000])
    with pytest.raises(StoreError, match="cannot be read"):
        load_results(torn)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ("PRAGMA application_id = 7", "another program"),
        ("PRAGMA user_version = 9", "expected schema version 1, got 9"),
        ("DROP TABLE progress", "'progress' is missing"),
        ("ALTER TABLE runs DROP COLUMN memory", "no column 'memory'"),
        ("DELETE FROM runs", "no finished run"),
    ],
)
def test_databases_of_another_schema(small: Path, change: str, problem: str) -> None:
    with closing(sqlite3.connect(small)) as db, db:
        db.execute(change)
    with pytest.raises(StoreError, match=problem):
        load_results(small)


@pytest.mark.parametrize("value", ["", "[[", b"\xff\xfe"])
def test_a_cell_that_is_no_number_is_reported(database: Path, tmp_path: Path, value: object) -> None:
    file = tmp_path / "damaged.db"
    file.write_bytes(database.read_bytes())
    with closing(sqlite3.connect(file)) as db:
        db.execute("UPDATE runs SET time = ?", (value,))
        db.commit()
    with pytest.raises(StoreError, match=r"damaged\.db: a cell holds what its column does not"):
        load_results(file)


def test_medians_and_counts(tmp_path: Path) -> None:
    file = tmp_path / "results.db"
    with Store(file) as store:
        row, good, bad = store.experiment(**experiment()), store.planner("good", ""), store.planner("bad", "")
        for seed, cost in enumerate((10.0, 11.0, 12.0)):
            store.add(row, good, solved(seed, solution_length=cost, simplified_solution_length=10.0))
        store.add(row, bad, solved(0, correct_solution=False, solution_length=1.0))
        store.add(row, bad, RunRecord(seed=1, status=4))
    assert summary_rows(load_results(file), ["good", "bad"])[1:] == [
        ("good", "3/3", "0", "0.250 s", "x 1.100", "x 1.000"),
        ("bad", "0/2", "1", "-", "-", "-"),
    ]


def test_experiments_of_one_name_have_rows_of_their_own(tmp_path: Path) -> None:
    file = tmp_path / "results.db"
    with Store(file) as store:
        first, second = experiment(), experiment()
        second |= {"identity": {**second["identity"], "time_limit": 5.0}, "timelimit": 5.0}
        planner = store.planner("good", "")
        for row, cost in ((store.experiment(**first), 10.0), (store.experiment(**second), 8.0)):
            store.add(row, planner, solved(0, solution_length=cost, simplified_solution_length=cost))
    rows = summary_rows(load_results(file), ["good"])[1:]
    assert [row[1:2] for row in rows] == [("1/1",), ("1/1",)]
    assert rows[1][0] == "good (limit 5 s)"
    assert rows[0][0].startswith("good (limit ")
    names = [problem.name for problem in load_results(file).problems]
    assert len(set(names)) == 2
    assert names[1].endswith("(limit 5 s)")


def test_the_most_frequent_reason_for_failing_is_told(tmp_path: Path) -> None:
    file = tmp_path / "results.db"
    with Store(file) as store:
        row, good, bad = store.experiment(**experiment()), store.planner("good", ""), store.planner("bad", "")
        store.add(row, good, solved(0))
        for seed, reason in enumerate(("hit a\nwall", "late", "late", None)):
            store.add(row, bad, RunRecord(seed=seed, status=8, failure=reason))
    assert failure_lines(load_results(file), ["good", "bad", "absent"]) == ["bad: 2 of 4 runs: late"]
