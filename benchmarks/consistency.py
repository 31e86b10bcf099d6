"""Does the filter know how wrong it is? Simulated runs with known truth. Writes results/consistency.{json,md}.

A robot drives round a square loop with posts on both sides, identities known. Sensors and odometry err by white
Gaussian noise of the very models that the filter is given. At the end of each run:

- pose NEES: eᵀ P⁻¹ e of x, y, theta (3 degrees of freedom);
- map NEES: that of all landmarks together (they share their errors), divided by the number of landmarks (2 each);
- NIS: the sum over the run's updates, divided by its degrees of freedom (1).

Averages over the runs should lie in their 95 % chi-square band; an average above it means a filter too sure of itself.
One average in twenty leaves its band by chance, as the map NEES of the first 100 runs does, which is too low; more
runs tell: a filter that is wrong leaves the narrower band of more runs all the more. "invariant" is EkfSlam as it
comes (invariant error, iterated), "additive" the filter of the books on the same logs. "too sure" is the share of runs
whose pose NEES passes the 95 % quantile of one value: 0.05 if all is well.

    python -m benchmarks.consistency [--runs N] [--table-runs N]
"""

from __future__ import annotations

import argparse
import json
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.machine import describe_machine, markdown_table
from trailmark import World
from trailmark.estimation import EkfSlam, RangeBearing, SlamSettings, Unicycle
from trailmark.estimation.filter.consistency import Consistency, average, chi_square_quantile, nees
from trailmark.estimation.simulation.simulator import Simulation, simulate
from trailmark.estimation.simulation.virtual_sensors import Detector
from trailmark.se2 import wrap
from trailmark.shapes import Disc

FloatArray = NDArray[np.float64]

RESULTS = Path(__file__).resolve().parent / "results"

FILTERS = {
    "invariant": SlamSettings(),
    "additive": SlamSettings(error="additive", iterations=1),
}


class Setting(NamedTuple):
    """What is simulated."""

    noise: float
    """Times the moderate noise: range 0.1 m, bearing 0.02 rad; speed 0.05 m/s, turning 0.02 rad/s, each per second."""
    side: float
    """Metres: the loop's."""
    laps: int
    """How often it is driven."""


class Sample(NamedTuple):
    """One filter's run."""

    pose: float
    """NEES."""
    landmarks: float
    """NEES of all together."""
    size: int
    """How many landmarks."""
    nis: float
    """Sum over the updates."""
    dof: int
    """Its degrees of freedom."""


MODERATE = Setting(1.0, 20.0, 2)
TABLE = [
    *(Setting(noise, 20.0, 2) for noise in (0.3, 1.0, 2.0, 4.0, 8.0)),
    *(Setting(noise, 20.0, laps) for noise in (1.0, 4.0) for laps in (1, 6)),
    *(Setting(noise, 60.0, 1) for noise in (1.0, 2.0, 4.0)),
]


def course(setting: Setting) -> tuple[World, FloatArray]:
    """Return the world and the waypoints, shape (n, 2)."""
    side, far = setting.side, setting.side + 3.0
    corners = np.array([[0.0, 0.0], [side, 0.0], [side, side], [0.0, side], [0.0, 0.0]])
    lap = corners[:-1]
    posts = []
    for a, b in pairwise(corners):
        along = (b - a) / side
        left = np.array([-along[1], along[0]])
        for k, s in enumerate(np.arange(2.0, side, 4.0)):
            posts.append(a + s * along + (1.8 if k % 2 else -1.8) * left)
    discs = tuple(Disc((float(x), float(y)), 0.05) for x, y in posts)
    world = World("loop", (-3.0, -3.0, far, far), discs)
    return world, np.concatenate([*[lap] * setting.laps, corners[:1]])


def run(setting: Setting, seed: int) -> tuple[Simulation, RangeBearing, Unicycle]:
    """Return one simulated log, with the models of its noise."""
    world, way = course(setting)
    sensor = RangeBearing(0.1 * setting.noise, 0.02 * setting.noise)
    motion = Unicycle(0.05 * setting.noise, 0.02 * setting.noise, period=1.0)
    detector = Detector(sensor, max_range=7.0, period=1.0)
    return (
        simulate(world, way, motion, detector=detector, speed=1.0, turn_rate=1.0, period=0.25, random_state=seed),
        sensor,
        motion,
    )


def judge(simulation: Simulation, sensor: RangeBearing, motion: Unicycle, settings: SlamSettings) -> Sample:
    """Run a filter and compare it to the truth."""
    truth = simulation.truth
    slam = EkfSlam({"range-bearing": sensor}, velocity=motion, settings=settings, start=truth[0, 1:])
    result = slam.run(simulation.log.records)
    true_place = {int(i): np.array([x, y]) for i, x, y in simulation.log.landmarks}
    error = slam.filter.pose - truth[-1, 1:]
    error[2] = wrap(error[2])
    features = [(f.mean, true_place[f.identity]) for f in result.features if f.identity is not None]
    off = np.concatenate([found - true for found, true in features])
    order = np.concatenate(
        [np.arange(*slam.filter.features[f.id].indices(len(slam.filter.x))) for f in result.features]
    )
    updates = [update for update in result.updates if update.dof]
    return Sample(
        float(nees(error, slam.filter.pose_covariance)),
        float(nees(off, slam.filter.P[np.ix_(order, order)])),
        len(features),
        sum(update.nis for update in updates),
        sum(update.dof for update in updates),
    )


def measure(setting: Setting, *counts: int) -> list[dict[str, Any]]:
    """Return a row for each number of runs, the first so many seeds, and each filter, over the same logs."""
    samples: dict[str, list[Sample]] = {name: [] for name in FILTERS}
    for seed in range(max(counts)):
        simulation, sensor, motion = run(setting, seed)
        for name, settings in FILTERS.items():
            samples[name].append(judge(simulation, sensor, motion, settings))
    return [row(name, setting, some[:count]) for count in counts for name, some in samples.items()]


def row(name: str, setting: Setting, samples: list[Sample]) -> dict[str, Any]:
    """Return the averages of one filter's runs and their bands."""
    pose = average([s.pose for s in samples], 3)
    count = np.array([s.size for s in samples])
    joint = average([s.landmarks for s in samples], 2 * count)
    each = divided(joint, float(count.mean()))
    dof = np.array([s.dof for s in samples])
    total = average([s.nis for s in samples], dof)
    per = divided(total, float(dof.mean()))
    row: dict[str, Any] = {
        "noise": setting.noise,
        "loop m": 4.0 * setting.side,
        "laps": setting.laps,
        "landmarks": round(float(count.mean()), 1),
        "runs": len(samples),
        "filter": name,
    }
    for title, figure in (("pose NEES", pose), ("map NEES", each), ("NIS", per)):
        row[title] = figure.mean
        row[f"{title} band"] = f"{figure.low:.3f}..{figure.high:.3f}"
        row[f"{title} inside"] = "yes" if figure.inside else "NO"
    limit = float(chi_square_quantile(0.95, 3))
    row["too sure"] = float(np.mean([s.pose > limit for s in samples]))
    return row


def divided(of: Consistency, by: float) -> Consistency:
    """Return an average and its band in other units."""
    return Consistency(of.mean / by, of.low / by, of.high / by, of.expected / by, of.size)


def table(rows: list[dict[str, Any]]) -> str:
    """Return rows as a Markdown table."""
    return markdown_table(
        list(rows[0]), [[f"{v:.3f}" if isinstance(v, float) else str(v) for v in r.values()] for r in rows]
    )


def main() -> int:
    """Measure and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100, help="of the moderate setting")
    parser.add_argument("--table-runs", type=int, default=30, help="of each row of the table")
    given = parser.parse_args()
    begin = perf_counter()
    with threadpool_limits(1):
        moderate = measure(MODERATE, given.runs, 3 * given.runs)
        rows = [r for setting in TABLE for r in measure(setting, given.table_runs)]
    machine, seconds = describe_machine(), perf_counter() - begin
    text = ["# Consistency of EKF-SLAM", "", machine, "", *(__doc__ or "").strip().splitlines()[2:-2]]
    text += ["", f"## Moderate noise, {given.runs} seeded runs, and three times as many", "", table(moderate)]
    text += ["", "## Where it becomes inconsistent", "", table(rows), "", f"All of it took {seconds:.0f} s."]
    print("\n".join(text))
    RESULTS.mkdir(exist_ok=True)
    content = {"machine": machine, "seconds": seconds, "moderate": moderate, "table": rows}
    (RESULTS / "consistency.json").write_text(json.dumps(content, indent=1) + "\n")
    (RESULTS / "consistency.md").write_text("\n".join(text) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
