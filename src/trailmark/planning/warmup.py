"""Make the compiled kernels ready before a clock runs: compiled on the machine's first use, else loaded from cache."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from trailmark.motion import Kind
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

__all__ = ["SMALL", "warm_up", "warm_up_queries"]

SMALL = World("warm-up", (0.0, 0.0, 6.0, 4.0), (Rectangle((3.0, 1.0), 0.5, 2.0),)), np.array([[1.0, 1, 0], [5, 1, 1]])
"""A small world, and a start and a goal that no single motion joins."""

ROBOTS: dict[Kind, Robot] = {
    "translation": Robot.disc(0.25),
    "straight": Robot.rectangle(0.6, 0.4),
    "curve": Robot.rectangle(0.6, 0.4).steered(0.4),
}


def warm_up(kind: Kind = "straight") -> None:
    """Run every kernel that plans a kind of motion once: a minute or two on a machine's first use, else a second."""
    _plan_once(kind)


def warm_up_queries(kind: Kind = "straight") -> None:
    """Run every kernel that only :meth:`LandmarkPlanner.plan_many` needs once, as :func:`warm_up` does the others."""
    _plan_many_once(kind)


@lru_cache(maxsize=3)
def _plan_once(kind: Kind) -> None:
    from trailmark.collision import StateChecker
    from trailmark.landmarks import Relaxation
    from trailmark.planning.hybrid_astar import hybrid_astar
    from trailmark.planning.planner import LandmarkPlanner
    from trailmark.planning.proofs import enclosed
    from trailmark.planning.proofs.claims import grid_separates

    world, (start, goal) = SMALL
    planner = LandmarkPlanner(world, ROBOTS[kind], seed=0, warm=False)
    found = planner.plan(start, goal, time_limit=600.0, max_iterations=1)
    planner.roadmap.certify_all()
    for checking in (True, False):
        planner.roadmap.find_path(start, goal, checking=checking)
    # Only what is hardly feasible, or not at all, asks for proofs.
    shut = StateChecker(World("shut", (0.0, 0.0, 3.0, 2.0), (Rectangle((1.5, 1.0), 0.6, 2.0),)), ROBOTS["straight"])
    ends = np.array([[0.6, 1.0, 0.0], [2.4, 1.0, 0.0]])
    enclosed(shut, *ends)
    relaxation = Relaxation(shut)
    grid_separates(relaxation, relaxation.costs_from(ends[1], until=ends[0]), *ends)
    if kind == "curve":
        if found.path is not None:
            found.path.at(0.5)
        # Which queries need drives nobody knows beforehand.
        hybrid_astar(
            planner.motion,
            planner.relaxation,
            planner.relaxation.costs_from(goal),
            start[None],
            reverse=False,
            step=0.1,
            most=50,
            landmarks=5,
            rng=np.random.default_rng(0),
        )


@lru_cache(maxsize=3)
def _plan_many_once(kind: Kind) -> None:
    from trailmark.planning.planner import LandmarkPlanner

    world, (start, goal) = SMALL
    planner = LandmarkPlanner(world, ROBOTS[kind], seed=0, warm=False)
    planner.build(50)
    planner.plan_many([start, goal], [goal, start], time_limit=600.0)
