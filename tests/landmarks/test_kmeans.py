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
from trailmark.landmarks.kmeans import farthest_samples, lloyd

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


def test_one_landmark_lies_nearest_to_the_mean() -> None:
    q = samples(200, 5)
    middle = points(q, 1.0).mean(axis=0)
    nearest = q[np.argmin(np.linalg.norm(points(q, 1.0) - middle, axis=1))]
    assert np.array_equal(k_means_landmarks(q, 1, radius=1.0, random_state=0), nearest[None])


def test_separate_clusters_get_one_landmark_each() -> None:
    rng = np.random.default_rng(2)
    centres = np.array([[0.0, 0.0], [50.0, 0.0], [0.0, 50.0], [50.0, 50.0]])
    q = np.zeros((400, 3))
    q[:, :2] = np.repeat(centres, 100, axis=0) + rng.uniform(-1.0, 1.0, (400, 2))
    # Forgy's start may put two means into one cluster; with a start in each, Lloyd keeps one in each.
    for seed in range(20):
        start = np.random.default_rng(seed).choice(400, 4, replace=False) // 100
        if len(set(start)) == 4:
            found = k_means_landmarks(q, 4, radius=0.0, random_state=seed, steps=10)
            assert sorted(np.argmin(cdist(found[:, :2], centres), axis=1)) == [0, 1, 2, 3]
            assert cdist(found[:, :2], centres).min(axis=0).max() < 0.5
            return
    pytest.fail("no seed starts in all four clusters")


def test_headings_count_as_far_as_the_radius_says() -> None:
    # Two headings at one place: told apart with a radius, one and the same without.
    rng = np.random.default_rng(3)
    q = np.column_stack([rng.uniform(0.0, 0.1, (100, 2)), np.repeat([0.0, np.pi / 2], 50)])
    apart = k_means_landmarks(q, 2, radius=5.0, steps=10, random_state=1)
    assert sorted(apart[:, 2]) == [0.0, np.pi / 2]
    turned = q.copy()
    turned[:, 2] = rng.uniform(-np.pi, np.pi, 100)
    blind = k_means_landmarks(q, 7, radius=0.0, random_state=1)
    assert np.array_equal(blind[:, :2], k_means_landmarks(turned, 7, radius=0.0, random_state=1)[:, :2])


def test_samples_that_are_all_one_place() -> None:
    q = np.ones((30, 3))
    found = k_means_landmarks(q, 5, radius=1.0, random_state=1)
    assert 1 <= len(found) <= 5
    assert (found == 1.0).all()


@pytest.mark.parametrize("steps", [0, 1, 3, 100])
def test_lloyds_steps(steps: int) -> None:
    data = points(samples(400, 8), 1.0)
    # The last centre lies so far off that no point is nearest to it.
    first = np.vstack([data[:20], np.full(4, 1e3)])
    expected = first.copy()
    for _ in range(steps):
        owner = cdist(data, expected).argmin(axis=1)
        expected = np.array([data[owner == i].mean(axis=0) if (owner == i).any() else expected[i] for i in range(21)])
    found = lloyd(data, first, steps)
    assert found == pytest.approx(expected, abs=1e-9)
    assert (first[-1] == found[-1]).all()


def test_without_a_number_of_steps_no_sample_changes_its_cluster_any_more() -> None:
    # Two tight clusters and a bad start: one step is not enough, convergence finds the middles.
    q = np.zeros((100, 3))
    q[:, 0] = np.concatenate([np.linspace(0.0, 1.0, 90), np.linspace(9.0, 10.0, 10)])
    for seed in range(10):
        found = k_means_landmarks(q, 2, radius=0.0, random_state=seed)
        assert np.sort(found[:, 0]) == pytest.approx([0.5, 9.5], abs=0.06)


@pytest.mark.parametrize("radius", [0.0, 0.7])
@pytest.mark.parametrize("k", [1, 100, 399, 400, 1000])
def test_the_samples_farthest_from_landmarks(radius: float, k: int) -> None:
    q, landmarks = samples(400, 11), samples(30, 12)
    found = farthest_samples(q, landmarks, k, radius=radius)
    apart = cdist(points(q, radius), points(landmarks, radius)).min(axis=1)
    assert found.tolist() == q[apart >= np.sort(apart)[-min(k, len(q))]].tolist()
