"""The hot paths one by one: checks, field, relaxed problem, clustering, search, shortening, lower bound.

Each is the median of several repeats, in microseconds a call or an element. ``--save`` keeps the figures under a name,
``--compare`` sets those of this run beside kept ones; a busy machine drifts by a factor of two, so compare runs of the
same minute, and look at the ratio of the reference loop, which uses nothing of trailmark.

    python -m benchmarks.micro [--save NAME] [--compare NAME]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.random_worlds import ROBOTS, random_world
from trailmark.collision import StateChecker
from trailmark.collision.field import build_field
from trailmark.collision.obstacles import build_grid
from trailmark.landmarks import Relaxation, free_samples, k_means_landmarks
from trailmark.motion.pointwise import PointwiseChecker
from trailmark.planning import LandmarkPlanner
from trailmark.planning.proofs import LowerBound
from trailmark.planning.shortening import shorten
from trailmark.roadmap import Roadmap

RESULTS = Path(__file__).resolve().parent / "results" / "micro"
REPEATS = 7


def cases() -> dict[str, tuple[Callable[[], object], int]]:
    """Return what is timed: a call, and by how many elements its time is divided."""
    world = random_world(0, 200, size=100.0)
    checker = StateChecker(world, ROBOTS["rectangle"])
    rng = np.random.default_rng(0)
    q = rng.uniform((0.0, 0.0, -np.pi), (100.0, 100.0, np.pi), (20_000, 3))
    free = q[checker.valid(q)]
    a, b = free[:4000], free[:4000] + rng.uniform(-2.0, 2.0, (4000, 3)) * (1.0, 1.0, 0.2)
    b[:, 2] = (b[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    b[~checker.valid(b)] = a[~checker.valid(b)]
    single = PointwiseChecker(checker)
    rows = [(*p, *r) for p, r in zip(a[:500].tolist(), b[:500].tolist(), strict=True)]
    grid = build_grid(world, checker.grid.size)
    samples = free_samples(checker, 5000, random_state=0)
    planner = LandmarkPlanner(world, checker=checker, seed=0)
    start, goal = free[np.argmin(free[:, :2].sum(axis=1))], free[np.argmax(free[:, :2].sum(axis=1))]
    found = planner.plan(start, goal, 20.0, max_iterations=2)
    assert found.path is not None
    roadmap = Roadmap(checker)
    roadmap.add(samples[:3000])
    roadmap.certify_all()
    bound = LowerBound(world, ROBOTS["rectangle"])
    bound.of(start, goal)
    seeded = np.random.default_rng
    return {
        "reference: a Python loop": (lambda: sum(i * i for i in range(20_000)), 20_000),
        "state, of many": (lambda: checker.valid(q), len(q)),
        "clearance, of many": (lambda: checker.clearance(q[:5000], cap=2.0), 5000),
        "motion, of many": (lambda: checker.motions_between_valid(a, b), len(a)),
        "motion, one a call": (lambda: [single.step_valid(*row) for row in rows], len(rows)),
        "obstacle grid": (lambda: build_grid(world, checker.grid.size), 1),
        "clearance field": (lambda: build_field(grid), 1),
        "relaxed costs": (lambda: Relaxation(checker).costs_from(start), 1),
        "K-means, 5,000 to 500": (
            lambda: k_means_landmarks(samples, 500, radius=checker.footprint.sweep_radius, steps=3, random_state=0),
            1,
        ),
        "roadmap of 3,000, edges by the field": (lambda: Roadmap(checker).add(samples[:3000]), 1),
        "shortest path in it, certified": (lambda: roadmap.shortest_path(0, 1), 1),
        "shortening": (lambda: shorten(roadmap.motion, found.path.states, seeded(0), sweeps=5), 1),  # type: ignore[union-attr]  # there is one
        "lower bound, triangles kept": (lambda: bound.of(start, goal), 1),
        "lower bound, new": (lambda: LowerBound(world, ROBOTS["rectangle"]).of(start, goal), 1),
    }


def measure() -> dict[str, float]:
    """Return microseconds for each case."""
    times = {}
    for name, (call, elements) in cases().items():
        call()
        runs = []
        for _ in range(REPEATS):
            begin = perf_counter()
            call()
            runs.append(perf_counter() - begin)
        times[name] = 1e6 * float(np.median(runs)) / elements
    return times


def main() -> int:
    """Measure, print, keep and compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--save", metavar="NAME")
    parser.add_argument("--compare", metavar="NAME")
    options = parser.parse_args()
    kept: dict[str, float] = {}
    if options.compare is not None:
        file = RESULTS / f"{options.compare}.json"
        if not file.is_file():
            known = ", ".join(sorted(f.stem for f in RESULTS.glob("*.json"))) or "none"
            parser.error(f"--compare {options.compare!r} given, allowed: {known}")
        kept = json.loads(file.read_text())["microseconds"]
    times = measure()
    header = ["hot path", "µs"] + (["before µs", "before / now"] if kept else [])
    rows = []
    for name, time in times.items():
        before = kept.get(name)
        beside = [] if not kept else ["", ""] if before is None else [f"{before:,.2f}", f"{before / time:.2f}"]
        rows.append([name, f"{time:,.2f}", *beside])
    print(markdown_table(header, rows))
    if options.save is not None:
        RESULTS.mkdir(parents=True, exist_ok=True)
        record = {"machine": describe_machine(), "microseconds": times}
        (RESULTS / f"{options.save}.json").write_text(json.dumps(record, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
