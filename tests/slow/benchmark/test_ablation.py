"""benchmarks/ablation.py: a tiny slice of it, and figures of runs that are made up."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks import ablation, report
from benchmarks.ablation import CONTROL, FULL, claims, compare
from benchmarks.problems import Case, ablation_cases

from trailmark.benchmark.problems import Problem
from trailmark.planning.settings import METHODS, STAGES


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
    assert [np.mean(values) for values in compare(ROWS, CONTROL, 1.0)] == [0.0, 0.0, 0.0]
    success, first, cost = compare(ROWS, "without lattice", 1.0)
    assert len(success) == 6
    assert np.mean(success) == pytest.approx(-1 / 6)
    # Without a path the limit counts.
    assert math.exp(np.mean(first)) == pytest.approx((4.0**5 * 100.0) ** (1 / 6))
    assert math.exp(np.mean(cost)) == pytest.approx(1.1)
    found = {claim.what: claim for claim in claims(ROWS, 1.0)}
    assert list(found) == [CONTROL, "without lattice"]
    assert "decided -16.7" in found["without lattice"].figure


def test_problems_are_of_every_group_and_variants_those_that_concern_the_robot() -> None:
    given = ablation_cases()
    assert {case.group for case in given[:12]} >= {"shipped", "random", "passages", "mixed", "cars"}
    assert len({case.problem.key for case in given}) == len(given)
    by_group = {case.group: case for case in given}
    car, straight = (ablation.variants(by_group[group]) for group in ("cars", "passages"))
    assert "planner lattice" in straight
    assert "planner lattice" not in car
    assert {f"planner {name}" for name in METHODS if name != "landmark"} <= set(straight)
    # What is not ablated is what makes first paths better, not sooner.
    named = {name.removeprefix("without ") for name in {*car, *straight} if name.startswith("without ")}
    assert set(STAGES) - named == {"disc-path", "shortening", "improvement", "roadmap"}


def test_a_slice_is_measured_resumed_and_not_mixed(
    tmp_path: Path, ahead: Problem, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ablation, "FOLDER", tmp_path)
    monkeypatch.setattr(report, "FOLDER", tmp_path)
    cases = [Case("worlds", "ahead", ahead, feasible=True)]  # straight on, where the first path is the best
    record = tmp_path / "record.jsonl"
    words = ["--record", str(record), "--seeds", "1", "--time-limit", "0.05", "--repeats", "1"]
    assert ablation.main(words, cases) == 0
    assert "| planner paper" in capsys.readouterr().out
    rows = [json.loads(line) for line in record.read_text().splitlines()]
    assert {r["stage"] for r in rows[1:]} == {"first", "cost"}
    assert all(r["first"] is not None for r in rows[1:] if r["variant"] == FULL)
    assert ablation.main(words, cases) == 0
    assert len(record.read_text().splitlines()) == len(rows)
    with pytest.raises(SystemExit, match="expected runs of this code and limit"):
        ablation.main([*words, "--time-limit", "0.1"], cases)
    monkeypatch.setattr(ablation, "source_digest", lambda: "of other code")
    with pytest.raises(SystemExit, match="expected runs of this code and limit"):
        ablation.main(words, cases)
