"""What the clock measures: a word on each planner, and the cold ranking counted by hand."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.helpers.made_results import run, write_results

from trailmark.benchmark.report import load_results
from trailmark.benchmark.report.clock import clock_table, cold_table
from trailmark.benchmark.report.palette import FAMILIES, family_of
from trailmark.benchmark.report.summary import summarise

NAMES = ["landmark", "PRM", "PRM+certified", "native:PRM", "module:plan"]


def test_every_family_has_its_row(tmp_path: Path) -> None:
    assert {family_of(name) for name in NAMES} == set(FAMILIES)
    rows = {name: [run(0, 0.1, 10.0, setup_time=0.02, simplification_time=0.003)] for name in NAMES}
    table = clock_table(load_results(write_results(tmp_path / "r.db", {"yard": rows})))
    assert [row[0] for row in table.rows] == NAMES
    for row in table.rows:
        assert len(row) == len(table.columns)
        assert (row[3], row[9]) == ("20.0", "3.00")
        assert all(row)


def test_loading_and_building_can_turn_the_order_round(tmp_path: Path) -> None:
    rows = {
        "landmark": [run(k, 0.01, 10.0, setup_time=0.2) for k in range(3)],
        "native:PRM": [run(0, 0.09, 10.0, setup_time=0.01), run(1, None, setup_time=0.25)],
        "own:plan": [run(0, 0.2, 10.0, setup_time=None)],
    }
    results = load_results(write_results(tmp_path / "r.db", {"yard": rows}))
    summary = summarise(results)
    cold = {s.planner: s.cold_mean for s in summary.planners}
    assert cold["landmark"] == pytest.approx(0.21)
    assert cold["native:PRM"] == pytest.approx((0.11 * 1.26) ** 0.5 - 0.01), "a failure at the limit of 1 s"
    table = cold_table(results, summary)
    assert [(row[0], row[5], row[6]) for row in table.rows] == [
        *(("landmark", "1", "1"), ("native:PRM", "2", "3"), ("own:plan", "–", "2"))
    ]
