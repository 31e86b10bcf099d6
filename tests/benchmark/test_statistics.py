"""Statistics of runs, against SciPy and against counting everything by hand."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, settings
from hypothesis import strategies as st

from trailmark.benchmark.statistics import (
    EXACT_RUNS,
    bootstrap_log_means,
    holm,
    least_probability,
    quantiles,
    rank_test,
    runs_needed,
    shifted_geometric_mean,
    step_values,
    wilson,
)

INF = math.inf
values = st.lists(st.floats(0.001, 1000.0) | st.just(INF), min_size=1, max_size=30)
coarse = st.lists(st.integers(1, 6).map(float) | st.just(INF), min_size=1, max_size=8)


@pytest.mark.parametrize(
    ("successes", "n", "expected"),
    # By hand, with z = 1.959964: (p + z²/2n ± z √(p(1 - p)/n + z²/4n²)) / (1 + z²/n).
    [(0, 10, (0.0, 0.27753)), (4, 8, (0.21521, 0.78479)), (10, 10, (0.72247, 1.0)), (0, 0, (0.0, 1.0))],
)
def test_wilson_by_hand(successes: int, n: int, expected: tuple[float, float]) -> None:
    assert wilson(successes, n) == pytest.approx(expected, abs=1e-5)


@pytest.mark.slow
@given(st.lists(st.floats(1e-4, 1e4), min_size=1, max_size=20))
def test_without_a_shift_it_is_the_geometric_mean(array: list[float]) -> None:
    assert shifted_geometric_mean(array, 0.0) == pytest.approx(scipy.stats.gmean(array))


def test_shifted_geometric_mean_by_hand() -> None:
    # sqrt((1 + 8) * (8 + 8)) - 8 = 12 - 8
    assert shifted_geometric_mean([1.0, 8.0], 8.0) == pytest.approx(4.0)
    assert math.isnan(shifted_geometric_mean([], 0.01))


@given(st.lists(st.floats(1e-4, 1e4), min_size=1, max_size=20), st.floats(0.001, 10.0))
def test_a_shifted_mean_lies_among_the_values(array: list[float], shift: float) -> None:
    mean = shifted_geometric_mean(array, shift)
    assert min(array) * (1 - 1e-9) <= mean <= max(array) * (1 + 1e-9)


@pytest.mark.slow
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40), st.lists(st.floats(0.0, 1.0), min_size=1, max_size=5))
def test_quantiles_are_numpys(array: list[float], shares: list[float]) -> None:
    # NumPy's own rounding decides otherwise where n times the share is a whole number but for its last digit.
    shares = [s for s in shares if abs(s * len(array) - round(s * len(array))) > 1e-6] + [0.25, 0.5, 0.75]
    expected = np.quantile(array, shares, method="averaged_inverted_cdf")
    assert quantiles(array, shares) == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_quantiles_keep_infinity_where_it_is() -> None:
    assert quantiles([1.0, 2.0, 3.0, INF], (0.25, 0.5, 0.75)).tolist() == [1.5, 2.5, INF]
    assert quantiles([1.0, 2.0, INF], (0.5,)).tolist() == [2.0]
    assert quantiles([INF, INF], (0.0, 0.5, 1.0)).tolist() == [INF, INF, INF]
    assert quantiles(np.array([[1.0, 5.0], [3.0, INF]]), (0.5,)).tolist() == [[2.0, INF]]


def test_step_values_hold_between_steps() -> None:
    found = step_values([0.1, 0.5], [9.0, 7.0], [0.05, 0.1, 0.3, 0.5, 2.0])
    assert found.tolist() == [INF, 9.0, 9.0, 7.0, 7.0]
    # A worse path later is no step back; no path at all is none at any time.
    assert step_values([0.1, 0.5], [7.0, 9.0], [1.0]).tolist() == [7.0]
    assert step_values([], [], [1.0]).tolist() == [INF]


@pytest.mark.slow
@given(values, values)
def test_superiority_is_the_share_of_pairs(a: list[float], b: list[float]) -> None:
    wins = [1.0 if x < y else 0.5 if x == y else 0.0 for x, y in itertools.product(a, b)]
    assert rank_test([(a, b)]).superiority == pytest.approx(np.mean(wins))


@pytest.mark.slow
@given(st.integers(2, 9), st.integers(2, 9), st.integers(0, 2**32 - 1))
def test_one_problem_without_ties_is_mann_whitneys_exact_test(n: int, m: int, seed: int) -> None:
    generator = np.random.default_rng(seed)
    a, b = generator.normal(size=n), generator.normal(0.8, size=m)
    expected = scipy.stats.mannwhitneyu(a, b, method="exact").pvalue
    assert rank_test([(a, b)]).p == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
@given(coarse, coarse)
@settings(max_examples=40)
def test_with_ties_every_way_to_share_the_ranks_is_counted(a: list[float], b: list[float]) -> None:
    ranks = scipy.stats.rankdata([*a, *b])
    middle = len(a) * (len(ranks) + 1) / 2.0
    sums = np.array([sum(ranks[list(chosen)]) for chosen in itertools.combinations(range(len(ranks)), len(a))])
    expected = np.mean(np.abs(sums - middle) >= abs(sum(ranks[: len(a)]) - middle) - 1e-9)
    assert rank_test([(a, b)]).p == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_many_runs_of_one_problem_are_mann_whitneys_normal_test(seed: int, ties: bool) -> None:
    generator = np.random.default_rng(seed)
    a, b = generator.normal(size=30), generator.normal(0.4, size=25)
    if ties:
        a, b = np.round(2.0 * a), np.round(2.0 * b)
    assert len(a) + len(b) > EXACT_RUNS
    expected = scipy.stats.mannwhitneyu(a, b, method="asymptotic").pvalue
    assert rank_test([(a, b)]).p == pytest.approx(expected, rel=1e-9)


def test_several_problems_are_counted_together() -> None:
    # Problem 1: 2 runs against 1, problem 2: 1 against 2; all six ways to share out the ranks of each.
    pairs = [([1.0, 2.0], [3.0]), ([1.0], [2.0, 3.0])]
    sums = []
    for one, two in itertools.product(itertools.combinations((1, 2, 3), 2), itertools.combinations((1, 2, 3), 1)):
        sums.append((sum(one) - 4) / 4.0 + (sum(two) - 2) / 4.0)
    observed = (3 - 4) / 4.0 + (1 - 2) / 4.0
    expected = np.mean([abs(s) >= abs(observed) - 1e-12 for s in sums])
    found = rank_test(pairs)
    assert found.p == pytest.approx(expected)
    assert found.superiority == 1.0


@pytest.mark.parametrize("ties", [False, True])
def test_many_problems_agree_with_permutations(ties: bool) -> None:
    generator = np.random.default_rng(11)
    pairs = []
    for k in range(8):
        a, b = generator.normal(k, 1.0, size=8), generator.normal(k + 0.45, 1.0, size=6)
        pairs.append((np.round(a), np.round(b)) if ties else (a, b))

    runs = np.array([np.concatenate(pair) for pair in pairs])

    def statistic(parts: np.ndarray) -> np.ndarray:
        """Of runs, shape (..., 8, 14), the first 8 of each problem being those of one planner."""
        ranks = scipy.stats.rankdata(parts, axis=-1)[..., :8].sum(axis=-1)
        found: np.ndarray = np.abs(((ranks - 8 * 15 / 2.0) / 15).sum(axis=-1))
        return found

    mixed = generator.permuted(np.broadcast_to(runs, (1500, *runs.shape)), axis=-1)
    share = float(np.mean(statistic(mixed) >= statistic(runs) - 1e-12))
    assert rank_test(pairs).p == pytest.approx(share, abs=4.0 * math.sqrt(share / 1500) + 0.002)


@pytest.mark.slow
@given(st.lists(st.tuples(coarse, coarse), min_size=1, max_size=3))
@settings(max_examples=40)
def test_superiority_and_the_test_agree_on_the_side(pairs: list[tuple[list[float], list[float]]]) -> None:
    # The sum of van Elteren's test, which is 0 where neither is ahead.
    total = 0.0
    for a, b in pairs:
        ranks = scipy.stats.rankdata([*a, *b])
        total += (len(a) * (len(ranks) + 1) / 2.0 - ranks[: len(a)].sum()) / (len(ranks) + 1)
    found = rank_test(pairs)
    assert (
        found.superiority == pytest.approx(0.5, abs=1e-9)
        if abs(total) < 1e-9
        else (found.superiority > 0.5) == (total > 0)
    )
    assert rank_test([(b, a) for a, b in pairs]).p == pytest.approx(found.p)


def test_nothing_to_compare_tells_nothing() -> None:
    assert rank_test([]) == (1.0, 0.5)
    assert rank_test([([], [1.0])]) == (1.0, 0.5)
    assert rank_test([([INF] * 30, [INF] * 30)]) == (1.0, 0.5)
    # Three runs against three cannot show a difference, however large.
    assert rank_test([([1.0, 2.0, 3.0], [7.0, 8.0, 9.0])]).p == pytest.approx(0.1)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12))
def test_holm_by_its_definition(p: list[float]) -> None:
    order = sorted(range(len(p)), key=lambda i: p[i])
    expected = {}
    for place, i in enumerate(order):
        steps = [(len(p) - j) * p[order[j]] for j in range(place + 1)]
        expected[i] = min(1.0, max(steps))
    assert holm(p) == pytest.approx([expected[i] for i in range(len(p))])


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([]).shape == (0,)


def test_the_bootstrap_spreads_as_the_mean_does() -> None:
    generator = np.random.default_rng(5)
    logs = generator.normal(1.0, 0.5, size=40)
    means = bootstrap_log_means(np.exp(logs), 4000, generator)
    assert means.mean() == pytest.approx(logs.mean(), abs=0.01)
    assert means.std() == pytest.approx(logs.std() / math.sqrt(40), rel=0.05)
    assert bootstrap_log_means([math.e], 3, generator).tolist() == [1.0, 1.0, 1.0]


@pytest.mark.parametrize("n", [1, 3, 9])
def test_the_lowest_probability_is_that_of_two_orders_among_all(n: int) -> None:
    assert least_probability([(n, n)]) == pytest.approx(2.0 / math.comb(2 * n, n))
    assert least_probability([(n, n + 1)] * 2) == pytest.approx(2.0 / math.comb(2 * n + 1, n) ** 2)


@pytest.mark.parametrize(("planners", "runs"), [(2, 4), (8, 7), (39, 9)])
def test_runs_that_it_takes_for_any_difference_to_be_shown(planners: int, runs: int) -> None:
    pairs = math.comb(planners, 2)
    assert runs_needed(pairs, 1, 0.05) == runs
    # Counted by hand: of all orders of n + n runs, two set the planners apart.
    assert pairs * 2 / math.comb(2 * runs, runs) < 0.05 <= pairs * 2 / math.comb(2 * runs - 2, runs - 1)
    assert runs_needed(pairs, 1000, 0.05) == 1
