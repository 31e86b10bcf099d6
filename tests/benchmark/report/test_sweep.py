"""Speed against refusals, on runs made up."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.benchmark.conftest import experiment, solved

from trailmark.benchmark.record import RunRecord
from trailmark.benchmark.report.data import Results, load_results
from trailmark.benchmark.report.markdown import markdown_report
from trailmark.benchmark.report.page import html_report
from trailmark.benchmark.report.sweep import sweep_table
from trailmark.benchmark.store import Store


def swept(file: Path, problems: dict[str, list[float]]) -> Results:
    """Four runs a planner: at the coarse resolution PRM is fast, and one of its paths is refused."""
    with Store(file) as store:
        names = ("PRM", "PRM+certified")
        planners = {name: store.planner(name, "default") for name in names}
        for problem, shares in problems.items():
            for share in shares:
                identity = {"problem": problem, "time_limit": 1.0, "resolution": 0.2 * share}
                row = store.experiment(experiment(identity=identity, facts={"resolution_share": share}))
                for name, planner in planners.items():
                    for seed in range(4):
                        coarse = share == 0.5 and name == "PRM"
                        first = 0.1 if coarse else 0.2
                        wrong = coarse and seed == 3
                        store.add(row, planner, solved(seed, time_to_first_solution=first, correct_solution=not wrong))
    return load_results(file)


@pytest.mark.slow
def test_each_resolution_of_planners_with_discrete_checks_has_its_row(tmp_path: Path) -> None:
    results = swept(tmp_path / "r.db", {"a": [0.5, 0.1], "b": [0.5, 0.1], "c": [0.5]})
    table = sweep_table(results)
    assert table is not None
    assert "on 2 problems" in table.caption
    coarse, fine = table.rows
    # Wilson's interval of 2 in 8 and of 0 in 8, by hand: 7.1 to 59.1 %, 0 to 32.4 %.
    assert coarse[:8] == ["PRM", "50 %", "0.1", "8", "8", "25.0 %", "7.1 to 59.1 %", "75.0 %"]
    assert fine[:8] == ["PRM", "10 %", "0.02", "8", "8", "0 %", "0.0 to 32.4 %", "100 %"]
    assert fine[8].startswith("200")
    assert "Speed against refusals" in html_report(results)
    assert "## Speed against refusals" in markdown_report(results)


def test_planners_of_a_family_are_counted_together(tmp_path: Path) -> None:
    file = tmp_path / "r.db"
    with Store(file) as store:
        for share in (0.5, 0.1):
            identity = {"problem": "a", "resolution": share}
            row = store.experiment(experiment(identity=identity, facts={"resolution_share": share}))
            for name in ("PRM", "RRT", "landmark"):
                for seed in range(3):
                    store.add(row, store.planner(name, "default"), solved(seed, correct_solution=name != "RRT"))
    table = sweep_table(load_results(file))
    assert table is not None
    assert [row[0] for row in table.rows[::2]] == ["PRM", "RRT", "all: OMPL, discrete checks"]
    assert [row[3:6] for row in table.rows[4:]] == [["6", "6", "50.0 %"]] * 2


def test_one_resolution_is_no_sweep(tmp_path: Path) -> None:
    results = swept(tmp_path / "r.db", {"a": [0.5], "b": [0.1]})
    assert sweep_table(results) is None
    assert "Speed against refusals" not in html_report(results)


def test_a_planner_that_found_nothing(tmp_path: Path) -> None:
    file = tmp_path / "r.db"
    with Store(file) as store:
        for share in (0.5, 0.1):
            row = store.experiment(experiment(identity={"problem": "a", "r": share}, facts={"resolution_share": share}))
            store.add(row, store.planner("PRM", "default"), RunRecord(seed=0, time=1.0))
    table = sweep_table(load_results(file))
    assert table is not None
    assert [row[5] for row in table.rows] == ["–", "–"]
