"""Are first paths as soon as they were? This checkout against another, in turns in one run; what the final check costs.

Two processes load either checkout's package and answer the same problems in turns, those of
benchmarks/ahead_problems.py and the cars of benchmarks/car.py, so that whatever else the machine does meets both.
Writes results/first_path.{json,md}.

    python -m benchmarks.first_path --base PATH [--worlds 8] [--seeds 3] [--repeats 3] [--limit 0.25]

PATH is the root of the other checkout, for example a ``git worktree`` of an earlier commit.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from inspect import signature
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from trailmark import LandmarkPlanner
from trailmark.errors import TrailmarkError
from trailmark.world import Query, Robot, World

CAR = "car: "
"""How the names of cars' problems begin."""

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "results"


def write_problems(worlds: int, folder: Path) -> None:
    """Write the problems as world files, which any version reads, one query each, in the order of their names.

    A grid map comes as cells, and beside it as polygons, for a checkout that knows no cells in world files.
    """
    from benchmarks.ahead_problems import cases
    from benchmarks.car import PROBLEMS
    from trailmark.formats.cell_obstacles import cells_of

    found: list[tuple[str, World, Robot, Query]] = [
        (case.problem.key, case.problem.world, case.problem.robot, case.problem.query)
        for case in cases(worlds, data=True)
        if case.feasible is not False
    ]
    for car in PROBLEMS:
        world = car.load()
        assert world.robot is not None
        found.append((CAR + car.name, world, world.robot, world.query(car.query)))
    for number, (key, world, robot, query) in enumerate(found):
        alone = replace(world, name=key, robot=robot, queries=(query,))
        alone.save(folder / f"{number:04}.yaml")
        if cells_of(world) is not None:
            polygons = World(key, world.bounds, tuple(world.obstacles), robot, world.boundary, (query,))
            polygons.save(folder / f"{number:04}-polygons.yaml")


def answer(folder: Path) -> None:
    """Answer problems by name, read from standard input, until it ends: what the two processes do."""
    from trailmark.planning.warmup import warm_up

    warm_up()
    # By length alone in either checkout, of which an earlier one knows nothing else.
    charged = "objective" in signature(LandmarkPlanner).parameters
    length: dict[str, Any] = {"objective": "length"} if charged else {}
    known: list[tuple[str, World, Robot, Query]] = []
    for file in sorted(folder.glob("????.yaml")):
        for version in (file, file.with_name(f"{file.stem}-polygons.yaml")):
            with contextlib.suppress(TrailmarkError):  # what this checkout does not read is nothing to compare
                world = World.load(version)
                assert world.robot is not None
                known.append((world.name, world, world.robot, world.queries[0]))
                break
    print(json.dumps([key for key, *_ in known]), flush=True)
    for line in sys.stdin:
        wanted, seed, limit = json.loads(line)
        key, world, robot, query = next(row for row in known if row[0] == wanted)
        planner = LandmarkPlanner(world, robot, seed=seed, **length)
        result = planner.plan(query.start, query.goal, time_limit=limit)
        row: dict[str, Any] = {"first": result.time["first_solution"], "cost": result.cost}
        # By its name in either checkout.
        own = getattr(getattr(planner, "_model", None), "verification", getattr(planner, "_verification", None))
        check: Any = getattr(planner, "_last_look", None) if own is None else own.final_check
        if result.path is not None and not key.startswith(CAR):
            # The median of three, since a cold cache is the last plan's fault.
            times = []
            for _ in range(3):
                begin = perf_counter()
                check.fault(result.path, result.path.states[0], result.path.states[-1])
                times.append(perf_counter() - begin)
            row["look"] = float(np.median(times))
        print(json.dumps(row), flush=True)


class Side:
    """A process that answers by one checkout's package."""

    def __init__(self, root: Path, folder: Path) -> None:
        own = {**os.environ, "PYTHONPATH": os.pathsep.join([str(root / "src"), str(ROOT)])}
        command = [sys.executable, "-m", "benchmarks.first_path", "--answer", str(folder)]
        self.process = subprocess.Popen(
            command, cwd=ROOT, env=own, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.keys: list[str] = self._read()

    def ask(self, key: str, seed: int, limit: float) -> dict[str, Any]:
        """Return what one plan gave."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps([key, seed, limit]) + "\n")
        self.process.stdin.flush()
        row: dict[str, Any] = self._read()
        return row

    def _read(self) -> Any:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"the process ended with status {self.process.wait()}")
        return json.loads(line)

    def end(self) -> None:
        """Let the process end."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()


def main() -> int:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--base", type=Path)
    parser.add_argument("--worlds", type=int, default=8)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--limit", type=float, default=0.25)
    parser.add_argument("--answer", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.answer is not None:
        answer(options.answer)
        return 0
    if options.base is None:
        parser.error("--base is missing: the other checkout's root")
    with tempfile.TemporaryDirectory() as folder:
        write_problems(options.worlds, Path(folder))
        sides = [Side(root, Path(folder)) for root in (options.base.resolve(), ROOT)]
    # A world that ships with one checkout alone is nothing to compare.
    both = [key for key in sides[1].keys if key in sides[0].keys]
    rows: list[dict[str, Any]] = []
    for number, key in enumerate(both):
        for seed in range(options.seeds):
            found: dict[int, dict[str, Any]] = {}
            for repeat in range(options.repeats):
                # Who goes first changes, so that neither always finds the caches cold.
                for side in (0, 1) if (number + seed + repeat) % 2 else (1, 0):
                    answer_ = sides[side].ask(key, seed, options.limit)
                    # The soonest: the same seed does the same work, and what else it takes is other programs'.
                    if side not in found or (answer_["first"] or np.inf) < (found[side]["first"] or np.inf):
                        found[side] = answer_
            rows.append({"problem": key, "seed": seed, "before": found[0], "now": found[1]})
        print(f"\r{number + 1} of {len(sides[1].keys)} problems", end="", file=sys.stderr, flush=True)
    for process in sides:
        process.end()
    _write(rows, options)
    return 0


def _compare(rows: list[dict[str, Any]], of: str) -> list[list[str]]:
    """Return the table's lines for the rows of some problems, ``of`` their name."""
    both = [r for r in rows if r["before"]["first"] is not None and r["now"]["first"] is not None]
    ratios = np.log([r["now"]["first"] / r["before"]["first"] for r in both])
    costs = np.log([r["now"]["cost"] / r["before"]["cost"] for r in both if r["before"]["cost"] > 0.0])
    problems = sorted({r["problem"] for r in both})
    each = np.array([np.mean([x for x, r in zip(ratios, both, strict=True) if r["problem"] == p]) for p in problems])
    solved = [sum(r[side]["first"] is not None for r in rows) for side in ("before", "now")]
    return [
        [f"{of}: first path, now / before, geometric mean over problems", _interval(each), "at most 1.05"],
        [f"{of}: solved within the limit, before / now", f"{solved[0]} / {solved[1]} of {len(rows)}", "not fewer"],
        [f"{of}: cost at the limit, now / before, geometric mean", _interval(costs, 4), "not higher beyond chance"],
    ]


def _interval(logs: np.ndarray, digits: int = 3) -> str:
    """Return the geometric mean of ratios and its 95 % interval by bootstrap; ``logs`` are the ratios' logarithms."""
    draws = np.random.default_rng(0).choice(logs, (2000, len(logs))).mean(axis=1)
    low, high = np.exp(np.quantile(draws, [0.025, 0.975]))
    return f"{np.exp(logs.mean()):.{digits}f} ({low:.{digits}f}..{high:.{digits}f})"


def _write(rows: list[dict[str, Any]], options: argparse.Namespace) -> None:
    looks = np.array([r["now"]["look"] for r in rows if "look" in r["now"]])
    table = [
        *_compare([r for r in rows if not r["problem"].startswith(CAR)], "ahead's problems"),
        *_compare([r for r in rows if r["problem"].startswith(CAR)], "cars"),
        ["final check, median", f"{float(np.median(looks)) * 1e3:.2f} ms", "at most 1 ms"],
        ["final check, 95 %", f"{np.quantile(looks, 0.95) * 1e3:.2f} ms", ""],
    ]
    table_text = markdown_table(["figure", "value", "wanted"], table)
    problems = len({r["problem"] for r in rows})
    what = f"{problems} problems, {options.seeds} seeds, soonest of {options.repeats}, limit {options.limit:g} s."
    machine = describe_machine()
    text = f"# First paths, before and now\n\n{what}\n\n{table_text}\n\n{machine}\n"
    (RESULTS / "first_path.md").write_text(text)
    (RESULTS / "first_path.json").write_text(json.dumps({"machine": machine, "rows": rows}, indent=1) + "\n")
    print("\n" + text)


if __name__ == "__main__":
    sys.exit(main())
