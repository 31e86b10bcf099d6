"""The least clearance along motions, against clearances at thousands of places."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.trials import few

from trailmark import StateChecker
from trailmark.landmarks import free_samples
from trailmark.motion import motion_of
from trailmark.motion.base import least_clearance_of

TOLERANCE, STEP = 1e-3, 4e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", [*ROBOTS, "car"])
def test_none_is_less_and_one_is_as_small(name: str) -> None:
    robot = ROBOTS["rectangle"].steered(3.0) if name == "car" else ROBOTS[name]
    checker = StateChecker(random_world(1, 60, size=50.0, discs=0.3), robot)
    motion = motion_of(checker)
    q = free_samples(checker, 60, random_state=0)
    near = q[:-1] + 0.1 * (q[1:] - q[:-1])
    pairs = [(a, b) for a, b in zip(q[:-1], near, strict=True) if checker.valid(b)]
    positive = 0
    for a, b in pairs[: few(60)]:
        found = float(least_clearance_of(motion.kind, np.array([a, b]), TOLERANCE, 100_000)[0])
        places = motion.path(np.array([a, b])).resample(STEP).states
        sampled = float(np.min(checker.clearance(places)))
        # Between two places no point of the robot moves farther than so.
        between = STEP * max(1.0, 2.0 * robot.sweep_radius) * (1.0 + robot.sweep_radius / (robot.turning_radius or 1e9))
        assert sampled - between - 1e-6 <= found <= sampled + TOLERANCE + 1e-6
        positive += found > TOLERANCE
    assert positive > few(10)
