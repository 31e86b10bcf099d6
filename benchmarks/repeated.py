"""Does a kept roadmap slow the planner? Writes results/repeated.{json,md}.

One planner answers query after query and keeps its roadmap; a fresh one answers each of them from nothing. Both take
turns, in one process, with one checker. Queries are one and the same, again and again, or random ones whose ends the
relaxed problem may join and no straight motion does. Measured are, in parts of the run:

- the processor time to the first path, kept and fresh (medians), and the two's ratio (geometric mean);
- nodes and edges that searches took until then (means): counted work, which no other program disturbs;
- the ratio of the costs at the end of the limit (geometric mean), below 1 if the kept planner's paths are cheaper;
- nodes and edges of the kept roadmap at the end of the part.

    python -m benchmarks.repeated [--quick] [--no-write]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from time import thread_time
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.random_worlds import ROBOTS, random_world
from trailmark import LandmarkPlanner, PlanResult
from trailmark.formats.files import write_atomically
from trailmark.landmarks import free_samples
from trailmark.library import shipped_worlds
from trailmark.planning import incumbent as incumbent_module
from trailmark.planning import query as query_module
from trailmark.planning import single_query as planner_module
from trailmark.planning.proofs import LowerBound
from trailmark.planning.query import Query
from trailmark.planning.result import Status
from trailmark.planning.solve import solve
from trailmark.world import World

__all__ = ["Asked", "ask", "random_pairs"]

RESULTS = Path(__file__).resolve().parent / "results"

FloatArray = NDArray[np.float64]

REPEATED, RANDOM, PARTS, LIMIT = 300, 3_000, 6, 0.05
"""Queries of each kind, parts that are told apart, seconds for each query."""

OFFICE = ("office", "door")
"""The world and query whose first path took 42 ms after 180 times."""


class Asked(NamedTuple):
    """What came of one query.

    Attributes:
        result: the answer.
        effort: nodes and edges that searches took until the first path, or in all.
    """

    result: PlanResult
    effort: int


def ask(planner: LandmarkPlanner, start: FloatArray, goal: FloatArray, limit: float, **options: Any) -> Asked:
    """Plan, and count the work; times are the thread's own, which other programs do not disturb."""
    queries: list[Query] = []

    def counted(query: Query, bound: LowerBound | None, known: FloatArray | None = None) -> Status:
        queries.append(query)
        return solve(query, bound, known)

    with ExitStack() as stack:
        stack.enter_context(patch.object(planner_module, "solve", counted))
        for module in (planner_module, query_module, incumbent_module):
            stack.enter_context(patch.object(module, "perf_counter", thread_time))
        result = planner.plan(start, goal, limit, **options)
    (query,) = queries
    return Asked(result, query.effort if query.incumbent.history else query.expanded())


def random_pairs(planner: LandmarkPlanner, n: int, seed: int) -> FloatArray:
    """Return n starts and goals, shape (n, 2, 3), that the relaxed problem may join, and no straight motion does."""
    pairs, have, rng = [np.empty((0, 2, 3))], 0, np.random.default_rng(seed)
    relaxation = planner.relaxation
    while have < n:
        q = free_samples(planner.checker, 4 * (n - have) + 64, random_state=rng)
        reached = relaxation.component(q[0])
        q = q[reached[relaxation.cells(relaxation.disc_centers(q))]]
        q = q[: len(q) // 2 * 2].reshape(-1, 2, 3)
        found = q[~planner.checker.motions_between_valid(q[:, 0], q[:, 1])]
        pairs.append(found)
        have += len(found)
    return np.concatenate(pairs)[:n]


def _problems(quick: bool) -> Iterator[tuple[str, LandmarkPlanner, FloatArray]]:
    """Yield the name, the planner that keeps its roadmap, and the queries of each problem."""
    office = World.load(shipped_worlds()[OFFICE[0]])
    door = next(q for q in office.queries if q.name == OFFICE[1])
    few, many = (12, 24) if quick else (REPEATED, RANDOM)
    yield (
        f"{OFFICE[0]}, {OFFICE[1]} again and again",
        LandmarkPlanner(office, seed=0),
        np.array([[door.start, door.goal]] * few),
    )
    planner = LandmarkPlanner(office, seed=0)
    yield "office, random queries", planner, random_pairs(planner, many, 1)
    for name, obstacles in (("rectangle", 200), ("L", 200), ("disc", 300)):
        planner = LandmarkPlanner(random_world(3, obstacles), ROBOTS[name], seed=0)
        pairs = random_pairs(planner, many // 3, 2)
        yield f"{obstacles} random obstacles, {name}, again and again", planner, np.repeat(pairs[:1], few, axis=0)
        planner = LandmarkPlanner(planner.world, planner.robot, seed=0, checker=planner.checker)
        yield f"{obstacles} random obstacles, {name}, random queries", planner, pairs


def _run(kept: LandmarkPlanner, pairs: FloatArray) -> list[dict[str, Any]]:
    rows = []
    for i, (start, goal) in enumerate(pairs):
        fresh = LandmarkPlanner(kept.world, kept.robot, seed=i, checker=kept.checker)
        # The grid of the relaxed problem belongs to the world, as the checker does.
        fresh._model.bound, fresh._model.relaxation = kept.bound, kept.relaxation
        # By turns: whoever comes first finds the caches cold.
        order = [("kept", kept), ("fresh", fresh)][:: 1 if i % 2 else -1]
        asked = {name: ask(planner, start, goal, LIMIT) for name, planner in order}
        row: dict[str, Any] = {"nodes": len(kept.roadmap), "edges": len(kept.roadmap.edges)}
        for name, (result, effort) in asked.items():
            row[name] = {"first": result.time["first_solution"], "cost": result.cost, "effort": effort}
        rows.append(row)
    return rows


def _summary(name: str, rows: list[dict[str, Any]]) -> list[list[str]]:
    lines = []
    for part in np.array_split(np.arange(len(rows)), PARTS):
        some = [rows[i] for i in part]
        both = [r for r in some if r["kept"]["first"] is not None and r["fresh"]["first"] is not None]
        first = {k: np.array([r[k]["first"] for r in both]) for k in ("kept", "fresh")}
        cost = {k: np.array([r[k]["cost"] for r in both]) for k in ("kept", "fresh")}
        effort = {k: np.mean([r[k]["effort"] for r in some]) for k in ("kept", "fresh")}
        solved = {k: sum(r[k]["first"] is not None for r in some) for k in ("kept", "fresh")}
        lines.append(
            [
                name,
                f"{part[0] + 1} to {part[-1] + 1}",
                f"{solved['kept']} / {solved['fresh']}",
                f"{1e3 * np.median(first['kept']):.2f} / {1e3 * np.median(first['fresh']):.2f}",
                f"{np.exp(np.log(first['kept'] / first['fresh']).mean()):.2f}",
                f"{effort['kept']:.0f} / {effort['fresh']:.0f}",
                f"{np.exp(np.log(cost['kept'] / cost['fresh']).mean()):.4f}",
                f"{some[-1]['nodes']:,} / {some[-1]['edges']:,}",
            ]
        )
        name = ""
    return lines


HEADER = (
    "problem",
    "queries",
    "solved, kept / fresh",
    "first path, ms",
    "ratio",
    "taken",
    "cost, ratio",
    "nodes / edges kept",
)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a few queries, nothing is written")
    parser.add_argument("--no-write", action="store_true")
    options = parser.parse_args()
    lines, records = [], {}
    for name, planner, pairs in _problems(options.quick):
        records[name] = _run(planner, pairs)
        lines += _summary(name, records[name])
        print(markdown_table(HEADER, lines), flush=True)
    if options.quick or options.no_write:
        return
    text = (
        f"# Queries on a kept roadmap, and on none\n\n{__doc__.split('    python')[0].split(chr(10), 2)[2].strip()}\n\n"
    )
    text += f"{LIMIT} s for each query. {describe_machine()}.\n\n{markdown_table(HEADER, lines)}\n"
    write_atomically(RESULTS / "repeated.md", text.encode())
    write_atomically(RESULTS / "repeated.json", json.dumps({"machine": describe_machine(), "rows": lines}).encode())


if __name__ == "__main__":
    main()
