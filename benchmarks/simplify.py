"""Does OMPL's path simplifier come back from the landmark planner's paths?

    python -m benchmarks.simplify [--paths 200] [--limit 1.0]

The same query and random ones, on a roadmap that is kept, in a few worlds; after each ``solve``, ``simplifySolution()``
without a limit. Every world runs in a process of its own with a time limit: what does not come back is counted.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

from benchmarks.machine import describe_machine

RESULTS = Path(__file__).resolve().parent / "results" / "simplify.md"
WORLDS = ("office", "maze", "clutter", "narrow")

PROGRAM = """
import json, os, sys, time
import numpy as np
from ompl import geometric as og, util as ou
from benchmarks.oracle import Oracle, motion_states
from trailmark import World
from trailmark.library import find_world
from trailmark.ompl_bridge import LandmarkPlanner, SE2Problem, state
ou.setLogLevel(ou.LOG_ERROR)
name, paths, limit = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
world = World.load(find_world(name))
problem = SE2Problem(world)
problem.set_planner(LandmarkPlanner(problem.information, seed=0))
oracle, rng = Oracle(world, problem.checker.robot), np.random.default_rng(0)
low, high = (*world.bounds[:2], -np.pi), (*world.bounds[2:], np.pi)
free = rng.uniform(low, high, (20 * paths + 100, 3))
free = free[problem.checker.valid(free)]
print("READY", flush=True)
for i in range(paths):
    # Two of three are the same query again: those paths become the shortest, which hang on corners.
    ends = free[2 * i : 2 * i + 2] if i % 3 == 2 else (problem.start, problem.goal)
    problem.setup.clear()
    problem.setup.setStartAndGoalStates(*(state(problem.information, q) for q in ends))
    problem.solve(limit)
    if not problem.setup.haveExactSolutionPath():
        print(json.dumps(None), flush=True)
        continue
    solution = problem.setup.getSolutionPath()
    before, cost = solution.getStateCount(), solution.length()
    begin = time.process_time()
    problem.setup.simplifySolution()
    seconds = time.process_time() - begin
    rows = problem.path.states
    hit = bool(oracle.collides(motion_states(rows[:-1], rows[1:], 100).reshape(-1, 3)).any())
    print(json.dumps([before, solution.getStateCount(), seconds, solution.length() / cost - 1.0, hit]), flush=True)
os._exit(0)
"""


def run(world: str, paths: int, limit: float) -> list[list[float] | None]:
    """Return vertices before and after, processor seconds, change of cost and collision of each path; None: no path."""
    command = [sys.executable, "-c", PROGRAM, world, str(paths), str(limit)]
    # Ten seconds for each path beyond its planning, and ten minutes to compile.
    seconds = 600.0 + paths * (limit + 10.0)
    try:
        text = subprocess.run(command, capture_output=True, text=True, timeout=seconds, check=True).stdout
    except subprocess.TimeoutExpired as expired:
        text = (expired.stdout or b"").decode()
    return [json.loads(line) for line in text.splitlines() if line != "READY"]


def main() -> int:
    """Run all worlds and write the table; 1 if a simplification did not come back or collides."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--paths", type=int, default=200, help="of all worlds together")
    parser.add_argument("--limit", type=float, default=1.0, help="seconds of planning for each")
    options = parser.parse_args()
    each = options.paths // len(WORLDS)
    lines = [
        "# Simplified paths of a kept roadmap",
        "",
        f"`python -m benchmarks.simplify`: `simplifySolution()` after `solve({options.limit:g})`, the roadmap is kept.",
        "",
        "| world | paths | came back | vertices, most | after, most | processor ms, median | most | collide |",
        "|---|---|---|---|---|---|---|---|",
    ]
    failed = 0
    for world in WORLDS:
        found = run(world, each, options.limit)
        rows = [row for row in found if row is not None]
        missing, collide = each - len(found), sum(bool(row[4]) for row in rows)
        failed += missing + collide
        times = sorted(1e3 * row[2] for row in rows)
        lines.append(
            f"| {world} | {each - (len(found) - len(rows))} | {len(rows)} | {max(row[0] for row in rows):.0f} | "
            f"{max(row[1] for row in rows):.0f} | {times[len(times) // 2]:.1f} | {times[-1]:.1f} | {collide} |"
        )
        print(lines[-1], flush=True)
    RESULTS.write_text("\n".join([*lines, "", describe_machine()]) + "\n", encoding="utf-8")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
