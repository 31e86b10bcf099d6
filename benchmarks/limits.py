"""Are time limits kept? Writes results/limits.{json,md}.

Each query is planned by a fresh planner (its checker, which reads the world, is shared and stands outside of the
limit), alone and, with others, by plan_many without a roadmap, which has to be built within the limit too. What is
told is the processor time of the planning thread above the limit, for plan_many above its limit times the number of
queries: other programs do not disturb it. Worlds: 20,000 random obstacles; maps of 65,000 blocked cells and of a
million cells.

    python -m benchmarks.limits [--quick] [--no-write]
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from time import CLOCK_THREAD_CPUTIME_ID, thread_time
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.random_worlds import ROBOTS, random_world
from trailmark import LandmarkPlanner, clock
from trailmark.collision import StateChecker
from trailmark.formats.files import write_atomically
from trailmark.landmarks import free_samples
from trailmark.planning.warmup import warm_up
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

RESULTS = Path(__file__).resolve().parent / "results"

FloatArray = NDArray[np.float64]

LIMITS, QUERIES, CELL = (0.1, 0.5, 1.0, 3.0), 4, 0.1
"""Seconds, queries of each world, metres."""

PLANNING, BESIDE = ("trailmark.planning.", "trailmark.roadmap."), "trailmark.planning.proofs.enclosure"
"""Modules that read the clock in the planning thread, and one that reads it in a thread of its own."""


def cell_map(cells: int, blocked: int, seed: int = 1) -> World:
    """Return a square map of so many cells a side, of which so many are blocked, in clumps."""
    noise = gaussian_filter(np.random.default_rng(seed).standard_normal((cells, cells)), 2.0)
    rows, columns = np.nonzero(noise >= np.sort(noise.ravel())[-blocked])
    squares = [
        Rectangle(((x + 0.5) * CELL, (y + 0.5) * CELL), CELL, CELL)
        for x, y in zip(columns.tolist(), rows.tolist(), strict=True)
    ]
    return World(f"{cells} x {cells} cells", (0.0, 0.0, cells * CELL, cells * CELL), tuple(squares))


def far_pairs(checker: StateChecker, n: int) -> FloatArray:
    """Return n starts and goals, shape (n, 2, 3), in opposite corners."""
    q = free_samples(checker, 400, random_state=1)
    order = np.argsort(q[:, 0] + q[:, 1]), np.argsort(q[:, 0] - q[:, 1])
    return np.array([[q[order[i % 2][3 * i]], q[order[i % 2][-1 - 3 * i]]] for i in range(n)])


@contextmanager
def by_processor_time() -> Iterator[None]:
    """Have planning read the thread's processor time where it reads the clock."""
    with ExitStack() as stack:
        for name, module in list(sys.modules.items()):
            if name.startswith(PLANNING) and name != BESIDE and hasattr(module, "perf_counter"):
                stack.enter_context(patch.object(module, "perf_counter", thread_time))
        stack.enter_context(patch.object(clock, "KIND", CLOCK_THREAD_CPUTIME_ID))
        yield


def _worlds(quick: bool) -> Iterator[tuple[str, World, Robot]]:
    if quick:
        yield "500 random obstacles", random_world(5, 500, size=150.0), ROBOTS["rectangle"]
        return
    yield "20,000 random obstacles", random_world(5, 20_000, size=1000.0), ROBOTS["rectangle"]
    yield "20,000 random obstacles, disc", random_world(5, 20_000, size=1000.0), ROBOTS["disc"]
    yield "65,000 blocked of 360,000 cells", cell_map(600, 65_000), Robot.rectangle(0.6, 0.4)
    yield "180,000 blocked of 1,000,000 cells", cell_map(1000, 180_000), Robot.rectangle(0.6, 0.4)


HEADER = ("world", "limit, s", "plan: worst above, ms", "solved", "plan_many: above, ms", "solved", "kept")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a small world, nothing is written")
    parser.add_argument("--no-write", action="store_true")
    options = parser.parse_args()
    for kind in ("straight", "translation"):
        warm_up(kind, "many")
    lines = []
    for name, world, robot in _worlds(options.quick):
        checker = StateChecker(world, robot)
        pairs = far_pairs(checker, QUERIES)
        # What is compiled, and what belongs to the world, is there before.
        LandmarkPlanner(world, robot, seed=0, checker=checker).plan(pairs[0, 0], pairs[0, 1], 1.0)
        for limit in LIMITS:
            late, solved = [], 0
            for start, goal in pairs:
                fresh = LandmarkPlanner(world, robot, seed=0, checker=checker)
                with by_processor_time():
                    begin = thread_time()
                    solved += fresh.plan(start, goal, limit).status == "solved"
                    late.append(thread_time() - begin - limit)
            fresh = LandmarkPlanner(world, robot, seed=0, checker=checker)
            with by_processor_time():
                begin = thread_time()
                found = fresh.plan_many(pairs[:, 0], pairs[:, 1], limit)
                over = thread_time() - begin - QUERIES * limit
            kept = max(late) <= max(0.02, 0.05 * limit) and over <= max(0.02, 0.05 * QUERIES * limit)
            some = sum(r.status == "solved" for r in found)
            lines.append(
                [
                    name,
                    f"{limit:g}",
                    f"{1e3 * max(late):+.0f}",
                    f"{solved} of {QUERIES}",
                    f"{1e3 * over:+.0f}",
                    f"{some} of {QUERIES}",
                    "yes" if kept else "no",
                ]
            )
            name = ""
        print(markdown_table(HEADER, lines), flush=True)
    if options.quick or options.no_write:
        return
    about = (__doc__ or "").split("    python")[0].split("\n", 2)[2].strip()
    text = f"# Time limits\n\n{about} Kept: at most 5 % or 20 ms above.\n\n{describe_machine()}.\n\n"
    write_atomically(RESULTS / "limits.md", f"{text}{markdown_table(HEADER, lines)}\n")
    write_atomically(RESULTS / "limits.json", json.dumps({"machine": describe_machine(), "rows": lines}, indent=1))


if __name__ == "__main__":
    main()
