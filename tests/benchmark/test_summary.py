"""The table that the shell prints."""

from __future__ import annotations

from pathlib import Path

from tests.benchmark.conftest import experiment, solved

from trailmark.benchmark.record import RunRecord
from trailmark.benchmark.store import Store
from trailmark.benchmark.summary import summary_rows


def test_medians_and_counts(tmp_path: Path) -> None:
    file = tmp_path / "results.db"
    with Store(file) as store:
        row, good, bad = store.experiment(experiment()), store.planner("good", ""), store.planner("bad", "")
        for seed, cost in enumerate((10.0, 11.0, 12.0)):
            store.add(row, good, solved(seed, solution_length=cost, simplified_solution_length=10.0))
        store.add(row, bad, solved(0, correct_solution=False, solution_length=1.0))
        store.add(row, bad, RunRecord(seed=1, status=4))
    assert summary_rows(file, ["good", "bad"])[1:] == [
        ("good", "3/3", "0", "0.250 s", "x 1.100", "x 1.000"),
        ("bad", "0/2", "1", "-", "-", "-"),
    ]
