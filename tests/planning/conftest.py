"""What the tests of planning share: kernels made ready, and a judge of paths who knows shapely alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from tests.helpers.oracles import Oracle, motion_states

from trailmark.planning.warmup import warm_up
from trailmark.world import Robot, World

Judge = Callable[[World, Robot, ArrayLike, ArrayLike, NDArray[np.float64]], float]


@pytest.fixture(scope="session", autouse=True)
def _ready() -> None:
    warm_up()
    warm_up("translation")


@pytest.fixture(scope="session")
def judge() -> Judge:
    """Assert that states are a path from start to goal free of collision; return its cost (metres)."""

    def judged(
        world: World, robot: Robot, start: ArrayLike, goal: ArrayLike, states: NDArray[np.float64], fine: float = 0.02
    ) -> float:
        assert np.array_equal(states[0], start)
        assert np.array_equal(states[-1], goal)
        assert ((states[:, 2] > -math.pi) & (states[:, 2] <= math.pi)).all()
        oracle = Oracle(world, robot)
        cost, samples = 0.0, [states[:1]]
        for a, b in pairwise(states):
            turn = abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2])))
            way = math.dist(a[:2], b[:2])
            cost += way + 0.5 * turn
            n = 2 + int((way + oracle.reach * turn) / (fine * oracle.reach))
            samples.append(motion_states(a[None], b[None], n)[0])
        q = np.concatenate(samples)
        hit = oracle.collides(q)
        assert not hit.any(), q[hit][0]
        return cost

    return judged
