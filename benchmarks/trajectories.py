"""Smoothed paths before the referee, and trajectories beside those of TOPP-RA on a finer grid.

Random paths in random worlds of a rectangle, a disc and two cars, one that reverses and one that does not: half of the
paths of straight motions are pulled tight first, so that they touch what they pass. Each is smoothed and judged by the
referee, which samples densely and shares no code with the certificate. Of every fiftieth the trajectory is sampled for
speeds and accelerations beyond the limits, and its duration compared with TOPP-RA's, with four times as many intervals
and a circle of 64 sides for the acceleration's norm, which allows up to 0.12 % more.

Run it from a checkout, with toppra installed (``pip install toppra``; without it the comparison is left out):

    python -m benchmarks.trajectories [--cases 10000] [--workers 2] [--output benchmarks/results/trajectories]
"""

from __future__ import annotations

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.random_worlds import random_states, random_world
from trailmark import CurvePath, Path, Robot, StateChecker, World, se2
from trailmark.benchmark.referee import Referee
from trailmark.motion import motion_of
from trailmark.trajectories import Limits, Trajectory
from trailmark.trajectories.pieces import joined

KINDS = {
    "rectangle": Robot.rectangle(2.0, 1.0),
    "disc": Robot.disc(0.6),
    "car": Robot.rectangle(2.0, 1.0).steered(2.0),
    "forward car": Robot.rectangle(2.0, 1.0).steered(2.0, reverse=False),
}

BATCH = 50
"""Paths in one world; the last of them gets a trajectory that is looked into."""

CORNERS, TRIES, REACH = 6, 400, 12.0
"""Motions of a path; states that are tried as the end of the next; metres that it may be away."""

OBSTACLES, SIZE = 25, 40.0
"""Of a world: how many, and the edge of its bounds in metres."""

SAMPLES, SIDES, FINER = 50_000, 64, 4


def random_path(checker: StateChecker, rng: np.random.Generator) -> Path:
    """Return a path of certified motions through random places; perhaps of one state."""
    motion = motion_of(checker)
    states = random_states(checker.world, TRIES, rng)
    states = states[np.asarray(checker.valid(states))]
    knots = [states[0]]
    for _ in range(CORNERS):
        near = states[np.hypot(*(states - knots[-1])[:, :2].T) < REACH]
        free = motion.motions_valid(np.repeat(knots[-1][None], len(near), axis=0), near)
        if not free.any():
            break
        knots.append(near[rng.choice(np.flatnonzero(free))])
    path = np.array(knots)
    if checker.robot.turning_radius is None and rng.random() < 0.5:
        path = pulled(checker, path)
    return motion.path(path)


def pulled(checker: StateChecker, states: np.ndarray) -> np.ndarray:
    """Return a path whose corners are moved towards the line between their neighbours until they touch something."""
    states = states.copy()
    for i in range(1, len(states) - 1):
        wanted = se2.interpolate(states[i - 1], states[i + 1], 0.5)
        low, high = 0.0, 1.0
        for _ in range(20):
            middle = 0.5 * (low + high)
            corner = se2.interpolate(states[i], wanted, middle)
            ends = np.array([states[i - 1], corner]), np.array([corner, states[i + 1]])
            low, high = (middle, high) if checker.motions_valid(*ends).all() else (low, middle)
        states[i] = se2.interpolate(states[i], wanted, low)
    return states


def excess(trajectory: Trajectory) -> float:
    """Return the largest speed or acceleration, by finite differences, as a share of its limit."""
    limits, t = trajectory.limits, np.linspace(0.0, trajectory.duration, SAMPLES)
    q, dq, dt = trajectory.at(t), trajectory.velocity(t), t[1] - t[0]
    moved, change = se2.difference(q[:-1], q[1:]) / dt, np.diff(dq, axis=0) / dt
    shares = [
        np.hypot(*moved[:, :2].T).max() / limits.max_speed,
        np.abs(moved[:, 2]).max() / limits.max_turn_rate,
        np.hypot(*change[:, :2].T).max() / limits.max_acceleration,
    ]
    if limits.max_turn_acceleration is not None:
        shares.append(np.abs(change[:, 2]).max() / limits.max_turn_acceleration)
    return float(max(shares))


def toppra_duration(trajectory: Trajectory) -> float | None:
    """Return the duration that TOPP-RA finds for the same path and limits, stretch by stretch between stops."""
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import DiscretizationType, LinearConstraint

    toppra.setup_logging("ERROR")
    pieces, limits = trajectory.pieces, trajectory.limits

    class Stretch(toppra.interpolator.AbstractGeometricPath):  # type: ignore[misc]  # without types
        """Some of the path's pieces, one after the other."""

        dof = 3

        def __init__(self, rows: np.ndarray) -> None:
            self.rows, self.ends = rows, np.cumsum(pieces.length[rows])

        @property
        def path_interval(self) -> np.ndarray:
            return np.array([0.0, self.ends[-1]])

        def __call__(self, s: Any, order: int = 0) -> Any:
            places = np.atleast_1d(np.asarray(s, dtype=float))
            k = np.clip(np.searchsorted(self.ends, places, side="right"), 0, len(self.rows) - 1)
            inside = np.clip(places - (self.ends[k] - pieces.length[self.rows[k]]), 0.0, pieces.length[self.rows[k]])
            found = (pieces.states, lambda p, z: pieces.derivatives(p, z)[0], lambda p, z: pieces.derivatives(p, z)[1])
            return found[order](self.rows[k], inside).reshape(*np.shape(s), 3)

    class Bounds(LinearConstraint):  # type: ignore[misc]  # without types
        """The limits, the norm of the acceleration by a polygon about its circle."""

        def __init__(self) -> None:
            super().__init__()
            self.discretization_type, self.identical = DiscretizationType.Collocation, True

        def compute_constraint_params(self, path: Any, grid: np.ndarray, *args: Any, **words: Any) -> Any:
            first, second = path(grid, 1), path(grid, 2)
            angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
            rows = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(SIDES)])
            allowed = np.full(SIDES, limits.max_acceleration)
            if limits.max_turn_acceleration is not None:
                rows = np.vstack([rows, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
                allowed = np.append(allowed, [limits.max_turn_acceleration] * 2)
            with np.errstate(divide="ignore"):
                top = np.minimum(
                    limits.max_speed**2 / (first[:, :2] ** 2).sum(axis=1), (limits.max_turn_rate / first[:, 2]) ** 2
                )
            bound = np.column_stack([np.zeros(len(grid)), top])
            return first, second, np.zeros_like(first), rows, allowed, None, bound

    smooth = limits.max_turn_acceleration is not None or not isinstance(trajectory.path, CurvePath)
    stops = np.flatnonzero(~joined(pieces, smooth)) + 1
    total = 0.0
    for rows in np.split(np.arange(len(pieces.length)), stops):
        ends = np.concatenate([[0.0], np.cumsum(pieces.length[rows])])
        parts = [np.linspace(a, b, FINER * limits.intervals, endpoint=False) for a, b in pairwise(ends)]
        grid = np.append(np.concatenate(parts), ends[-1])
        solver = TOPPRA([Bounds()], Stretch(rows), gridpoints=grid, parametrizer="ParametrizeConstAccel")
        _, speeds, _ = solver.compute_parameterization(0.0, 0.0)
        if speeds is None or not np.isfinite(speeds).all():
            return None
        total += float((2.0 * np.diff(grid) / (speeds[1:] + speeds[:-1])).sum())
    return total


def judged(seed: int, kind: str, count: int) -> dict[str, Any]:
    """Return what has become of paths in one world."""
    rng = np.random.default_rng(seed)
    robot = KINDS[kind]
    world: World = random_world(int(rng.integers(2**31)), OBSTACLES, size=SIZE, discs=0.2, boundary=seed % 3 == 0)
    checker = StateChecker(world, robot)
    # Rows of a smooth path are joined by straight motions, as for a robot that moves in every direction.
    referee = Referee(world, robot.steered(None))
    found: dict[str, Any] = {
        "kind": kind,
        "cases": 0,
        "faults": [],
        "corners": 0,
        "stops": 0,
        "seconds": 0.0,
        "timed": [],
    }
    for case in range(count):
        path = random_path(checker, rng)
        begun = time.process_time()
        smooth = path.smooth(checker)
        found["seconds"] += time.process_time() - begun
        fault = referee.fault(smooth.states, path.states[0], path.states[-1])
        if fault is None and smooth.max_curvature * (robot.turning_radius or 0.0) > 1.0 + 1e-9:
            fault = f"curvature {smooth.max_curvature}"
        if fault is not None:
            found["faults"].append(f"{world.name}, seed {seed}, case {case}: {fault}")
        plain = path.timed(1.5, 0.8, 1.0, 2.0)
        corners = 0 if not len(plain.pieces.length) else int(np.count_nonzero(~joined(plain.pieces, True)))
        found["cases"] += 1
        found["corners"] += corners
        found["stops"] += len(smooth.stops)
        if case == count - 1 and len(smooth.pieces.length):
            speed, acceleration, rate, turning = np.exp(rng.uniform(-1.5, 1.0, 4)).tolist()
            limits = Limits(speed, acceleration, rate, turning)
            for name, driven in (("as planned", path), ("smooth", smooth)):
                begun = time.process_time()
                trajectory = driven.timed(
                    limits.max_speed, limits.max_acceleration, limits.max_turn_rate, limits.max_turn_acceleration
                )
                seconds = time.process_time() - begun
                try:
                    other = toppra_duration(trajectory)
                except ImportError:
                    other = None
                found["timed"].append([name, excess(trajectory), trajectory.duration, other, seconds])
    return found


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=FilePath, default=FilePath("benchmarks/results/trajectories"))
    words = parser.parse_args()
    kinds = list(KINDS)
    jobs = [(words.seed + i, kinds[i % len(kinds)], BATCH) for i in range(-(-words.cases // BATCH))]
    begun = time.perf_counter()
    with ProcessPoolExecutor(words.workers, get_context("spawn")) as pool:
        found = list(pool.map(judged, *zip(*jobs, strict=True)))
    text = report(found) + f"\n{time.perf_counter() - begun:.0f} s with {words.workers} workers. {describe_machine()}\n"
    print(text)
    record = {"machine": describe_machine(), "batches": found}
    words.output.with_suffix(".json").write_text(json.dumps(record, indent=1) + "\n")
    words.output.with_suffix(".md").write_text(text)


def report(found: list[dict[str, Any]]) -> str:
    """Return what was found as Markdown."""
    rows = []
    for kind in KINDS:
        some = [item for item in found if item["kind"] == kind]
        cases, faults, corners, stops = (
            sum(len(item[key]) if key == "faults" else item[key] for item in some)
            for key in ("cases", "faults", "corners", "stops")
        )
        mean = 1000.0 * sum(item["seconds"] for item in some) / max(1, cases)
        rows.append([kind, f"{cases - faults:,} of {cases:,}", f"{corners:,}", f"{stops:,}", f"{mean:.1f} ms"])
    lines = ["# Smooth paths and trajectories", "", "## Smoothed paths that the referee passes", ""]
    lines.append(markdown_table(["Robot", "Passed", "Stops before", "Stops after", "Mean time"], rows))
    lines += ["", *(fault for item in found for fault in item["faults"][:3])][:20]
    rows = []
    for name in ("as planned", "smooth"):
        timed = [entry for item in found for entry in item["timed"] if entry[0] == name]
        compared = [entry[2] / entry[3] - 1.0 for entry in timed if entry[3]]
        beside = f"{100.0 * max(compared):+.2f} %" if compared else "not compared"
        least = f"{100.0 * min(compared):+.2f} %" if compared else "not compared"
        worst = f"{100.0 * (max((entry[1] for entry in timed), default=1.0) - 1.0):+.4f} %"
        mean = 1000.0 * float(np.mean([entry[4] for entry in timed])) if timed else 0.0
        rows.append([name, str(len(timed)), str(len(compared)), worst, least, beside, f"{mean:.0f} ms"])
    header = [
        "Path",
        "Trajectories",
        "Compared",
        "Largest share of a limit",
        "Duration beside TOPP-RA: least",
        "most",
        "Mean time",
    ]
    lines += ["", "## Trajectories", "", markdown_table(header, rows), ""]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
