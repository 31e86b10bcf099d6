"""Make the compiled kernels ready before a clock runs: compiled on the machine's first use, else loaded from cache."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

__all__ = ["SMALL", "warm_up", "warm_up_curves", "warm_up_queries"]

SMALL = (
    World("warm-up", (0.0, 0.0, 6.0, 4.0), (Rectangle((3.0, 1.0), 0.5, 2.0),)),
    Robot.rectangle(0.6, 0.4),
    np.array([[1.0, 1.0, 0.0], [5.0, 1.0, 1.0]]),
)
"""A small world, a robot, and a start and a goal that no single motion joins."""


@lru_cache(maxsize=1)
def warm_up() -> None:
    """Run every kernel once, on a small world: a minute or two on a machine's first use, about a second later on."""
    from trailmark.collision import StateChecker
    from trailmark.landmarks import Relaxation
    from trailmark.planning.claims import grid_separates
    from trailmark.planning.lower_bound import enclosed
    from trailmark.planning.planner import LandmarkPlanner

    world, robot, (start, goal) = SMALL
    planner = LandmarkPlanner(world, robot, seed=0, warm=False)
    planner.plan(start, goal, time_limit=600.0, max_iterations=1)
    planner.roadmap.certify_all()
    for checking in (True, False):
        planner.roadmap.way(start, goal, checking=checking)
    # Only what is hardly feasible, or not at all, asks for proofs.
    shut = StateChecker(
        World("shut", (0.0, 0.0, 3.0, 2.0), (Rectangle((1.5, 1.0), 0.6, 2.0),)), Robot.rectangle(0.6, 0.4)
    )
    ends = np.array([[0.6, 1.0, 0.0], [2.4, 1.0, 0.0]])
    enclosed(shut, *ends)
    relaxation = Relaxation(shut)
    grid_separates(relaxation, relaxation.costs_from(ends[1], until=ends[0]), *ends)


@lru_cache(maxsize=1)
def warm_up_queries() -> None:
    """Run every kernel that only :meth:`LandmarkPlanner.plan_many` needs once, as :func:`warm_up` does the others."""
    from trailmark.planning.planner import LandmarkPlanner

    world, robot, (start, goal) = SMALL
    planner = LandmarkPlanner(world, robot, seed=0, warm=False)
    planner.build(50)
    planner.plan_many([start, goal], [goal, start], time_limit=600.0)


@lru_cache(maxsize=1)
def warm_up_curves() -> None:
    """Run every kernel that only cars need once, as :func:`warm_up` does the others."""
    from trailmark.collision.curve_motions import CurveChecker
    from trailmark.planning.drives import drives_from
    from trailmark.planning.planner import LandmarkPlanner

    world, robot, (start, goal) = SMALL
    planner = LandmarkPlanner(world, robot.steered(0.4), seed=0, warm=False)
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
