"""Nearest neighbours: as near as those of brute force, whatever the order and the number in which points come."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from trailmark.nearest import NearestNeighbours, nearest_in, nearest_to


@pytest.mark.slow
@given(
    seed=st.integers(0, 10_000),
    parts=st.lists(st.integers(0, 300), min_size=1, max_size=6),
    dimension=st.integers(1, 4),
    spread=st.sampled_from([1.0, 4.0, 1e3]),
)
def test_neighbours_are_as_near_as_those_of_brute_force(
    seed: int, parts: list[int], dimension: int, spread: float
) -> None:
    rng = np.random.default_rng(seed)
    index, points = NearestNeighbours(dimension), np.empty((0, dimension))
    for size in parts:
        # Whole numbers over a small range: many points equally far, many the same.
        new = np.floor(rng.random((size, dimension)) * spread)
        first, k = len(points), int(rng.integers(1, 40))
        index.add(new)
        points = np.vstack([points, new])
        assert len(index) == len(points)
        tree, distances, ids = index.merged(), np.empty(k), np.empty(k, np.int64)
        for rows, own in ((np.floor(rng.random((5, dimension)) * spread), -1), (new, first)):
            apart = cdist(rows, points)
            if own >= 0:
                apart[np.arange(size), own + np.arange(size)] = np.inf
            count = min(k, max(0, len(points) - (own >= 0)))
            found = index.query(rows, k, first=own)
            assert found.shape == (len(rows), k)
            assert (found[:, count:] == -1).all()
            assert all(len(set(row)) == count for row in found[:, :count].tolist())
            nearest = np.sort(apart, axis=1)[:, :count]
            assert np.array_equal(np.take_along_axis(apart, found[:, :count], 1), nearest)
            for i in range(len(rows) if own < 0 else 0):
                assert nearest_in(tree, rows[i], k, distances, ids) == count
                assert distances[:count] == pytest.approx(nearest[i] ** 2)
                assert np.array_equal(apart[i, ids[:count]], nearest[i])
                assert len(set(ids[:count].tolist())) == count


def test_an_empty_index() -> None:
    index = NearestNeighbours(2)
    assert index.query(np.zeros((2, 2)), 3).tolist() == [[-1, -1, -1], [-1, -1, -1]]
    index.add(np.empty((0, 2)))
    assert len(index) == 0


def test_the_nearest_to_each_target_is_that_of_brute_force() -> None:
    rng = np.random.default_rng(4)
    for n in (1, 5, 400):
        points, targets = rng.random((n, 4)), rng.random((50, 4))
        assert np.array_equal(nearest_to(targets, points), cdist(targets, points).argmin(axis=1))
