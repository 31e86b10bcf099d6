"""Is an audit of a path ever wrong, and how long does it take? Writes results/check.{json,md}.

Random paths of six robots in random worlds, half of them colliding: a motion that goes past a place where the robot
touches something is moved towards it, or away from it, by 1e-5 to 1 m. The referee is shapely alone
(benchmarks/oracle.py, which shares no code with the audit): a path is free if distances cover all of it, and collides
if a state does; paths that stay within 1e-6 m of touching are left out. Least clearances and colliding intervals are
compared, too.

    python -m benchmarks.check [--paths 100000] [--json] [--no-write]
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.oracle import BAND, Oracle, motion_states
from benchmarks.random_worlds import ROBOTS, random_states, random_world
from trailmark import LandmarkPlanner, PathAuditor, StateChecker
from trailmark.formats.files import write_atomically
from trailmark.library import find_world
from trailmark.path import Path as RobotPath
from trailmark.se2 import FloatArray
from trailmark.world import World

RESULTS = Path(__file__).resolve().parent / "results"

PATHS_PER_WORLD = 500
SAMPLES = 30
"""States of a path at which intervals and least clearance are compared."""

EFFORT = 2_000
"""States that the referee looks at before it leaves a path undecided."""

DEPTHS = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)
"""Metres: borders of the rows that paths are counted in, by how far they were moved."""

WORLDS = ("warehouse", "office", "maze", "long", "clutter")
LENGTH = 50.0
"""Metres of the paths that are timed, of those that are so long."""


def motion_bound(a: FloatArray, b: FloatArray, reach: float) -> float:
    """Return how far the motion from a to b, each of shape (3,), moves any point of the robot at most."""
    turn = abs((b[2] - a[2] + np.pi) % (2.0 * np.pi) - np.pi)
    return float(np.hypot(*(b - a)[:2]) + reach * turn)


def truth(oracle: Oracle, states: FloatArray) -> bool | None:
    """Return whether a path, shape (n, 3), is free, by distances and states alone; None if that is not decided."""
    if oracle.collides(states).any():
        return False
    spent = 0
    for a, b in pairwise(states):
        bound = motion_bound(a, b, oracle.reach)
        gaps = np.array([[0.0, bound]]) if bound > 0.0 else np.empty((0, 2))
        while len(gaps):
            spent += len(gaps)
            if spent > EFFORT:
                return None
            middle, half = gaps.mean(axis=1), 0.5 * np.diff(gaps, axis=1)[:, 0]
            way = motion_states(a[None], b[None], 2)[0]
            q = way[0] + (middle / bound)[:, None] * (way[1] - way[0])
            if oracle.collides(q).any():
                return False
            d = np.minimum(oracle.clearance(q), half)
            left = (d < half) & (half > 1e-9)
            if (half <= 1e-9).any():
                return None  # nowhere beyond the band, nowhere free: touching
            gaps = np.concatenate(
                [
                    np.column_stack([gaps[left, 0], (middle - d)[left]]),
                    np.column_stack([(middle + d)[left], gaps[left, 1]]),
                ]
            )
    return True


def contacts(checker: StateChecker, n: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return free states at which the robot touches something, shape (m, 3), m <= n, and where each came from."""
    q = random_states(checker.world, n, rng)
    angle = rng.uniform(-np.pi, np.pi, n)
    way = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    gap = checker.clearance(q)
    q, way = q[gap > 0.0], way[gap > 0.0]
    for _ in range(60):
        gap = checker.clearance(q)
        q = q + gap[:, None] * way
    return q[gap < 1e-9], way[gap < 1e-9]


def random_path(q: FloatArray, way: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, float]:
    """Return a path that comes near to a contact, shape (n, 3), and by how much it was moved towards it."""
    moved = float(np.exp(rng.uniform(np.log(DEPTHS[0]), np.log(DEPTHS[-1]))))
    towards = rng.random() < 0.2
    length = min(4.0, moved * float(np.exp(rng.uniform(np.log(0.3), np.log(3e3 if towards else 300.0)))))
    moved *= 1.0 if towards else -1.0
    angle, turn = rng.uniform(-np.pi, np.pi), rng.normal(0.0, 0.5) * (rng.random() < 0.6)
    along = length * np.array([np.cos(angle), np.sin(angle), turn])
    middle, share = q + moved * way, rng.random()
    states = [middle - share * along, middle + (1.0 - share) * along]
    if rng.random() < 0.5:
        states.append(states[-1] + length * np.array([*rng.normal(0.0, 0.5, 2), rng.normal(0.0, 0.5)]))
    return np.array(states), moved


def compare(oracle: Oracle, auditor: PathAuditor, states: FloatArray, free: bool) -> list[str]:
    """Return what of an audit shapely contradicts: nothing, ``verdict``, ``interval``, ``clearance``."""
    audit = auditor.audit(states)
    if audit.free != free:
        return ["verdict"]
    wrong = []
    shares = np.linspace(0.0, 1.0, SAMPLES)
    rows = motion_states(states[:-1], states[1:], SAMPLES).reshape(-1, 3)
    if free:
        least = float(oracle.clearance(rows).min())
        there = float(oracle.clearance(np.array([audit.min_clearance_state]))[0])
        if audit.min_clearance > least + BAND or abs(there - audit.min_clearance) > BAND:
            wrong.append("clearance")
        return wrong
    places = (np.arange(len(states) - 1)[:, None] + shares).ravel()
    covered = np.zeros(len(places), bool)
    slack = 1e-4
    for hit in audit.collisions:
        covered |= (places >= hit.motions[0] - slack) & (places <= hit.motions[1] + slack)
    if (oracle.collides(rows) & ~covered).any():
        wrong.append("interval")
    inside = np.zeros(len(places), bool)
    for hit in audit.collisions:
        inside |= (places > hit.motions[0] + slack) & (places < hit.motions[1] - slack)
    if (inside & (oracle.clearance(rows) > BAND)).any():
        wrong.append("interval")
    return wrong


def measure_verdicts(n: int) -> dict[str, Any]:
    """Return how many audits of n random paths shapely contradicts, and in what."""
    rng = np.random.default_rng(0)
    wanted = {True: n // 2, False: n - n // 2}
    counted: Counter[tuple[bool, int]] = Counter()
    wrong: Counter[str] = Counter()
    examples: list[Any] = []
    undecided, seed = 0, 0
    while sum(wanted.values()):
        world = random_world(seed, 25, size=25.0, radii=(0.3, 2.5), discs=0.2, holes=0.2, boundary=seed % 3 == 0)
        name = list(ROBOTS)[seed % len(ROBOTS)]
        oracle, auditor = Oracle(world, ROBOTS[name]), PathAuditor(StateChecker(world, ROBOTS[name]))
        for q, way in zip(*contacts(auditor.checker, PATHS_PER_WORLD, rng), strict=True):
            states, moved = random_path(q, way, rng)
            free = truth(oracle, states)
            undecided += free is None
            if free is None or wanted[free] == 0:
                continue
            wanted[free] -= 1
            problems = compare(oracle, auditor, states, free)
            counted[free, int(np.searchsorted(DEPTHS, abs(moved), side="right")) - 1] += 1
            wrong.update(problems)
            if problems and len(examples) < 20:
                examples.append({"seed": seed, "robot": name, "states": states.tolist(), "wrong": problems})
        seed += 1
        if seed % 20 == 0:
            left = sum(wanted.values())
            print(f"{n - left:,} of {n:,} paths, wrong: {dict(wrong)}", file=sys.stderr, flush=True)
    rows = [
        {"from": low, "to": high, "free": counted[True, k], "collides": counted[False, k]}
        for k, (low, high) in enumerate(pairwise(DEPTHS))
    ]
    return {
        "paths": n,
        "worlds": seed,
        "undecided": undecided,
        "wrong": {kind: wrong[kind] for kind in ("verdict", "interval", "clearance")},
        "by_shift": rows,
        "examples": examples,
    }


def measure_times(repeats: int = 200) -> list[dict[str, Any]]:
    """Return how long audits of planned paths take, which come as near to obstacles as it pays."""
    rows = []
    for name in WORLDS:
        world = World.load(find_world(name))
        query = world.query()
        assert world.robot is not None
        path = LandmarkPlanner(world, world.robot, seed=0).plan(query.start, query.goal, time_limit=1.0).path
        assert path is not None
        if path.length > LENGTH:
            path = _beginning(path)
        auditor = PathAuditor(StateChecker(world, world.robot))
        audit = auditor.audit(path)
        seconds = np.array([_timed(auditor, path) for _ in range(repeats)])
        rows.append(
            {
                "world": name,
                "length": path.length,
                "states": len(path),
                "obstacles": len(world.obstacles),
                "min_clearance": audit.min_clearance,
                "free": audit.free,
                "ms_median": 1e3 * float(np.median(seconds)),
                "ms_95": 1e3 * float(np.quantile(seconds, 0.95)),
            }
        )
    return rows


def _beginning(path: RobotPath) -> RobotPath:
    """Return the first LENGTH metres of a path, as driven."""
    steps = np.hypot(*np.diff(path.states[:, :2], axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    k = int(np.searchsorted(along, LENGTH)) - 1
    last = RobotPath(path.states[k : k + 2])
    share = (LENGTH - along[k]) / steps[k]
    return RobotPath(np.vstack([path.states[: k + 1], last.at(share)]))


def _timed(auditor: PathAuditor, path: RobotPath) -> float:
    begun = perf_counter()
    auditor.audit(path)
    return perf_counter() - begun


def tables(record: dict[str, Any]) -> str:
    """Return both tables as Markdown."""
    verdicts = [
        [f"{row['from']:g} to {row['to']:g}", f"{row['free']:,}", f"{row['collides']:,}"]
        for row in record["verdicts"]["by_shift"]
    ]
    times = [
        [
            row["world"],
            f"{row['length']:.1f}",
            str(row["states"]),
            f"{row['obstacles']:,}",
            f"{row['min_clearance']:.1e}",
            f"{row['ms_median']:.2f}",
            f"{row['ms_95']:.2f}",
        ]
        for row in record["times"]
    ]
    header = ["world", "metres", "states", "obstacles", "least clearance (m)", "ms, median", "ms, 95th percentile"]
    wrong = record["verdicts"]["wrong"]
    return "\n".join(
        [
            f"{record['verdicts']['paths']:,} random paths, wrong: {wrong['verdict']} verdicts, {wrong['interval']} "
            f"colliding intervals, {wrong['clearance']} least clearances.",
            "",
            markdown_table(["moved by (m)", "free", "collides"], verdicts),
            "",
            markdown_table(header, times),
        ]
    )


def write(record: dict[str, Any]) -> None:
    """Write results/check.{json,md}."""
    write_atomically(RESULTS / "check.json", json.dumps(record, indent=1) + "\n")
    text = [
        "# Audits of paths",
        "",
        f"Written by `python -m benchmarks.check`: {record['machine']}.",
        "",
        tables(record),
        "",
        f"Referee: shapely. {record['verdicts']['undecided']:,} more paths stay within {BAND:g} m of touching, or take",
        f"it {EFFORT:,} states and more; they are left out. Robots: disc, rectangle, L, thin, star, and one beside its",
        "reference point; 25 obstacles (discs, polygons, some with holes) in each world, every third with a boundary.",
        "Times: verdict and least clearance of paths that the planner shortened, hence as near to obstacles as it",
        "pays; the 95th percentile on a machine that did other work as well.",
    ]
    write_atomically(RESULTS / "check.md", "\n".join(text) + "\n")


def main() -> int:
    """Measure, print and write; the exit status is 1 if anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--paths", type=int, default=100_000, help="number of random paths")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of tables")
    parser.add_argument("--no-write", action="store_true", help="print only")
    options = parser.parse_args()
    record = {
        "machine": describe_machine(),
        "times": measure_times(),
        "verdicts": measure_verdicts(options.paths),
    }
    print(json.dumps(record) if options.json else tables(record))
    if not options.no_write:
        write(record)
    return 1 if sum(record["verdicts"]["wrong"].values()) else 0  # type: ignore[index]  # a dict of dicts


if __name__ == "__main__":
    raise SystemExit(main())
