"""Shortening: never longer, the same ends, no collision. Costs and collisions are measured without trailmark."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.oracles import Oracle, judge
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world

from trailmark.collision import StateChecker
from trailmark.curves import Steering
from trailmark.landmarks import free_samples
from trailmark.motion import CurveMotion, motion_of
from trailmark.planning import shorten
from trailmark.roadmap import Roadmap
from trailmark.shapes import Rectangle
from trailmark.trajectories import CurvePath
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]


def cost(states: FloatArray, turning: bool = True) -> float:
    total = 0.0
    for a, b in pairwise(states):
        angle = abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2])))
        total += math.dist(a[:2], b[:2]) + (0.5 * angle if turning else 0.0)
    return total


@lru_cache(maxsize=64)
def roadmap(name: str, seed: int) -> Roadmap:
    world = random_world(seed, 40, size=30.0, radii=(0.5, 3.0), discs=0.3, holes=0.2)
    found = Roadmap(StateChecker(world, ROBOTS[name], cell=0.2))
    found.add(free_samples(found.checker, 120, random_state=seed))
    return found


def longest_way(roadmap: Roadmap) -> FloatArray:
    """The roadmap's path with most vertices among those from its first node."""
    ways = (roadmap.shortest_path(0, i).nodes for i in range(1, len(roadmap), 3))
    return np.asarray(roadmap.configurations[max(ways, key=len, default=np.zeros(1, np.int64))])


@pytest.mark.slow
@settings(max_examples=few(40))
@given(name=st.sampled_from(sorted(ROBOTS)), world=st.integers(0, 5), seed=st.integers(0, 10_000))
def test_paths_get_no_longer_and_stay_free(name: str, world: int, seed: int) -> None:
    chart = roadmap(name, world)
    states = longest_way(chart)
    if len(states) < 3:
        return
    before = states.copy()
    rng = np.random.default_rng(seed)
    short = shorten(chart.motion, states, rng, sweeps=int(rng.integers(0, 12)), splitting=bool(seed % 2))
    assert np.array_equal(states, before)
    turning = name != "disc"
    assert cost(short, turning) <= cost(states, turning) + 1e-9
    judge(chart.checker.world, ROBOTS[name], states[0], states[-1], short)
    assert chart.checker.motions_valid(short[:-1], short[1:]).all()


@pytest.mark.slow
def test_much_is_gained() -> None:
    gains = []
    for name in ROBOTS:
        for seed in range(3):
            states = longest_way(roadmap(name, seed))
            if len(states) > 4:
                short = shorten(roadmap(name, seed).motion, states, np.random.default_rng(0))
                gains.append(1.0 - cost(short, name != "disc") / cost(states, name != "disc"))
    assert len(gains) > 10
    assert np.mean(gains) > 0.15


@pytest.mark.slow
def test_added_vertices_lead_around_a_block() -> None:
    # The shortest path bends twice; moved alone, the one bend that there is has nowhere better to go.
    robot = Robot.rectangle(2.0, 1.0)
    checker = StateChecker(World("block", (0, 0, 30, 20), (Rectangle((15.0, 6.0), 6.0, 12.0),)), robot)
    states = np.array([[6.0, 6.0, 0.0], [15.0, 18.2, 0.0], [24.0, 6.0, 0.0]])
    assert checker.motions_valid(states[:-1], states[1:]).all()
    motion = motion_of(checker)
    plain, split = (
        [cost(shorten(motion, states, np.random.default_rng(s), tolerance=1e-5, splitting=on)) for s in range(9)]
        for on in (False, True)
    )
    assert np.median(split) < np.median(plain), (split, plain)


def test_seed_sweeps_and_deadline() -> None:
    chart = roadmap("L", 1)
    states = longest_way(chart)
    assert len(states) > 4
    first, again, other = (shorten(chart.motion, states, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    # One generator does not repeat itself.
    rng = np.random.default_rng(1)
    assert np.array_equal(shorten(chart.motion, states, rng), first)
    assert not np.array_equal(shorten(chart.motion, states, rng), first)
    for untouched in (
        shorten(chart.motion, states, rng, sweeps=0),
        shorten(chart.motion, states, rng, seconds_left=lambda: 0.0),
        # A sweep that the time ends changes no more.
        shorten(chart.motion, states, rng, seconds_left=lambda: 1e-9),
    ):
        assert np.array_equal(untouched, states)
        assert not np.shares_memory(untouched, states)
    few, many = (cost(shorten(chart.motion, states, np.random.default_rng(3), sweeps=n)) for n in (1, 40))
    assert many < few < cost(states)


# --- a car's paths

KINDS = [Steering(1.5), Steering(1.5, reverse=False)]
NAMES = ["reeds-shepp", "dubins"]
LORRY = Robot.rectangle(1.6, 0.8)


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
    checker = StateChecker(world, LORRY)
    knots = walked(checker, steering, seed, 15)
    short = shorten(CurveMotion(checker, steering), knots, np.random.default_rng(seed))
    assert np.array_equal(short[[0, -1]], knots[[0, -1]])
    before, after = CurvePath(knots, steering), CurvePath(short, steering)
    assert steering.lengths(knots[0], knots[-1]) - 1e-6 <= after.length < 0.9 * before.length
    assert CurveMotion(checker, steering).motions_valid(short[:-1], short[1:]).all()
    assert not Oracle(world, LORRY).collides(after.resample(0.01).states).any()
