"""The source method against what was published of it, and against trailmark's own. Prints a table.

- Forbidden points, inertia and centres over many runs in the two environments, for each initialisation. Every run has
  its own readings and points; the initialisations of one run share them, so that they compare directly.
- Spread: RMS distance of centres matched between runs, on average over all pairs, in units of √(A/k), A being the area
  of the valid points. Beside it that of places drawn at random, which is what no stability at all looks like, and
  that of Forgy's starts on one and the same set of points, which leaves only the start to differ.
- Times of Algorithm 2, readings given, in a process that has loaded scikit-learn.

    python -m benchmarks.paper [--runs 200]
"""

from __future__ import annotations

import argparse
import math
import resource
import sys
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Claim, keep, markdown_table
from trailmark.collision import StateChecker
from trailmark.landmarks import algorithm_1, algorithm_2, repair_centres, spread_of_runs
from trailmark.landmarks.executions import execute_se2, readings_in
from trailmark.landmarks.paper import INITIALISATIONS, Initialisation, PaperLandmarks
from trailmark.world import World
from trailmark.world.library import shipped_worlds

ENVIRONMENTS = {"environment1": 12, "environment2": 14}
N = 1000
PUBLISHED = "169/831, 165/835, 171/829"
WANTED = (165.0, 171.0)

GROWN = "forgy, boxes grown"
"""Forgy's initialisation, the obstacles' boxes grown by the robot's inscribed disc."""

LARGE = (1_000_000, 1000)
LIMITS = {"small": 0.05, "large": 20.0}
"""Seconds that n = 1,000, k = 12 and n = 1,000,000, k = 1,000 should stay under."""

FloatArray = NDArray[np.float64]


class Environment:
    """One environment: its runs, by method."""

    def __init__(self, name: str, k: int, runs: int) -> None:
        self.name, self.k = name, k
        self.world = World.load(shipped_worlds()[name])
        self.checker = StateChecker(self.world)
        self.start = np.array(self.world.queries[0].start)
        self.found: dict[str, list[PaperLandmarks]] = {method: [] for method in (*INITIALISATIONS, GROWN)}
        self.seconds: dict[str, list[float]] = {method: [] for method in self.found}
        radius = self.checker.robot.inscribed_disc.radius
        for run in range(runs):
            self.readings = readings_in(self.checker, np.random.default_rng([0, run]), start=self.start)
            methods: list[tuple[str, Initialisation, float]] = [(init, init, 0.0) for init in INITIALISATIONS]
            for method, init, margin in (*methods, (GROWN, "forgy", radius)):
                rng, begin = np.random.default_rng([1, run]), perf_counter()
                landmarks = algorithm_2(
                    self.readings, self.world.bounds, N, k, init, rng, robot=self.start[:2], margin=margin
                )
                self.seconds[method].append(perf_counter() - begin)
                self.found[method].append(landmarks)
        self.own = [
            execute_se2(self.checker, N, k, np.random.default_rng([1, run]), start=self.start) for run in range(runs)
        ]

    def spacing(self, valid: float) -> float:
        """Return √(A/k) in metres for so many valid points."""
        xmin, ymin, xmax, ymax = self.world.bounds
        return math.sqrt((xmax - xmin) * (ymax - ymin) * valid / N / self.k)

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each method."""
        rows = []
        for method, found in self.found.items():
            repairs = [repair_centres(self.checker, each.centres, each.samples[~each.forbidden]) for each in found]
            counts = [int(each.forbidden.sum()) for each in found]
            valid = [bool(self.checker.valid(each.configurations).all()) for each in repairs]
            assert all(valid)
            rows.append(
                self._row(method, counts, [each.centres for each in found])
                | {
                    "inertia": float(np.mean([each.inertia for each in found])),
                    "iterations": float(np.mean([each.iterations for each in found])),
                    "in_obstacle": float(np.mean([each.in_obstacle.mean() for each in repairs])),
                    "invalid": float(np.mean([each.invalid.mean() for each in repairs])),
                    "seconds": float(np.median(self.seconds[method])),
                    "most_seconds": max(self.seconds[method]),
                }
            )
        own = [each.centres[:, :2] for each in self.own]
        rows.append(self._row("trailmark's own (SE(2))", [int(each.forbidden.sum()) for each in self.own], own))
        rows[-1] |= {"in_obstacle": 0.0, "invalid": 0.0}
        rows[-1]["seconds"] = float(np.median([each.seconds for each in self.own]))
        return rows

    def baselines(self) -> dict[str, float]:
        """Return the spread of random places, and of Forgy's starts on one set of points."""
        rng, spacing = np.random.default_rng(2), self.spacing(N - float(np.mean(self._counts("forgy"))))
        sets = [each.samples[~each.forbidden] for each in self.found["forgy"]]
        chance = [points[rng.choice(len(points), self.k, replace=False)] for points in sets]
        starts = [algorithm_1(sets[0], self.k, "forgy", rng).centres for _ in sets]
        return {
            "random places": spread_of_runs(chance).mean / spacing,
            "one set of points, Forgy's starts": spread_of_runs(starts).mean / spacing,
        }

    def _counts(self, init: str) -> list[int]:
        return [int(each.forbidden.sum()) for each in self.found[init]]

    def _row(self, method: str, counts: list[int], centres: list[FloatArray]) -> dict[str, Any]:
        spread, mean = spread_of_runs(centres), float(np.mean(counts))
        return {
            "environment": self.name,
            "method": method,
            "k": self.k,
            "runs": len(counts),
            "forbidden": mean,
            "deviation": float(np.std(counts, ddof=1)),
            "binomial": math.sqrt(mean * (1.0 - mean / N)),
            "spread": spread.mean / self.spacing(N - mean),
            "worst": spread.worst / self.spacing(N - mean),
        }


def large(environment: Environment) -> dict[str, Any]:
    """Return time and memory of a million points."""
    n, k = LARGE
    before, begin = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, perf_counter()
    found = algorithm_2(
        environment.readings,
        environment.world.bounds,
        n,
        k,
        random_state=0,
        robot=environment.start[:2],
    )
    seconds = perf_counter() - begin
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0
    assert found.mini_batches
    return {"n": n, "k": k, "seconds": seconds, "megabytes": grown, "forbidden": int(found.forbidden.sum())}


def report(rows: list[dict[str, Any]], baselines: dict[str, dict[str, float]], million: dict[str, Any]) -> list[str]:
    """Return the tables and what they say, as lines of Markdown."""
    header = ["environment", "method", "runs", "forbidden of 1,000", "st. dev. (binomial)", "inertia m²", "iterations"]
    header += ["in obstacle %", "invalid %", "spread / spacing", "worst pair", "median ms", "most ms"]
    table = [
        [
            *(row["environment"], row["method"], f"{row['runs']}", f"{row['forbidden']:.1f}"),
            f"{row['deviation']:.1f} ({row['binomial']:.1f})",
            *(f"{row[key]:.0f}" if key in row else "" for key in ("inertia", "iterations")),
            *(f"{100.0 * row[key]:.1f}" for key in ("in_obstacle", "invalid")),
            *(f"{row[key]:.2f}" for key in ("spread", "worst")),
            *(f"{1e3 * row[key]:.1f}" if key in row else "" for key in ("seconds", "most_seconds")),
        ]
        for row in rows
    ]
    first = rows[0]
    verdict = "reached" if WANTED[0] <= first["forbidden"] <= WANTED[1] else "not reached"
    small = max(row["seconds"] for row in rows if row["environment"] == "environment1" and "iterations" in row)
    lines = [markdown_table(header, table), ""]
    lines.append(
        f"Environment 1, published: {PUBLISHED}. Mean of forbidden points within {WANTED[0]:g} to {WANTED[1]:g}: "
        f"{verdict} ({first['forbidden']:.1f}). Every repaired centre is valid for the robot."
    )
    for name, values in baselines.items():
        lines.append(f"Spread in {name}: " + ", ".join(f"{what} {value:.2f}" for what, value in values.items()) + ".")
    lines += [
        f"n = 1,000, k = 12, median: {1e3 * small:.1f} ms, wanted below {1e3 * LIMITS['small']:g} ms: "
        + ("reached." if small < LIMITS["small"] else "not reached."),
        f"n = {million['n']:,}, k = {million['k']:,}, mini-batches: {million['seconds']:.1f} s and "
        f"{million['megabytes']:.0f} MB more than before, wanted below {LIMITS['large']:g} s: "
        + ("reached." if million["seconds"] < LIMITS["large"] else "not reached."),
    ]
    return lines


def main() -> int:
    """Measure and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=200, help="runs in each environment")
    options = parser.parse_args()
    algorithm_2([], (0.0, 0.0, 1.0, 1.0), 100, 2, random_state=0)  # loads scikit-learn
    rows: list[dict[str, Any]] = []
    baselines: dict[str, dict[str, float]] = {}
    for name, k in ENVIRONMENTS.items():
        environment = Environment(name, k, options.runs)
        rows += environment.rows()
        baselines[name] = environment.baselines()
        if name == "environment1":
            million = large(environment)
    lines = report(rows, baselines, million)
    sys.stdout.write("\n".join(lines) + "\n")
    first, ours = rows[0], next(row for row in rows if row["method"].startswith("trailmark"))
    keep(
        "paper",
        [
            Claim("forbidden of 1,000 points, environment 1", f"{first['forbidden']:.1f}", f"published: {PUBLISHED}"),
            Claim(
                "spread of centres between runs, in spacings, environment 1",
                f"{first['spread']:.2f} as published, {ours['spread']:.2f} with trailmark's own landmarks",
                f"random places {baselines['environment1']['random places']:.2f}",
            ),
        ],
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
