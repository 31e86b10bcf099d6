"""Retraction: configurations come off the obstacles, by no more than they may; distances by shapely."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import ROBOTS, random_states, random_world
from tests.support.trials import few

from trailmark.collision import StateChecker
from trailmark.landmarks.retraction import retract, retract_all

FloatArray = NDArray[np.float64]

"""A wall with a gap from y = 8.8 to 10.2."""


def retracted(checker: StateChecker, q: FloatArray, reach: float, turn: float, margin: float) -> FloatArray:
    moved = np.array(q, dtype=np.float64)
    retract(checker.field, checker.footprint, moved, reach, turn, margin)
    return moved


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
