"""Retraction: configurations come off the obstacles, by no more than they may; distances by shapely."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import ROBOTS, random_states, random_world
from tests.support.trials import few

from trailmark.collision import StateChecker
from trailmark.landmarks.retraction import retract, retract_all
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]

LONG = Robot.rectangle(2.0, 1.0)
GAP = World("gap", (0, 0, 20, 20), (Rectangle((10.0, 4.4), 2.0, 8.8), Rectangle((10.0, 15.1), 2.0, 9.8)))
"""A wall with a gap from y = 8.8 to 10.2."""


def retracted(checker: StateChecker, q: FloatArray, reach: float, turn: float, margin: float) -> FloatArray:
    moved = np.array(q, dtype=np.float64)
    retract(checker.field, checker.footprint, moved, reach, turn, margin)
    return moved


def clearance(checker: StateChecker, q: FloatArray) -> float:
    """The distance to the nearest obstacle by shapely; 0 if they overlap."""
    outline = shapely.affinity.rotate(checker.robot.outline.shapely(), q[2], origin=(0, 0), use_radians=True)
    placed = shapely.affinity.translate(outline, q[0], q[1])
    return min(float(placed.distance(shape.polygon().shapely())) for shape in checker.world.obstacles)


@pytest.mark.slow
@pytest.mark.parametrize(("aside", "aslant"), [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.2, -0.3), (-0.25, 0.25)])
def test_in_a_gap_the_robot_comes_to_rest_in_the_middle_along_it(aside: float, aslant: float) -> None:
    checker = StateChecker(GAP, LONG, cell=0.05)
    q = np.array([10.0, 9.5 + aside, aslant])
    assert not checker.valid(q)
    moved = retracted(checker, q, 0.4, 0.4, 0.2)
    assert checker.valid(moved)
    assert clearance(checker, moved) > 0.05
    assert abs(moved[1] - 9.5) < abs(aside) or abs(moved[2]) < abs(aslant)


def test_what_has_room_stays_exactly_where_it_is() -> None:
    checker = StateChecker(GAP, LONG, cell=0.05)
    q = np.array([5.0, 9.0, 2.0])
    assert (retracted(checker, q, 1.0, 1.0, 0.2) == q).all()


def test_without_reach_nothing_moves() -> None:
    checker = StateChecker(GAP, LONG, cell=0.05)
    q = np.array([10.0, 9.3, 0.2])
    assert (retracted(checker, q, 0.0, 0.0, 0.2) == q).all()


@pytest.mark.slow
@settings(max_examples=few(60))
@given(
    name=st.sampled_from(sorted(ROBOTS)),
    world=st.integers(0, 3),
    seed=st.integers(0, 10_000),
    reach=st.floats(0.05, 1.0),
    turn=st.floats(0.0, 0.5),
)
def test_nothing_moves_farther_than_it_may(name: str, world: int, seed: int, reach: float, turn: float) -> None:
    checker = StateChecker(
        random_world(world, 25, size=24.0, radii=(0.5, 2.0), discs=0.3, holes=0.2), ROBOTS[name], cell=0.2
    )
    q = np.random.default_rng(seed).uniform((-1, -1, -math.pi), (25, 25, math.pi), (20, 3))
    # Where a heading is half a turn, as it may be.
    q[0, 2] = math.pi
    for one in q:
        moved = retracted(checker, one, reach, turn, 0.1)
        assert np.abs(moved[:2] - one[:2]).max() <= reach + 1e-12
        away = abs(math.remainder(moved[2] - one[2], 2.0 * math.pi))
        assert away <= turn + 1e-12
        assert -math.pi < moved[2] <= math.pi


@pytest.mark.parametrize("name", ["rectangle", "L", "offset", "disc"])
def test_most_that_collides_by_little_becomes_valid(name: str) -> None:
    rng = np.random.default_rng(5)
    checker = StateChecker(random_world(1, 40, size=40.0, radii=(0.5, 3.0)), ROBOTS[name])
    q = rng.uniform((1, 1, -math.pi), (39, 39, math.pi), (4000, 3))
    nearly = q[~checker.valid(q) & checker.valid(q + np.array([0.3, 0.0, 0.0]))]
    assert len(nearly) > 40
    saved = np.mean([bool(checker.valid(retracted(checker, one, 0.4, 0.3, 0.1))) for one in nearly])
    assert saved > 0.8


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
        moved = retract_all(checker, q, reach)
        assert np.array_equal(q, before)
        assert moved.shape == q.shape
        assert np.abs(moved[:, :2] - q[:, :2]).max() <= reach + 1e-12
        assert (np.abs(moved[:, 2]) <= np.pi).all()
        assert (~oracle.collides(moved)).sum() > (~oracle.collides(q)).sum()
        assert name != "disc" or not moved[:, 2].any()


def test_configurations_come_to_the_middle_of_a_passage() -> None:
    robot = Robot.rectangle(2.0, 0.8)
    checker = StateChecker(corridor(0.9), robot, cell=0.05)
    rng = np.random.default_rng(3)
    q = rng.uniform((5, 4.7, -0.25), (15, 5.3, 0.25), (300, 3))
    moved = retract_all(checker, q, 0.45)
    valid: NDArray[np.bool_] = np.asarray(checker.valid(moved))
    assert valid.mean() > 0.9 > 0.1 > np.asarray(checker.valid(q)).mean()
    assert np.abs(moved[valid, 1] - 5.0).max() <= 0.05 + 1e-6


def test_one_that_can_turn_freely_stays() -> None:
    checker = StateChecker(World("open", (0, 0, 20, 20)), Robot.rectangle(1.0, 0.5))
    q = np.array([[10.0, 10.0, 0.3], [5.0, 12.0, -3.0]])
    assert np.array_equal(retract_all(checker, q, 1.0), q)
    assert retract_all(checker, np.empty((0, 3)), 1.0).shape == (0, 3)
