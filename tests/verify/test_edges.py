"""The index of cells finds every edge that is near, as the tree of the polygons' edges does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trailmark.path import Path
from trailmark.verify import RIM, Verifier
from trailmark.world import Robot, World


@pytest.mark.slow
@pytest.mark.parametrize("robot", [Robot.disc(0.4), Robot.rectangle(0.9, 0.5)])
def test_verdicts_are_those_of_the_polygons(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    world = World.from_grid(rng.random((20, 20)) < 0.05, 1.0)
    mine, theirs = Verifier(world, robot, RIM), Verifier(replace(world, obstacles=tuple(world.obstacles)), robot, RIM)
    free = 0
    for _ in range(300):
        a, b = np.column_stack([rng.uniform(1.0, 19.0, (2, 2)), rng.uniform(-3.0, 3.0, 2)])
        path = Path(np.array([a, a + 0.3 * (b - a)]))
        verdicts = [check.fault(path, path.states[0], path.states[1]) for check in (mine, theirs)]
        assert (verdicts[0] is None) == (verdicts[1] is None)
        free += verdicts[0] is None
    assert 30 < free < 270
