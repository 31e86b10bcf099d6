"""Sets of 1 to 100 goals, beside planning to each. Writes results/goals.{json,md}.

In each world a start and 100 goals are drawn at random, valid and not proven to be out of reach. For 1, 10 and 100 of
them, the set is planned to, and, as the oracle, each of its goals by itself: the time to a first path beside that of
the goal which the set's first path leads to, the cost beside the least of all, the gap stated, and whether the best
goal was chosen. All planners are new, so that none knows a path of another's.

    python -m benchmarks.goals [--sets N] [--no-write]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.random_worlds import ROBOTS, random_world
from trailmark import Goal, LandmarkPlanner, World
from trailmark.formats.files import write_atomically
from trailmark.landmarks import free_samples
from trailmark.library import shipped_worlds
from trailmark.se2 import FloatArray

RESULTS = Path(__file__).resolve().parent / "results"

SIZES = (1, 10, 100)

TARGETS = {1: 1.3, 10: 1.3, 100: 2.0}
"""Times a single query's first path that the first path to a set may take, at the median."""

LIMIT, ORACLE_LIMIT = 1.0, 0.1
"""Seconds for a set, and for each of its goals alone."""


def _worlds() -> dict[str, World]:
    worlds = {name: World.load(shipped_worlds()[name]) for name in ("office", "warehouse", "clutter", "maze")}
    worlds["random 200, 2 x 1"] = random_world(0, 200).with_robot(ROBOTS["rectangle"])
    return worlds


def draw_ends(world: World, rng: np.random.Generator, count: int) -> FloatArray:
    """Return a start and goals that are not proven to be out of its reach, shape (count + 1, 3)."""
    planner = LandmarkPlanner(world, seed=0)
    states = free_samples(planner.checker, 3 * count, random_state=rng)
    joined = [q for q in states[1:] if np.isfinite(planner.bound.of(states[0], q).cost)]
    return np.array([states[0], *joined[:count]])


def measure(world: World, seed: int) -> list[dict[str, Any]]:
    """Return what was measured of sets of all sizes from one start."""
    rng = np.random.default_rng(seed)
    start, *poses = draw_ends(world, rng, max(SIZES))
    alone = [LandmarkPlanner(world, seed=seed).plan(start, q, ORACLE_LIMIT) for q in poses]
    rows = []
    for size in SIZES:
        goals = [Goal(tuple(q)) for q in poses[:size]]
        result = LandmarkPlanner(world, seed=seed).plan(start, goals, LIMIT)
        costs = np.array([np.inf if r.cost is None else r.cost for r in alone[:size]])
        firsts = np.array([np.inf if r.cost is None else r.time["first_solution"] for r in alone[:size]])
        best = int(np.argmin(costs))
        rows.append(
            {
                "goals": size,
                "first": result.time["first_solution"] or np.inf,
                "single_first": float(firsts[best]),
                "single_median": float(np.median(firsts)),
                "cost": np.inf if result.cost is None else result.cost,
                "least": float(costs[best]),
                "lower_bound": result.lower_bound,
                "chosen": result.goal is not None and result.goal.index == best,
            }
        )
    return rows


def summarise(rows: list[dict[str, Any]], size: int) -> dict[str, Any]:
    """Return the figures of all sets of one size."""
    some = [row for row in rows if row["goals"] == size]
    column = {
        key: np.array([row[key] for row in some], dtype=np.float64) for key in some[0] if key not in ("chosen", "world")
    }
    excess = column["cost"] / column["least"] - 1.0
    return {
        "goals": size,
        "sets": len(some),
        "first_ms": 1e3 * float(np.median(column["first"])),
        "single_ms": 1e3 * float(np.median(column["single_first"])),
        "median_ms": 1e3 * float(np.median(column["single_median"])),
        "ratio": float(np.median(column["first"]) / np.median(column["single_median"])),
        "ratio_to_best": float(np.median(column["first"]) / np.median(column["single_first"])),
        "chosen": sum(row["chosen"] for row in some),
        "worst_excess": float(excess.max()),
        "median_gap": float(np.median(column["cost"] / column["lower_bound"] - 1.0)),
        "within": bool((column["lower_bound"] <= np.minimum(column["cost"], column["least"]) * (1.0 + 1e-9)).all()),
    }


def report(summaries: list[dict[str, Any]]) -> str:
    """Return the Markdown page."""
    header = ("goals", "sets", "first path", "each alone", "ratio", "target", "the best alone", "ratio", "best chosen")
    proven = ("cost above the best, at most", "stated gap, median", "bounds hold")
    rows = [
        (
            str(s["goals"]),
            str(s["sets"]),
            f"{s['first_ms']:.1f} ms",
            f"{s['median_ms']:.1f} ms",
            f"{s['ratio']:.2f}",
            f"{TARGETS[s['goals']]:g}",
            f"{s['single_ms']:.1f} ms",
            f"{s['ratio_to_best']:.2f}",
            f"{s['chosen']} of {s['sets']}",
            f"{100.0 * s['worst_excess']:.2f} %",
            f"{100.0 * s['median_gap']:.2f} %",
            "yes" if s["within"] else "no",
        )
        for s in summaries
    ]
    text = (
        'Medians over all sets. "Each alone" is the median of a single query\'s first path over the goals of a set, '
        f'"the best alone" that of the goal which costs least. Planning to each alone has {ORACLE_LIMIT:g} s for each '
        f"goal, to a set {LIMIT:g} s for all."
    )
    return f"# Sets of goals\n\n{describe_machine()}\n\n{text}\n\n{markdown_table((*header, *proven), rows)}\n"


def main() -> None:
    """Measure, print, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=4, help="starts in each of the five worlds")
    parser.add_argument("--no-write", action="store_true", help="print only")
    arguments = parser.parse_args()
    rows = []
    for name, world in _worlds().items():
        for seed in range(arguments.sets):
            found = measure(world, seed)
            rows += [{"world": name, "seed": seed, **row} for row in found]
            facts = (f"{r['goals']}: {1e3 * r['first']:.1f} ms, {r['cost']:.3f} of {r['least']:.3f}" for r in found)
            print(f"{name} {seed}: {'; '.join(facts)}", flush=True)
    summaries = [summarise(rows, size) for size in SIZES]
    page = report(summaries)
    print(page)
    if not arguments.no_write:
        record = {"machine": describe_machine(), "summaries": summaries, "sets": rows}
        write_atomically(RESULTS / "goals.json", json.dumps(record, indent=1) + "\n")
        write_atomically(RESULTS / "goals.md", page)


if __name__ == "__main__":
    main()
