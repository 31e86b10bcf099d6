"""Two databases: differences that are there, and none where there are none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats
from tests.helpers.made_results import Run, run, write_results

from trailmark.benchmark.report import html_report, load_results, markdown_report
from trailmark.benchmark.report.against import Against, compare_results
from trailmark.benchmark.report.digits import factor


def rows(seed: int, time: float, cost: float = 10.0, runs: int = 10) -> list[Run]:
    generator = np.random.default_rng(seed)
    spread = generator.normal(0.0, 0.2, (2, runs))
    return [run(k, time * float(np.exp(spread[0, k])), cost + float(spread[1, k])) for k in range(runs)]


def compared(folder: Path, new: dict[str, Any], old: dict[str, Any], **experiment: Any) -> Against:
    files = (write_results(folder / "new.db", new, **experiment), write_results(folder / "old.db", old))
    return compare_results(*(load_results(file) for file in files))


def test_who_is_faster_and_who_is_slower(tmp_path: Path) -> None:
    new = {p: {"A": rows(i, 0.1), "B": rows(i + 9, 0.4), "C": rows(i + 18, 0.2)} for i, p in enumerate(("one", "two"))}
    old = {p: {"A": rows(i, 0.2), "B": rows(i + 9, 0.2), "C": rows(i + 27, 0.2)} for i, p in enumerate(("one", "two"))}
    found = compared(tmp_path, new, old)
    assert {name: pair.winner for name, pair in found.times.items()} == {"A": "new", "B": "old", "C": None}
    assert found.times["A"].factor == pytest.approx(0.21 / 0.11, abs=0.15)
    said = found.sentences()
    assert said[:3] == ["Faster beyond chance: A.", "Cheaper beyond chance: none.", "Slower beyond chance: B."]
    assert "van Elteren" in said[4]
    middle = sorted(pair.factor for pair in found.times.values())[1]
    assert f"The middle planner is {factor(middle)} as fast" in said[5]
    assert [row[0] for row in found.table().rows] == ["A", "B", "C"]
    single = found.problems()
    assert single is not None
    assert {(row[0], row[4]) for row in single.rows} == {("A", "faster"), ("B", "slower")}


def test_on_one_problem_it_is_mann_and_whitneys(tmp_path: Path) -> None:
    new, old = rows(0, 0.1), rows(1, 0.115)
    found = compared(tmp_path, {"one": {"A": new}}, {"one": {"A": old}})
    ours, theirs = ([r["time_to_first_solution"] for r in some] for some in (new, old))
    expected = scipy.stats.mannwhitneyu(ours, theirs, method="exact").pvalue
    assert found.times["A"].p == pytest.approx(expected)
    assert "Mann–Whitney" in found.test


@pytest.mark.slow
def test_chance_is_not_called_a_difference(tmp_path: Path) -> None:
    """Of databases that differ by chance alone, 5 % of all may be called different, whatever number of planners."""
    tries, planners = 60, 6
    new, old = ({"one": {f"{i}": rows(2 * i + side, 0.1, runs=8) for i in range(tries * planners)}} for side in (0, 1))
    files = [write_results(tmp_path / name, made) for name, made in (("new.db", new), ("old.db", old))]
    new_runs, old_runs = map(load_results, files)
    wrong = 0
    for k in range(tries):
        some = replace(new_runs, planners=[f"{i}" for i in range(planners * k, planners * (k + 1))])
        found = compare_results(some, old_runs)
        assert len(found.times) == planners
        wrong += any(pair.winner for pair in found.times.values())
    # More than 8 of 60 has a probability of 0.2 % at 5 %.
    assert wrong <= 8


def test_more_failures_are_slower(tmp_path: Path) -> None:
    some = rows(0, 0.1)
    failed = [run(k, None) for k in range(8)] + some[8:]
    found = compared(tmp_path, {"one": {"A": failed}}, {"one": {"A": some}})
    assert found.times["A"].winner == found.costs["A"].winner == "old"
    assert found.table().rows[0][2:4] == ["100 %", "20.0 %"]


def test_what_keeps_them_from_being_compared_is_said(tmp_path: Path) -> None:
    found = compared(
        tmp_path,
        {"one": {"A": rows(0, 0.1, runs=2), "N": rows(0, 0.1)}, "two": {"A": rows(0, 0.1)}},
        {"one": {"A": rows(1, 0.5, runs=2), "O": rows(0, 0.1)}},
        cpuinfo="another",
    )
    said = " ".join(found.sentences())
    assert "it takes 4 runs" in said
    assert "processor (a processor, 2 cores, now another)" in said
    assert "1 problem and 1 planner only in new.db; 0 problems and 1 planner only in old.db" in said


def test_nothing_in_common(tmp_path: Path) -> None:
    found = compared(tmp_path, {"one": {"A": rows(0, 0.1)}}, {"one": {"A": rows(0, 0.1)}}, timelimit=2.0)
    assert found.sentences() == [
        "Nothing to compare: no planner ran on the same problem with the same limits in both databases."
    ]
    for write in (html_report, markdown_report):
        assert "Nothing to compare" in write(found.new, found.old)


def test_both_reports_have_it(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>"
    found = compared(tmp_path, {"one": {evil: rows(0, 0.1)}}, {"one": {evil: rows(1, 0.5)}})
    page, tables = html_report(found.new, found.old), markdown_report(found.new, found.old)
    assert evil not in page
    assert "Against old.db" in page
    assert "## Against old.db" in tables
    assert "Against" not in html_report(found.new)
