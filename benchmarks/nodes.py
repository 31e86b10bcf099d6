"""Are K-means centres good roadmap nodes? Writes results/nodes.{json,md,png}.

The same number of valid nodes, placed in several ways, in 50 worlds (those that ship, and random clutter), for a disc
and a rectangle, with one checker and one neighbour rule (Roadmap.add). Measured are

- dispersion: radius of the largest disc that is empty of nodes and has its centre in free space, in units of √(A/n),
  A being the free area; a lower bound, attained at a centre of a grid's cell (benchmarks.dispersion);
- coverage: share of random valid configurations from which a certified motion leads straight to some node;
- success: share of queries that the roadmap answers. Their ends are random valid configurations that no straight
  motion joins, but a roadmap of REFERENCE uniform nodes does, which proves each query feasible.

    python -m benchmarks.nodes [--quick] [--no-write]

--quick takes a few worlds and writes nothing; the full run takes some minutes on one core.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from benchmarks import nodes_report
from benchmarks.dispersion import coverage, dispersion, free_positions
from benchmarks.machine import describe_machine
from benchmarks.placements import INFORMED, PLACEMENTS, informed
from benchmarks.random_worlds import ROBOTS, random_world
from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.formats.files import write_atomically
from trailmark.landmarks import Relaxation, free_samples
from trailmark.landmarks.band import Band
from trailmark.library import shipped_worlds
from trailmark.planning.warmup import warm_up
from trailmark.roadmap import Roadmap
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

RESULTS = Path(__file__).resolve().parent / "results"

WORLDS, COUNTS, QUERIES = 50, (100, 300, 1000), 8
QUICK_WORLDS, QUICK_COUNTS = 6, (100, 300)

CLUTTER = (30, 80, 140, 200, 260, 320, 400)
"""Obstacles of the random worlds, in turn."""

REFERENCE, ENDS = 3000, 200
"""Nodes of the roadmap that proves queries feasible, and ends to choose from."""

SEEN = 400
"""Configurations that coverage is measured at."""

CELLS = 1 << 15
"""Cells of the grid that dispersion is measured on."""


def settings(quick: bool) -> Iterator[tuple[World, dict[str, Robot]]]:
    """Yield the worlds, each with a disc and a rectangle to measure it for."""
    shipped = [World.load(file) for file in shipped_worlds().values()]
    shipped, count = (shipped[::8], QUICK_WORLDS) if quick else (shipped, WORLDS)
    for world in shipped:
        assert world.robot is not None
        r = world.robot.inscribed_disc.radius
        own = isinstance(world.robot.footprint, Rectangle)
        yield world, {"disc": Robot.disc(r), "rectangle": world.robot if own else Robot.rectangle(3.0 * r, 2.0 * r)}
    for i in range(count - len(shipped)):
        obstacles = CLUTTER[(3 * i if quick else i) % len(CLUTTER)]
        world = random_world(1000 + i, obstacles, discs=0.3, holes=0.1, boundary=i % 3 == 0)
        yield world, {name: ROBOTS[name] for name in ("disc", "rectangle")}


def feasible_queries(checker: StateChecker, count: int, rng: np.random.Generator) -> tuple[se2.FloatArray, int, int]:
    """Return starts and goals, shape (m, 2, 3), how many pairs were looked at, and how many were left undecided."""
    reference = Roadmap(checker)
    reference.add(free_samples(checker, REFERENCE, random_state=rng))
    ends = reference.add(free_samples(checker, ENDS, random_state=rng))
    reference.certify_all()
    joined = reference.edges[reference.certified]
    n = len(reference)
    graph = coo_array((np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(n, n))
    part = connected_components(graph, directed=False)[1]
    pairs = ends[rng.permutation(len(ends))][: len(ends) // 2 * 2].reshape(-1, 2)
    q = reference.configurations[pairs]
    straight = checker.motions_between_valid(np.array(q[:, 0]), np.array(q[:, 1]))
    proven = part[pairs[:, 0]] == part[pairs[:, 1]]
    return q[proven & ~straight][:count], int((~straight).sum()), int((~proven & ~straight).sum())


def answered(base: Roadmap, query: se2.FloatArray) -> bool:
    """Return whether the roadmap joins the query's ends, shape (2, 3); the roadmap itself stays as it is."""
    roadmap = Roadmap.from_arrays(base.checker, base.configurations, base.edges, base.status)
    start, goal = roadmap.add(query)
    return len(roadmap.shortest_path(int(start), int(goal)).nodes) > 0


def measure(world: World, kind: str, robot: Robot, counts: tuple[int, ...], seed: int) -> list[dict[str, Any]]:
    """Return one row per method and number of nodes."""
    checker = StateChecker(world, robot)
    rng = np.random.default_rng(seed)
    free = free_positions(checker, cells=CELLS, headings=8)
    seeing = free_samples(checker, SEEN, random_state=rng)
    queries, looked_at, undecided = feasible_queries(checker, QUERIES, rng)
    about = {"world": world.name, "robot": kind, "pairs": looked_at, "undecided": undecided, "queries": len(queries)}
    rows = []
    for n in counts:
        scale = np.sqrt(free.area / n)
        for method, place in PLACEMENTS.items():
            nodes = place(checker, n, rng)
            roadmap = Roadmap(checker)
            roadmap.add(nodes)
            roadmap.certify_all()
            gap = dispersion(nodes, free)
            rows.append(
                {
                    **about,
                    "n": n,
                    "method": method,
                    "nodes": len(nodes),
                    "dispersion": gap.lower / scale,
                    "error": (gap.upper - gap.lower) / scale,
                    "coverage": float(coverage(checker, nodes, seeing).mean()),
                    "success": float(np.mean([answered(roadmap, query) for query in queries]))
                    if len(queries)
                    else None,
                }
            )
    relaxation = Relaxation(checker)
    hits: dict[int, list[bool]] = defaultdict(list)
    sizes: dict[int, list[int]] = defaultdict(list)
    for query in queries:
        band = Band(checker, relaxation, query[0], query[1])
        for n in counts:
            roadmap = Roadmap(checker)
            roadmap.add(informed(checker, band, n, rng))
            sizes[n].append(len(roadmap))
            hits[n].append(answered(roadmap, query))
    rows += [
        {**about, "n": n, "method": INFORMED, "nodes": float(np.mean(sizes[n])), "success": float(np.mean(hits[n]))}
        for n in hits
    ]
    return rows


def report(rows: list[dict[str, Any]], seconds: float) -> str:
    """Return the Markdown page."""
    table = nodes_report.Table(rows)
    worlds, settings_ = len({row["world"] for row in rows}), {(row["world"], row["robot"]): row for row in rows}
    pairs, undecided = (sum(row[key] for row in settings_.values()) for key in ("pairs", "undecided"))
    queries = sum(row["queries"] for row in settings_.values())
    placed = [row["nodes"] / row["n"] for row in rows]
    error = np.median([row["error"] for row in rows if "error" in row])
    return f"""# Are K-means centres good roadmap nodes?

Written by `python -m benchmarks.nodes`.

**{nodes_report.verdict(table)}**

![dispersion, coverage and success against the number of nodes](nodes.png)

{worlds} worlds (the shipped ones and random clutter), each for a disc and a rectangle; {queries} feasible queries.
Means over the worlds with 95 % bootstrap intervals (worlds are resampled).

{nodes_report.markdown(nodes_report.means(table), "nodes")}

K-means centres minus the others, world by world, with 99 % bootstrap intervals; a star where that excludes 0.
Less dispersion, more coverage and more success are better. Intervals are not corrected for their number.

{nodes_report.markdown(nodes_report.differences(table), "K-means centres minus", signed=True)}

- Every placement gets the same checker, the same neighbour rule (`Roadmap.add`: PRM*'s bound) and valid nodes only;
  each placed {100 * min(placed):.1f} to 100 % of the n asked for.
- Uniform samples, Halton points (scrambled) and trailmark's landmarks (`LandmarkPlanner.build`: K-means over positions
  and headings) are configurations. Lattice and K-means centres are positions, each with a random valid heading; the
  centres are those of Algorithm 1 (Forgy's start, until no point changes cluster) on ten uniform valid samples per
  centre, and one that is valid at no heading tried is replaced by its nearest sample.
- Informed by the query: landmarks in bands around the query's relaxed shortest path, placed anew for each query. They
  answer no other, so dispersion and coverage say nothing of them.
- Dispersion: radius of the largest disc empty of nodes with its centre at a free position, in units of √(A/n), A the
  free area; regular hexagons have 0.62. A lower bound on a grid of {CELLS} cells; the median distance to its proven
  upper bound is {error:.2f}.
- Coverage: share of {SEEN} random valid configurations that a certified motion joins straight to some node.
- Success: share of queries answered. A query's ends are random valid configurations that no straight motion joins, but
  a roadmap of {REFERENCE} uniform nodes does; it left {undecided} of {pairs} pairs undecided, which are not counted.
- {seconds:.0f} s on one core; {describe_machine()}
"""


def main() -> int:
    """Measure, print the tables, and write them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_WORLDS} worlds, n up to 300; writes nothing")
    parser.add_argument("--no-write", action="store_true", help="print only")
    options = parser.parse_args()
    warm_up()
    begin, cpu = perf_counter(), process_time()
    rows: list[dict[str, Any]] = []
    worlds = list(settings(options.quick))
    for i, (world, robots) in enumerate(worlds):
        for kind, robot in robots.items():
            rows += measure(world, kind, robot, QUICK_COUNTS if options.quick else COUNTS, seed=i)
        print(f"{i + 1}/{len(worlds)} {world.name}: {perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)
    page = report(rows, process_time() - cpu)
    print(page)
    if not (options.quick or options.no_write):
        RESULTS.mkdir(exist_ok=True)
        table = nodes_report.Table(rows)
        record = {
            "machine": describe_machine(),
            "means": [found._asdict() for found in nodes_report.means(table)],
            "differences": [found._asdict() for found in nodes_report.differences(table)],
        }
        write_atomically(RESULTS / "nodes.json", json.dumps(record, indent=1) + "\n")
        write_atomically(RESULTS / "nodes.png", nodes_report.draw(table))
        write_atomically(RESULTS / "nodes.md", page)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
