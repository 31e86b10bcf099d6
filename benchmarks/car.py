"""Car-like robots: the landmark planner beside OMPL's planners on the same curves. Writes results/car.{json,md}.

All plan on Reeds-Shepp curves (or Dubins curves, for cars that drive forwards only) with the same checker and the same
certified motions; OMPL's run in processes of their own with a time limit. RRTConnect's path is simplified by OMPL for
what is left of the time; RRT* goes on until the time is up, the landmark planner until its path settles or the time is
up.
A run counts as solved only if the path passes a referee that shares no code with the planners (benchmarks/oracle.py:
shapely, a configuration every centimetre of the curves).

    python -m benchmarks.car [--seeds 10] [--time-limit 3] [--problem parking/bay ...] [--no-write]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.oracle import Oracle
from trailmark.collision import StateChecker
from trailmark.curves import CurvePath, Steering
from trailmark.formats.files import write_atomically
from trailmark.library import find_world
from trailmark.planning import LandmarkPlanner
from trailmark.world import World

RESULTS = Path(__file__).resolve().parent / "results"

OMPL = ("RRTConnect", "RRTstar")
SPARE = 60.0
"""Seconds that a process gets beyond what its runs may take."""


class Problem(NamedTuple):
    """A query of a shipped world, for that world's robot as a car; radius in metres."""

    world: str
    query: str
    radius: float
    reverse: bool = True

    @property
    def name(self) -> str:
        """What the table calls it."""
        return f"{self.world}/{self.query}, {self.radius:g} m" + ("" if self.reverse else ", forward only")

    def load(self) -> World:
        """Return the world with the car in it."""
        world = World.load(find_world(self.world))
        assert world.robot is not None
        return world.with_robot(world.robot.steered(self.radius, self.reverse))


PROBLEMS = (
    Problem("parking", "parallel", 4.5),
    Problem("parking", "bay", 4.5),
    Problem("parking", "leave", 4.5),
    Problem("parking", "swap", 4.5),
    Problem("office", "door", 0.6),
    Problem("office", "door", 0.6, reverse=False),
    Problem("warehouse", "dock", 1.8),
    Problem("warehouse", "dock", 1.8, reverse=False),
)


def by_landmarks(
    problem: Problem, seeds: Sequence[int], limit: float, objective: str | None = "length"
) -> list[dict[str, Any]]:
    """Return the runs of the landmark planner, each with a planner of its own; by length, as OMPL's plan."""
    world = problem.load()
    query = world.query(problem.query)
    checker = StateChecker(world)
    runs = []
    for seed in seeds:
        planner = LandmarkPlanner(world, checker=checker, seed=seed, objective=objective)
        result = planner.plan(query.start, query.goal, time_limit=limit)
        knots = result.path.knots.tolist() if isinstance(result.path, CurvePath) else []
        runs.append(
            {"seed": seed, "first": result.time["first_solution"], "total": result.time["total"], "knots": knots}
        )
    return runs


def by_ompl(problem: Problem, planner: str, seeds: Sequence[int], limit: float) -> list[dict[str, Any]]:
    """Return the runs of one of OMPL's planners, in this process; its random numbers go on from run to run."""
    from ompl import util as ou

    from trailmark.ompl_bridge import SE2Problem, state

    ou.setLogLevel(ou.LOG_ERROR)
    ou.RNG.setSeed(seeds[0] + 1)
    world = problem.load()
    checker = StateChecker(world)
    runs = []
    for seed in seeds:
        made = SE2Problem(world, query=problem.query, checker=checker)
        made.set_planner(planner)
        here = state(made.information, made.start)
        made.information.checkMotion(here, here)
        begin = perf_counter()
        made.solve(limit)
        first = perf_counter() - begin
        if planner == "RRTConnect" and made.path is not None and first < limit:
            made.setup.simplifySolution(limit - first)
        knots = made.path.knots.tolist() if isinstance(made.path, CurvePath) else []
        timed = first if planner == "RRTConnect" and knots else None
        runs.append({"seed": seed, "first": timed, "total": perf_counter() - begin, "knots": knots})
    return runs


def in_process(problem: Problem, planner: str, seeds: Sequence[int], limit: float) -> list[dict[str, Any]]:
    """Return the runs of one of OMPL's planners in a process of its own; none of them solved if it fails."""
    job = json.dumps([problem, planner, list(seeds), limit])
    nothing: list[dict[str, Any]] = [{"seed": seed, "first": None, "total": limit, "knots": []} for seed in seeds]
    try:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.car", "--child", job],
            capture_output=True,
            text=True,
            timeout=SPARE + 2.0 * limit * len(seeds),
        )
        runs: list[dict[str, Any]] = json.loads(done.stdout.splitlines()[-1])
    except (subprocess.TimeoutExpired, IndexError, json.JSONDecodeError):
        print(f"{planner} on {problem.name}: the process gave no answer", file=sys.stderr)
        return nothing
    return runs


def judged(problem: Problem, runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the runs with cost and cusps, and whether the referee accepts the path."""
    world = problem.load()
    assert world.robot is not None
    query, oracle = world.query(problem.query), Oracle(world, world.robot)
    steering = Steering(problem.radius, problem.reverse)
    for run in runs:
        run["solved"], run["cost"], run["cusps"] = False, None, None
        knots = run.pop("knots")
        if knots:
            path = CurvePath(np.array(knots), steering)
            joins = np.allclose(path.states[[0, -1]], [query.start, query.goal], rtol=0.0, atol=1e-9)
            run["solved"] = bool(joins and not oracle.collides(path.resample(0.01).states).any())
            run["wrong"] = not run["solved"]
            run["cost"], run["cusps"] = path.cost, path.cusps
    return runs


def row(name: str, planner: str, runs: list[dict[str, Any]], best: float, bound: float) -> list[str]:
    """Return one row of the table."""
    solved = [run for run in runs if run["solved"]]
    first = [run["first"] for run in solved if run["first"] is not None]
    costs = [run["cost"] for run in solved]
    return [
        name,
        planner,
        f"{len(solved)}/{len(runs)}",
        str(sum(run.get("wrong", False) for run in runs)),
        f"{np.median(first):.2f} / {np.max(first):.2f}" if first else "",
        f"{np.median(costs):.2f}" if costs else "",
        f"{np.median(costs) / best:.3f}" if costs else "",
        f"{np.median([run['cusps'] for run in solved]):.0f}" if costs else "",
        f"{bound:.2f}",
    ]


HEADER = [
    "problem, turning radius",
    "planner",
    "solved",
    "wrong",
    "first s (median / max)",
    "cost (median), m",
    "/ best known",
    "changes of direction",
    "without obstacles, m",
]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--time-limit", type=float, default=3.0)
    parser.add_argument("--problem", nargs="*", help="world/query; default: all")
    parser.add_argument("--no-write", action="store_true")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.child:
        problem, planner, seeds, limit = json.loads(given.child)
        print(json.dumps(by_ompl(Problem(*problem), planner, seeds, limit)))
        return 0
    chosen = [p for p in PROBLEMS if not given.problem or f"{p.world}/{p.query}" in given.problem]
    record: dict[str, Any] = {"machine": describe_machine(), "time_limit": given.time_limit, "problems": {}}
    rows = []
    for problem in chosen:
        runs = {"landmark": judged(problem, by_landmarks(problem, range(given.seeds), given.time_limit))}
        for name in OMPL:
            runs[name] = judged(problem, in_process(problem, name, range(given.seeds), given.time_limit))
        costs = [run["cost"] for each in runs.values() for run in each if run["solved"]]
        query = problem.load().query(problem.query)
        bound = Steering(problem.radius, problem.reverse).lengths(query.start, query.goal)
        made = [row(problem.name, name, each, min(costs, default=np.nan), bound) for name, each in runs.items()]
        print(*("  ".join(line) for line in made), sep="\n", flush=True)
        rows += made
        record["problems"][problem.name] = {"without_obstacles": bound, "runs": runs}
    if not given.no_write:
        write(record, rows, given.seeds)
    return 0


def write(record: dict[str, Any], rows: list[list[str]], seeds: int) -> None:
    """Write results/car.{json,md}."""
    RESULTS.mkdir(exist_ok=True)
    write_atomically(RESULTS / "car.json", json.dumps(record, indent=1) + "\n")
    lines = [
        "# Car-like robots",
        "",
        f"Written by `python -m benchmarks.car`: {seeds} runs each of at most {record['time_limit']:g} s;",
        "every path passed a referee of its own. `first`: time to the first path (RRT* does not tell);",
        "`/ best known`: median cost over the least of all runs; `without obstacles`: length of the shortest curve, a",
        "lower bound.",
        "",
        markdown_table(HEADER, rows),
        "",
        record["machine"],
        "",
    ]
    write_atomically(RESULTS / "car.md", "\n".join(lines))


if __name__ == "__main__":
    sys.exit(main())
