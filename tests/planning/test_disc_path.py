"""Disc ways: certified, and as short as lower bounds, visibility graphs (networkx, shapely) and geometry say."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.oracles import Oracle
from tests.helpers.trials import few
from tests.helpers.worlds import random_world

from trailmark.collision import StateChecker
from trailmark.planning.pipeline import disc_path
from trailmark.proofs import LowerBound
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]


def length(way: FloatArray) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(way))


def judged(world: World, radius: float, start: FloatArray, goal: FloatArray, most: float = np.inf) -> FloatArray:
    """A disc's way, which is empty or leads from start to goal through free space for certain."""
    way = disc_path(world, radius, start, goal, most)
    assert way.shape[1:] == (2,)
    if len(way):
        assert np.array_equal(way[0], start)
        assert np.array_equal(way[-1], goal)
        states = np.column_stack([way, np.zeros(len(way))])
        checker = StateChecker(world, Robot.disc(radius))
        assert checker.motions_valid(states[:-1], states[1:]).all()
        steps = [np.linspace(a, b, 2 + int(math.dist(a, b) / (0.02 * radius))) for a, b in pairwise(way)]
        points = np.concatenate(steps)
        assert not Oracle(world, Robot.disc(radius)).collides(np.column_stack([points, np.zeros(len(points))])).any()
    return way


def bound(world: World, radius: float, start: FloatArray, goal: FloatArray) -> float:
    return LowerBound(world, Robot.disc(radius)).of(np.append(start, 0.0), np.append(goal, 0.0)).cost


@pytest.mark.slow
@settings(max_examples=few(40, of=5))
@given(seed=st.integers(0, 10_000), radius=st.sampled_from([0.05, 0.3, 0.8]), boundary=st.booleans())
# A corner of 16 degrees, for which GEOS takes one chord.
@example(seed=1238, radius=0.05, boundary=False)
def test_ways_are_free_and_as_short_as_bounds_tell(seed: int, radius: float, boundary: bool) -> None:
    world = random_world(seed, 15, size=14.0, radii=(0.3, 2.5), discs=0.4, holes=0.3, boundary=boundary)
    q = np.random.default_rng(seed).uniform(0.0, 14.0, (200, 2))
    q = q[StateChecker(world, Robot.disc(1.04 * radius + 0.01)).valid(np.column_stack([q, np.zeros(len(q))]))]
    if len(q) < 2:
        return
    start, goal = q[:2]
    way = judged(world, radius, start, goal)
    least = bound(world, radius, start, goal)
    # Obstacles grown by a little more: no gap that is taken for one by this bound is missed.
    most = bound(world, 1.03 * radius + 0.01, start, goal)
    if len(way) == 0:
        assert most == np.inf
        return
    assert least * (1.0 - 1e-9) <= length(way) <= most * (1.0 + 1e-9)
    if most < 1.004 * least:
        assert length(way) <= 1.005 * least
    # What is known to be no shorter does not change the way, but for rounding; what is known to be shorter, ends it.
    again = judged(world, radius, start, goal, length(way) * (1.0 + 1e-9))
    assert length(again) == pytest.approx(length(way))
