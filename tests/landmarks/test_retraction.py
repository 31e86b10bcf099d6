"""Retraction: configurations gain clearance, stay within reach, and come out alike for the same seed."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.oracle import Oracle
from benchmarks.random_worlds import ROBOTS, random_states, random_world
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.landmarks.retraction import MAX_DISPLACEMENT, retract_all
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World


def corridor(width: float) -> World:
    return World("corridor", (0, 0, 20, 10), (Rectangle((10, 2), 16, 6 - width), Rectangle((10, 8), 16, 6 - width)))


@pytest.mark.parametrize("name", ROBOTS)
def test_more_become_valid_and_none_goes_far(name: str) -> None:
    world = random_world(4, 80, size=40.0, discs=0.3)
    checker = StateChecker(world, ROBOTS[name], cell=0.1)
    oracle = Oracle(world, ROBOTS[name])
    q = random_states(world, 400, np.random.default_rng(1))
    if name == "disc":
        q[:, 2] = 0.0
    before = q.copy()
    for reach in (0.2, 1.0):
        moved = retract_all(checker, q, reach, np.random.default_rng(2))
        assert np.array_equal(q, before)
        assert moved.shape == q.shape
        assert np.abs(moved[:, :2] - q[:, :2]).max() <= MAX_DISPLACEMENT * reach + 1e-12
        assert (np.abs(moved[:, 2]) <= np.pi).all()
        assert (~oracle.collides(moved)).sum() > (~oracle.collides(q)).sum()
        assert np.array_equal(moved, retract_all(checker, q, reach, np.random.default_rng(2)))
        assert not np.array_equal(moved, retract_all(checker, q, reach, np.random.default_rng(3)))
        assert name != "disc" or not moved[:, 2].any()


def test_configurations_come_to_the_middle_of_a_passage() -> None:
    robot = Robot.rectangle(2.0, 0.8)
    checker = StateChecker(corridor(0.9), robot, cell=0.05)
    rng = np.random.default_rng(3)
    q = rng.uniform((5, 4.7, -0.25), (15, 5.3, 0.25), (300, 3))
    moved = retract_all(checker, q, 0.3, rng, steps=100)
    valid: NDArray[np.bool_] = np.asarray(checker.valid(moved))
    assert valid.mean() > 0.5 > 0.1 > np.asarray(checker.valid(q)).mean()
    assert np.abs(moved[valid, 1] - 5.0).max() <= 0.05 + 1e-6


def test_one_that_can_turn_freely_stays() -> None:
    checker = StateChecker(World("open", (0, 0, 20, 20)), Robot.rectangle(1.0, 0.5))
    q = np.array([[10.0, 10.0, 0.3], [5.0, 12.0, -3.0]])
    assert np.array_equal(retract_all(checker, q, 1.0, np.random.default_rng(1)), q)
    assert retract_all(checker, np.empty((0, 3)), 1.0, np.random.default_rng(1)).shape == (0, 3)
