"""Roadmaps of k nodes for benchmarks/kmeans.py, all asked in the same way: ends joined to their nearest nodes."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from benchmarks.placements import CENTRES, PLACEMENTS, UNIFORM
from trailmark import se2
from trailmark.benchmark.problems import Problem, read_problem
from trailmark.collision import StateChecker
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray

__all__ = ["COUNTS", "PLACED", "PlainRoadmap", "feasible", "placed_roadmap", "prm_roadmaps"]

COUNTS = (50, 100, 200, 400, 800)
"""Landmarks, or milestones."""

NEAREST = 10
"""Nodes that a query's end is joined to, as OMPL's PRM does by default."""

PRM_SECONDS = 120.0
"""Seconds after which a PRM's process is ended."""

PLACED = {name: PLACEMENTS[name] for name in (CENTRES, UNIFORM)}


class PlainRoadmap(NamedTuple):
    """Nodes and certified motions between them.

    Attributes:
        k: nodes that were asked for.
        nodes: shape (n, 3).
        edges: pairs of nodes, shape (m, 2).
        seconds: to build it.
    """

    k: int
    nodes: FloatArray
    edges: NDArray[np.int64]
    seconds: float

    def costs(self, checker: StateChecker, queries: FloatArray) -> FloatArray:
        """Return the cost (metres) of each query's shortest path, infinite without one; queries (m, 2, 3)."""
        ends = queries.reshape(-1, 3)
        apart = se2.distance(ends[:, None], self.nodes[None])
        near = np.argsort(apart, axis=1, kind="stable")[:, :NEAREST]
        at = np.repeat(np.arange(len(ends)), near.shape[1])
        free = checker.motions_between_valid(ends[at], self.nodes[near.ravel()]).reshape(near.shape)
        joined = np.where(free, np.take_along_axis(apart, near, axis=1), np.inf)
        lengths = se2.distance(self.nodes[self.edges[:, 0]], self.nodes[self.edges[:, 1]])
        n = len(self.nodes)
        between = dijkstra(coo_array((lengths, self.edges.T), shape=(n, n)).tocsr(), directed=False)
        start, goal = near[0::2], near[1::2]
        through = joined[0::2, :, None] + between[start[:, :, None], goal[:, None, :]] + joined[1::2, None, :]
        direct = checker.motions_between_valid(np.ascontiguousarray(ends[0::2]), np.ascontiguousarray(ends[1::2]))
        straight = np.where(direct, se2.distance(ends[0::2], ends[1::2]), np.inf)
        return np.asarray(np.minimum(straight, through.reshape(len(start), -1).min(axis=1)))


def feasible(checker: StateChecker, queries: FloatArray, best: FloatArray) -> NDArray[np.bool_]:
    """Return the queries that some roadmap answers and that are no straight motion."""
    starts, goals = np.ascontiguousarray(queries[:, 0]), np.ascontiguousarray(queries[:, 1])
    return np.asarray(np.isfinite(best) & ~checker.motions_between_valid(starts, goals))


def placed_roadmap(checker: StateChecker, place: object, k: int, seed: int) -> PlainRoadmap:
    """Return trailmark's roadmap of k nodes placed in one way (a function of ``benchmarks.placements``)."""
    assert callable(place)
    begin = perf_counter()
    roadmap = Roadmap(checker)
    roadmap.add(place(checker, k, np.random.default_rng(seed)))
    roadmap.certify_all()
    seconds = perf_counter() - begin
    edges = roadmap.edges[roadmap.certified].astype(np.int64)
    return PlainRoadmap(k, np.array(roadmap.configurations), edges, seconds)


def prm_roadmaps(problem: Problem, name: str, seed: int) -> Iterator[PlainRoadmap]:
    """Yield a PRM's or PRM*'s roadmap as it has grown to each of COUNTS, in a process of its own."""
    request = json.dumps({"text": problem.text, "planner": name, "seed": seed})
    command = [sys.executable, "-m", "benchmarks.kmeans_roadmaps"]
    try:
        done = subprocess.run(command, input=request, capture_output=True, text=True, check=True, timeout=PRM_SECONDS)
    except (subprocess.TimeoutExpired, subprocess.CalledProcessError) as error:
        print(f"{problem.name}: {name}: {error}", file=sys.stderr)
        return
    for k, nodes, edges, seconds in json.loads(done.stdout.splitlines()[-1]):
        yield PlainRoadmap(k, np.array(nodes).reshape(-1, 3), np.array(edges, dtype=np.int64).reshape(-1, 2), seconds)


def _grow() -> None:
    """Grow the roadmap that standard input asks for, with certified motions, and print it at each of COUNTS."""
    from trailmark.ompl_bridge import SE2Problem
    from trailmark.ompl_bridge.guard import planning
    from trailmark.ompl_bridge.measured import seed_ompl, silence_ompl
    from trailmark.ompl_bridge.states import planner_data_graph

    request = json.load(sys.stdin)
    silence_ompl()
    seed_ompl(request["seed"])
    posed = read_problem(request["text"])
    problem = SE2Problem(posed.world, posed.robot, (posed.query.start, posed.query.pose()))
    planner = problem.set_planner(request["planner"])
    problem.setup.setup()
    answer, spent = [], 0.0
    for k in COUNTS:
        while planner.milestoneCount() < k:
            begin = perf_counter()
            with planning():
                # In short turns: growing goes by time, not by number. So it has a few milestones more than k.
                planner.growRoadmap(0.0005)
            spent += perf_counter() - begin
        graph = planner_data_graph(planner)
        nodes = [graph.nodes[i]["configuration"] for i in range(len(graph))]
        answer.append((k, nodes, list(graph.edges), spent))
    print(json.dumps(answer))


if __name__ == "__main__":
    _grow()
