"""Many queries on one kept roadmap, beside OMPL's PRM on its own of the same size. Writes results/many.{json,md}.

In each world, 1,000 random queries (pairs of random valid configurations; those that the bound proves infeasible are
drawn anew) are answered by `plan_many` in one thread; those that it proves to have no path count no further. The best
known cost, of every 50th query, is the least that `plan` with a roadmap of its own or any answer here has found; PRM
answers every tenth query, with certified motions too, in a process of its own. Pure graph search is from node to node
on 10,000 landmarks.

    python -m benchmarks.many [--queries N] [--no-write]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.random_worlds import ROBOTS, random_world
from benchmarks.suite import data_folder
from trailmark import LandmarkPlanner
from trailmark.formats.files import write_atomically
from trailmark.landmarks import free_samples
from trailmark.library import shipped_worlds
from trailmark.roadmap.snapshot import RoadmapSnapshot
from trailmark.se2 import FloatArray
from trailmark.world import Robot, World

RESULTS = Path(__file__).resolve().parent / "results"

EVERY, EVERY_PRM = 50, 10
"""One query in so many gets a best known cost; one in so many is put to PRM."""

REFERENCE_SECONDS = 0.5
"""Seconds that `plan` has for the best known cost of a query."""

BUILD_SECONDS = 60.0
"""Seconds that the first query has, half of them for the roadmap, which is to grow as large as the world asks for."""

PRM_SECONDS = 60.0
"""Seconds after which PRM's process is ended."""

CLOSE = 0.03
"""A path this near the best known, as a share of it, counts as good."""

FIRST_LIMIT, CLOSE_LIMIT, TIMES_FASTER, SEARCH_LIMIT = 2e-3, 20e-3, 20.0, 0.25e-3
"""The targets: medians in seconds, and the ratio of medians to PRM's."""

SEARCHES, SEARCH_NODES = 1_000, 10_000


def _shipped(name: str) -> World:
    return World.load(shipped_worlds()[name])


def _depot() -> World:
    return World.load(data_folder() / "nav2" / "depot.yaml")


PROBLEMS: dict[str, tuple[Callable[[], World], Robot | None]] = {
    "office": (lambda: _shipped("office"), None),
    "warehouse": (lambda: _shipped("warehouse"), None),
    "clutter": (lambda: _shipped("clutter"), None),
    "depot, disc 0.22": (_depot, Robot.disc(0.22)),
    "depot, 0.5 x 0.3": (_depot, Robot.rectangle(0.5, 0.3)),
    "random 200, 2 x 1": (lambda: random_world(0, 200), ROBOTS["rectangle"]),
}


def feasible_queries(planner: LandmarkPlanner, n: int, seed: int = 1) -> FloatArray:
    """Return n random queries, shape (n, 2, 3), none of them proven infeasible."""
    found: list[FloatArray] = []
    rng = np.random.default_rng(seed)
    while sum(map(len, found)) < n:
        missing = n - sum(map(len, found))
        pairs = free_samples(planner.checker, 2 * missing, random_state=rng).reshape(-1, 2, 3)
        bounds = [planner.bound.of(start, goal).cost for start, goal in pairs]
        found.append(pairs[np.isfinite(bounds)])
    return np.concatenate(found)


def measure(name: str, n: int) -> dict[str, Any]:
    """Return what was measured in one world."""
    make, robot = PROBLEMS[name]
    planner = LandmarkPlanner(make(), robot, seed=0)
    queries = feasible_queries(planner, n)
    begin = perf_counter()
    planner.plan_many(queries[:1, 0], queries[:1, 1], BUILD_SECONDS)
    built = perf_counter() - begin
    nodes, edges = len(planner.roadmap), int(planner.roadmap.certified.sum())
    begin = perf_counter()
    every = planner.plan_many(queries[:, 0], queries[:, 1])
    seconds = perf_counter() - begin
    # The bound rules out fewer of those without a path than planning does.
    queries = queries[[r.status != "infeasible" for r in every]]
    results = [r for r in every if r.status != "infeasible"]
    first = np.array([r.time["first_solution"] or np.inf for r in results], dtype=np.float64)
    total = np.array([r.time["total"] for r in results], dtype=np.float64)
    gaps = [r.cost / r.lower_bound - 1.0 for r in results if r.cost and r.lower_bound]
    some = range(0, len(results), EVERY)
    best = np.array([_reference(planner, queries[i], results[i].cost) for i in some])
    good = np.array([_until(results[i].history, (1.0 + CLOSE) * b) for i, b in zip(some, best, strict=True)])
    costs = np.array([results[i].cost or np.inf for i in some])
    asked = queries[::EVERY_PRM]
    prm = _prm_apart(name, nodes, asked)
    own = first[::EVERY_PRM]
    begin = perf_counter()
    part = queries[: n // 10]
    planner.plan_many(part[:, 0], part[:, 1], workers=2)
    in_two = perf_counter() - begin
    return {
        "world": name,
        "robot": planner.robot.describe(),
        "queries": len(results),
        "nodes": nodes,
        "certified_edges": edges,
        "build_seconds": built,
        "solved": sum(r.status == "solved" for r in results),
        "infeasible": len(every) - len(results),
        "planned": len(planner.roadmap) - nodes,
        "first_median": float(np.median(first)),
        "first_95": float(np.quantile(first, 0.95)),
        "total_median": float(np.median(total)),
        "queries_per_second": n / seconds,
        "queries_per_second_two_threads": len(part) / in_two,
        "references": len(best),
        "good_median": float(np.median(good)),
        "good_share": float(np.isfinite(good).mean()),
        "cost_to_best_median": float(np.median(costs / best)),
        "cost_to_best_90": float(np.quantile(costs / best, 0.9)),
        "gap_median": float(np.median(gaps)),
        "prm": prm,
        "times_faster": None if prm is None else prm["median"] / float(np.median(own)),
    }


def _reference(planner: LandmarkPlanner, query: FloatArray, cost: float | None) -> float:
    """Return the best known cost of a query (metres)."""
    alone = LandmarkPlanner(planner.world, planner.robot, seed=1, checker=planner.checker)
    found = alone.plan(query[0], query[1], time_limit=REFERENCE_SECONDS).cost
    return min(np.inf if c is None else c for c in (cost, found))


def _until(history: tuple[tuple[float, float], ...], cost: float) -> float:
    """Return when (seconds) a path of at most that cost was there."""
    return next((seconds for seconds, c in history if c <= cost), np.inf)


def _prm_apart(name: str, nodes: int, queries: FloatArray) -> dict[str, Any] | None:
    """Return what PRM takes for the queries, measured in a process of its own; None if it is not done in time."""
    request = json.dumps({"nodes": nodes, "queries": queries.tolist()})
    command = [sys.executable, "-m", "benchmarks.many", "--prm", name]
    try:
        done = subprocess.run(command, input=request, capture_output=True, text=True, check=True, timeout=PRM_SECONDS)
    except (subprocess.TimeoutExpired, subprocess.CalledProcessError) as error:
        print(f"{name}: PRM: {error}", file=sys.stderr)
        return None
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def prm(name: str, nodes: int, queries: FloatArray) -> dict[str, Any]:
    """Grow a PRM to so many nodes and put the queries to it, shape (m, 2, 3)."""
    from ompl import base as ob
    from ompl import geometric as og
    from ompl import util as ou

    from trailmark.ompl_bridge import SE2Problem
    from trailmark.ompl_bridge.guard import planning
    from trailmark.ompl_bridge.states import state

    ou.setLogLevel(ou.LOG_NONE)
    make, robot = PROBLEMS[name]
    problem = SE2Problem(make(), robot, (queries[0, 0], queries[0, 1]))
    planner = problem.set_planner(og.PRM(problem.information))
    problem.setup.setup()
    begin = perf_counter()
    with planning():
        # In short turns: growing goes by time, not by number.
        while planner.milestoneCount() < nodes:
            planner.growRoadmap(0.01)
    grown, size = perf_counter() - begin, planner.milestoneCount()
    seconds, costs = [], []
    for start, goal in queries:
        ends = [state(problem.information, q) for q in (start, goal)]
        planner.clearQuery()
        problem.setup.getProblemDefinition().clearSolutionPaths()
        begin = perf_counter()
        problem.setup.setStartAndGoalStates(*ends)
        condition = ob.timedPlannerTerminationCondition(1.0)
        with planning(condition):
            planner.solve(condition)
        seconds.append(perf_counter() - begin)
        costs.append(problem.path.cost if problem.path is not None else None)
    return {
        "nodes": size,
        "grown_seconds": grown,
        "queries": len(queries),
        "solved": sum(cost is not None for cost in costs),
        "median": float(np.median(seconds)),
        "q95": float(np.quantile(seconds, 0.95)),
        "nodes_after": planner.milestoneCount(),
    }


def search() -> dict[str, Any]:
    """Measure pure graph search, from node to node."""
    planner = LandmarkPlanner(random_world(0, 200), ROBOTS["rectangle"], seed=0)
    graph = RoadmapSnapshot(planner.build(SEARCH_NODES))
    rng = np.random.default_rng(2)
    # Landmarks are snapped to samples: a few fall on the same one.
    ends: NDArray[np.int64] = rng.integers(0, len(graph), (SEARCHES, 2))
    seconds, found = [], 0
    for start, goal in ends.tolist():
        begin = perf_counter()
        states = graph.between(start, goal)
        seconds.append(perf_counter() - begin)
        found += states is not None
    return {
        "nodes": len(graph),
        "links": len(graph.links.node) // 2,
        "certified_edges": int(planner.roadmap.certified.sum()),
        "searches": SEARCHES,
        "found": found,
        "median": float(np.median(seconds)),
        "q95": float(np.quantile(seconds, 0.95)),
    }


def tables(record: dict[str, Any]) -> str:
    """Return the tables as Markdown."""

    def ms(seconds: float) -> str:
        return f"{1e3 * seconds:.2f}" if np.isfinite(seconds) else "-"

    answers, beside = [], []
    for row in record["worlds"]:
        answers.append(
            [
                row["world"],
                f"{row['nodes']:,}",
                f"{row['build_seconds']:.1f}",
                f"{row['solved']} of {row['queries']}",
                ms(row["first_median"]),
                ms(row["first_95"]),
                ms(row["good_median"]),
                f"{100 * row['good_share']:.0f} %",
                f"{row['cost_to_best_median']:.3f}",
                f"{row['cost_to_best_90']:.3f}",
                f"{100 * row['gap_median']:.1f} %",
                f"{row['queries_per_second']:.0f}",
                f"{row['queries_per_second_two_threads']:.0f}",
            ]
        )
        other = row["prm"]
        if other is not None:
            beside.append(
                [
                    row["world"],
                    f"{other['nodes']:,}",
                    f"{other['solved']} of {other['queries']}",
                    ms(other["median"]),
                    ms(other["q95"]),
                    ms(row["first_median"]),
                    f"{row['times_faster']:.0f}",
                ]
            )
    header = ["world", "nodes", "build s", "solved", "first ms", "95 % ms", "within 3 % ms", "within 3 %"]
    header += ["cost / best", "90 %", "gap", "queries/s", "two threads"]
    second = ["world", "PRM's nodes", "solved", "PRM ms", "95 % ms", "first path ms", "times faster"]
    return f"{markdown_table(header, answers)}\n\n{markdown_table(second, beside)}"


def verdicts(record: dict[str, Any]) -> list[tuple[str, bool, str]]:
    """Return each target, whether it is reached, and the figure."""
    rows, pure = record["worlds"], record["search"]
    faster = [row["times_faster"] for row in rows if row["times_faster"] is not None]
    worst = {key: max(row[key] for row in rows) for key in ("first_median", "good_median")}
    unsolved = sum(row["queries"] - row["solved"] for row in rows)
    return [
        ("all queries solved", unsolved == 0, f"{unsolved} not"),
        (
            "median below 2 ms to the first path",
            worst["first_median"] < FIRST_LIMIT,
            f"{1e3 * worst['first_median']:.2f} ms in the slowest world",
        ),
        (
            "median below 20 ms to a path within 3 % of the best known",
            worst["good_median"] < CLOSE_LIMIT,
            f"{1e3 * worst['good_median']:.2f} ms in the slowest world",
        ),
        (
            "20 times faster than PRM's query",
            len(faster) == len(rows) and min(faster) >= TIMES_FASTER,
            ", ".join(f"{f:.0f}" for f in faster),
        ),
        (
            "pure graph search on 10,000 nodes below 0.25 ms",
            pure["median"] < SEARCH_LIMIT,
            f"{1e3 * pure['median']:.3f} ms median, {1e3 * pure['q95']:.3f} ms at 95 %",
        ),
    ]


def text(record: dict[str, Any]) -> str:
    """Return the whole report as Markdown."""
    pure = record["search"]
    lines = [
        f"- {'reached' if ok else '**not reached**'}: {target} ({figure})." for target, ok, figure in verdicts(record)
    ]
    return "\n".join(
        [
            "# Many queries on one roadmap",
            "",
            f"Written by `python -m benchmarks.many`: {record['machine']}.",
            "",
            *lines,
            "",
            tables(record),
            "",
            "`first`: from the call to a certified path over the roadmap. `within 3 %`: to a path at most 3 % above",
            f"the best known, over the {record['worlds'][0]['references']} queries of each world that have one; a",
            "query that does not get there counts as never. `gap`: to the proven lower bound. `build`: choosing the",
            "roadmap's size, building it, making it ready. `two threads`: queries a second with `workers=2`. PRM is",
            "OMPL's, from Python, with the same certified motions, grown to the same number of nodes; its time is that",
            "of `solve()`, which like `first` ends with a path that is not shortened yet.",
            "",
            f"Pure graph search: {pure['searches']:,} searches from node to node, {pure['nodes']:,} nodes,",
            f"{pure['links']:,} links kept of {pure['certified_edges']:,} certified edges.",
        ]
    )


def main() -> int:
    """Measure, print and write; the exit status is 1 if a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--queries", type=int, default=1000, metavar="N", help="for each world, a multiple of 50")
    parser.add_argument("--no-write", action="store_true", help="print only")
    parser.add_argument("--prm", metavar="WORLD", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.prm is not None:
        request = json.load(sys.stdin)
        print(json.dumps(prm(options.prm, request["nodes"], np.array(request["queries"]))))
        return 0
    record: dict[str, Any] = {"machine": describe_machine(), "search": search(), "worlds": []}
    for name in PROBLEMS:
        begin = perf_counter()
        record["worlds"].append(measure(name, options.queries))
        print(f"{name}: {perf_counter() - begin:.0f} s", file=sys.stderr)
    report = text(record)
    print(report)
    if not options.no_write:
        RESULTS.mkdir(exist_ok=True)
        write_atomically(RESULTS / "many.json", json.dumps(record, indent=1) + "\n")
        write_atomically(RESULTS / "many.md", report + "\n")
    return 0 if all(ok for _, ok, _ in verdicts(record)) else 1


if __name__ == "__main__":
    sys.exit(main())
