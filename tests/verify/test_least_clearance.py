"""The least clearance along paths, against clearances at thousands of places, and where obstacles are known."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.trials import few

from trailmark import Rectangle, Robot, StateChecker, World, check_path
from trailmark.landmarks import free_samples
from trailmark.motion import motion_of
from trailmark.planning.verification import Verification

TOLERANCE, STEP = 1e-3, 4e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", [*ROBOTS, "car"])
def test_none_is_less_and_one_is_as_small(name: str) -> None:
    robot = ROBOTS["rectangle"].steered(3.0) if name == "car" else ROBOTS[name]
    checker = StateChecker(random_world(1, 60, size=50.0, discs=0.3), robot)
    motion = motion_of(checker)
    verification = Verification(checker, motion, seed=0)
    q = free_samples(checker, 60, random_state=0)
    near = q[:-1] + 0.1 * (q[1:] - q[:-1])
    pairs = [(a, b) for a, b in zip(q[:-1], near, strict=True) if checker.valid(b)]
    positive = 0
    for a, b in pairs[: few(60)]:
        path = motion.path(np.array([a, b]))
        found, places = verification.least_clearance(path), path.resample(STEP).states
        sampled = float(np.min(checker.clearance(places)))
        # Between two places no point of the robot moves farther than so.
        between = STEP * max(1.0, 2.0 * robot.sweep_radius) * (1.0 + robot.sweep_radius / (robot.turning_radius or 1e9))
        assert sampled - between - TOLERANCE <= found <= sampled + TOLERANCE + 1e-6
        positive += found > TOLERANCE
    assert positive > few(10)


@pytest.mark.slow
def test_a_turn_beside_a_wall() -> None:
    # Half a turn, the corner passing the wall on the way.
    wall, gap = Rectangle((10.0, 5.0), 20.0, 1.0), 0.02
    robot = Robot.rectangle(1.0, 0.6)
    y = 5.5 + float(np.hypot(0.5, 0.3)) + gap
    world = World("w", (0.0, 0.0, 20.0, 20.0), (wall,), robot)
    checker = StateChecker(world)
    motion = motion_of(checker)
    path = motion.path(np.array([[10.0, y, 0.0], [10.5, y, 1.5], [11.0, y, 3.0]]))
    assert Verification(checker, motion, seed=0).least_clearance(path) == pytest.approx(gap, abs=TOLERANCE)
    assert check_path(world, robot, path).min_clearance == pytest.approx(gap, abs=5e-7)
