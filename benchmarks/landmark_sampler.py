"""Does the landmark sampler help OMPL's PRM? Writes results/landmark_sampler.{json,md}.

PRM with the landmark sampler against PRM with its own sampler (uniform valid states), in narrow-passage worlds: the
same time, the same checker and certified motion validator, so many seeds each. The landmarks are made within that time.
Both are to find short paths (path length as objective), so that both use all of it; a run counts as solved only if a
referee that shares no code with either (benchmarks/oracle.py) finds no fault in the path.

Each run has a process of its own, forked from one that has loaded all but OMPL's random numbers, and a time limit.

    python -m benchmarks.landmark_sampler [--seeds 50] [--pilot] [--no-write]

--pilot runs PRM with its own sampler alone, until it has a path, to choose the time limits by; it writes nothing.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import multiprocessing.connection
import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from ompl import base as ob
from ompl import util as ou

from benchmarks import landmark_sampler_report
from benchmarks.machine import describe_machine
from benchmarks.oracle import Oracle
from benchmarks.random_worlds import random_world
from benchmarks.solve import path_is_right
from benchmarks.suite import Problem
from trailmark.benchmark.public.made_worlds import passage_world
from trailmark.collision import StateChecker
from trailmark.formats.files import write_atomically
from trailmark.library import find_world
from trailmark.motion import kind_of
from trailmark.motion.pointwise import PointwiseChecker
from trailmark.ompl_bridge import SE2Problem, plug_landmark_sampler
from trailmark.ompl_bridge.mixture import warm_up_sampling
from trailmark.world import Query, Robot, World

RESULTS = Path(__file__).resolve().parent / "results"

RUN_COLUMNS = ("world", "query", "limit", "sampler", "seed", "seconds", "cost", "milestones")
SAMPLERS = ("landmark", "uniform")
SEEDS = 50

PILOT_SEEDS, PILOT_LIMIT = 5, 2.5

GRACE = 20.0
"""Seconds after its time limit that a run's process gets before it is ended."""


class Case(NamedTuple):
    """One problem and its time limit (seconds)."""

    group: str
    world: str
    query: str
    limit: float


CASES = (
    Case("shipped", "narrow", "first", 0.8),
    Case("shipped", "narrow", "second", 1.5),
    Case("shipped", "bugtrap", "out", 0.2),
    Case("shipped", "bugtrap", "into", 0.5),
    Case("shipped", "corridor", "across", 0.2),
    Case("shipped", "corridor", "end", 0.35),
    Case("shipped", "corridor", "ward", 0.4),
    Case("shipped", "gate", "keep", 0.2),
    Case("shipped", "gate", "cloister", 0.1),
    Case("shipped", "lshape", "thread", 0.2),
    Case("shipped", "lshape", "park", 0.25),
    Case("shipped", "lshape", "turn", 0.1),
    Case("shipped", "maze", "across", 0.08),
    Case("shipped", "maze", "centre", 0.05),
    Case("generated", "passages-5", "through", 0.9),
    Case("generated", "passages-6", "through", 1.5),
    Case("generated", "passages-8", "through", 1.3),
    Case("generated", "clutter-3", "corners", 0.15),
    Case("generated", "clutter-4", "corners", 0.14),
    Case("longer", "lshape", "turn", 0.3),
    Case("longer", "maze", "across", 0.2),
    Case("longer", "clutter-3", "corners", 0.4),
    Case("longer", "clutter-4", "corners", 0.4),
)
"""The limits were chosen by --pilot so that PRM's own sampler neither always fails nor always gets through.

Those called longer came later: problems of the others in which the landmark sampler was not ahead, with more time.
"""

CLUTTER = {"clutter-3": (13, 240), "clutter-4": (14, 240)}
"""Seed and number of obstacles of the generated clutter."""


def world_of(name: str) -> World:
    """Return a shipped or generated world with its robot and queries."""
    if name.startswith("passages-"):
        return passage_world(int(name.removeprefix("passages-")))
    if name in CLUTTER:
        seed, obstacles = CLUTTER[name]
        base = random_world(seed, obstacles, size=60.0, radii=(0.5, 2.5))
        robot = Robot.rectangle(3.0, 0.6)
        checker = StateChecker(base, robot)
        rng = np.random.default_rng(seed)
        ends = [_free_near(checker, corner, rng) for corner in ((3.0, 3.0), (57.0, 57.0))]
        query = Query("corners", ends[0], ends[1])
        return World(name, base.bounds, base.obstacles, robot=robot, queries=(query,))
    return World.load(find_world(name))


def _free_near(checker: StateChecker, corner: tuple[float, float], rng: np.random.Generator) -> Any:
    spread = 0.5
    while True:
        q = np.array([*corner, 0.0]) + rng.uniform(-1.0, 1.0, 3) * (spread, spread, math.pi)
        if checker.valid(q):
            return tuple(float(v) for v in q)
        spread += 0.1


def run(problem: Problem, checker: StateChecker, sampler: str, seed: int, limit: float, pilot: bool) -> dict[str, Any]:
    """Plan once; this is what a forked process does."""
    ou.setLogLevel(ou.LOG_NONE)
    ou.RNG.setSeed(seed + 1)  # 0 is no seed
    made = SE2Problem(problem.world, query=problem.query.name, checker=checker)
    if not pilot:
        made.setup.setOptimizationObjective(ob.PathLengthOptimizationObjective(made.information))
    made.set_planner("PRM")
    made.setup.setup()
    begin = perf_counter()
    plugged = plug_landmark_sampler(made.setup, checker=checker, seed=seed) if sampler == "landmark" else None
    if plugged is not None:
        # PRM asked for its sampler when it was set up.
        made.setup.getPlanner().clear()
    made.solve(limit - (perf_counter() - begin))
    seconds = perf_counter() - begin
    path = made.path
    right = path is not None and path_is_right(Oracle(problem.world, checker.robot), problem, path.states)
    return {
        "seconds": seconds,
        "cost": path.cost if path is not None and right else None,
        "wrong": path is not None and not right,
        "milestones": made.setup.getPlanner().milestoneCount(),
        "handed": None if plugged is None else plugged.handed,
    }


def apart(work: Callable[[], dict[str, Any]], seconds: float) -> dict[str, Any]:
    """Return what work returns in a process of its own; a failed run if it does not within so many seconds."""
    here, there = multiprocessing.Pipe(duplex=False)

    def child(connection: multiprocessing.connection.Connection) -> None:
        connection.send(work())

    process = multiprocessing.get_context("fork").Process(target=child, args=(there,))
    process.start()
    there.close()
    try:
        found: dict[str, Any] = here.recv() if here.poll(seconds) else {}
    except EOFError:  # the process came down
        found = {}
    process.join(GRACE)
    if process.is_alive():
        process.kill()
        process.join()
    here.close()
    return found or {"seconds": seconds, "cost": None, "wrong": False, "milestones": 0, "handed": None, "lost": True}


def runs(case: Case, seeds: int, samplers: tuple[str, ...], pilot: bool) -> list[dict[str, Any]]:
    """Return the runs of one case, the samplers in turns."""
    world = world_of(case.world)
    checker = StateChecker(world)
    single = PointwiseChecker(checker)
    problem = Problem(case.group, world, world.query(case.query))
    # Kernels and libraries are loaded here once for all processes.
    warm_up_sampling(kind_of(checker.robot))
    single.valid(*problem.query.start)
    single.step_valid(*problem.query.start, *problem.query.goal)
    limit = PILOT_LIMIT if pilot else case.limit
    rows = []
    for seed in range(seeds):
        # Other seeds than the pilot's, which chose the limits.
        number = 1000 + seed if pilot else seed
        for sampler in samplers if seed % 2 else samplers[::-1]:
            work = partial(run, problem, checker, sampler, number, limit, pilot)
            found = apart(work, limit + GRACE)
            rows.append({**case._asdict(), "sampler": sampler, "seed": number, **found})
    return rows


def main() -> int:
    """Run all cases, print the tables, and write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="runs of each sampler in each world")
    parser.add_argument("--only", help="cases of one world")
    parser.add_argument("--pilot", action="store_true", help="choose time limits: PRM's own sampler alone")
    parser.add_argument("--no-write", action="store_true", help="print only")
    options = parser.parse_args()
    begin = perf_counter()
    rows: list[dict[str, Any]] = []
    for case in CASES:
        if options.only not in (None, case.world):
            continue
        seeds, samplers = (PILOT_SEEDS, SAMPLERS[1:]) if options.pilot else (options.seeds, SAMPLERS)
        found = runs(case, seeds, samplers, options.pilot)
        rows += found
        if options.pilot:
            times = sorted(row["seconds"] if row["cost"] is not None else math.inf for row in found)
            print(f"{case.world} {case.query}: {' '.join(f'{t:.2f}' for t in times)}", flush=True)
        print(f"{case.world} {case.query}: {perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)
    if options.pilot:
        return 0
    publish(rows, perf_counter() - begin, write=not (options.no_write or options.only))
    return 0


def publish(rows: list[dict[str, Any]], seconds: float, *, write: bool) -> None:
    """Print the page, and write it and its figures."""
    page = landmark_sampler_report.page(rows, seconds, os.getloadavg()[2])
    print(page)
    if write:
        record = {
            "machine": describe_machine(),
            "cases": landmark_sampler_report.summary(rows),
            "columns of runs": RUN_COLUMNS,
            "runs": [[row[column] for column in RUN_COLUMNS] for row in rows],
        }
        RESULTS.mkdir(exist_ok=True)
        write_atomically(RESULTS / "landmark_sampler.json", json.dumps(record) + "\n")
        write_atomically(RESULTS / "landmark_sampler.md", page)


if __name__ == "__main__":
    raise SystemExit(main())
