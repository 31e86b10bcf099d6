"""Make the compiled kernels ready before a clock runs: compiled on the machine's first use, else loaded from cache."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from trailmark.world import Robot, World

__all__ = ["warm_up", "warm_up_curves"]


@lru_cache(maxsize=1)
def warm_up() -> None:
    """Run every kernel once, on a small world: half a minute on a machine's first use, about a second later on."""
    from trailmark.planning.planner import LandmarkPlanner
    from trailmark.shapes import Rectangle

    world = World("warm-up", (0.0, 0.0, 6.0, 4.0), (Rectangle((3.0, 1.0), 0.5, 2.0),))
    planner = LandmarkPlanner(world, Robot.rectangle(0.6, 0.4), seed=0, warm=False)
    start, goal = np.array([1.0, 1.0, 0.0]), np.array([5.0, 1.0, 1.0])
    planner.plan(start, goal, time_limit=600.0, max_iterations=1)
    planner.roadmap.certify_all()


@lru_cache(maxsize=1)
def warm_up_curves() -> None:
    """Run every kernel that only cars need once, as :func:`warm_up` does the others."""
    from trailmark.collision.curve_motions import CurveChecker
    from trailmark.planning.drives import drives_from
    from trailmark.planning.planner import LandmarkPlanner
    from trailmark.shapes import Rectangle

    world = World("warm-up", (0.0, 0.0, 6.0, 4.0), (Rectangle((3.0, 1.0), 0.5, 2.0),))
    planner = LandmarkPlanner(world, Robot.rectangle(0.6, 0.4).steered(0.4), seed=0, warm=False)
    start, goal = np.array([1.0, 1.0, 0.0]), np.array([5.0, 1.0, 1.0])
    found = planner.plan(start, goal, time_limit=600.0, max_iterations=1)
    planner.roadmap.certify_all()
    if found.path is not None:
        found.path.at(0.5)
    # Which queries need drives nobody knows beforehand.
    drives_from(
        CurveChecker(planner.checker),
        planner.relaxation,
        planner.relaxation.costs_from(goal),
        start[None],
        into=False,
        step=0.1,
        most=50,
        landmarks=5,
        rng=np.random.default_rng(0),
    )
