"""The table that the shell prints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from tests.benchmark.conftest import experiment, solved

from trailmark.benchmark.record import RunRecord
from trailmark.benchmark.results import failure_lines, load_results, summary_rows
from trailmark.benchmark.store import Store


def test_medians_and_counts(tmp_path: Path) -> None:
    file = tmp_path / "results.db"
    with Store(file) as store:
        row, good, bad = store.experiment(experiment()), store.planner("good", ""), store.planner("bad", "")
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
        second = replace(second, identity={**second.identity, "time_limit": 5.0}, time_limit=5.0)
        planner = store.planner("good", "")
        for row, cost in ((store.experiment(first), 10.0), (store.experiment(second), 8.0)):
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
        row, good, bad = store.experiment(experiment()), store.planner("good", ""), store.planner("bad", "")
        store.add(row, good, solved(0))
        for seed, reason in enumerate(("hit a\nwall", "late", "late", None)):
            store.add(row, bad, RunRecord(seed=seed, status=8, failure=reason))
    assert failure_lines(load_results(file), ["good", "bad", "absent"]) == ["bad: 2 of 4 runs: late"]
