"""Mini-batches: nearly as good as Lloyd's algorithm, with progress, in bounded memory."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from trailmark.errors import ConfigurationError
from trailmark.landmarks import algorithm_1, algorithm_2, mini_batch_clusters, paper
from trailmark.landmarks.paper import INITIALISATIONS, Initialisation

FloatArray = NDArray[np.float64]


def uniform(n: int, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform(0.0, 100.0, (n, 2))


@pytest.mark.slow
@pytest.mark.parametrize("init", INITIALISATIONS)
def test_nearly_as_good_as_lloyd(init: Initialisation) -> None:
    x = uniform(30_000)
    lloyd, batches = algorithm_1(x, 20, init, 0), mini_batch_clusters(x, 20, init, 0)
    assert batches.centres.shape == (20, 2)
    gaps = cdist(x, batches.centres)
    assert np.array_equal(batches.labels, np.argmin(gaps, axis=1))
    assert batches.inertia == pytest.approx(float((gaps.min(axis=1) ** 2).sum()))
    # A first pass does not bring together what a poor start has thrown apart.
    assert batches.inertia < (2.0 if init == "random-partition" else 1.15) * lloyd.inertia


@pytest.mark.slow
def test_progress_and_seed() -> None:
    x, told = uniform(25_000), list[tuple[int, int]]()
    first = mini_batch_clusters(x, 8, "forgy", 3, on_progress=lambda done, total: told.append((done, total)))
    assert told == [(10_000, 25_000), (20_000, 25_000), (25_000, 25_000)]
    assert first.iterations == 3
    assert np.array_equal(first.centres, mini_batch_clusters(x, 8, "forgy", 3).centres)
    assert not np.array_equal(first.centres, mini_batch_clusters(x, 8, "forgy", 4).centres)


@pytest.mark.slow
def test_memory_is_bounded_by_the_samples_and_not_by_samples_times_clusters() -> None:
    x = uniform(100_000)
    mini_batch_clusters(x[:1000], 5, "forgy", 0)
    tracemalloc.start()
    try:
        mini_batch_clusters(x, 200, "forgy", 0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # All distances at once would be 160 MB, a batch's are 16 MB, the samples 1.6 MB.
    assert peak < 40e6


def test_algorithm_2_takes_mini_batches_where_there_is_much(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paper, "MINI_BATCHES_FROM", 100_000)
    told: list[int] = []
    walls = [[(40.0, 0.0), (60.0, 50.0)]]
    found = algorithm_2(
        walls, (0.0, 0.0, 100.0, 100.0), 20_000, 10, random_state=1, on_progress=lambda done, _: told.append(done)
    )
    assert found.mini_batches
    assert found.iterations == 2
    assert told[-1] == (~found.forbidden).sum() == len(found.labels)
    few = algorithm_2(walls, (0.0, 0.0, 100.0, 100.0), 5000, 10, random_state=1)
    assert not few.mini_batches


def test_too_many_clusters() -> None:
    with pytest.raises(ConfigurationError, match="k: expected 1 to 10, the number of samples, got 11"):
        mini_batch_clusters(uniform(10), 11)
