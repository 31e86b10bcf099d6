"""trailmark's parts inside OMPL: same answers, growth of trees and roadmaps, memory. Writes results/bridge.{json,md}.

1. 100,000 random states and 20,000 random motions through ``SpaceInformation`` and directly by ``StateChecker``.
2. Iterations per second of RRT* and edges per second of PRM with trailmark's certified motion validator, against OMPL's
   discrete validator over trailmark's state checker, one state every 0.1 m; the two take turns in the same run.
3. Memory of one process over 1,000 set-ups with a solve each, by RRT-Connect and by the landmark planner, and over
   10,000 set-ups without.

Each measurement runs in a process of its own with a time limit, since OMPL can take one down.

    python -m benchmarks.bridge [--seconds 2] [--repeats 5] [--solves 1000]
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from trailmark.library import find_world
from trailmark.world import World

RESULTS = Path(__file__).resolve().parent / "results"
ROOT = Path(__file__).resolve().parents[1]

WORLDS = ("office", "clutter", "warehouse", "narrow")
RESOLUTION = 0.1


def same_answers(name: str, states: int, motions: int) -> dict[str, Any]:
    """Count the states and motions on which OMPL hears something else than ``StateChecker`` says."""
    from trailmark.ompl_bridge import SE2Problem, state

    world = World.load(find_world(name))
    problem = SE2Problem(world)
    information, checker = problem.information, problem.checker
    rng = np.random.default_rng(0)
    xmin, ymin, xmax, ymax = world.bounds
    q = rng.uniform((xmin, ymin, -np.pi), (xmax, ymax, np.pi), (states, 3))
    valid = checker.valid(q)
    heard = np.array([information.isValid(state(information, row)) for row in q])
    free = q[valid]
    a = free[rng.integers(len(free), size=motions)]
    # From a tenth of the robot's size up to all of the world, so that there are enough of both kinds.
    reach = np.hypot(xmax - xmin, ymax - ymin) * 10.0 ** -rng.uniform(0.0, 2.0, (motions, 1))
    b = (
        a
        + reach * rng.uniform(-1.0, 1.0, (motions, 3)) * (1.0, 1.0, 0.0)
        + rng.uniform(-1, 1, (motions, 3)) * (0, 0, 1)
    )
    b[:, 0], b[:, 1] = np.clip(b[:, 0], xmin, xmax), np.clip(b[:, 1], ymin, ymax)
    b[:, 2] = (b[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    certified = checker.motions_valid(a, b)
    told = np.array(
        [information.checkMotion(state(information, p), state(information, r)) for p, r in zip(a, b, strict=True)]
    )
    return {
        "states": states,
        "valid": float(valid.mean()),
        "states differ": int((heard != valid).sum()),
        "motions": motions,
        "certified": float(certified.mean()),
        "motions differ": int((told != certified).sum()),
    }


def growth(name: str, planner: str, certified: bool, seconds: float) -> float:
    """Return iterations (RRT*) or edges (PRM) per second."""
    from ompl import util as ou

    from trailmark.ompl_bridge import SE2Problem

    ou.setLogLevel(ou.LOG_ERROR)
    problem = SE2Problem(
        World.load(find_world(name)), certified=certified, resolution=None if certified else RESOLUTION
    )
    made = problem.set_planner(planner)
    problem.solve(0.05)
    problem.setup.clear()
    if planner == "PRM":
        # By itself it stops at the first path.
        problem.setup.setup()
        made.growRoadmap(seconds)
        return float(made.edgeCount()) / seconds
    problem.solve(seconds)
    return float(made.numIterations()) / seconds


def memory(planner: str | None, rounds: int) -> list[tuple[int, float]]:
    """Return resident memory (MB) after some numbers of set-ups, each with a short solve unless ``planner`` is None."""
    from ompl import util as ou

    from trailmark.ompl_bridge import LandmarkPlanner, SE2Problem

    ou.setLogLevel(ou.LOG_ERROR)
    world = World.load(find_world("office"))
    checker = SE2Problem(world).checker
    marks = sorted({100, rounds, *np.linspace(100, rounds, 10).astype(int).tolist()})
    record = []
    for k in range(1, rounds + 1):
        problem = SE2Problem(world, checker=checker)
        if planner is not None:
            made = LandmarkPlanner(problem.information, seed=k) if planner == "landmark" else planner
            problem.set_planner(made)
            problem.solve(0.05)
        del problem
        if k in marks:
            gc.collect()
            record.append((k, _resident()))
    return record


def _resident() -> float:
    """Return this process's resident memory in MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _apart(call: str, *arguments: Any, limit: float) -> Any:
    """Return what a function of this file returns, run in a process of its own."""
    program = (
        f"import json, os; from benchmarks.bridge import {call}; answer = {call}(*{arguments!r}); "
        "print('ANSWER', json.dumps(answer), flush=True); os._exit(0)"
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=limit)
    lines = [line for line in done.stdout.splitlines() if line.startswith("ANSWER ")]
    if not lines:
        raise RuntimeError(f"{call}{arguments}: no answer, exit status {done.returncode}: {done.stderr[-500:]}")
    return json.loads(lines[0].removeprefix("ANSWER "))


def main() -> int:
    """Measure and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--solves", type=int, default=1000)
    options = parser.parse_args()

    answers = {name: _apart("same_answers", name, 25_000, 5_000, limit=600) for name in WORLDS}
    first = markdown_table(
        ["world", *next(iter(answers.values()))],
        [
            [name, *(f"{v:.2f}" if isinstance(v, float) else f"{v:,}" for v in row.values())]
            for name, row in answers.items()
        ],
    )
    print(first, flush=True)

    speeds: dict[str, dict[str, Any]] = {}
    rows = []
    for planner, unit in (("RRTstar", "iterations/s"), ("PRM", "edges/s")):
        for name in WORLDS:
            # By turns, so that a slow minute of the machine strikes both alike.
            pairs = [
                [_apart("growth", name, planner, certified, options.seconds, limit=120) for certified in (True, False)]
                for _ in range(options.repeats)
            ]
            ours, discrete = np.median(pairs, axis=0)
            ratio = float(np.median([a / b for a, b in pairs]))
            speeds[f"{planner} {name}"] = {"certified": ours, "discrete": discrete, "ratio": ratio, "runs": pairs}
            rows.append([planner, name, unit, f"{ours:,.0f}", f"{discrete:,.0f}", f"{ratio:.2f}"])
            print(rows[-1], flush=True)
    second = markdown_table(["planner", "world", "unit", "certified", f"discrete {RESOLUTION:g} m", "ratio"], rows)

    records = {
        "set-ups alone": _apart("memory", None, 10 * options.solves, limit=1200),
        "RRTConnect": _apart("memory", "RRTConnect", options.solves, limit=1200),
        "landmark": _apart("memory", "landmark", options.solves, limit=1200),
    }
    third = markdown_table(
        ["", "rounds", "MB after 100", "MB at the end", "most above that of 100, MB"],
        [
            [name, f"{r[-1][0]:,}", f"{r[0][1]:.1f}", f"{r[-1][1]:.1f}", f"{max(m for _, m in r) - r[0][1]:.1f}"]
            for name, r in records.items()
        ],
    )
    print(third)
    machine = describe_machine()
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "bridge.json").write_text(
        json.dumps({"machine": machine, "answers": answers, "growth": speeds, "memory": records}, indent=1) + "\n"
    )
    parts = ["# trailmark's parts inside OMPL", f"By `python -m benchmarks.bridge`: {machine}.", "## Same answers",
             first, "## Growth", second, "## Memory", third]  # fmt: skip
    (RESULTS / "bridge.md").write_text("\n\n".join(parts) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
