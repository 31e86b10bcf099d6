"""The hour in short: threads plan, save and load; verdicts tell memory that grows and queries that slow down."""

from __future__ import annotations

import gc
from typing import Any

import pytest
from benchmarks.soak import SAMPLES, measure, text, verdicts


def record(memory: float, slower: float, wrong: list[str]) -> dict[str, Any]:
    """A made-up record whose memory and times grow linearly."""
    rows = []
    for k in range(SAMPLES):
        part = k / (SAMPLES - 1)
        row = {"minutes": 60.0 * part, "memory": 500.0 + memory * part, "queries": 10.0 * k, "nodes": 5.0, "edges": 9.0}
        rows.append(row | dict.fromkeys(("plan", "again", "many"), 5.0 * (1.0 + (slower - 1.0) * part)))
    return {"machine": "here", "minutes": 60.0, "threads": 8, "rows": rows, "counts": {"plan": 7}, "wrong": wrong}


def test_verdicts() -> None:
    assert [ok for _, ok, _ in verdicts(record(10.0, 1.0, []))] == [True] * 5
    assert [ok for _, ok, _ in verdicts(record(60.0, 1.0, []))] == [False, True, True, True, True]
    assert [ok for _, ok, _ in verdicts(record(0.0, 3.0, ["bad"]))] == [True, False, False, False, False]


@pytest.mark.slow
def test_a_short_soak() -> None:
    gc.freeze()  # else each look at the memory goes through all that other tests have left
    try:
        found = measure(minutes=0.02, threads=3, seed=0, size=15.0, names=("clutter", "clutter, car"))
    finally:
        gc.unfreeze()
    assert found["wrong"] == []
    assert len(found["rows"]) == SAMPLES
    assert found["rows"][-1]["queries"] > 0
    assert found["counts"]["judged"] > 0
    assert "| minutes" in text(found)
