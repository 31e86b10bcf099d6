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


def test_guides_tell_whether_they_are_a_path() -> None:
    start, goal = (2.0, 10.0, 0.0), (18.0, 10.0, 0.0)
    for gap, fits in ((3.0, True), (0.95, False)):
        walls = tuple(Rectangle((10.0, 10.0 + side * (0.5 * gap + 4.0)), 1.0, 8.0) for side in (-1, 1))
        ends = tuple(Rectangle((10.0, 10.0 + side * 9.5), 1.0, 1.0) for side in (-1, 1))
        checker = StateChecker(World("gap", (0, 0, 20, 20), (*walls, *ends)), Robot.disc(0.5))
        band = band_of(checker, start, goal)
        assert np.isfinite(band.shortest)
        guides, whole = band.guides(np.random.default_rng(0))
        assert whole == fits
        if fits:
            assert checker.motions_valid(guides[:-1], guides[1:]).all()
            assert np.hypot(*(guides[0, :2] - guides[-1, :2])) > 15.0


@pytest.mark.slow
def test_refined_bands_have_cells_half_as_large_until_the_grid_is_the_finest() -> None:
    checker = StateChecker(World("open", (0, 0, 60, 60)), Robot.rectangle(1.0, 0.6))
    band = band_of(checker, (20.0, 30.0, 0.0), (40.0, 30.0, 0.0))
    size, shortest = band.relaxation.size, band.shortest
    while band.refine():
        size /= 2.0
        assert band.relaxation.size == pytest.approx(size)
        assert band.shortest == pytest.approx(shortest, abs=1.0)
    assert band.relaxation.finer() is None


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


def test_tight_places_get_more_samples() -> None:
    band = band_of(gate(0.8, Robot.disc(0.3)), (5.0, 8.0, 0.0), (15.0, 8.0, 0.0))
    q = band.samples(4000, 0.3, np.random.default_rng(1))
    inside = (np.abs(q[:, 0] - 10.0) < 0.5).mean()
    # Per square metre, the gap gets far more than the open on its sides.
    beside = ((np.abs(q[:, 0] - 7.0) < 0.5) & (np.abs(q[:, 1] - 8.0) < 0.1)).mean()
    assert inside > 3.0 * beside


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


@pytest.mark.parametrize("gap", [0.62, 0.7, 1.5])
def test_guides_lead_through_the_gap(gap: float) -> None:
    robot = Robot.rectangle(1.5, 0.6)
    checker = gate(gap, robot)
    band = band_of(checker, (5.0, 8.0, 0.0), (15.0, 8.0, 0.0))
    found = np.concatenate([band.guides(np.random.default_rng(seed))[0] for seed in range(5)])
    inside = found[np.abs(found[:, 0] - 10.0) < 0.4]
    assert len(inside) > 0
    assert np.abs(inside[:, 1] - 8.0).max() <= (gap - 0.6) / 2 + 1e-6
    # One in every stretch as long as the clearance is room for: no gap wider than the world's clearance.
    assert np.diff(np.sort(found[:, 0])).max() < 5.0


def test_samples_near_stay_near() -> None:
    checker = StateChecker(World("open", (0, 0, 60, 60)), Robot.rectangle(1.0, 0.6))
    band = band_of(checker, (20.0, 30.0, 0.0), (40.0, 30.0, 0.0))
    at = np.array([30.0, 30.0, 0.0])
    for reach in (0.5, 4.0):
        q = band.samples_near(at, reach, 500, np.random.default_rng(1))
        away = np.hypot(*(q[:, :2] - at[:2]).T)
        assert np.mean(away < 2.0 * reach + 1.0) > 0.95
        assert away.max() < 8.0 * reach


def test_nearest_on_the_relaxed_way_is_not_nearest_as_the_crow_flies() -> None:
    # Goal behind the wall: what lies right at the wall is farther from it than what lies at the gap.
    band = band_of(gate(2.0, Robot.disc(0.3)), (5.0, 1.0, 0.0), (11.5, 1.0, 0.0))
    q = np.array([[9.0, 1.0, 0.0], [8.0, 8.0, 0.0], [5.0, 1.0, 0.0]])
    assert band.nearest_to_goal(q) == 1
    assert band.nearest_to_start(q) == 2
    behind = np.array([[11.5, 1.0, 0.0], [11.0, 8.0, 0.0]])
    assert band.nearest_to_start(behind) == 1


def test_estimates_are_low_in_the_open_and_know_of_walls() -> None:
    checker = StateChecker(World("open", (0, 0, 60, 60)), Robot.rectangle(1.0, 0.6))
    band = band_of(checker, (20.0, 30.0, 0.0), (40.0, 30.0, 0.0))
    q = np.random.default_rng(1).uniform((1, 1, -3), (59, 59, 3), (500, 3))
    for estimate, end in ((band.costs_to_goal(q), band.goal), (band.costs_to_start(q), band.start)):
        straight = np.hypot(*(q[:, :2] - end[:2]).T)
        assert estimate == pytest.approx(straight, rel=1e-12)
    walled = band_of(gate(2.0, Robot.disc(0.3)), (5.0, 1.0, 0.0), (11.5, 1.0, 0.0))
    at = np.array([[8.5, 1.0, 0.0]])
    way = math.dist((8.5, 1.0), (9.2, 7.3)) + 1.6 + math.dist((10.8, 7.3), (11.5, 1.0))
    assert 0.8 * way < walled.costs_to_goal(at)[0] <= way
