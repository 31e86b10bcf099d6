"""Make the compiled kernels ready before a clock runs: compiled on the machine's first use, else loaded from cache."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from trailmark.world import Robot, World

__all__ = ["warm_up"]


@lru_cache(maxsize=1)
def warm_up() -> None:
    """Run every kernel once, on a small world; takes about half a minute on first use, a fraction of a second later."""
    from trailmark.planning.planner import LandmarkPlanner
    from trailmark.shapes import Rectangle

    world = World("warm-up", (0.0, 0.0, 6.0, 4.0), (Rectangle((3.0, 1.0), 0.5, 2.0),))
    for robot in (Robot.rectangle(0.6, 0.4), Robot.disc(0.2)):
        planner = LandmarkPlanner(world, robot, seed=0, warm=False)
        planner.plan(np.array([1.0, 1.0, 0.0]), np.array([5.0, 1.0, 1.0]), time_limit=60.0, max_iterations=2)
        planner.roadmap.certify_all()
