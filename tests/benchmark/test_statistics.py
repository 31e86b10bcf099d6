"""Statistics of runs, against counting by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.benchmark.report import paired_ratio, shifted_geometric_mean, step_values, wilson

INF = math.inf


@pytest.mark.parametrize(
    ("successes", "n", "expected"),
    # By hand, with z = 1.959964: (p + z²/2n ± z √(p(1 - p)/n + z²/4n²)) / (1 + z²/n).
    [(0, 10, (0.0, 0.27753)), (4, 8, (0.21521, 0.78479)), (10, 10, (0.72247, 1.0)), (0, 0, (0.0, 1.0))],
)
def test_wilson_by_hand(successes: int, n: int, expected: tuple[float, float]) -> None:
    assert wilson(successes, n) == pytest.approx(expected, abs=1e-5)


def test_shifted_geometric_mean_by_hand() -> None:
    # sqrt((1 + 8) * (8 + 8)) - 8 = 12 - 8
    assert shifted_geometric_mean([1.0, 8.0], 8.0) == pytest.approx(4.0)
    assert math.isnan(shifted_geometric_mean([], 0.01))


@given(st.lists(st.floats(1e-4, 1e4), min_size=1, max_size=20), st.floats(0.001, 10.0))
def test_a_shifted_mean_lies_among_the_values(array: list[float], shift: float) -> None:
    mean = shifted_geometric_mean(array, shift)
    assert min(array) * (1 - 1e-9) <= mean <= max(array) * (1 + 1e-9)


def test_step_values_hold_between_steps() -> None:
    found = step_values([0.1, 0.5], [9.0, 7.0], [0.05, 0.1, 0.3, 0.5, 2.0])
    assert found.tolist() == [INF, 9.0, 9.0, 7.0, 7.0]
    # A worse path later is no step back; no path at all is none at any time.
    assert step_values([0.1, 0.5], [7.0, 9.0], [1.0]).tolist() == [7.0]
    assert step_values([], [], [1.0]).tolist() == [INF]


def test_ratios_of_pairs_by_hand() -> None:
    # 2 / 1 and 8 / 1: the geometric mean is 4, and either may be all that a resample holds.
    assert paired_ratio([([2.0, 2.0], [1.0, 1.0]), ([8.0], [1.0])]) == pytest.approx((4.0, 2.0, 8.0))
    assert paired_ratio([([3.0, 3.0], [1.0, 1.0])]) == pytest.approx((3.0, 3.0, 3.0))
    assert all(math.isnan(value) for value in paired_ratio([]))


@pytest.mark.slow
def test_an_interval_holds_the_true_ratio_about_as_often_as_it_says() -> None:
    rng, held = np.random.default_rng(0), 0
    for _ in range(60):
        pairs = [(np.exp(rng.normal(0.5, 1.0, 3)), np.ones(3)) for _ in range(25)]
        _, low, high = paired_ratio(pairs)
        held += low <= math.exp(0.5) <= high
    assert 50 <= held <= 60
