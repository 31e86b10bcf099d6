"""How soon are answers? First paths, kept roadmaps, growth, changes, grid maps, start-up; against another checkout.

    python -m benchmarks.speed [--base PATH] [--only NAME]... [--worlds 8] [--repeats 3]

With ``--base``, the root of another checkout (a ``git worktree`` of an earlier commit), two processes load either
package and answer the same questions in turns, so that whatever else the machine does meets both; the ratios count.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.report import ROOT, Claim, keep
from trailmark import LandmarkPlanner, World
from trailmark.landmarks import free_samples
from trailmark.shapes import Disc

Answer = dict[str, float | None]
"""Seconds, costs or counts by name; None where there is none."""

LIMIT = 0.25
"""Seconds for a first path."""

KEPT, CHANGES = 200, 20
"""Queries on a kept roadmap, and changes of a world, a question."""


# --- questions, answered in a process by one checkout's package ------------------------------------------------------


def first_path(file: str, seed: int) -> Answer:
    """Answer the first query of a world by a new planner."""
    world = World.load(file)
    query = world.queries[0]
    planner = LandmarkPlanner(world, seed=seed)
    result = planner.plan(query.start, query.pose(), time_limit=LIMIT)
    return {"seconds": result.time["first_solution"], "cost": result.cost}


def kept_roadmap(file: str, seed: int) -> Answer:
    """Answer random queries on a kept roadmap."""
    planner = LandmarkPlanner(World.load(file), seed=seed)
    ends = free_samples(planner.checker, 2 * KEPT, random_state=seed).reshape(-1, 2, 3)
    begin = perf_counter()
    planner.plan_many(ends[:1, 0], ends[:1, 1], 10.0)
    built = perf_counter() - begin
    found = planner.plan_many(ends[:, 0], ends[:, 1])
    solved = [result for result in found if result.status == "solved"]
    return {
        "seconds": float(np.median([result.time["first_solution"] or 0.0 for result in solved])),
        "built": built,
        "cost": float(sum(result.cost or 0.0 for result in solved)),
    }


def change(file: str, seed: int) -> Answer:
    """Drop a disc on a path being followed, update and replan; and take it away again."""
    world, rng = World.load(file), np.random.default_rng(seed)
    query = world.queries[0]
    planner = LandmarkPlanner(world, seed=seed)
    path = planner.plan(query.start, query.pose(), time_limit=1.0).path
    times, costs = [], []
    for _ in range(CHANGES if path is not None else 0):
        assert path is not None
        x, y, _ = path.at(float(rng.uniform(0.3, 0.7)))
        begin = perf_counter()
        planner.update(world.edited(add=[Disc((float(x), float(y)), 0.2)]))
        found = planner.replan(query.start, query.pose(), path)
        times.append(perf_counter() - begin)
        costs += [] if found.cost is None else [found.cost]
        planner.update(world)
    return {"seconds": float(np.median(times)) if times else None, "cost": float(np.mean(costs)) if costs else None}


def shell(file: str, seed: int) -> Answer:
    """Run ``trailmark plan`` as a whole process."""
    words = ["-m", "trailmark", "plan", file, "--time-limit", "0.1", "--seed", str(seed)]
    begin = perf_counter()
    subprocess.run([sys.executable, *words], capture_output=True, check=False)
    return {"seconds": perf_counter() - begin}


QUESTIONS: dict[str, Callable[[str, int], Answer]] = {
    "first path": first_path,
    "first path, cars": first_path,
    "first path, grid maps": first_path,
    "first path, 2,000 and 8,000 obstacles": first_path,
    "kept roadmap": kept_roadmap,
    "after a change": change,
    "trailmark plan, whole process": shell,
}


def write_problems(folder: Path, worlds: int) -> Iterator[tuple[str, str]]:
    """Write the problems as world files, one query each; yield the question's name and the file."""
    from tests.helpers.worlds import GRID_KINDS, ROBOTS, far_pairs, random_world, write_map

    from benchmarks.problems import cars, cases
    from trailmark.benchmark.public.graded import corner_ends
    from trailmark.world import Query, Robot

    def put(question: str, world: World) -> tuple[str, str]:
        file = folder / f"{len(list(folder.iterdir())):04}.yaml"
        world.save(file)
        return question, str(file)

    given = [case for case in cases(worlds) if case.feasible is not False]
    for case in given:
        yield put("first path", case.problem.world)
    for case in cars():
        yield put("first path, cars", case.problem.world)
    for kind, make in GRID_KINDS.items():
        rng = np.random.default_rng(1)
        cells = make(rng, 512)
        write_map(folder / f"{kind}.map", cells, far_pairs(cells, rng, 1))
        yield put("first path, grid maps", World.load(folder / f"{kind}.map").with_robot(Robot.disc(0.4)))
    for obstacles in (2_000, 8_000):
        world = random_world(obstacles, obstacles, size=5.0 * obstacles**0.5).with_robot(ROBOTS["rectangle"])
        ends = corner_ends(world, np.random.default_rng(0))
        if ends is not None:
            alone = World("large", world.bounds, world.obstacles, world.robot, queries=(Query("across", *ends),))
            yield put("first path, 2,000 and 8,000 obstacles", alone)
    for case in [case for case in given if case.group == "shipped"][:6]:
        yield put("kept roadmap", case.problem.world)
        yield put("after a change", case.problem.world)
    yield put("trailmark plan, whole process", given[0].problem.world)


# --- the two sides ---------------------------------------------------------------------------------------------------


class Side:
    """A process that answers by one checkout's package."""

    def __init__(self, root: Path) -> None:
        own = {**os.environ, "PYTHONPATH": os.pathsep.join([str(root / "src"), str(ROOT)])}
        command = [sys.executable, "-m", "benchmarks.speed", "--answer"]
        self.process = subprocess.Popen(
            command, cwd=ROOT, env=own, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def ask(self, *question: Any) -> Answer:
        """Return the answer to one question."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(question) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"the process ended with status {self.process.wait()}")
        found: Answer = json.loads(line)
        return found


def answer() -> None:
    """Answer questions read from standard input, until it ends."""
    from trailmark.planning.warmup import warm_up

    warm_up()
    for line in sys.stdin:
        name, file, seed = json.loads(line)
        print(json.dumps(QUESTIONS[name](file, seed)), flush=True)


def soonest(answers: Sequence[Answer]) -> Answer:
    """Return the soonest answer: the same seed does the same work, and what else it takes is other programs'."""
    return min(answers, key=lambda found: np.inf if found["seconds"] is None else found["seconds"])


def ratios(rows: Sequence[tuple[Answer, ...]], key: str) -> str:
    """Return the geometric mean of this checkout's figures over the base's, with a 95 % bootstrap interval."""
    pairs = [(now.get(key), base.get(key)) for now, base in rows]
    logs = np.array([np.log(now / base) for now, base in pairs if now and base])
    if len(logs) == 0:
        return "none"
    draws = np.random.default_rng(0).choice(logs, (4000, len(logs))).mean(axis=1)
    low, high = np.exp(np.quantile(draws, [0.025, 0.975]))
    return f"{np.exp(logs.mean()):.3f} ({low:.3f} to {high:.3f})"


def claim(name: str, rows: Sequence[tuple[Answer, ...]]) -> Claim:
    """Return what the answers to one kind of question come to."""
    own = [row[0] for row in rows]
    seconds = np.array([found["seconds"] or np.nan for found in own], dtype=np.float64)
    solved = int(np.isfinite(seconds).sum())
    figure = f"median {1e3 * np.nanmedian(seconds):.2f} ms, {solved} of {len(rows)} solved"
    if len(rows[0]) == 1:
        return Claim(name, figure)
    before = sum(row[1]["seconds"] is not None for row in rows)
    beside = f"base: time x {ratios(rows, 'seconds')}, cost x {ratios(rows, 'cost')}, solved {before}"
    return Claim(name, figure, beside, "" if solved >= before else "fewer are solved")


def main() -> int:
    """Ask all questions of either side in turns, and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--base", type=Path, help="root of another checkout")
    parser.add_argument("--only", action="append", choices=list(QUESTIONS), help="only this; may be given again")
    parser.add_argument("--worlds", type=int, default=8, help="random worlds for each level of clutter")
    parser.add_argument("--repeats", type=int, default=3, help="of each question, of which the soonest counts")
    parser.add_argument("--answer", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.answer:
        answer()
        return 0
    sides = [Side(root.resolve()) for root in (ROOT, options.base) if root is not None]
    rows: dict[str, list[tuple[Answer, ...]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        asked = [row for row in write_problems(Path(folder), options.worlds) if row[0] in (options.only or QUESTIONS)]
        for number, (name, file) in enumerate(asked):
            found: list[list[Answer]] = [[] for _ in sides]
            for repeat in range(options.repeats):
                # Who goes first changes, so that neither always finds the caches cold.
                for side in range(len(sides)) if (number + repeat) % 2 else reversed(range(len(sides))):
                    found[side].append(sides[side].ask(name, file, 0))
            rows.setdefault(name, []).append(tuple(soonest(answers) for answers in found))
            print(f"\r{number + 1} of {len(asked)} questions", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    keep("speed", [claim(name, found) for name, found in rows.items()])
    return 0


if __name__ == "__main__":
    sys.exit(main())
