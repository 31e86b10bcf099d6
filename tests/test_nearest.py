"""Nearest neighbours: against brute force, whatever the order and the number in which points come."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from trailmark.nearest import NearestNeighbours, nearest_in, nearest_to


def brute_force(points: np.ndarray, rows: np.ndarray, k: int, first: int = -1) -> np.ndarray:
    """Return the k nearest of each row; of points equally far, the older ones."""
    apart = cdist(rows, points, "sqeuclidean")
    if first >= 0:
        apart[np.arange(len(rows)), first + np.arange(len(rows))] = np.inf
    order = np.argsort(apart, axis=1, kind="stable")
    return np.where(np.take_along_axis(apart, order, 1) < np.inf, order, -1)[:, :k]


@pytest.mark.slow
@given(
    seed=st.integers(0, 10_000),
    parts=st.lists(st.integers(0, 300), min_size=1, max_size=6),
    dimension=st.integers(1, 4),
    spread=st.sampled_from([1.0, 4.0, 1e3]),
)
def test_neighbours_are_those_of_brute_force(seed: int, parts: list[int], dimension: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    index, points = NearestNeighbours(dimension), np.empty((0, dimension))
    for size in parts:
        # Whole numbers over a small range: many points equally far, many the same.
        new = np.floor(rng.random((size, dimension)) * spread)
        first = len(points)
        index.add(new)
        points = np.vstack([points, new])
        assert len(index) == len(points)
        k = int(rng.integers(1, 40))
        rows = np.floor(rng.random((5, dimension)) * spread)
        found, expected = index.query(rows, k), brute_force(points, rows, k)
        assert np.array_equal(found[:, : expected.shape[1]], expected)
        assert (found[:, expected.shape[1] :] == -1).all()
        own = index.query(new, k, first=first)
        expected = brute_force(points, new, k, first)
        assert np.array_equal(own[:, : expected.shape[1]], expected)


@pytest.mark.slow
def test_a_merged_index_is_a_copy() -> None:
    rng = np.random.default_rng(1)
    points = rng.random((1000, 3))
    index = NearestNeighbours(3)
    for part in np.array_split(points, 17):
        index.add(part)
    whole = index.merged()
    index.add(rng.random((5000, 3)))
    distances, ids = np.empty(7), np.empty(7, np.int64)
    for row in rng.random((50, 3)):
        assert nearest_in(whole, row, -1, 7, distances, ids) == 7
        expected = brute_force(points, row[None], 7)[0]
        assert np.array_equal(ids, expected)
        assert distances == pytest.approx(((points[expected] - row) ** 2).sum(axis=1))


def test_an_empty_index() -> None:
    index = NearestNeighbours(2)
    assert index.query(np.zeros((2, 2)), 3).tolist() == [[-1, -1, -1], [-1, -1, -1]]
    index.add(np.empty((0, 2)))
    assert len(index) == 0


def test_the_nearest_to_each_target_is_that_of_brute_force() -> None:
    rng = np.random.default_rng(4)
    for n in (1, 5, 400):
        points, targets = rng.random((n, 4)), rng.random((50, 4))
        assert np.array_equal(nearest_to(targets, points), brute_force(points, targets, 1)[:, 0])
