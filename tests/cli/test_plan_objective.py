"""``trailmark plan --objective``: what is charged, and what is refused in one line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Shell = Callable[..., Any]


@pytest.mark.slow
def test_an_objective_is_planned_for_and_told(shell: Shell, yard: Path) -> None:
    words = ("plan", yard, "--objective", "clearance", "--gap", "0.5", "--time-limit", "20")
    run = shell(*words, "--json")
    assert run.status == 0
    record = json.loads(run.out)
    assert record["objective"]["clearance"] == 5.0
    assert record["lower_bound"] <= record["cost"]
    assert record["cost"] > record["length"]
    assert "clearance 5" in shell(*words).out


@pytest.mark.slow
def test_time_takes_the_speeds_of_the_time_law(shell: Shell, yard: Path) -> None:
    limits = ("--max-speed", "0.5", "--max-turn-rate", "2")
    run = shell("plan", yard, "--objective", "time", *limits, "--json", "--max-iterations", "1")
    assert run.status == 0
    record = json.loads(run.out)
    assert record["objective"]["max_speed"] == 0.5
    assert record["cost"] == pytest.approx(record["length"] / 0.5 + record["rotation"] / 2.0)
