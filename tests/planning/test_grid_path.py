"""Grid maps, planned for a disc: certified paths next to the bound, however little time there is."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.worlds import KINDS, far_pairs

from trailmark import LandmarkPlanner
from trailmark.collision import StateChecker
from trailmark.world import Robot, World


@pytest.mark.parametrize("kind", KINDS)
def test_paths_are_certified_and_within_a_hundredth_of_the_bound(kind: str) -> None:
    rng = np.random.default_rng(5)
    blocked = KINDS[kind](rng, 100)
    ((x, y, u, v),) = far_pairs(blocked, rng, 1)
    world = World.from_grid(blocked, 1.0)
    planner = LandmarkPlanner(world, Robot.disc(0.4), seed=0)
    result = planner.plan((x + 0.5, y + 0.5, 0.0), (u + 0.5, v + 0.5, 0.0), time_limit=5.0)
    assert result.path is not None
    assert result.lower_bound is not None
    assert result.lower_bound <= result.path.cost <= 1.01 * result.lower_bound
    states = result.path.states
    assert StateChecker(world, Robot.disc(0.4)).motions_valid(states[:-1], states[1:]).all()
