"""How fast and how right are StateChecker's verdicts? Writes results/collision.{json,md}.

Throughput against a plain Python loop over FCL in the same run, verdicts on configurations against shapely, and
accepted motions against dense sampling with shapely (benchmarks/oracle.py, which shares no code with the checker).
Half of the motions are refused ones, cut where they nearly touch: there a certificate could be wrong.

    python -m benchmarks.collision [--quick] [--json] [--no-write]
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import fcl
import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.oracle import BAND, Oracle, motion_states
from benchmarks.random_worlds import ROBOTS, random_states, random_world, short_motions
from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.formats.files import write_atomically
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc
from trailmark.world import Robot, World

RESULTS = Path(__file__).resolve().parent / "results"

NAMES = ("disc", "rectangle", "L", "thin")
"""Robots measured, of random_worlds.ROBOTS."""

LEAST_SPEEDUP = 10.0

CHUNK = 400
"""Motions that the referee samples at a time, which bounds its memory."""


def flat_mesh(polygons: list[shapely.Polygon]) -> Any:
    """Return one FCL mesh of flat triangles that fill the polygons."""
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygons))
    corners = shapely.get_coordinates(shapely.get_parts(parts)).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    points = np.column_stack([corners, np.zeros(len(corners))])
    mesh = fcl.BVHModel()
    mesh.beginModel(len(points) // 3, len(points))
    mesh.addSubModel(points, np.arange(len(points)).reshape(-1, 3))
    mesh.endModel()
    return mesh


class FclLoop:
    """The check that a user of python-fcl would write: one mesh of all obstacles, a loop over the states, no bounds."""

    def __init__(self, world: World, robot: Robot) -> None:
        self.obstacles = fcl.CollisionObject(flat_mesh([shape.polygon().shapely() for shape in world.obstacles]))
        disc = isinstance(robot.footprint, Disc)
        shape = fcl.Sphere(robot.circumradius) if disc else flat_mesh([robot.outline.shapely()])
        self.body = fcl.CollisionObject(shape)
        self.request = fcl.CollisionRequest()

    def valid(self, q: FloatArray) -> NDArray[np.bool_]:
        """Return which configurations, shape (n, 3), are free."""
        free = np.empty(len(q), bool)
        for i, (x, y, theta) in enumerate(q.tolist()):
            turn = np.array([math.cos(0.5 * theta), 0.0, 0.0, math.sin(0.5 * theta)])
            self.body.setTransform(fcl.Transform(turn, np.array([x, y, 0.0])))
            free[i] = fcl.collide(self.body, self.obstacles, self.request, fcl.CollisionResult()) == 0
        return free


def measure_states(world: World, name: str, n: int) -> dict[str, Any]:
    """Return throughput and disagreements of ``valid`` on n uniform configurations."""
    robot = ROBOTS[name]
    begin = perf_counter()
    checker = StateChecker(world, robot)
    build = perf_counter() - begin
    loop, oracle = FclLoop(world, robot), Oracle(world, robot)
    q = random_states(world, n, np.random.default_rng(1))
    valid, looped = checker.valid(q), np.empty(n, bool)
    seconds = loop_seconds = 0.0
    # In turns, so that whatever else the machine does slows both down alike.
    for part in np.array_split(np.arange(n), max(1, n // 10_000)):
        begin = perf_counter()
        checker.valid(q[part])
        middle = perf_counter()
        looped[part] = loop.valid(q[part])
        seconds, loop_seconds = seconds + middle - begin, loop_seconds + perf_counter() - middle
    # The loop knows no bounds: it is compared where they play no part.
    low, high = np.add(world.bounds[:2], oracle.reach), np.subtract(world.bounds[2:], oracle.reach)
    inside = ((q[:, :2] > low) & (q[:, :2] < high)).all(axis=1)
    return {
        "robot": name,
        "states": n,
        "free": float(valid.mean()),
        "build_seconds": build,
        "seconds": seconds,
        "loop_seconds": loop_seconds,
        "speedup": loop_seconds / seconds,
        "disagreements_with_shapely": int(oracle.disagrees(q, valid).sum()),
        "loop_disagreements": int((inside & oracle.disagrees(q, looped)).sum()),
    }


def accepted_motions(checker: StateChecker, n: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return n accepted motions, shapes (n, 3), the last half of them refused ones cut where they nearly touch."""
    found: tuple[list[FloatArray], list[FloatArray]] = ([], [])
    halves = (n - n // 2, n // 2)
    while any(sum(map(len, rows)) < half for rows, half in zip(found, halves, strict=True)):
        a, b = short_motions(checker.world, 20_000, rng, 8.0)
        accepted = checker.motions_valid(a, b)
        found[0].append(np.hstack([a, b])[accepted])
        cut = ~accepted & checker.valid(a)
        a, way = a[cut], se2.difference(a[cut], b[cut])
        low, high = np.zeros(len(a)), np.ones(len(a))
        for _ in range(24):
            middle = 0.5 * (low + high)
            free = checker.motions_valid(a, a + middle[:, None] * way)
            low[free], high[~free] = middle[free], middle[~free]
        found[1].append(np.hstack([a, a + low[:, None] * way])[low > 0.0])
    rows = np.concatenate([np.concatenate(part)[:half] for part, half in zip(found, halves, strict=True)])
    return rows[:, :3], rows[:, 3:]


def measure_motions(world: World, name: str, n: int, samples: int) -> dict[str, Any]:
    """Return the time of checking motions, and how many of n accepted ones collide when sampled."""
    checker, oracle = StateChecker(world, ROBOTS[name]), Oracle(world, ROBOTS[name])
    rng = np.random.default_rng(2)
    a, b = short_motions(world, 20_000, rng, 8.0)
    checker.motions_valid(a[:10], b[:10])
    begin = perf_counter()
    share = float(checker.motions_valid(a, b).mean())
    elapsed = perf_counter() - begin
    a, b = accepted_motions(checker, n, rng)
    assert checker.motions_valid(a, b).all()
    begin = perf_counter()
    colliding = 0
    for first in range(0, n, CHUNK):
        states = motion_states(a[first : first + CHUNK], b[first : first + CHUNK], samples)
        hit = oracle.collides(states.reshape(-1, 3)).reshape(states.shape[:2])
        colliding += int(hit.any(axis=1).sum())
    return {
        "robot": name,
        "accepted": n,
        "samples": samples,
        "share_accepted": share,
        "microseconds_per_motion": 1e6 * elapsed / 20_000,
        "collisions": colliding,
        "referee_seconds": perf_counter() - begin,
    }


def tables(record: dict[str, Any]) -> str:
    """Return both tables as Markdown."""
    states = [
        [
            row["robot"],
            f"{row['states']:,}",
            f"{100 * row['free']:.0f} %",
            f"{1e6 * row['seconds'] / row['states']:.2f}",
            f"{1e6 * row['loop_seconds'] / row['states']:.2f}",
            f"{row['speedup']:.1f}",
            str(row["disagreements_with_shapely"]),
            str(row["loop_disagreements"]),
        ]
        for row in record["states"]
    ]
    motions = [
        [
            row["robot"],
            f"{row['accepted']:,}",
            f"{row['samples']}",
            f"{100 * row['share_accepted']:.0f} %",
            f"{row['microseconds_per_motion']:.2f}",
            str(row["collisions"]),
        ]
        for row in record["motions"]
    ]
    header = ["robot", "states", "free", "µs/state", "FCL loop µs/state", "times faster", "wrong", "FCL loop wrong"]
    second = ["robot", "accepted motions", "samples each", "accepted of random ones", "µs/motion", "with a collision"]
    return f"{markdown_table(header, states)}\n\n{markdown_table(second, motions)}"


def write(record: dict[str, Any]) -> None:
    """Write results/collision.json and collision.md."""
    RESULTS.mkdir(exist_ok=True)
    write_atomically(RESULTS / "collision.json", json.dumps(record, indent=1) + "\n")
    text = [
        "# Collision checks",
        "",
        f"Written by `python -m benchmarks.collision`: {record['machine']}.",
        f"World: {record['world']}. Robots: {record['robots']}.",
        "",
        tables(record),
        "",
        f"`wrong`: verdicts that shapely contradicts outside of a band of {BAND:g} m around contact. `FCL loop`: one",
        "`setTransform` and one `fcl.collide` against one mesh of all obstacles for each state, without bounds.",
        "Half of the accepted motions are refused ones, cut where they nearly touch; the referee samples all of them.",
    ]
    write_atomically(RESULTS / "collision.md", "\n".join(text) + "\n")


def main() -> int:
    """Measure, print and write; the exit status is 1 if a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a tenth of the states and a hundredth of the motions")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument("--no-write", action="store_true", help="print only")
    options = parser.parse_args()
    n_states, n_motions = (10_000, 200) if options.quick else (100_000, 20_000)
    world = random_world(0, 200)
    record: dict[str, Any] = {
        "machine": describe_machine(),
        "world": "200 random polygons of 3 to 7 vertices, radius 0.5 to 4 m, on 100 x 100 m",
        "robots": ", ".join(f"{name} ({ROBOTS[name].describe()})" for name in NAMES),
        "band": BAND,
        "states": [],
        "motions": [],
    }
    for name in NAMES:
        record["states"].append(measure_states(world, name, n_states))
        print(f"{name}: states done", file=sys.stderr, flush=True)
    for name in NAMES:
        record["motions"].append(measure_motions(world, name, n_motions, 500))
        print(f"{name}: motions done", file=sys.stderr, flush=True)
    print(json.dumps(record) if options.json else tables(record))
    if not (options.quick or options.no_write):
        write(record)
    wrong = sum(row["disagreements_with_shapely"] for row in record["states"])
    wrong += sum(row["collisions"] for row in record["motions"])
    slow = min(row["speedup"] for row in record["states"]) < LEAST_SPEEDUP
    return 1 if wrong or slow else 0


if __name__ == "__main__":
    raise SystemExit(main())
