"""K-means landmarks: which samples they are and how well they spread. Spread is measured with scipy alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from trailmark.errors import ConfigurationError
from trailmark.landmarks import k_means_landmarks

FloatArray = NDArray[np.float64]


def samples(n: int, seed: int) -> FloatArray:
    """Clustered samples: half of them in a tenth of the region."""
    rng = np.random.default_rng(seed)
    q = rng.uniform((0.0, 0.0, -np.pi), (10.0, 10.0, np.pi), (n, 3))
    q[: n // 2, :2] = 4.0 + 0.1 * q[: n // 2, :2]
    return q


def points(q: FloatArray, radius: float) -> FloatArray:
    return np.column_stack([q[:, :2], radius * np.cos(q[:, 2]), radius * np.sin(q[:, 2])])


def inertia(q: FloatArray, landmarks: FloatArray, radius: float) -> float:
    """Sum of the squared distances of the samples to their nearest landmark."""
    return float((cdist(points(q, radius), points(landmarks, radius)).min(axis=1) ** 2).sum())


def rows(q: FloatArray) -> set[tuple[float, ...]]:
    return {tuple(row) for row in q.tolist()}


@pytest.mark.slow
@settings(max_examples=50)
@given(n=st.integers(1, 60), k=st.integers(1, 80), radius=st.sampled_from([0.0, 0.5, 3.0]), seed=st.integers(0, 999))
def test_landmarks_are_samples_and_no_two_the_same(n: int, k: int, radius: float, seed: int) -> None:
    q = samples(n, seed)
    found = k_means_landmarks(q, k, radius=radius, random_state=seed)
    assert len(rows(found)) == len(found)
    assert rows(found) <= rows(q)
    assert 1 <= len(found) <= min(k, n)
    # Two centres seldom have the same nearest sample.
    assert len(found) >= 0.5 * min(k, n)


def test_the_seed_decides() -> None:
    q = samples(500, 1)
    first = k_means_landmarks(q, 40, radius=1.0, random_state=3)
    assert np.array_equal(first, k_means_landmarks(q, 40, radius=1.0, random_state=3))
    assert np.array_equal(first, k_means_landmarks(q, 40, radius=1.0, random_state=np.random.default_rng(3)))
    assert not np.array_equal(first, k_means_landmarks(q, 40, radius=1.0, random_state=4))


@pytest.mark.parametrize("k", [20, 21, 1000])
def test_every_sample_is_a_landmark_where_there_are_no_more(k: int) -> None:
    q = samples(20, 1)
    found = k_means_landmarks(q, k, radius=1.0)
    assert np.array_equal(found, q)
    assert not np.shares_memory(found, q)
    assert k_means_landmarks(np.empty((0, 3)), k, radius=1.0).shape == (0, 3)


@pytest.mark.parametrize("k", [0, -3])
def test_too_few_landmarks_is_an_error(k: int) -> None:
    with pytest.raises(ConfigurationError, match=f"expected 1 or more, got {k}"):
        k_means_landmarks(samples(20, 1), k, radius=1.0)


@pytest.mark.parametrize("radius", [0.0, 2.0])
@pytest.mark.parametrize("seed", range(3))
def test_landmarks_spread_better_than_a_random_subset(seed: int, radius: float) -> None:
    q = samples(1000, seed)
    found = inertia(q, k_means_landmarks(q, 50, radius=radius, random_state=seed), radius)
    rng = np.random.default_rng(seed)
    chance = [inertia(q, q[rng.choice(1000, 50, replace=False)], radius) for _ in range(20)]
    assert found < min(chance)
    assert found < 0.9 * np.mean(chance)


def test_without_a_number_of_steps_no_sample_changes_its_cluster_any_more() -> None:
    # Two tight clusters and a bad start: one step is not enough, convergence finds the middles.
    q = np.zeros((100, 3))
    q[:, 0] = np.concatenate([np.linspace(0.0, 1.0, 90), np.linspace(9.0, 10.0, 10)])
    for seed in range(10):
        found = k_means_landmarks(q, 2, radius=0.0, random_state=seed)
        assert np.sort(found[:, 0]) == pytest.approx([0.5, 9.5], abs=0.06)
