"""What does K-means contribute? Writes results/kmeans.{md,json,png}.

    python -m benchmarks.kmeans [--part limit narrow counts many report] [--seeds 3] [--minutes 15] [--output FILE.db]

Parts, each of which may be run alone; what is there is kept:

- limit: trailmark's methods beside OMPL's planners from Python with trailmark's certified motions, 1 s each, by the
  project's own benchmark (each run in a process of its own, refereed). All in one database: the same command goes on.
- narrow: ``roadmap`` and ``roadmap-uniform`` on worlds of narrow passages, with the same seeds, for a test of chance.
- counts: one query, one roadmap of k landmarks: success and cost against k, and OMPL's PRM and PRM* with k milestones.
- many: a thousand queries on one roadmap of k nodes over all free space: K-means centres, uniform samples, PRM's.
- report: the page, from what is there.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.ablation_problems import ablation_cases
from benchmarks.ahead import Runner, TimeIsUp
from benchmarks.ahead_problems import FIRST_WORLD, Case, random_cases
from benchmarks.ahead_results import FIRST_LIMIT
from benchmarks.kmeans_report import OURS, PARTS, RIVALS, publish
from benchmarks.kmeans_roadmaps import COUNTS, PLACED, feasible, placed_roadmap, prm_roadmaps
from benchmarks.placements import CENTRES, UNIFORM
from trailmark.benchmark.isolation.executors import local
from trailmark.benchmark.problems import Problem
from trailmark.benchmark.public.made_worlds import passage_world
from trailmark.benchmark.store import Store
from trailmark.collision import StateChecker
from trailmark.landmarks import free_samples
from trailmark.planning import LandmarkPlanner
from trailmark.planning.methods import METHODS

__all__ = ["main", "problems"]

Rows = list[dict[str, Any]]

QUERIES = 1000
NARROW_SEEDS, FIRST_PASSAGE = 10, 100
"""Runs of each on each narrow world; the passages' numbers begin beyond those that the planner is developed on."""


def problems(each: int) -> list[Case]:
    """Return problems of robots that move straight, at most ``each`` of a kind of world (the case's group)."""
    found = [case for case in ablation_cases() if case.group != "cars" and case.feasible is not False]
    found += [
        case
        for case in random_cases(each, FIRST_WORLD + 1)
        if case.kind in ("random 50, disc", "random 200, rectangle")
    ]
    groups = list(dict.fromkeys(case.group for case in found))
    return [case for group in groups for case in [other for other in found if other.group == group][:each]]


def narrow_problems(count: int) -> Iterator[Case]:
    """Yield worlds of narrow passages."""
    for seed in range(FIRST_PASSAGE, FIRST_PASSAGE + count):
        yield Case("passages", f"passages {seed}", Problem(passage_world(seed)), feasible=True)


def limit(given: list[Case], options: argparse.Namespace) -> None:
    """Make the missing runs of all planners, seed by seed, until the minutes are over."""
    options.output.parent.mkdir(parents=True, exist_ok=True)
    with local(1) as pool, Store(options.output) as store:
        runner = Runner(store, pool, perf_counter() + 60.0 * options.minutes, "limit")
        try:
            for seed in range(options.seeds):
                runner.run(given, [*OURS, *RIVALS], FIRST_LIMIT, seed)
        except TimeIsUp:
            print("limit: time is up", file=sys.stderr)


def narrow(options: argparse.Namespace) -> Iterator[Rows]:
    """Yield for each world whether either planner has a path in 1 s, seed by seed."""
    for case in narrow_problems(options.narrow):
        checker, rows = StateChecker(case.problem.world, case.problem.robot), Rows()
        for name in OURS[:2]:
            # Loads the kernels, which else the first run would wait for.
            _planned(case, checker, name, NARROW_SEEDS, first=True)
        for seed in range(NARROW_SEEDS):
            row: dict[str, Any] = {"problem": case.kind, "seed": seed}
            # In turns, so that neither always comes first.
            for name in OURS[:2][:: 1 if seed % 2 else -1]:
                found = _planned(case, checker, name, seed, first=True)
                row[name] = found["cost"] is not None
            rows.append(row)
        yield rows


def _planned(
    case: Case, checker: StateChecker, name: str, seed: int, *, count: int | None = None, first: bool = False
) -> dict[str, Any]:
    """Return cost (None without a path) and seconds of one run: of one round of so many landmarks, or for a second."""
    settings, seen = METHODS[name], list[float]()
    if count is not None:
        settings = replace(settings, first_landmarks=count)
    planner = LandmarkPlanner(
        case.problem.world, case.problem.robot, seed=seed, checker=checker, settings=settings, warm=False
    )
    ends = (case.problem.query.start, case.problem.query.pose())
    begin = perf_counter()
    result = planner.plan(
        *ends,
        FIRST_LIMIT if count is None else 30.0,
        max_iterations=None if count is None else 1,
        on_progress=lambda progress: None if progress.cost is None else seen.append(progress.cost),
        stop=lambda: first and bool(seen),
    )
    seconds = result.time["first_solution"]
    return {"cost": result.cost, "seconds": seconds or perf_counter() - begin, "nodes": result.landmarks}


def counts(given: list[Case], options: argparse.Namespace) -> Iterator[Rows]:
    """Yield for each problem, by number of landmarks, planner and seed, what one roadmap answers."""
    for case in given:
        checker, rows = StateChecker(case.problem.world, case.problem.robot), Rows()
        query = np.array([[case.problem.query.start, case.problem.query.pose()]])
        for seed in range(options.seeds):
            about = {"problem": case.problem.key, "group": case.group, "seed": seed}
            for count in COUNTS:
                of = {**about, "k": count}
                rows += [{**of, "planner": name, **_planned(case, checker, name, seed, count=count)} for name in OURS]
            for name in ("PRM", "PRMstar"):
                for roadmap in prm_roadmaps(case.problem, name, seed):
                    (cost,) = roadmap.costs(checker, query)
                    known = float(cost) if np.isfinite(cost) else None
                    rows.append({**about, "k": roadmap.k, "planner": name, "cost": known, "seconds": roadmap.seconds})
        print(f"counts: {case.kind}", file=sys.stderr, flush=True)
        yield rows


def many(given: list[Case], options: argparse.Namespace) -> Iterator[Rows]:
    """Yield for each world, by number of nodes and placement, how many of a thousand queries are answered."""
    for case in given:
        checker, rows = StateChecker(case.problem.world, case.problem.robot), Rows()
        queries = free_samples(checker, 2 * QUERIES, random_state=7).reshape(-1, 2, 3)
        for seed in range(options.seeds):
            found = [
                (name, placed_roadmap(checker, PLACED[name], count, seed))
                for name in (CENTRES, UNIFORM)
                for count in COUNTS
            ]
            found += [("PRM", roadmap) for roadmap in prm_roadmaps(case.problem, "PRM", seed)]
            costs = np.array([roadmap.costs(checker, queries) for _, roadmap in found])
            best = costs.min(axis=0)
            asked = feasible(checker, queries, best)
            for (name, roadmap), cost in zip(found, costs, strict=True):
                answered = asked & np.isfinite(cost)
                rows.append(
                    {
                        **{
                            "problem": case.kind,
                            "seed": seed,
                            "k": roadmap.k,
                            "nodes": name,
                            "queries": int(asked.sum()),
                        },
                        "success": float(answered.sum() / max(1, asked.sum())),
                        "over_best": float(np.median(cost[answered] / best[answered])) if answered.any() else None,
                        "seconds": roadmap.seconds,
                    }
                )
        print(f"many: {case.kind}", file=sys.stderr, flush=True)
        yield rows


def main() -> int:
    """Run the parts that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "trailmark"
    parser.add_argument("--part", nargs="+", choices=[*PARTS, "report"], default=[*PARTS, "report"])
    parser.add_argument(
        "--output", type=Path, default=cache / "kmeans.db", help="the database; other parts lie beside it"
    )
    parser.add_argument("--each", type=int, default=4, help="problems of each kind of world")
    parser.add_argument("--narrow", type=int, default=12, help="narrow worlds")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--minutes", type=float, default=15.0, help="after which the part limit ends")
    parser.add_argument("--no-write", action="store_true", help="print the report only")
    options = parser.parse_args()
    given = problems(options.each)
    if "limit" in options.part:
        limit(given, options)
    parts: dict[str, Callable[[], Iterator[Rows]]] = {
        "narrow": lambda: narrow(options),
        "counts": lambda: counts(given, options),
        "many": lambda: many(_one_of_each(given), options),
    }
    for name, measure in parts.items():
        if name in options.part:
            rows = Rows()
            for more in measure():
                rows += more
                # After each world, so that what ends early leaves what it has.
                options.output.with_suffix(f".{name}.json").write_text(json.dumps(rows), encoding="utf-8")
    if "report" in options.part:
        publish(options.output, given, write=not options.no_write)
    return 0


def _one_of_each(given: list[Case]) -> list[Case]:
    return list({case.group: case for case in reversed(given)}.values())


if __name__ == "__main__":
    raise SystemExit(main())
