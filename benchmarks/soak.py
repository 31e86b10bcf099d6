"""An hour of planning in threads: do memory and work stay as they were? Writes results/soak.{json,md}.

Threads share a few planners, for robots that move every way and for cars. They plan random and repeated queries, ask
many at once, save roadmaps and worlds and load them again, and make planners that are thrown away. Every so often the
process's memory, the roadmaps' sizes and the processor time of a query are written down; paths are judged by shapely.

    python -m benchmarks.soak [--minutes M] [--threads N] [--seed N] [--no-write]

The exit status is 1 if memory grew by more than 20 MB after the warm-up, queries became slower, or an answer was wrong.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import json
import math
import os
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.random_worlds import ROBOTS, random_states, random_world
from benchmarks.soundness.cases import judge_result
from benchmarks.soundness.reference import Reference
from trailmark import LandmarkPlanner, World
from trailmark.errors import InternalErrorWarning
from trailmark.formats.files import write_atomically
from trailmark.planning import PlanResult
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray
from trailmark.world import Robot

RESULTS = Path(__file__).resolve().parent / "results"

WARM_UP = 0.25
"""Part of the run that counts as warm-up."""

SAMPLES = 24
"""Times that memory and work are written down."""

GROWTH = 20.0
"""MB by which memory may grow after the warm-up."""

SLOWER = 1.25
"""Times the processor time for a query in the last third after the warm-up as in the first: the machine is shared."""

JUDGED = 20
"""One path of so many is judged."""

SIZE = 40.0
"""Metres: of the random world's sides."""

M_ARENA_MAX = -8
"""Of the C library's ``mallopt``: how many pools of memory there are."""

STATES = 400
"""Configurations of each problem that queries join."""


NAMES = ("office", "clutter", "clutter, L", "clutter, disc", "clutter, car", "clutter, car forwards")
"""Of the problems: worlds and robots."""


class Problem(NamedTuple):
    """What is planned.

    Attributes:
        name: of it.
        planner: shared by all threads.
        states: valid configurations, shape (n, 3).
        reference: judges paths.
    """

    name: str
    planner: LandmarkPlanner
    states: FloatArray
    reference: Reference


def problems(seed: int, size: float = SIZE, names: Collection[str] = NAMES) -> list[Problem]:
    """Return what is planned: a world that ships and a random one of some size, for cars, too."""
    from trailmark.library import shipped_worlds

    found = []
    office = World.load(shipped_worlds()["office"])
    clutter = random_world(seed, round(60 * (size / SIZE) ** 2), size=size, radii=(0.5, 3.0), discs=0.3, holes=0.2)
    robots = (
        office.robot,
        ROBOTS["rectangle"],
        ROBOTS["L"],
        Robot.disc(0.6),
        ROBOTS["rectangle"].steered(2.0),
        ROBOTS["rectangle"].steered(2.0, reverse=False),
    )
    for name, robot in zip(NAMES, robots, strict=True):
        if name not in names:
            continue
        assert robot is not None
        world = office if name == "office" else clutter
        planner = LandmarkPlanner(world, robot, seed=seed)
        states = random_states(world, 40 * STATES, np.random.default_rng(seed))
        states = states[np.asarray(planner.checker.valid(states))][:STATES]
        if robot.turning_radius is None:
            # The roadmap over all free space, whole: in the threads' short queries it would be built bit by bit.
            planner.plan_many(states[:1], states[1:2], time_limit=300.0)
        found.append(Problem(name, planner, states, Reference(world, robot)))
    return found


def resident() -> float:
    """Return the memory that this process holds on to, MB: garbage collected, free pages given back."""
    gc.collect()
    if sys.platform == "linux":
        # What is freed stays in the C library's pool.
        ctypes.CDLL(None).malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


class Soak:
    """Threads at work, and what they have counted.

    Args:
        seed: of all chances.
        folder: where roadmaps and worlds are saved.
        size: of the random world.
        names: of the problems.
    """

    def __init__(self, seed: int, folder: Path, size: float = SIZE, names: Collection[str] = NAMES) -> None:
        self.problems, self.seed, self.folder = problems(seed, size, names), seed, folder
        self.counts: Counter[str] = Counter()
        self.seconds: dict[str, list[float]] = {"plan": [], "again": [], "many": []}
        self.wrong: list[str] = []
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._idle = threading.Condition()
        self._busy, self._paused = 0, False

    def start(self, threads: int) -> None:
        """Let threads begin."""
        self._threads = [threading.Thread(target=self._work, args=(k,), daemon=True) for k in range(threads)]
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Let them end."""
        self._end.set()
        for thread in self._threads:
            thread.join()

    @contextmanager
    def pause(self) -> Iterator[None]:
        """Hold the threads between two actions, so that what is measured is what stays, not what they work on."""
        with self._idle:
            self._paused = True
            self._idle.wait_for(lambda: self._busy == 0)
        yield
        with self._idle:
            self._paused = False
            self._idle.notify_all()

    def take(self) -> tuple[dict[str, float], dict[str, int]]:
        """Return the median processor time (ms) of a query of each kind since the last call, and all counts."""
        with self._lock:
            medians = {kind: 1e3 * float(np.median(v)) if v else math.nan for kind, v in self.seconds.items()}
            for v in self.seconds.values():
                v.clear()
            return medians, dict(self.counts)

    def _work(self, thread: int) -> None:
        rng = np.random.default_rng([self.seed, thread])
        actions = (self._plan, self._again, self._many, self._save_and_load, self._anew)
        while not self._end.is_set():
            action = actions[int(rng.choice(len(actions), p=(0.6, 0.2, 0.1, 0.05, 0.05)))]
            problem = self.problems[int(rng.integers(len(self.problems)))]
            with self._idle:
                self._idle.wait_for(lambda: not self._paused)
                self._busy += 1
            try:
                action(problem, rng)
            except Exception:
                with self._lock:
                    self.wrong.append(f"{problem.name}: {traceback.format_exc(limit=-3)}")
            finally:
                with self._idle:
                    self._busy -= 1
                    self._idle.notify_all()

    def _plan(self, problem: Problem, rng: np.random.Generator, again: bool = False) -> None:
        i, j = (0, 1) if again else rng.choice(len(problem.states), 2, replace=False)
        found: list[bool] = []
        begin = time.thread_time()
        result = problem.planner.plan(
            problem.states[i],
            problem.states[j],
            1.0,
            on_progress=lambda progress: found.append(True) if progress.cost is not None else None,
            stop=lambda: bool(found),
        )
        self._count("again" if again else "plan", time.thread_time() - begin, 1)
        self._judge(problem, problem.states[[i, j]], result)

    def _again(self, problem: Problem, rng: np.random.Generator) -> None:
        self._plan(problem, rng, again=True)

    def _many(self, problem: Problem, rng: np.random.Generator) -> None:
        if problem.planner.robot.turning_radius is not None:
            return
        ends = problem.states[rng.integers(0, len(problem.states), (10, 2))]
        begin = time.thread_time()
        results = problem.planner.plan_many(ends[:, 0], ends[:, 1], 0.2)
        self._count("many", (time.thread_time() - begin) / len(ends), len(ends))
        self._judge(problem, ends[0], results[0])

    def _save_and_load(self, problem: Problem, rng: np.random.Generator) -> None:
        name = f"{threading.get_ident()}-{rng.integers(4)}"
        problem.planner.world.save(self.folder / f"{name}.yaml")
        world = World.load(self.folder / f"{name}.yaml")
        same = world.bounds == problem.planner.world.bounds and world.obstacles == problem.planner.world.obstacles
        kept = LandmarkPlanner(world, problem.planner.robot, seed=0, landmarks=100)
        roadmap = kept.build()
        roadmap.save(self.folder / f"{name}.npz")
        loaded = type(roadmap).load(self.folder / f"{name}.npz", kept.checker)
        same &= np.array_equal(loaded.configurations, roadmap.configurations)
        same &= isinstance(loaded, Roadmap) and np.array_equal(loaded.edges, roadmap.edges)
        self._count("saved and loaded", None, 1)
        if not same:
            with self._lock:
                self.wrong.append(f"{problem.name}: another world or roadmap loaded than was saved")

    def _anew(self, problem: Problem, rng: np.random.Generator) -> None:
        planner = LandmarkPlanner(problem.planner.world, problem.planner.robot, seed=int(rng.integers(1000)))
        ends = problem.states[rng.integers(0, len(problem.states), 2)]
        self._judge(problem, ends, planner.plan(ends[0], ends[1], 0.1))
        self._count("planners thrown away", None, 1)

    def _count(self, kind: str, seconds: float | None, n: int) -> None:
        with self._lock:
            self.counts[kind] += n
            if seconds is not None:
                self.seconds[kind].append(seconds)

    def _judge(self, problem: Problem, ends: FloatArray, result: PlanResult) -> None:
        with self._lock:
            self.counts[result.status] += 1
            due = self.counts[result.status] % JUDGED == 1
            self.counts["judged"] += due
        if due:
            complaint = judge_result(
                problem.planner.world, problem.planner.robot, ends, result, None, problem.reference
            )
            if complaint is not None:
                with self._lock:
                    self.wrong.append(f"{problem.name}: {complaint}")


def measure(
    minutes: float, threads: int, seed: int, size: float = SIZE, names: Collection[str] = NAMES
) -> dict[str, Any]:
    """Return what was measured."""
    rows: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        # What the library finds of its own errors before they do harm is an error all the same.
        warnings.simplefilter("error", InternalErrorWarning)
        soak = Soak(seed, Path(folder), size, names)
        begin = time.perf_counter()
        soak.start(threads)
        for k in range(1, SAMPLES + 1):
            while (left := 60.0 * minutes * k / SAMPLES - (time.perf_counter() - begin)) > 0.0:
                time.sleep(min(0.2, left))
            with soak.pause():
                memory = resident()
            medians, counts = soak.take()
            row = {
                "minutes": (time.perf_counter() - begin) / 60.0,
                "memory": memory,
                "queries": float(counts.get("plan", 0) + counts.get("again", 0) + counts.get("many", 0)),
                "nodes": float(sum(len(p.planner.roadmap) for p in soak.problems)),
                "edges": float(sum(len(p.planner.roadmap.edges) for p in soak.problems)),
                **medians,
            }
            rows.append(row)
            print(
                ", ".join(f"{key} {value:.4g}" for key, value in row.items()),
                len(soak.wrong),
                file=sys.stderr,
                flush=True,
            )
        soak.stop()
    return {
        "machine": describe_machine(),
        "minutes": minutes,
        "threads": threads,
        "rows": rows,
        "counts": dict(soak.counts),
        "wrong": soak.wrong,
    }


def verdicts(record: dict[str, Any]) -> list[tuple[str, bool, str]]:
    """Return each target, whether it is reached, and the figure."""
    rows = record["rows"][round(WARM_UP * SAMPLES) :]
    third = max(1, len(rows) // 3)
    memory = [row["memory"] for row in rows]
    grown = max(memory) - memory[0]
    found = [(f"memory flat within {GROWTH:.0f} MB after the warm-up", grown <= GROWTH, f"{grown:+.1f} MB")]
    for kind in ("plan", "again", "many"):
        first, last = (_median([row[kind] for row in part]) for part in (rows[:third], rows[-third:]))
        name = {"plan": "random queries", "again": "repeated queries", "many": "queries of many"}[kind]
        found.append((f"{name} no slower", not last > SLOWER * first, f"{first:.2f} ms, then {last:.2f} ms"))
    found.append(("no wrong answer", not record["wrong"], f"{len(record['wrong'])} wrong"))
    return found


def _median(values: list[float]) -> float:
    """Return the median of the numbers among values; NaN if there are none, as in short runs."""
    known = [value for value in values if not math.isnan(value)]
    return float(np.median(known)) if known else math.nan


def text(record: dict[str, Any]) -> str:
    """Return the report as Markdown."""
    lines = [
        f"- {'reached' if ok else '**not reached**'}: {target} ({figure})." for target, ok, figure in verdicts(record)
    ]
    header = ["minutes", "memory MB", "queries", "nodes", "edges", "random ms", "repeated ms", "many ms"]
    rows = [
        [
            f"{row['minutes']:.1f}",
            f"{row['memory']:.1f}",
            *(f"{row[key]:,.0f}" for key in ("queries", "nodes", "edges")),
            *(f"{row[key]:.2f}" for key in ("plan", "again", "many")),
        ]
        for row in record["rows"]
    ]
    counts = ", ".join(f"{n:,} {key}" for key, n in sorted(record["counts"].items()))
    return "\n".join(
        [
            f"# {record['minutes']:g} minutes of planning in {record['threads']} threads",
            "",
            f"Written by `python -m benchmarks.soak`: {record['machine']}.",
            "",
            *lines,
            "",
            f"Counted: {counts}.",
            *(f"- wrong: {line}" for line in (" ".join(w.split()) for w in record["wrong"][:20])),
            "",
            markdown_table(header, rows),
            "",
            f"The first {WARM_UP:.0%} are warm-up. `ms`: processor time of the asking thread for a query, median since",
            "the row before; random and repeated queries end with their first path, of `plan_many` each has its whole",
            "answer. `nodes`, `edges`: of all roadmaps together. Memory is read while all threads wait between two",
            "queries, garbage is collected and free pages are given back; all threads allocate from one pool, since",
            "the C library keeps what is free at the end of a thread's own: up to 300 MB more of 8 threads.",
        ]
    )


def one_pool() -> None:
    """Let all threads allocate from one pool: what is free at the end of each one's own is never given back."""
    if sys.platform == "linux":
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, 1)


def main() -> int:
    """Soak, print and write."""
    one_pool()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0, metavar="M")
    parser.add_argument("--threads", type=int, default=8, metavar="N")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--no-write", action="store_true", help="print only")
    options = parser.parse_args()
    record = measure(options.minutes, options.threads, options.seed)
    report = text(record)
    print(report)
    if not options.no_write:
        write_atomically(RESULTS / "soak.json", json.dumps(record, indent=1) + "\n")
        write_atomically(RESULTS / "soak.md", report + "\n")
    return 0 if all(ok for _, ok, _ in verdicts(record)) else 1


if __name__ == "__main__":
    sys.exit(main())
