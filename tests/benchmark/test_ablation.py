"""benchmarks/ablation.py: a tiny slice of it, and figures of runs that are made up."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from benchmarks import ablation
from benchmarks.ablation_problems import ablation_cases
from benchmarks.ablation_report import CONTROL, FULL, compare, draw, names_in, page
from benchmarks.ahead_problems import Case

from trailmark.benchmark.problems import Problem
from trailmark.planning.mechanisms import MECHANISMS
from trailmark.planning.methods import METHODS


def row(variant: str, problem: int, first: float | None, cost: float | None, stage: str = "first") -> dict[str, Any]:
    status = "timeout" if first is None else "solved"
    named = {"stage": stage, "problem": f"p{problem}", "group": "worlds", "kind": "office", "seed": 0}
    return named | {"variant": variant, "status": status, "first": first, "cost": cost}


ROWS = [
    *(row(FULL, i, 0.01, 10.0, stage) for i in range(6) for stage in ("first", "cost")),
    *(row(CONTROL, i, 0.01, 10.0, stage) for i in range(6) for stage in ("first", "cost")),
    *(row("without lattice", i, 0.04, 11.0, stage) for i in range(5) for stage in ("first", "cost")),
    *(row("without lattice", 5, None, None, stage) for stage in ("first", "cost")),
]


def test_figures_are_those_of_the_runs() -> None:
    same, without = (compare(ROWS, name, 1.0) for name in (CONTROL, "without lattice"))
    assert (same.problems, same.success.mean, same.first.mean, same.cost.mean) == (6, 0.0, 0.0, 0.0)
    assert not same.first.differs
    assert without.success.mean == pytest.approx(-1 / 6)
    # Without a path the limit counts.
    assert math.exp(without.first.mean) == pytest.approx((4.0**5 * 100.0) ** (1 / 6))
    assert math.exp(without.cost.mean) == pytest.approx(1.1)
    assert without.first.differs
    assert without.first.low < without.first.mean < without.first.high


@pytest.mark.slow
def test_the_page_has_a_row_for_each_variant_and_the_plot_is_a_picture() -> None:
    text = page(ROWS, 1.0)
    assert names_in(ROWS) == [CONTROL, "without lattice"]
    assert "| without lattice" in text
    assert "measured by" not in text or "benchmarks.ablation" in text
    assert draw(ROWS, 1.0).startswith(b"\x89PNG")


@pytest.fixture(scope="module")
def given() -> list[Case]:
    return ablation_cases()


@pytest.mark.slow
def test_problems_are_of_every_group_from_the_front(given: list[Case]) -> None:
    assert {case.group for case in given[:12]} >= {"worlds", "random", "passages", "mixed", "cars"}
    assert len({case.problem.key for case in given}) == len(given)


@pytest.mark.slow
def test_variants_are_those_that_concern_the_robot(given: list[Case]) -> None:
    by_group = {case.group: case for case in given}
    car, straight = (ablation.variants(by_group[group]) for group in ("cars", "passages"))
    assert "planner lattice" in straight
    assert "planner lattice" not in car
    assert {f"planner {name}" for name in METHODS if name != "landmark"} <= set(straight)
    # What is not ablated is what makes first paths better, not sooner.
    named = {name.removeprefix("without ") for name in {*car, *straight} if name.startswith("without ")}
    assert set(MECHANISMS) - named == {"disc-path", "shortening", "improvement"}


@pytest.mark.slow
def test_a_slice_is_measured_resumed_and_not_mixed(
    tmp_path: Path, ahead: Problem, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ablation, "code_digest", lambda name: f"of {name}")  # which reads all code that there is
    cases = [Case("worlds", "ahead", ahead, feasible=True)]  # straight on, where the first path is the best
    record = tmp_path / "record.jsonl"
    words = ["--record", str(record), "--seeds", "1", "--time-limit", "0.05", "--repeats", "1", "--no-write"]
    assert ablation.main(words, cases) == 0
    assert "| planner paper" in capsys.readouterr().out
    rows = [json.loads(line) for line in record.read_text().splitlines()]
    assert {r["stage"] for r in rows[1:]} == {"first", "cost"}
    assert all(r["first"] is not None for r in rows[1:] if r["variant"] == FULL)
    assert ablation.main(words, cases) == 0
    assert len(record.read_text().splitlines()) == len(rows)
    with pytest.raises(SystemExit, match="expected runs of this code and limit"):
        ablation.main([*words, "--time-limit", "0.1"], cases)
    monkeypatch.setattr(ablation, "code_digest", lambda _: "of other code")
    with pytest.raises(SystemExit, match="expected runs of this code and limit"):
        ablation.main(words, cases)
