"""The problems that the benchmarks are run on: shipped worlds and, where it is there, the real data."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from trailmark.collision import StateChecker
from trailmark.landmarks import Relaxation
from trailmark.library import shipped_worlds
from trailmark.shapes import Disc
from trailmark.world import Query, Robot, World

__all__ = ["GROUPS", "Problem", "data_folder", "problems"]


@dataclass(frozen=True)
class Problem:
    """One query in one world for one robot.

    Attributes:
        group: where it comes from.
        world: obstacles and bounds; its robot is the one to plan for.
        query: start and goal.
        feasible: whether a path exists.
        optimum: the published optimal cost on the grid (metres), where there is one.
    """

    group: str
    world: World
    query: Query
    feasible: bool = True
    optimum: float | None = None


def data_folder() -> Path:
    """Return the folder of real data: TRAILMARK_DATA, else ../shared/data beside the project."""
    here = Path(__file__).resolve().parents[2]
    return Path(os.environ.get("TRAILMARK_DATA", here / "shared" / "data"))


def problems(group: str, limit: int | None = None) -> Iterator[Problem]:
    """Yield the problems of a group.

    Args:
        group: one of GROUPS.
        limit: at most so many of each scenario file or map, spread over it.
    """
    yield from GROUPS[group](limit)


def _shipped(limit: int | None) -> Iterator[Problem]:
    for file in shipped_worlds().values():
        world = World.load(file)
        for query in world.queries[:limit]:
            yield Problem("worlds", world, query, feasible=not query.name.startswith("infeasible"))


def _omplapp(limit: int | None) -> Iterator[Problem]:
    for name in ("Maze", "RandomPolygons"):
        world = World.load(data_folder() / "omplapp" / f"{name}_planar.cfg")
        yield Problem("omplapp", world, world.query())


def _nav2(limit: int | None) -> Iterator[Problem]:
    """Ends that a disc around the robot can join: nodes of depot's route graph, random places in tb3_sandbox."""
    depot = World.load(data_folder() / "nav2" / "depot.yaml")
    graph = json.loads((data_folder() / "nav2" / "depot_graph.geojson").read_text())
    nodes = [f["geometry"]["coordinates"] for f in graph["features"] if f["geometry"]["type"] == "Point"]
    sandbox = World.load(data_folder() / "nav2" / "tb3_sandbox.yaml")
    rng = np.random.default_rng(0)
    xmin, ymin, xmax, ymax = sandbox.bounds
    places = rng.uniform((xmin, ymin), (xmax, ymax), (4000, 2)).tolist()
    for world, points in ((depot, nodes), (sandbox, places)):
        for robot in (Robot.disc(0.22), Robot.rectangle(0.5, 0.3)):
            yield from _joinable(world.with_robot(robot), np.array(points), limit or 10)


def _joinable(world: World, points: np.ndarray, count: int) -> Iterator[Problem]:
    assert world.robot is not None
    rng = np.random.default_rng(1)
    around = StateChecker(world, Robot.disc(world.robot.circumradius))
    q = np.column_stack([points, np.zeros(len(points))])
    q = q[around.valid(q)]
    relaxation = Relaxation(around)
    # Cells whose centres are free for the disc around the robot, joined from one place to the next.
    start = q[0]
    costs = relaxation.costs_from(start)
    q = q[np.isfinite(costs.cost.ravel()[relaxation.cells(q[:, :2])])]
    for i in range(count):
        a, b = q[rng.choice(len(q), 2, replace=False)]
        a[2], b[2] = rng.uniform(-np.pi, np.pi, 2)
        yield Problem("nav2", world, Query(f"pair-{i}", tuple(a), tuple(b)))


def _circles(limit: int | None) -> Iterator[Problem]:
    folder = data_folder() / "circles"
    rows = [line.split() for line in (folder / "circle_obstacles.txt").read_text().splitlines()]
    discs = [Disc((float(r[1]), float(r[2])), float(r[3])) for r in rows if len(r) == 4]
    ends: dict[str, dict[str, tuple[float, float]]] = {}
    for line in (folder / "circle_queries.txt").read_text().splitlines():
        number, end, x, y = line.split()
        ends.setdefault(number, {})[end.rstrip(":")] = (float(x), float(y))
    queries = [Query(n, (*e["start"], 0.0), (*e["goal"], 0.0)) for n, e in ends.items()]
    boxes = [disc.bounding_box() for disc in discs] + [(*q.start[:2], *q.start[:2]) for q in queries]
    boxes += [(*q.goal[:2], *q.goal[:2]) for q in queries]
    low, high = np.min(boxes, axis=0)[:2], np.max(boxes, axis=0)[2:]
    robot = Robot.disc(0.01)
    # The robot's centre may reach the outermost ends.
    bounds = (*(low - 0.01), *(high + 0.01))
    world = World("circles", tuple(float(v) for v in bounds), tuple(discs), robot, None, tuple(queries))  # type: ignore[arg-type]  # four floats
    for query in queries[:limit]:
        yield Problem("circles", world, query)


def _movingai(name: str, limit: int | None) -> Iterator[Problem]:
    from trailmark.formats.movingai import read_scenarios

    file = data_folder() / "movingai" / f"{name}.map"
    world = World.load(file).with_robot(Robot.disc(0.4))
    rows = read_scenarios(file.with_suffix(".map.scen"))
    longest = int(np.argmax([row.optimal_length for row in rows]))
    chosen = np.unique([*np.linspace(0, len(rows) - 1, limit or 200).astype(int), longest])
    for i in chosen[-(limit or 200) :]:
        yield Problem(name, world, world.queries[i], optimum=rows[i].optimal_length)


GROUPS: dict[str, Callable[[int | None], Iterator[Problem]]] = {
    "worlds": _shipped,
    "omplapp": _omplapp,
    "nav2": _nav2,
    "circles": _circles,
    "Berlin_0_256": partial(_movingai, "Berlin_0_256"),
    "8room_000": partial(_movingai, "8room_000"),
}
"""Group names and where their problems come from."""
