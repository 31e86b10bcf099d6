"""How do time and memory grow with the obstacles and with the landmarks? Writes results/growth.{json,md,png}.

Obstacles: random worlds with 10 to 10,000 polygons, as dense as 200 on 100 x 100 m, the robot 2 x 1 m: making the
checker, checking 20,000 states, and the first path of a query from corner to corner. Landmarks: 100 to 100,000 in the
world of 200 polygons: building the roadmap, making it ready for queries, a query's path over it, and a search from node
to node. Each size is measured in a process of its own, so that its memory is its own.

    python -m benchmarks.growth [--quick] [--no-write]
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.random_worlds import ROBOTS, random_states, random_world
from trailmark import LandmarkPlanner
from trailmark.collision import StateChecker
from trailmark.formats.files import write_atomically
from trailmark.landmarks import free_samples
from trailmark.planning import PlanProgress
from trailmark.planning.warmup import warm_up
from trailmark.roadmap.snapshot import RoadmapSnapshot
from trailmark.se2 import FloatArray

RESULTS = Path(__file__).resolve().parent / "results"

OBSTACLES = (10, 30, 100, 300, 1_000, 3_000, 10_000)
LANDMARKS = (100, 300, 1_000, 3_000, 10_000, 30_000, 100_000)

QUERY_SECONDS = 20.0
"""Seconds after which a query without a path is given up."""

STATES, QUERIES = 20_000, 200

LEAST_SIZE = 300
"""Sizes from which on growth is fitted: below, what does not grow at all takes most of the time."""

LEAST_MEMORY = 5.0
"""MB from which on memory is fitted: less may come from what the process had been given before."""

ALLOWED = 1.05
"""Largest exponent of n log n that counts as n log n: what a fit over these sizes can tell."""


class Curve(NamedTuple):
    """What is plotted and fitted.

    Attributes:
        key: of the rows.
        title: what it says.
        unit: of the values.
    """

    key: str
    title: str
    unit: str


BY_OBSTACLES = (
    Curve("checker", "making the checker", "s"),
    Curve("states", f"{STATES:,} states", "s"),
    Curve("query", "a query's first path", "s"),
    Curve("memory", "memory", "MB"),
)
BY_LANDMARKS = (
    Curve("build", "building the roadmap", "s"),
    Curve("ready", "making it ready", "s"),
    Curve("query", "a query's path", "s"),
    Curve("search", "graph search", "s"),
    Curve("memory", "memory", "MB"),
)


def resident() -> float:
    """Return this process's peak of memory since it was last forgotten, MB; NaN where the system does not tell."""
    status = Path("/proc/self/status")
    if not status.exists():
        return math.nan
    row = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
    return float(row.split()[1]) / 1024.0


def forget_peak() -> None:
    """Let the peak of memory start from what is in use now."""
    control = Path("/proc/self/clear_refs")
    if control.exists():
        control.write_text("5")


def by_obstacles(n: int) -> dict[str, float]:
    """Return what n obstacles take."""
    world = random_world(0, n, size=100.0 * math.sqrt(n / 200.0))
    robot = ROBOTS["rectangle"]
    forget_peak()
    before = resident()
    begin = perf_counter()
    checker = StateChecker(world, robot)
    made = perf_counter() - begin
    states = random_states(world, STATES, np.random.default_rng(0))
    begin = perf_counter()
    checker.valid(states)
    checked = perf_counter() - begin
    # From near one corner to near the opposite one.
    ends = free_samples(checker, 4_000, random_state=0)
    ends = ends[np.argsort(ends[:, 0] + ends[:, 1])]
    seconds = [
        first_path(LandmarkPlanner(world, robot, seed=k, checker=checker), ends[k], ends[-1 - k]) for k in range(3)
    ]
    return {"checker": made, "states": checked, "query": float(np.nanmedian(seconds)), "memory": resident() - before}


def first_path(planner: LandmarkPlanner, start: FloatArray, goal: FloatArray) -> float:
    """Return when (seconds) a query had its first path; NaN if it had none in time."""
    found: list[PlanProgress] = []

    def follow(progress: PlanProgress) -> None:
        if progress.cost is not None:
            found.append(progress)

    result = planner.plan(start, goal, QUERY_SECONDS, stop=lambda: bool(found), on_progress=follow)
    seconds = result.time["first_solution"]
    return math.nan if seconds is None else seconds


def by_landmarks(n: int) -> dict[str, float]:
    """Return what n landmarks take."""
    planner = LandmarkPlanner(random_world(0, 200), ROBOTS["rectangle"], seed=0)
    # What is compiled is loaded before the clock runs.
    small = LandmarkPlanner(planner.world, planner.robot, seed=0, checker=planner.checker)
    RoadmapSnapshot(small.build(50))
    forget_peak()
    before = resident()
    begin = perf_counter()
    planner.build(n)
    built = perf_counter() - begin
    begin = perf_counter()
    graph = RoadmapSnapshot(planner.roadmap)
    ready = perf_counter() - begin
    memory = resident() - before
    ends = free_samples(planner.checker, 2 * QUERIES, random_state=1).reshape(-1, 2, 3)
    nodes = np.random.default_rng(1).integers(0, len(graph), (QUERIES, 2)).tolist()
    ways, searches = [], []
    for (start, goal), (i, j) in zip(ends, nodes, strict=True):
        begin = perf_counter()
        graph.find_path(start, goal)
        ways.append(perf_counter() - begin)
        begin = perf_counter()
        graph.between(i, j)
        searches.append(perf_counter() - begin)
    return {
        "build": built,
        "ready": ready,
        "query": float(np.median(ways)),
        "search": float(np.median(searches)),
        "memory": memory,
        "nodes": float(len(graph)),
        "edges": float(len(planner.roadmap.edges)),
    }


def apart(kind: str, n: int) -> dict[str, float]:
    """Return what one size takes, measured in a process of its own."""
    command = [sys.executable, "-m", "benchmarks.growth", "--one", kind, str(n)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300.0)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return {"n": float(n), **found}


def exponent(rows: list[dict[str, float]], key: str) -> float:
    """Return b of a least-squares fit of (n log n)^b to a quantity; NaN if it is not known at three sizes."""
    least = LEAST_MEMORY if key == "memory" else 1e-9
    known = [(r["n"], r[key]) for r in rows if r["n"] >= LEAST_SIZE and least <= r[key] < math.inf]
    if len(known) < 3:
        return math.nan
    n, value = np.array(known).T
    return float(np.polyfit(np.log(n * np.log(n)), np.log(value), 1)[0])


def fits(record: dict[str, Any]) -> list[tuple[str, Curve, float]]:
    """Return the exponents of all curves."""
    found = []
    for kind, curves in (("obstacles", BY_OBSTACLES), ("landmarks", BY_LANDMARKS)):
        found += [(kind, curve, exponent(record[kind], curve.key)) for curve in curves]
    return found


def draw(record: dict[str, Any]) -> bytes:
    """Return the plot as PNG: every curve over its size, with n log n beside it."""
    import io

    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    slopes = {(kind, curve.key): slope for kind, curve, slope in fits(record)}
    for axes, (kind, curves) in zip(
        figure.subplots(1, 2), (("obstacles", BY_OBSTACLES), ("landmarks", BY_LANDMARKS)), strict=True
    ):
        memory = axes.twinx()
        n = np.array([row["n"] for row in record[kind]])
        for i, curve in enumerate(curves):
            values = np.array([row[curve.key] for row in record[kind]])
            on, style = (memory, "--s") if curve.key == "memory" else (axes, "-o")
            label = f"{curve.title} ({slopes[kind, curve.key]:.2f})"
            on.plot(n, values, style, color=f"C{i}", markersize=4, label=label)
        first = np.array([row[curves[0].key] for row in record[kind]])
        guide = n * np.log(n)
        axes.plot(n, first[-1] * guide / guide[-1], ":", color="0.5", label="n log n")
        for side in (axes, memory):
            side.set_xscale("log")
            side.set_yscale("log")
        axes.set_xlabel(kind)
        axes.set_ylabel("seconds")
        memory.set_ylabel("MB (dashed)")
        handles: list[Any] = []
        for side in (axes, memory):
            handles += side.get_legend_handles_labels()[0]
        axes.legend(handles=handles, fontsize=8, loc="upper left", title="fitted exponent of n log n", title_fontsize=8)
        axes.grid(alpha=0.3)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=130, metadata={"Description": describe_machine()})
    return buffer.getvalue()


def text(record: dict[str, Any]) -> str:
    """Return the report as Markdown."""

    def shown(curve: Curve, value: float) -> str:
        if not math.isfinite(value):
            return "-"
        return f"{value:.1f}" if curve.unit == "MB" else f"{1e3 * value:.3g}"

    parts = ["# Growth", "", f"Written by `python -m benchmarks.growth`: {record['machine']}.", ""]
    for kind, curve, slope in fits(record):
        verdict = "reached" if slope <= ALLOWED else "**not reached**"
        parts.append(f"- {verdict}: {kind}, {curve.title}: (n log n)^{slope:.2f}.")
    for kind, curves in (("obstacles", BY_OBSTACLES), ("landmarks", BY_LANDMARKS)):
        header = [kind, *(f"{c.title}, {'MB' if c.unit == 'MB' else 'ms'}" for c in curves)]
        rows = [[f"{int(r['n']):,}", *(shown(c, r[c.key]) for c in curves)] for r in record[kind]]
        parts += ["", markdown_table(header, rows)]
    parts += [
        "",
        f"Exponents are fitted from {LEAST_SIZE} on, those of memory where it is at least {LEAST_MEMORY:g} MB; at most",
        f"{ALLOWED} counts as n log n. Worlds grow with their obstacles, so that the clutter stays the same: a query",
        "from corner to corner has the longer way. Memory is the peak of the process above what it had before.",
        "",
        "![growth](growth.png)",
    ]
    return "\n".join(parts)


def main() -> int:
    """Measure, print and write; the exit status is 1 if something grows faster than n log n."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="leave out the two largest sizes")
    parser.add_argument("--no-write", action="store_true", help="print only")
    parser.add_argument("--one", nargs=2, metavar=("KIND", "N"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one is not None:
        warm_up()
        measure = by_obstacles if options.one[0] == "obstacles" else by_landmarks
        print(json.dumps(measure(int(options.one[1]))))
        return 0
    record: dict[str, Any] = {"machine": describe_machine()}
    for kind, sizes in (("obstacles", OBSTACLES), ("landmarks", LANDMARKS)):
        record[kind] = []
        for n in sizes[: -2 if options.quick else None]:
            begin = perf_counter()
            record[kind].append(apart(kind, n))
            print(f"{kind} {n:,}: {perf_counter() - begin:.0f} s", file=sys.stderr)
    report = text(record)
    print(report)
    if not options.no_write:
        RESULTS.mkdir(exist_ok=True)
        write_atomically(RESULTS / "growth.json", json.dumps(record, indent=1) + "\n")
        write_atomically(RESULTS / "growth.png", draw(record))
        write_atomically(RESULTS / "growth.md", report + "\n")
    return 0 if all(not slope > ALLOWED for _, _, slope in fits(record)) else 1


if __name__ == "__main__":
    sys.exit(main())
