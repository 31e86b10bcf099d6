"""Samples, landmarks and bands: where they lie and how they spread, by shapely and scipy; and that a seed decides."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.oracles import Oracle
from tests.helpers.worlds import ROBOTS, random_states, random_world

from trailmark import ConfigurationError, Disc, Polygon, Rectangle, Robot, StateChecker, World
from trailmark.landmarks import Relaxation, draw, free_samples, k_means_landmarks
from trailmark.landmarks.band import Band
from trailmark.landmarks.retraction import retract_all

FloatArray = NDArray[np.float64]

BOUNDS = (-3.0, 2.0, 5.0, 18.0)
METHODS: tuple[Any, ...] = ("uniform", "halton")
FULL = StateChecker(World("full", (0, 0, 4, 4), (Rectangle((2, 2), 4, 4),)), Robot.disc(0.5))


def test_bad_arguments_are_named() -> None:
    other: Any = "halten"
    with pytest.raises(ConfigurationError, match=r"expected halton, uniform, got 'halten' \(did you mean 'halton'\?\)"):
        draw(BOUNDS, 3, method=other)
    for n in (0, 5):
        with pytest.raises(ConfigurationError, match="got 'halten'"):
            free_samples(FULL, n, method=other)
    with pytest.raises(ConfigurationError, match="expected 0 or more, got -2"):
        draw(BOUNDS, -2)
    with pytest.raises(ConfigurationError, match="expected 0 or more, got -2"):
        free_samples(FULL, -2)
    for k in (0, -3):
        with pytest.raises(ConfigurationError, match=f"expected 1 or more, got {k}"):
            k_means_landmarks(clumped(20, 1), k, radius=1.0)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ROBOTS)
def test_free_samples_are_valid(name: str, method: Any) -> None:
    world = random_world(3, 60, size=50.0, discs=0.3, holes=0.3, boundary=True)
    checker = StateChecker(world, ROBOTS[name])
    q, again, other = (free_samples(checker, 300, method=method, random_state=seed) for seed in (4, 4, 5))
    assert q.shape == np.unique(q, axis=0).shape == (300, 3)
    assert not Oracle(world, ROBOTS[name]).collides(q).any()
    assert (name == "disc") == (not q[:, 2].any())
    assert np.array_equal(q, again)
    assert not np.array_equal(q, other)


def test_what_is_enclosed_is_left_out() -> None:
    outer, inner = (np.array(shapely.box(a, a, b, b).exterior.coords[:-1]) for a, b in ((10, 30), (12, 28)))
    ring = Polygon(outer, (inner,))
    checker = StateChecker(World("ring", (0, 0, 40, 40), (ring, Disc((20.0, 20.0), 2.0))), Robot.rectangle(1.5, 1.0))

    def share(start: FloatArray | None) -> float:
        q = free_samples(checker, 500, reachable_from=start, random_state=2)
        assert len(q) == 500
        return float(shapely.contains_xy(shapely.Polygon(inner), q[:, 0], q[:, 1]).mean())

    assert 0.05 < share(None) < 0.95
    assert share(np.array([5.0, 5.0, 1.0])) == 0.0
    assert share(np.array([15.0, 15.0, 1.0])) == 1.0


# --- K-means.


def clumped(n: int, seed: int) -> FloatArray:
    """Samples of which half lie in a tenth of the region."""
    q = np.random.default_rng(seed).uniform((0.0, 0.0, -np.pi), (10.0, 10.0, np.pi), (n, 3))
    q[: n // 2, :2] = 4.0 + 0.1 * q[: n // 2, :2]
    return q


@pytest.mark.slow
@settings(max_examples=50)
@given(n=st.integers(1, 60), k=st.integers(1, 80), radius=st.sampled_from([0.0, 0.5, 3.0]), seed=st.integers(0, 999))
def test_landmarks_are_samples_and_no_two_the_same(n: int, k: int, radius: float, seed: int) -> None:
    q = clumped(n, seed)
    found = k_means_landmarks(q, k, radius=radius, random_state=seed)
    rows = {tuple(row) for row in found.tolist()}
    assert len(rows) == len(found)
    assert rows <= {tuple(row) for row in q.tolist()}
    # Two centres seldom have the same nearest sample.
    assert max(1, 0.5 * min(k, n)) <= len(found) <= min(k, n)
    assert np.array_equal(found, k_means_landmarks(q, k, radius=radius, random_state=np.random.default_rng(seed)))
    if k >= n:
        assert np.array_equal(found, q)
        assert not np.shares_memory(found, q)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_all_that_the_band_gives_is_valid_and_the_seeds_own(name: str) -> None:
    world = random_world(5, 40, size=40.0, discs=0.3, holes=0.2)
    checker = StateChecker(world, ROBOTS[name], cell=0.2)
    ends = free_samples(checker, 2, random_state=1)
    band = Band(checker, Relaxation(checker), ends[0], ends[1])
    assert np.isfinite(band.shortest)

    def all_kinds(seed: int) -> list[FloatArray]:
        rng = np.random.default_rng(seed)
        samples = [band.samples(100, widening, rng) for widening in (0.02, 0.3, 1.5, np.inf)]
        return [*samples, band.samples_near(ends[0], 3.0, 100, rng), band.guides(rng)[0]]

    for found, again, other in zip(all_kinds(1), all_kinds(1), all_kinds(2), strict=True):
        assert len(found) > 0
        assert not Oracle(world, ROBOTS[name]).collides(found).any()
        assert (np.abs(found[:, 2]) <= math.pi).all()
        assert (name == "disc") == (not found[:, 2].any())
        assert np.array_equal(found, again)
        assert not np.array_equal(found, other)


@pytest.mark.parametrize("name", ROBOTS)
def test_more_become_valid(name: str) -> None:
    world = random_world(4, 80, size=40.0, discs=0.3)
    checker, oracle = StateChecker(world, ROBOTS[name], cell=0.1), Oracle(world, ROBOTS[name])
    q = random_states(world, 400, np.random.default_rng(1))
    if name == "disc":
        q[:, 2] = 0.0
    before = q.copy()
    for reach in (0.2, 1.0):
        moved = retract_all(checker, q, reach)
        assert np.array_equal(q, before)
        assert (~oracle.collides(moved)).sum() > (~oracle.collides(q)).sum()
        assert name != "disc" or not moved[:, 2].any()
