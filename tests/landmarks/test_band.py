"""The band: samples where short paths are likely. Validity is judged by shapely, distances along the grid by scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import ROBOTS, random_world

from trailmark.collision import StateChecker
from trailmark.landmarks import Relaxation, free_samples
from trailmark.landmarks.band import Band
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]


def gate(gap: float, robot: Robot) -> StateChecker:
    """A 20 x 10 m world, a wall across it at x = 10 with one gap around y = 8."""
    low, high = 8.0 - gap / 2, 8.0 + gap / 2
    walls = (Rectangle((10.0, low / 2), 1.0, low), Rectangle((10.0, (10.0 + high) / 2), 1.0, 10.0 - high))
    return StateChecker(World("gate", (0, 0, 20, 10), walls), robot)


def band_of(checker: StateChecker, start: tuple[float, ...], goal: tuple[float, ...]) -> Band:
    return Band(checker, Relaxation(checker), np.array(start), np.array(goal))


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_all_that_the_band_gives_is_valid(name: str) -> None:
    world = random_world(5, 40, size=40.0, discs=0.3, holes=0.2)
    checker = StateChecker(world, ROBOTS[name], cell=0.2)
    oracle = Oracle(world, ROBOTS[name])
    ends = free_samples(checker, 2, random_state=1)
    band = Band(checker, Relaxation(checker), ends[0], ends[1])
    assert np.isfinite(band.shortest)
    rng = np.random.default_rng(2)
    for widening in (0.02, 0.3, 1.5, np.inf):
        q = band.samples(100, widening, rng)
        assert 0 < len(q) <= 100
        assert not oracle.collides(q).any()
    near = band.samples_near(ends[0], 3.0, 100, rng)
    assert 0 < len(near) <= 200
    guides = band.guides(rng)[0]
    assert len(guides) > 0
    for found in (near, guides):
        assert not oracle.collides(found).any()
        assert (np.abs(found[:, 2]) <= math.pi).all()
        assert (name == "disc") == (not found[:, 2].any())


@pytest.mark.parametrize("widening", [0.05, 0.3, 1.0])
def test_samples_keep_to_ways_not_much_longer_than_the_shortest(widening: float) -> None:
    # In the open: the disc's centre lies in an ellipse about start and goal, as wide as the band.
    checker = StateChecker(World("open", (0, 0, 60, 60)), Robot.rectangle(1.0, 0.6))
    start, goal = (20.0, 30.0, 0.0), (40.0, 30.0, 0.0)
    band = band_of(checker, start, goal)
    assert band.shortest == pytest.approx(20.0, abs=0.5)
    q = band.samples(2000, widening, np.random.default_rng(1))
    assert len(q) == 2000
    total = np.hypot(*(q[:, :2] - start[:2]).T) + np.hypot(*(q[:, :2] - goal[:2]).T)
    # Ways along eight directions are up to 8.3 % longer than straight ones.
    assert total.max() <= 20.0 * (1.0 + widening) + 4.0
    assert total.max() >= 20.0 * (1.0 + widening) / 1.083 - 2.0


def test_without_a_limit_samples_reach_all_that_is_joined() -> None:
    band = band_of(gate(2.0, Robot.rectangle(1.0, 0.6)), (5.0, 2.0, 0.0), (15.0, 2.0, 0.0))
    narrow, wide = (band.samples(4000, widening, np.random.default_rng(1)) for widening in (0.02, np.inf))
    for x in (1.5, 18.5):
        assert np.hypot(narrow[:, 0] - x, narrow[:, 1] - 2.0).min() > 1.5
        assert np.hypot(wide[:, 0] - x, wide[:, 1] - 2.0).min() < 1.0


@pytest.mark.parametrize("gap", [0.3, 0.5])
def test_what_is_apart_has_no_shortest_way(gap: float) -> None:
    checker = gate(gap, Robot.disc(0.4))
    assert band_of(checker, (5.0, 8.0, 0.0), (15.0, 8.0, 0.0)).shortest == np.inf
    assert band_of(checker, (5.0, 8.0, 0.0), (5.0, 2.0, 0.0)).shortest < np.inf


def test_the_same_seed_gives_the_same_samples() -> None:
    band = band_of(gate(1.0, Robot.rectangle(1.0, 0.6)), (5.0, 2.0, 0.0), (15.0, 2.0, 1.0))

    def all_kinds(seed: int) -> list[FloatArray]:
        rng = np.random.default_rng(seed)
        return [
            band.samples(50, 0.3, rng),
            band.guides(rng)[0],
            band.samples_near(np.array([9.0, 8.0, 0.1]), 1, 30, rng),
        ]

    for first, again, other in zip(all_kinds(1), all_kinds(1), all_kinds(2), strict=True):
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)
