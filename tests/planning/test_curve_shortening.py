"""Shortening of a car's paths: same ends, never longer, still certified, and close to what is known to be best."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import random_world

from trailmark.collision import StateChecker
from trailmark.curves import CurvePath, Steering
from trailmark.motion import CurveMotion
from trailmark.planning.shortening import shorten
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

KINDS = [Steering(1.5), Steering(1.5, reverse=False)]
NAMES = ["reeds-shepp", "dubins"]
CAR = Robot.rectangle(1.6, 0.8)


def walked(checker: StateChecker, steering: Steering, seed: int, knots: int) -> np.ndarray:
    """A path of certified curves to and fro."""
    motions, rng = CurveMotion(checker, steering), np.random.default_rng(seed)
    xmin, ymin, xmax, ymax = checker.world.bounds
    while True:
        q = rng.uniform((xmin, ymin, -np.pi), (xmax, ymax, np.pi))
        if checker.valid(q):
            break
    path = [q]
    for _ in range(20_000):
        near = path[-1] + rng.normal(0.0, 1.0, 3) * (3.0, 3.0, 0.8)
        near[2] = np.arctan2(np.sin(near[2]), np.cos(near[2]))
        if motions.motion_valid(path[-1], near):
            path.append(near)
        if len(path) == knots:
            break
    assert len(path) == knots
    return np.array(path)


@pytest.mark.parametrize("steering", KINDS, ids=NAMES)
@pytest.mark.parametrize("seed", range(4))
def test_shorter_and_still_free(steering: Steering, seed: int) -> None:
    world = random_world(30 + seed, 30, size=40.0, discs=0.3)
    checker = StateChecker(world, CAR)
    knots = walked(checker, steering, seed, 15)
    short = shorten(CurveMotion(checker, steering), knots, np.random.default_rng(seed))
    assert np.array_equal(short[[0, -1]], knots[[0, -1]])
    before, after = CurvePath(knots, steering), CurvePath(short, steering)
    assert steering.lengths(knots[0], knots[-1]) - 1e-6 <= after.length < 0.9 * before.length
    assert CurveMotion(checker, steering).motions_valid(short[:-1], short[1:]).all()
    assert not Oracle(world, CAR).collides(after.resample(0.01).states).any()


@pytest.mark.parametrize("steering", KINDS, ids=NAMES)
def test_in_the_open_the_shortest_curve_is_found(steering: Steering) -> None:
    checker = StateChecker(World("open", (-50.0, -50.0, 50.0, 50.0)), CAR)
    rng = np.random.default_rng(0)
    for _ in range(5):
        knots = rng.uniform((-20, -20, -3), (20, 20, 3), (8, 3))
        short = shorten(CurveMotion(checker, steering), knots, rng)
        assert CurvePath(short, steering).length == pytest.approx(steering.lengths(knots[0], knots[-1]), rel=1e-3)


def test_around_a_wall() -> None:
    # Around the end of a wall: the tangents and an arc about its corner bound the length from below.
    world = World("wall", (0.0, 0.0, 20.0, 20.0), (Rectangle((10.0, 6.0), 0.2, 12.0),))
    checker, steering = StateChecker(world, Robot.disc(0.5)), Steering(1.0)
    knots = np.array([(3.0, 3.0, 1.5), (4.0, 16.0, 0.5), (10.0, 18.0, 0.0), (16.0, 16.0, -1.0), (17.0, 3.0, -1.5)])
    motions = CurveMotion(checker, steering)
    assert motions.motions_valid(knots[:-1], knots[1:]).all()
    short = CurvePath(shorten(motions, knots, np.random.default_rng(1), sweeps=200, tolerance=1e-6), steering)
    assert 23.0 < short.length < 25.0
    assert short.length < 0.75 * CurvePath(knots, steering).length
