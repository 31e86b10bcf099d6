"""Strategies and the tour, against all orders that there are."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from trailmark.exploration.strategies import STRATEGIES, Outlook, covering_tour


def outlook(places: list[tuple[float, float]], sees: list[list[int]], areas: list[float] | None = None) -> Outlook:
    """Landmarks in the open, the robot at the origin."""
    xy = np.array(places)
    between = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    n = len(xy)
    seen = np.zeros((n, 1 + max(g for row in sees for g in row)), np.bool_)
    for i, row in enumerate(sees):
        seen[i, row] = True
    return Outlook(
        here=np.zeros(3),
        home=None,
        landmarks=np.column_stack([xy, np.zeros(n)]),
        costs=np.hypot(*xy.T),
        between=between,
        home_costs=np.zeros(n),
        areas=np.ones(n) if areas is None else np.array(areas),
        frontiers=np.ones(seen.shape[1]),
        sees=seen,
        sensor_range=5.0,
    )


def test_each_strategy_has_a_name_and_returns_a_landmark() -> None:
    o = outlook([(1.0, 0.0), (9.0, 0.0), (-2.0, 0.0)], [[0], [1], [2]], [0.1, 0.1, 40.0])
    chosen = {name: strategy(o) for name, strategy in STRATEGIES.items()}
    assert chosen == {"nearest-frontier": 0, "gain-per-cost": 2, "tour": 2}


def test_what_is_left_on_one_side_is_seen_before_the_far_other_side() -> None:
    # Nearest first would go to the right, and come back for the landmark on the left.
    o = outlook([(1.0, 0.0), (-1.2, 0.0), (3.0, 0.0), (9.0, 0.0)], [[0], [1], [2], [3]])
    assert STRATEGIES["nearest-frontier"](o) == 0
    assert STRATEGIES["tour"](o) == 1


def best_covering(ways: np.ndarray, sees: np.ndarray) -> float:
    n = len(sees)
    best = np.inf
    for k in range(1, n + 1):
        for chosen in itertools.permutations(range(n), k):
            if sees[list(chosen)].any(axis=0).all():
                stops = [0, *(c + 1 for c in chosen), n + 1]
                best = min(best, sum(ways[a, b] for a, b in itertools.pairwise(stops)))
    return best


@pytest.mark.parametrize("seed", range(12))
def test_tours_see_everything_and_are_nearly_as_short_as_the_shortest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, m = 6, 5
    xy = rng.uniform(0.0, 10.0, (n + 1, 2))
    ways = np.zeros((n + 2, n + 2))
    ways[:-1, :-1] = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    sees = rng.random((n, m)) < 0.4
    sees[rng.integers(0, n, m), np.arange(m)] = True
    order = covering_tour(ways, sees)
    assert sees[order].any(axis=0).all()
    assert len(set(order.tolist())) == len(order)
    stops = [0, *(order + 1).tolist(), n + 1]
    length = sum(ways[a, b] for a, b in itertools.pairwise(stops))
    assert length <= 1.35 * best_covering(ways, sees) + 1e-9
