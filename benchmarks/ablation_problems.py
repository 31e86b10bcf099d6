"""The problems of benchmarks/ablation.py: one of every kind of benchmarks/ahead.py, generated worlds, and cars."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.ahead_problems import FIRST_WORLD, Case, cases, random_cases
from benchmarks.car import PROBLEMS as CARS
from benchmarks.random_worlds import ROBOTS, random_world
from trailmark.benchmark.problems import Problem
from trailmark.benchmark.public.made_worlds import passage_world
from trailmark.collision import StateChecker
from trailmark.landmarks import free_samples
from trailmark.world import Query, Robot

__all__ = ["ablation_cases"]

PASSAGES = 8
"""Worlds of narrow passages."""

MIXED, OBSTACLES = ("disc", "rectangle", "L", "thin", "star", "offset"), 250
"""Robots of the worlds of discs, holes and a curved boundary, one each, and how many obstacles those have."""

RADIUS = 3.0
"""Turning radius of the cars in random worlds, metres."""

DENSE = 3
"""Random worlds of the highest clutter, beyond the first, in which first paths are hardest."""


def ablation_cases() -> list[Case]:
    """Return all cases, group by group in turns."""
    chosen: dict[str, Case] = {}
    for case in cases(1, data=True):
        # The queries of worlds without a way tell what proofs are good for.
        chosen.setdefault(case.kind if case.feasible is not False else case.problem.key, case)
    dense = [case for case in random_cases(DENSE, FIRST_WORLD + 1) if case.kind.startswith("random 500")]
    groups = [list(chosen.values()), dense, list(_passages()), list(_mixed()), list(_cars())]
    total = sum(map(len, groups))
    # Spread evenly, so that a part of them from the front has some of every group.
    places = [(i + 0.5) / len(group) for group in groups for i in range(len(group))]
    given = [case for group in groups for case in group]
    return [given[i] for i in np.argsort(places, kind="stable")[:total]]


def _passages() -> Iterator[Case]:
    for seed in range(PASSAGES):
        yield Case("passages", "passages", Problem(passage_world(seed)), feasible=True)


def _mixed() -> Iterator[Case]:
    for seed, name in enumerate(MIXED):
        robot: Robot = ROBOTS[name]
        world = random_world(seed, OBSTACLES, discs=0.3, holes=0.2, boundary=True)
        q = free_samples(StateChecker(world, robot), 200, random_state=seed)
        # The two that lie farthest apart.
        apart = np.hypot(*(q[:, None, :2] - q[None, :, :2]).transpose(2, 0, 1))
        a, b = np.unravel_index(np.argmax(apart), apart.shape)
        query = Query(name, *(tuple(float(v) for v in q[i]) for i in (a, b)))  # type: ignore[arg-type]  # three floats
        yield Case("mixed", "mixed", Problem(replace(world, robot=robot, queries=(query,))), feasible=None)


def _cars() -> Iterator[Case]:
    for problem in CARS:
        world = problem.load()
        yield Case("cars", "cars", Problem(replace(world, queries=(world.query(problem.query),))), feasible=True)
    for case in random_cases(1):
        world, robot = case.problem.world, case.problem.robot
        if robot == ROBOTS["rectangle"]:
            steered = replace(world, robot=robot.steered(RADIUS))
            yield Case("cars", "cars", Problem(steered), feasible=None)
