"""The problems of benchmarks/ahead.py: shipped worlds, real data and random worlds, with what is known of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import zip_longest

import numpy as np

from benchmarks import suite
from benchmarks.random_worlds import L_SHAPE, random_world
from trailmark.benchmark.problems import Problem
from trailmark.benchmark.public.made_worlds import corner_ends
from trailmark.formats.movingai import read_scenarios
from trailmark.world import Query, Robot, World

__all__ = ["CLUTTER", "ROBOTS", "Case", "cases", "random_cases"]

CLUTTER = (50, 200, 500)
"""Numbers of obstacles on 100 x 100 m."""

ROBOTS = {
    "disc": Robot.disc(0.6),
    "rectangle": Robot.rectangle(2.0, 1.0),
    "thin": Robot.rectangle(4.0, 0.5),
    "L": Robot.polygon(L_SHAPE),
}
"""Robots of the random worlds (metres)."""

FIRST_WORLD = 100
"""Number of the first random world of each level: those below are the ones that the planner is developed on."""


@dataclass(frozen=True)
class Case:
    """A problem, where it belongs in the tables, and what is known of it beforehand.

    Attributes:
        group: ``worlds``, ``data`` or ``random``.
        kind: the row of the tables: a shipped world, a map, or a level of clutter with a robot.
        problem: world, robot and query.
        feasible: whether there is a path; None if nobody knows yet.
    """

    group: str
    kind: str
    problem: Problem
    feasible: bool | None

    @property
    def world(self) -> str:
        """Name of the world with its robot, for figures of each world: its queries belong together."""
        return f"{self.problem.world.name}, {self.problem.robot.describe()}"


def cases(worlds: int, data: bool) -> list[Case]:
    """Return all cases, kind by kind in turns, so that a part of them from the front has some of every kind.

    Args:
        worlds: random worlds for each level of clutter.
        data: whether to take the real data too, where it is there.
    """
    kinds: dict[str, list[Case]] = {}
    found = [*_shipped(), *(_data() if data and suite.data_folder().is_dir() else ()), *random_cases(worlds)]
    for case in {case.problem.key: case for case in found}.values():
        kinds.setdefault(case.kind, []).append(case)
    return [case for row in zip_longest(*kinds.values()) for case in row if case is not None]


def _shipped() -> Iterator[Case]:
    for found in suite.problems("worlds"):
        assert found.world.robot is not None
        if found.world.robot.turning_radius is None:
            yield _case("worlds", found.world.name, found, feasible=found.feasible)


def _data() -> Iterator[Case]:
    for found in suite.problems("omplapp"):
        yield _case("data", found.world.name, found, feasible=True)
    for found in suite.problems("nav2", 2):
        yield _case("data", found.world.name, found, feasible=True)
    for name in ("Berlin_0_256", "8room_000"):
        file = suite.data_folder() / "movingai" / f"{name}.map"
        world = World.load(file).with_robot(Robot.disc(0.4))
        order = np.argsort([row.optimal_length for row in read_scenarios(file.with_suffix(".map.scen"))], kind="stable")
        for row in (order[-1], order[len(order) // 2]):
            yield _case("data", name, suite.Problem(name, world, world.queries[row]), feasible=True)
    for found in suite.problems("circles", 3):
        yield _case("data", "circles", found, feasible=True)


def _case(group: str, kind: str, found: suite.Problem, *, feasible: bool | None) -> Case:
    return Case(group, kind, Problem(replace(found.world, queries=(found.query,))), feasible)


def random_cases(worlds: int, first: int = FIRST_WORLD) -> Iterator[Case]:
    """Yield every robot's case in every random world; a robot that finds no room for an end has none there.

    Args:
        worlds: of each level of clutter.
        first: number of the first; world and ends follow from level, number and robot alone.
    """
    for number in range(first, first + worlds):
        for obstacles in CLUTTER:
            world = random_world(1000 * obstacles + number, obstacles)
            for name, robot in ROBOTS.items():
                ends = corner_ends(replace(world, robot=robot), np.random.default_rng(number))
                if ends is not None:
                    posed = replace(world, robot=robot, queries=(Query(name, *ends),))
                    yield Case("random", f"random {obstacles}, {name}", Problem(posed), None)
