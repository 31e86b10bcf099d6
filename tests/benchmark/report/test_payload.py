"""What the charts are drawn from, unpacked again: the runs of the database, to three digits."""

from __future__ import annotations

import base64
import gzip
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.helpers.made_results import random_results, run, write_results

from trailmark.benchmark.report import load_results
from trailmark.benchmark.report.palette import styles_of
from trailmark.benchmark.report.payload import STEPS, compressed, payload, stairs


def unpacked(file: Path) -> dict[str, Any]:
    results = load_results(file)
    text = gzip.decompress(base64.b64decode(compressed(payload(results, styles_of(results.planners)))))
    found: dict[str, Any] = json.loads(text)
    return found


def test_times_and_costs_are_kept_to_three_digits(tmp_path: Path) -> None:
    results = load_results(random_results(tmp_path / "r.db", ["landmark", "PRM", "RRT"], problems=2, runs=7))
    found = unpacked(tmp_path / "r.db")
    assert [p["name"] for p in found["planners"]] == list(results.planners)
    for problem, (name, limit, best, cells) in zip(results.problems, found["problems"], strict=True):
        assert (name, limit) == (problem.name, problem.time_limit)
        assert best == pytest.approx(problem.best_cost, rel=1e-6)
        for runs, (n, claimed, first, cold, cost, _, _) in zip(problem.runs.values(), cells, strict=True):
            assert (n, claimed) == (len(runs), runs.claimed.sum())
            times = np.sort(runs.first_times[runs.success])
            assert np.exp(np.cumsum(first) / STEPS) == pytest.approx(times, rel=3e-4)
            assert np.exp(np.cumsum(cold) / STEPS) == pytest.approx(times + 0.05, rel=3e-4)
            costs = np.sort(runs.costs[runs.success])
            assert best * np.exp(np.cumsum(cost) / STEPS) == pytest.approx(costs, rel=3e-4)


def test_what_is_not_known_is_null(tmp_path: Path) -> None:
    late = [run(0, 0.5, 10.0, setup_time=None), run(1, None)]
    problems = {"one": {"A": late}, "two": {"B": [run(0, None)]}}
    (_, _, best, (a, nothing)), (_, _, none, (_, b)) = unpacked(write_results(tmp_path / "r.db", problems))["problems"]
    assert (best, none, nothing) == (10.0, None, None)
    assert a[:2] == [2, 1]
    assert a[3] is None
    assert b == [1, 0, [], [], [], [32], 0.05]


@pytest.mark.slow
@given(st.lists(st.integers(0, 50) | st.just(math.inf), min_size=1, max_size=12))
def test_stairs_are_the_curve_again(drops: list[float]) -> None:
    # Beginning with what is not known, then falling from somewhere.
    known = [d for d in drops if math.isfinite(d)]
    curve = np.array([math.inf] * (len(drops) - len(known)) + (1000 - np.cumsum(known)).tolist())
    blank, *rest = stairs(curve)
    rest += [0] * (len(curve) - blank - len(rest)) if rest else []
    again = [math.inf] * blank + np.cumsum([*rest[:1], *(-d for d in rest[1:])]).tolist()
    assert again == curve.tolist()


@pytest.mark.slow
def test_a_run_takes_few_characters(tmp_path: Path) -> None:
    found = compressed(unpacked(random_results(tmp_path / "r.db", ["landmark", "PRM", "RRT"], problems=10, runs=50)))
    assert len(found) / 1500 < 9.0
