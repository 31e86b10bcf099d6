"""What the benchmark itself costs, whether it measures what OMPL's own does, and whether it survives being killed.

Writes results/overhead.{json,md}.

    python -m benchmarks.overhead [--only overhead throughput agreement kills]
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from trailmark.benchmark.isolation.prepared import Prepared
from trailmark.benchmark.isolation.worker import Worker
from trailmark.benchmark.problems import Job, Problem, problems_of
from trailmark.library import find_world
from trailmark.world import World

RESULTS = Path(__file__).resolve().parent / "results"
COMMAND = [sys.executable, "-m", "trailmark.cli", "benchmark"]

Figures = dict[str, Any]


def office() -> Problem:
    """Return the problem that all figures are of."""
    return next(problems_of(World.load(find_world("office")), queries=["door"]))


def job(problem: Problem, planner: str, seed: int, limit: float) -> dict[str, Any]:
    """Return one run's job."""
    return Job(problem.key, problem.text, planner, seed, limit, 4096.0, problem.resolution()).to_dict()


def overhead(runs: int = 12) -> Figures:
    """Runs of a second on one warm worker: what they take beyond planning and simplifying."""
    worker, problem = Worker(), office()
    found: Figures = {}
    worker.run(job(problem, "landmark", 0, 0.1))
    found["load"] = os.getloadavg()[1]
    for planner in ("landmark", "PRM+certified", "RRTstar+certified", "RRTstar"):
        answers, walls = [], []
        for seed in range(runs):
            begin = time.perf_counter()
            answers.append(worker.run(job(problem, planner, seed, 1.0)))
            walls.append(time.perf_counter() - begin)
        beyond = [
            wall - answer["time"] - (answer["simplification_time"] or 0.0)
            for wall, answer in zip(walls, answers, strict=True)
        ]
        planning = sum(answer["time"] for answer in answers)
        simplifying = sum(answer["simplification_time"] or 0.0 for answer in answers)
        found[planner] = {
            "runs": runs,
            "planning": planning / runs,
            "simplifying": simplifying / runs,
            "overhead": float(np.mean(beyond)),
            "median": float(np.median(beyond)),
            "least": float(np.min(beyond)),
            "share": float(np.sum(beyond)) / planning,
        }
    worker.stop()
    return found


def throughput(runs: int = 500) -> Figures:
    """Twice as many runs of 0.1 s, two planners on two workers, by the command: start of processes and all."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "results.db"
        words = ["office", "--query", "door", "-p", "landmark", "-p", "RRTstar+certified", "--runs", str(runs)]
        begin = time.perf_counter()
        subprocess.run(
            [*COMMAND, *words, "--time-limit", "0.1", "--workers", "2", "--output", str(file)],
            check=True,
            capture_output=True,
        )
        wall = time.perf_counter() - begin
        with closing(sqlite3.connect(file)) as db:
            made, planning = db.execute("SELECT count(*), sum(time) FROM runs").fetchone()
    return {"runs": made, "workers": 2, "wall": wall, "planning": planning}


def agreement(runs: int = 30, limit: float = 1.0) -> Figures:
    """Costs at the limit, ours and those of ``ot.Benchmark``, run by run in turns, so that the machine is the same."""
    problem, worker, found = office(), Worker(), {}
    prepared = Prepared(problem.text)
    worker.run(job(problem, "PRM+certified", 0, 0.1))
    for planner in ("PRM", "RRTstar"):
        ours: list[float] = []
        theirs: list[float] = []
        for seed in range(runs):
            ours.append(worker.run(job(problem, f"{planner}+certified", seed, limit))["solution_length"] or math.inf)
            theirs.append(in_child(partial(ompls_own, prepared, planner, seed, limit)))
        mine, others = np.array(ours), np.array(theirs)
        both = np.isfinite(mine).sum(), np.isfinite(others).sum()
        a, b = mine[np.isfinite(mine)], others[np.isfinite(others)]
        spread = math.sqrt(a.var(ddof=1) / len(a) + b.var(ddof=1) / len(b))
        found[planner] = {
            "runs": runs,
            "solved": [int(n) for n in both],
            "mean": [float(a.mean()), float(b.mean())],
            "difference": float(a.mean() - b.mean()),
            # Normal approximation of Welch's interval, 95 %.
            "interval": [float(a.mean() - b.mean() - 1.96 * spread), float(a.mean() - b.mean() + 1.96 * spread)],
        }
    worker.stop()
    return found


def ompls_own(prepared: Prepared, planner: str, seed: int, limit: float) -> float:
    """Return the best cost that ``ot.Benchmark`` noted within the limit; infinite if there was none.

    It looks at the clock every tenth of a second only, so its planners run on a little longer.
    """
    from trailmark.ompl_bridge.measured import seed_ompl, silence_ompl
    from trailmark.ompl_bridge.problem import SE2Problem

    silence_ompl()
    seed_ompl(10_000 + seed)
    from ompl import base as ob
    from ompl import tools as ot

    posed = SE2Problem(prepared.problem.world, None, prepared.ends, checker=prepared.checker, certified=True)
    posed.setup.setOptimizationObjective(ob.PathLengthOptimizationObjective(posed.information))
    benchmark = ot.Benchmark(posed.setup, "theirs")
    benchmark.addPlanner(posed.set_planner(planner))
    request = ot.Request()
    request.maxTime, request.maxMem, request.runCount = limit, 4096.0, 1
    request.saveConsoleOutput = False
    request.displayProgress, request.simplify, request.timeBetweenUpdates = False, False, 0.005
    benchmark.benchmark(request)
    rows = benchmark.getRecordedExperimentData().planners[0].runsProgressData[0]
    return min((float(row["best cost REAL"]) for row in rows if float(row["time REAL"]) <= limit), default=math.inf)


def in_child(work: Callable[[], float]) -> float:
    """Return what a function returns in a process of its own."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(writer, repr(work()).encode())
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as answer:
        text = answer.read()
    os.waitpid(child, 0)
    return float(text)


def kills(times: int = 30, runs: int = 600) -> Figures:
    """SIGKILL a running benchmark at random moments and continue it; look for what is lost, doubled or damaged."""
    rng = np.random.default_rng(0)
    lost = doubled = damaged = 0
    seen: dict[tuple[int, int], tuple[Any, ...]] = {}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "results.db"
        words = ["office", "--query", "door", "-p", "landmark", "-p", "RRTConnect+certified", "--runs", str(runs // 2)]
        command = [*COMMAND, *words, "--time-limit", "0.05", "--workers", "2", "--output", str(file)]
        for _ in range(times):
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            begun, moment = len(seen), rng.uniform(0.0, 1.5)
            # From when the first new run is in: before, there is nothing to lose.
            while process.poll() is None and len(rows_of(file)) <= begun:
                time.sleep(0.01)
            time.sleep(moment)
            before = rows_of(file)
            process.send_signal(signal.SIGKILL)
            process.wait()
            after = rows_of(file)
            lost += sum(after.get(key) != row for key, row in (seen | before).items())
            with closing(sqlite3.connect(file)) as db:
                damaged += db.execute("PRAGMA integrity_check").fetchone() != ("ok",)
                doubled += db.execute(
                    "SELECT count(*) - count(DISTINCT plannerid || ' ' || seed) FROM runs"
                ).fetchone()[0]
            seen = after
        at_the_kills = len(seen)
        subprocess.run(command, check=True, capture_output=True)
        final = rows_of(file)
    lost += sum(final.get(key) != row for key, row in seen.items())
    return {
        "kills": times,
        "runs": runs,
        "runs at the last kill": at_the_kills,
        "runs in the end": len(final),
        "lost": lost,
        "doubled": doubled,
        "damaged": damaged,
    }


def rows_of(file: Path) -> dict[tuple[int, int], tuple[Any, ...]]:
    """Return all runs in a database by planner and seed; none where its tables are not made yet."""
    if not file.exists():
        return {}
    with closing(sqlite3.connect(file)) as db:
        try:
            rows = db.execute("SELECT plannerid, seed, * FROM runs").fetchall()
        except sqlite3.OperationalError:
            return {}
    return {(row[0], row[1]): row[2:] for row in rows}


PARTS: dict[str, Callable[[], Figures]] = {
    "overhead": overhead,
    "throughput": throughput,
    "agreement": agreement,
    "kills": kills,
}


def report(figures: Figures) -> str:
    """Return the figures as Markdown."""
    text = ["# The benchmark's own figures", "", "Written by `python -m benchmarks.overhead`.", ""]
    text += [f"- {name}: {figures['machine'][name]}" for name in PARTS if name in figures]
    if "overhead" in figures:
        text += ["", "## Overhead of runs of 1 s on one warm worker", ""]
        text += ["Wall time of a run beyond planning and simplifying: forking, counting the graph, judging the path."]
        load = f"{figures['overhead']['load']:.1f}"
        text += [
            "The start of the worker process is not in it. To reach: at most 5 %, on a machine at rest. Load average"
        ]
        text += [
            f"of the five minutes before: {load} on {os.cpu_count()} cores. A planner that ends by itself before its"
        ]
        text += [
            "second is over (landmark, once its path is proven near the optimum) has as much overhead on less time.",
            "",
        ]
        text += [
            markdown_table(
                ["planner", "runs", "planning (s)", "simplifying (s)", "overhead (ms)", "median", "least", "share"],
                [
                    [
                        planner,
                        str(row["runs"]),
                        f"{row['planning']:.3f}",
                        f"{row['simplifying']:.3f}",
                        *(f"{1e3 * row[name]:.1f}" for name in ("overhead", "median", "least")),
                        f"{100.0 * row['share']:.1f} %",
                    ]
                    for planner, row in figures["overhead"].items()
                    if planner != "load"
                ],
            )
        ]
    if "throughput" in figures:
        row = figures["throughput"]
        text += ["", "## Many short runs", ""]
        text += [
            f"{row['runs']:,} runs of 0.1 s on {row['workers']} workers: {row['wall']:.0f} s from the command's start "
            f"to its end, of which {row['planning'] / row['workers']:.0f} s were planning. To reach: under 180 s."
        ]
    if "agreement" in figures:
        text += ["", "## Agreement with ot.Benchmark", ""]
        text += [
            "Best cost after 1 s on office/door with certified motions, runs in turns, means over those solved.",
            "",
        ]
        text += [
            markdown_table(
                ["planner", "runs", "solved, ours/theirs", "ours", "theirs", "difference", "95 % interval"],
                [
                    [
                        name,
                        str(row["runs"]),
                        "/".join(map(str, row["solved"])),
                        *(f"{mean:.3f}" for mean in row["mean"]),
                        f"{row['difference']:+.3f}",
                        f"{row['interval'][0]:+.3f} … {row['interval'][1]:+.3f}",
                    ]
                    for name, row in figures["agreement"].items()
                ],
            )
        ]
    if "kills" in figures:
        text += ["", "## Killed and continued", ""]
        text += [markdown_table(list(figures["kills"]), [[str(value) for value in figures["kills"].values()]])]
    return "\n".join(text) + "\n"


def main() -> None:
    """Measure what is asked for, and write it beside what was measured before."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    file = RESULTS / "overhead.json"
    figures: Figures = json.loads(file.read_text()) if file.exists() else {"machine": {}}
    for name in parser.parse_args().only:
        figures[name] = PARTS[name]()
        figures["machine"][name] = describe_machine()
        print(name, json.dumps(figures[name]), flush=True)
        file.write_text(json.dumps(figures, indent=1) + "\n")
        file.with_suffix(".md").write_text(report(figures))
    # Not by the interpreter's own way out, in which OMPL's bindings complain about what they leak.
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
