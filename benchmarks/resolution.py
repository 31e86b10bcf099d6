"""Speed against refusals: OMPL's planners at several resolutions of their discrete motion validation.

Ten problems of several kinds; what the referee refuses shows what a resolution misses. Writes results/resolution.md,
the report's table of the sweep.

    python -m benchmarks.resolution [--runs 8] [--time-limit 0.3] [--database FILE.db] [-p native:RRTConnect ...]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from benchmarks.age import ROOT
from benchmarks.machine import describe_machine
from trailmark.benchmark.isolation.executors import local
from trailmark.benchmark.planners import read_planners
from trailmark.benchmark.problems import Problem, problems_of
from trailmark.benchmark.public.catalogue import PUBLIC
from trailmark.benchmark.report.data import load_results
from trailmark.benchmark.report.sweep import sweep_table
from trailmark.benchmark.resolution import Resolution
from trailmark.benchmark.runner import Benchmark
from trailmark.benchmark.store import Store
from trailmark.library import find_world
from trailmark.world import World

SHIPPED = {
    "office": "door",
    "maze": "across",
    "clutter": "corner",
    "warehouse": "far",
    "narrow": "first",
    "environment1": "south-north",
}
MADE = {"passages": 2, "clutter": 2}
"""So many of these suites, spread evenly over their grades."""

SHARES = (0.5, 0.2, 0.1, 0.05, 0.02)
PLANNERS = ("RRTConnect", "PRM", "RRTstar", "BITstar")
MEMORY = 2048.0


def problems() -> list[Problem]:
    """Return the problems, of which each kind has a robot of another size."""
    found = [p for name, query in SHIPPED.items() for p in problems_of(World.load(find_world(name)), queries=[query])]
    for name, count in MADE.items():
        suite = PUBLIC[name]
        for world in suite.worlds(Path(), suite.find(Path()), count, None):
            found += problems_of(world)
    return found


def main() -> int:
    """Run the sweep and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--time-limit", type=float, default=0.3)
    parser.add_argument("--database", type=Path, help="kept, and continued; default: one that is thrown away")
    parser.add_argument("-p", "--planner", action="append", help="default: " + ", ".join(PLANNERS))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = options.database or Path(folder) / "results.db"
        with local(1) as pool, Store(file) as store:
            resolutions = [Resolution(share, share=True) for share in SHARES]
            planners = read_planners(options.planner or PLANNERS)
            runs, limit = options.runs, options.time_limit
            Benchmark(problems(), planners, runs, limit, MEMORY, resolutions=resolutions).run(store, pool)
        table = sweep_table(load_results(file))
    assert table is not None
    how = f"Written by `python -m benchmarks.resolution`: {runs} runs of {limit:g} s of each planner on each problem."
    lines = ["# Speed against refusals", "", how, "", table.caption, ""]
    text = "\n".join([*lines, table.markdown(), "", describe_machine(), ""])
    (ROOT / "benchmarks" / "results" / "resolution.md").write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
