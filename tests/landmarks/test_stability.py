"""Matching of centres between runs, against all permutations."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from trailmark.errors import ConfigurationError
from trailmark.landmarks import algorithm_1, spread_of_runs

FloatArray = NDArray[np.float64]


def test_spread_over_three_runs() -> None:
    runs = [
        np.array([[0.0, 0.0], [10.0, 0.0]]),
        np.array([[10.0, 1.0], [0.0, 0.0]]),
        np.array([[0.0, 3.0], [10.0, 0.0]]),
    ]
    spread = spread_of_runs(runs)
    assert spread.pairs.tolist() == [[0, 1], [0, 2], [1, 2]]
    assert spread.rms == pytest.approx(np.sqrt([0.5, 4.5, 5.0]))
    assert spread.mean == pytest.approx(np.sqrt([0.5, 4.5, 5.0]).mean())
    assert spread.worst == pytest.approx(np.sqrt(5.0))


def test_separate_clumps_give_stable_centres_and_uniform_points_do_not() -> None:
    rng = np.random.default_rng(0)
    corners = np.array([[0.0, 0.0], [50.0, 0.0], [0.0, 50.0], [50.0, 50.0]])
    clumps, uniform = [], []
    for run in range(4):
        x = np.repeat(corners, 100, axis=0) + rng.normal(0.0, 1.0, (400, 2))
        clumps.append(algorithm_1(x, 4, "k-means++", run).centres)
        uniform.append(algorithm_1(rng.uniform(0.0, 50.0, (400, 2)), 7, "forgy", run).centres)
    assert spread_of_runs(clumps).worst < 0.5
    assert spread_of_runs(uniform).mean > 2.0


@pytest.mark.parametrize(
    ("runs", "problem"),
    [
        ([], "spread of runs: expected 1 run or more, got none"),
        ([np.ones((3, 2)), np.ones((3, 3))], r"got \(3, 2\) and \(3, 3\)"),
        ([np.ones((3, 2)), np.empty((0, 2))], r"got \(3, 2\) and \(0, 2\)"),
        ([np.ones(3), np.ones(3)], r"got \(3,\)"),
        ([np.ones((3, 2)), np.full((3, 2), np.nan)], "centres: hold a value that is not a finite number"),
    ],
)
def test_bad_input(runs: list[FloatArray], problem: str) -> None:
    with pytest.raises(ConfigurationError, match=problem):
        spread_of_runs(runs)
