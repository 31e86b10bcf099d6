"""How far a robot drives to explore a world, what it then knows, and whether it ever hits anything.

Writes results/NAME.{json,md}. Worlds are generated (benchmarks.explore_worlds: ten offices, caves, fields of clutter
and nets of streets each) and shipped ones; each is explored by each strategy from the same start, without noise and
with the noise that the simulator has by default, at confidence 0.99. All strategies have the same simulator, planner,
map and end. What is seen, what the robot overlaps, how well the map's surfaces lie and what a tour takes that knows the
map is found by shapely (benchmarks.explore_oracle).

Each run has a process of its own, and a limit on the processor's time that it uses: what takes longer hangs. What is
measured is appended to a file of JSON Lines at once, and runs that stand there already are not run again.

    python -m benchmarks.explore [--worlds 40] [--shipped] [--maps NAME.{yaml,png} ...] [--drives NAME ...]
        [--seeds 1] [--noise 0 1] [--strategies NAME ...] [--workers 1] [--limit 1800] [--runs FILE.jsonl]
        [--report [NAME]]
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import resource
import signal
import time
import traceback
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.age import describe_code
from benchmarks.explore_report import report, summarise
from benchmarks.explore_run import DRIVES, Job, jobs_for, run_job
from benchmarks.explore_worlds import KINDS
from benchmarks.machine import describe_machine
from trailmark.formats.files import write_atomically
from trailmark.library import shipped_worlds

RESULTS = Path(__file__).resolve().parent / "results"

STRATEGIES = ("nearest-frontier", "gain-per-cost", "tour")

CLOSED = ("enclosed",)
"""Shipped worlds whose free space is not connected."""


PATIENCE = 20.0
"""Times its limit that a run may take by the clock on the wall: one that waits for ever uses up no time."""


class Running(NamedTuple):
    """A run that is on."""

    job: Job
    process: Any
    end: Connection
    began: float


def _child(job: Job, end: Connection, limit: float) -> None:
    # The kernel ends a process that has used up its time; other work on the machine does not count.
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(limit), math.ceil(limit) + 1))
    try:
        end.send(run_job(job))
    except BaseException as error:  # whatever it is, it is a result
        lines = traceback.format_exc().strip().splitlines()
        end.send({"status": "error", "reason": f"{type(error).__name__}: {error}", "trace": lines[-12:]})


def _started(job: Job, limit: float) -> Running:
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(job, there, limit), daemon=True)
    process.start()
    there.close()
    return Running(job, process, here, time.monotonic())


def _outcome(run: Running, limit: float) -> dict[str, Any] | None:
    """Return what a run gave, or that it hung or died; None while it is on."""
    if run.end.poll():
        try:
            found: dict[str, Any] = run.end.recv()
        except EOFError:  # it has ended without a word
            run.process.join()
            found = {"status": "died", "reason": f"exit status {run.process.exitcode}"}
            if run.process.exitcode in (-signal.SIGXCPU, -signal.SIGKILL):
                found = {"status": "hang", "reason": f"no end within {limit:g} s of work"}
    elif time.monotonic() - run.began > PATIENCE * limit:
        found = {"status": "hang", "reason": f"no end within {PATIENCE * limit:g} s"}
        run.process.kill()
    else:
        return None
    run.process.join()
    return found


def measure(jobs: list[Job], file: Path, workers: int, limit: float) -> list[dict[str, Any]]:
    """Return a row for each job, those of the file included; new ones are appended to it."""
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    done = {tuple(row["job"]) for row in rows}
    left, running = [job for job in jobs if limit > 0.0 and tuple(job) not in done], list[Running]()
    while left or running:
        while left and len(running) < workers:
            running.append(_started(left.pop(0), limit))
        time.sleep(0.1)
        for run in list(running):
            found = _outcome(run, limit)
            if found is not None:
                running.remove(run)
                row = {"job": list(run.job), "code": describe_code(), **found}
                rows.append(row)
                with file.open("a") as out:
                    out.write(json.dumps(row) + "\n")
                print(_line(run.job, row), flush=True)
    wanted = {tuple(job) for job in jobs}
    return [row for row in rows if tuple(row["job"]) in wanted]


def _line(job: Job, row: dict[str, Any]) -> str:
    facts = [f"{row['distance']:.1f} m"] if "distance" in row else []
    if "seen" in row:
        facts += [f"seen {100.0 * row['seen']:.2f} % ({100.0 * row['seen_by_oracle']:.2f} %)"]
        facts += [f"{row['collisions']} collisions", f"NEES {row['nees']:.2f}", f"{row['cpu']:.0f} s"]
    facts += [f"{row['status']}: {row['reason']}"] if "status" in row else []
    return f"{job.world}, seed {job.seed}, noise {job.noise:g}, {job.strategy}: {', '.join(facts)}"


def main() -> None:
    """Measure, print, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=40, help="generated worlds, of the four kinds in turn")
    parser.add_argument("--shipped", action="store_true", help="the shipped worlds that are connected, too")
    parser.add_argument(
        "--maps", nargs="+", default=[], help="NAME.yaml or NAME.png of the real data's folder explore, too"
    )
    parser.add_argument("--drives", nargs="+", choices=list(DRIVES), help="instead of robots that move every way")
    parser.add_argument("--seeds", type=int, default=1, help="runs of each kind in each world")
    parser.add_argument("--noise", type=float, nargs="+", default=[0.0, 1.0], help="times the noise by default")
    parser.add_argument("--strategies", nargs="+", default=list(STRATEGIES))
    parser.add_argument("--workers", type=int, default=1, help="processes at a time")
    parser.add_argument(
        "--limit", type=float, default=1800.0, help="seconds of work after which a run hangs; 0: run none"
    )
    parser.add_argument("--runs", type=Path, default=Path("explore.jsonl"), help="where runs are kept")
    parser.add_argument("--report", nargs="?", const="explore", help="write the results, into files of that name")
    arguments = parser.parse_args()
    kinds = list(KINDS)
    worlds = [f"{kinds[i % 4]} {i // 4}" for i in range(arguments.worlds)]
    worlds += [name for name in shipped_worlds() if name not in CLOSED] if arguments.shipped else []
    worlds += arguments.maps
    worlds = [f"{world} as {drive}" for world in worlds for drive in arguments.drives] if arguments.drives else worlds
    jobs = jobs_for(worlds, arguments.seeds, arguments.noise, arguments.strategies)
    rows = measure(jobs, arguments.runs, arguments.workers, arguments.limit)
    summary = summarise(rows)
    # The runs may have been measured before: a page is as old as its first run.
    machine = describe_machine().replace(describe_code(), next(iter(summary["code"]), describe_code()))
    page = report(summary, machine)
    print(page)
    if arguments.report:
        kept = [{key: value for key, value in row.items() if key not in ("decisions", "trace")} for row in rows]
        text = json.dumps({"machine": machine, "summary": summary, "runs": kept}, indent=1)
        write_atomically(RESULTS / f"{arguments.report}.json", text + "\n")
        write_atomically(RESULTS / f"{arguments.report}.md", page)


if __name__ == "__main__":
    main()
