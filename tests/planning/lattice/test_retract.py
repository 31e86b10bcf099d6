"""Seating: configurations come off the obstacles, by no more than they may; distances by shapely."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from benchmarks.random_worlds import ROBOTS, random_world
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.planning.lattice.retract import retract
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]

LONG = Robot.rectangle(2.0, 1.0)
GAP = World("gap", (0, 0, 20, 20), (Rectangle((10.0, 4.4), 2.0, 8.8), Rectangle((10.0, 15.1), 2.0, 9.8)))
"""A wall with a gap from y = 8.8 to 10.2."""


def seated(checker: StateChecker, q: FloatArray, reach: float, turn: float, margin: float) -> FloatArray:
    moved = np.array(q, dtype=np.float64)
    retract(checker.field, checker.footprint, moved, reach, turn, margin)
    return moved


def clearance(checker: StateChecker, q: FloatArray) -> float:
    """The distance to the nearest obstacle by shapely; 0 if they overlap."""
    outline = shapely.affinity.rotate(checker.robot.outline.shapely(), q[2], origin=(0, 0), use_radians=True)
    placed = shapely.affinity.translate(outline, q[0], q[1])
    return min(float(placed.distance(shape.polygon().shapely())) for shape in checker.world.obstacles)


@pytest.mark.parametrize(("aside", "aslant"), [(0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.2, -0.3), (-0.25, 0.25)])
def test_in_a_gap_the_robot_comes_to_rest_in_the_middle_along_it(aside: float, aslant: float) -> None:
    checker = StateChecker(GAP, LONG, cell=0.05)
    q = np.array([10.0, 9.5 + aside, aslant])
    assert not checker.valid(q)
    moved = seated(checker, q, 0.4, 0.4, 0.2)
    assert checker.valid(moved)
    assert clearance(checker, moved) > 0.05
    assert abs(moved[1] - 9.5) < abs(aside) or abs(moved[2]) < abs(aslant)


def test_what_has_room_stays_exactly_where_it_is() -> None:
    checker = StateChecker(GAP, LONG, cell=0.05)
    q = np.array([5.0, 9.0, 2.0])
    assert (seated(checker, q, 1.0, 1.0, 0.2) == q).all()


def test_without_reach_nothing_moves() -> None:
    checker = StateChecker(GAP, LONG, cell=0.05)
    q = np.array([10.0, 9.3, 0.2])
    assert (seated(checker, q, 0.0, 0.0, 0.2) == q).all()


@settings(max_examples=60)
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
        moved = seated(checker, one, reach, turn, 0.1)
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
    saved = np.mean([bool(checker.valid(seated(checker, one, 0.4, 0.3, 0.1))) for one in nearly])
    assert saved > 0.8
