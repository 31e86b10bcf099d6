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
from tests.helpers.oracles import judge
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import Roadmap, StateChecker
from trailmark.landmarks import free_samples
from trailmark.planning import shorten

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
