"""The problems that the benchmarks are run on: shipped worlds, real data where it is there, random worlds, cars."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path

import numpy as np
from tests.helpers.worlds import L_SHAPE, ROBOTS, random_world

from trailmark.benchmark.problems import Problem
from trailmark.benchmark.public.graded import corner_ends, passage_world
from trailmark.collision import StateChecker
from trailmark.formats.movingai import read_scenarios
from trailmark.landmarks import Relaxation, free_samples
from trailmark.shapes import Disc
from trailmark.world import Query, Robot, World
from trailmark.world.library import find_world, shipped_worlds

__all__ = ["Case", "ablation_cases", "cars", "cases", "data_folder", "random_cases"]

CLUTTER = (50, 200, 500)
"""Numbers of obstacles on 100 x 100 m."""

CLUTTER_ROBOTS = {
    "disc": Robot.disc(0.6),
    "rectangle": Robot.rectangle(2.0, 1.0),
    "thin": Robot.rectangle(4.0, 0.5),
    "L": Robot.polygon(L_SHAPE),
}
"""Robots of the random worlds (metres)."""

FIRST_WORLD = 100
"""Number of the first random world of each level: those below are the ones that the planner is developed on."""

CARS = (
    ("parking", "parallel", 4.5, True),
    ("parking", "bay", 4.5, True),
    ("parking", "leave", 4.5, True),
    ("parking", "swap", 4.5, True),
    ("office", "door", 0.6, True),
    ("office", "door", 0.6, False),
    ("warehouse", "dock", 1.8, True),
    ("warehouse", "dock", 1.8, False),
)
"""World, query, turning radius (metres), and whether the car reverses."""

CAR_RADIUS = 3.0
"""Turning radius of the cars in random worlds, metres."""


@dataclass(frozen=True)
class Case:
    """A problem, where it belongs in the tables, and what is known of it beforehand.

    Attributes:
        group: ``shipped``, ``data``, ``random``, ``mixed``, ``passages`` or ``cars``.
        kind: a shipped world, a map, or a level of clutter with a robot.
        problem: world, robot and query.
        feasible: whether there is a path; None if nobody knows yet.
    """

    group: str
    kind: str
    problem: Problem
    feasible: bool | None


def data_folder() -> Path:
    """Return the folder of real data: TRAILMARK_DATA, else ../shared/data beside the project."""
    here = Path(__file__).resolve().parents[2]
    return Path(os.environ.get("TRAILMARK_DATA", here / "shared" / "data"))


def cases(worlds: int) -> list[Case]:
    """Return shipped, real and random problems, kind by kind in turns: a part from the front has some of every kind.

    Args:
        worlds: random worlds for each level of clutter.
    """
    kinds: dict[str, list[Case]] = {}
    found = [*_shipped(), *(_data() if data_folder().is_dir() else ()), *random_cases(worlds)]
    for case in {case.problem.key: case for case in found}.values():
        kinds.setdefault(case.kind, []).append(case)
    return [case for row in zip_longest(*kinds.values()) for case in row if case is not None]


def _case(group: str, kind: str, world: World, query: Query, *, feasible: bool | None = True) -> Case:
    return Case(group, kind, Problem(replace(world, queries=(query,))), feasible)


def _shipped() -> Iterator[Case]:
    for file in shipped_worlds().values():
        world = World.load(file)
        if world.robot is not None and world.robot.turning_radius is None:
            for query in world.queries:
                yield _case("shipped", world.name, world, query, feasible=not query.name.startswith("infeasible"))


def _data() -> Iterator[Case]:
    for name in ("Maze", "RandomPolygons"):
        world = World.load(data_folder() / "omplapp" / f"{name}_planar.cfg")
        yield _case("data", world.name, world, world.query())
    for name in ("depot", "tb3_sandbox"):
        world = World.load(data_folder() / "nav2" / f"{name}.yaml")
        for robot in (Robot.disc(0.22), Robot.rectangle(0.5, 0.3)):
            for query in _joinable(world.with_robot(robot), 2):
                yield _case("data", name, world.with_robot(robot), query)
    for name in ("Berlin_0_256", "8room_000"):
        file = data_folder() / "movingai" / f"{name}.map"
        world = World.load(file).with_robot(Robot.disc(0.4))
        order = np.argsort([row.optimal_length for row in read_scenarios(file.with_suffix(".map.scen"))], kind="stable")
        for row in (order[-1], order[len(order) // 2]):
            yield _case("data", name, world, world.queries[row])
    world = circles()
    for query in world.queries[:3]:
        yield _case("data", "circles", world, query)


def _joinable(world: World, count: int) -> Iterator[Query]:
    """Yield pairs of random places that a disc around the robot can join."""
    assert world.robot is not None
    rng = np.random.default_rng(1)
    around = StateChecker(world, Robot.disc(world.robot.circumradius))
    q = free_samples(around, 500, random_state=0)
    relaxation = Relaxation(around)
    costs = relaxation.costs_from(q[0])
    q = q[np.isfinite(costs.cost.ravel()[relaxation.cells(q[:, :2])])]
    for i in range(count):
        a, b = q[rng.choice(len(q), 2, replace=False)]
        a[2], b[2] = rng.uniform(-np.pi, np.pi, 2)
        yield Query(f"pair-{i}", tuple(a.tolist()), tuple(b.tolist()))


def circles() -> World:
    """Return OMPL's world of 70 circles with its 100 queries, for a small disc."""
    folder = data_folder() / "circles"
    rows = [line.split() for line in (folder / "circle_obstacles.txt").read_text().splitlines()]
    discs = [Disc((float(r[1]), float(r[2])), float(r[3])) for r in rows if len(r) == 4]
    ends: dict[str, dict[str, tuple[float, float]]] = {}
    for line in (folder / "circle_queries.txt").read_text().splitlines():
        number, end, x, y = line.split()
        ends.setdefault(number, {})[end.rstrip(":")] = (float(x), float(y))
    queries = [Query(n, (*e["start"], 0.0), (*e["goal"], 0.0)) for n, e in ends.items()]
    boxes = [disc.bounding_box() for disc in discs] + [(*e[:2], *e[:2]) for q in queries for e in (q.start, q.pose())]
    low, high = np.min(boxes, axis=0)[:2], np.max(boxes, axis=0)[2:]
    robot = Robot.disc(0.01)
    # The robot's centre may reach the outermost ends.
    xmin, ymin, xmax, ymax = (float(v) for v in (*(low - 0.01), *(high + 0.01)))
    return World("circles", (xmin, ymin, xmax, ymax), tuple(discs), robot, None, tuple(queries))


def random_cases(worlds: int, first: int = FIRST_WORLD) -> Iterator[Case]:
    """Yield every robot's case in every random world; a robot that finds no room for an end has none there.

    Args:
        worlds: of each level of clutter.
        first: number of the first; world and ends follow from level, number and robot alone.
    """
    for number in range(first, first + worlds):
        for obstacles in CLUTTER:
            world = random_world(1000 * obstacles + number, obstacles)
            for name, robot in CLUTTER_ROBOTS.items():
                ends = corner_ends(replace(world, robot=robot), np.random.default_rng(number))
                if ends is not None:
                    posed, query = replace(world, robot=robot), Query(name, *ends)
                    yield _case("random", f"random {obstacles}, {name}", posed, query, feasible=None)


def cars() -> Iterator[Case]:
    """Yield the problems of cars in shipped worlds."""
    for name, query, radius, reverse in CARS:
        world = World.load(find_world(name))
        assert world.robot is not None
        steered = world.with_robot(world.robot.steered(radius, reverse))
        yield _case(
            "cars", f"{name}/{query}, {radius:g} m{'' if reverse else ', forward only'}", steered, world.query(query)
        )


def ablation_cases() -> list[Case]:
    """Return one problem of every kind, passages, mixed worlds and cars, group by group in turns."""
    chosen: dict[str, Case] = {}
    for case in cases(1):
        # The queries of worlds without a way tell what proofs are good for.
        chosen.setdefault(case.kind if case.feasible is not False else case.problem.key, case)
    dense = [case for case in random_cases(3, FIRST_WORLD + 1) if case.kind.startswith("random 500")]
    passages = [Case("passages", "passages", Problem(passage_world(seed)), feasible=True) for seed in range(8)]
    steered = [
        _case(
            "cars",
            "cars",
            replace(case.problem.world, robot=case.problem.robot.steered(CAR_RADIUS)),
            case.problem.query,
        )
        for case in random_cases(1)
        if case.problem.robot == CLUTTER_ROBOTS["rectangle"]
    ]
    groups = [list(chosen.values()), dense, passages, list(_mixed()), [*cars(), *steered]]
    # Spread evenly, so that a part of them from the front has some of every group.
    places = [(i + 0.5) / len(group) for group in groups for i in range(len(group))]
    given = [case for group in groups for case in group]
    return [given[i] for i in np.argsort(places, kind="stable")]


def _mixed() -> Iterator[Case]:
    """Yield problems among discs and polygons with holes inside a curved boundary, ends as far apart as there are."""
    for seed, name in enumerate(("disc", "rectangle", "L", "thin", "star", "offset")):
        robot: Robot = ROBOTS[name]
        world = random_world(seed, 250, discs=0.3, holes=0.2, boundary=True)
        q = free_samples(StateChecker(world, robot), 200, random_state=seed)
        apart = np.hypot(*(q[:, None, :2] - q[None, :, :2]).transpose(2, 0, 1))
        a, b = (tuple(q[i].tolist()) for i in np.unravel_index(np.argmax(apart), apart.shape))
        yield _case("mixed", "mixed", replace(world, robot=robot), Query(name, a, b), feasible=None)
