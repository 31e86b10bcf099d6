"""Returned paths have no vertex that a certified motion makes needless, and no motion of length 0."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.oracles import judge
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world

from trailmark.collision import StateChecker
from trailmark.collision.certify import BUDGET
from trailmark.motion import motion_of
from trailmark.planning.shortening import without_needless

FloatArray = NDArray[np.float64]


def fewer(checker: StateChecker, path: FloatArray) -> FloatArray:
    return np.asarray(without_needless(motion_of(checker).kind, path, BUDGET))


def stroll(checker: StateChecker, n: int, rng: np.random.Generator) -> FloatArray:
    """A path of n certified motions to and fro; (0, 3) if the robot has no room."""
    xmin, ymin, xmax, ymax = checker.world.bounds
    q = rng.uniform((xmin, ymin, -math.pi), (xmax, ymax, math.pi), (400, 3))
    states = q[checker.valid(q)][:1]
    while 0 < len(states) <= n:
        ahead = states[-1] + rng.normal(0.0, (1.0, 1.0, 0.6), (400, 3))
        ahead[:, 2] = np.arctan2(np.sin(ahead[:, 2]), np.cos(ahead[:, 2]))
        ahead = ahead[checker.valid(ahead)]
        ahead = ahead[checker.motions_valid(np.tile(states[-1], (len(ahead), 1)), ahead)]
        if len(ahead) == 0:
            return np.empty((0, 3))
        states = np.concatenate([states, ahead[:1]])
    return np.asarray(states)


def cost(states: FloatArray) -> float:
    return sum(
        math.dist(a[:2], b[:2]) + 0.5 * abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2])))
        for a, b in pairwise(states)
    )


@pytest.mark.slow
@settings(max_examples=few(60))
@given(
    name=st.sampled_from(sorted(ROBOTS)),
    world=st.integers(0, 5),
    seed=st.integers(0, 10_000),
    n=st.integers(1, 40),
)
def test_what_is_left_is_a_certified_path_over_some_of_the_vertices(name: str, world: int, seed: int, n: int) -> None:
    checker = StateChecker(
        random_world(world, 25, size=24.0, radii=(0.5, 2.0), discs=0.3, holes=0.2), ROBOTS[name], cell=0.2
    )
    path = stroll(checker, n, np.random.default_rng(seed))
    if len(path) == 0:
        return
    before = path.copy()
    short = fewer(checker, path)
    assert np.array_equal(path, before)
    judge(checker.world, checker.robot, path[0], path[-1], short)
    assert checker.motions_valid(short[:-1], short[1:]).all()
    # Some of the vertices, in their order.
    rows = [next(i for i, row in enumerate(path) if np.array_equal(row, kept)) for kept in short]
    assert all(i < j for i, j in pairwise(rows))
    assert cost(short) <= cost(path) + 1e-9
    # None of the vertices that are left could be left out.
    assert not checker.motions_valid(short[:-2], short[2:]).any()
