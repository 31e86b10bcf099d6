"""MRCLAM 6: maps by the shell's defaults against the survey, and a robust batch. Writes results/mrclam.{json,md}.

Robots 1, 2, 3 and 5; 15 barcodes in 6 groups, their nearest neighbours 18 to 25 cm away. Landmarks are compared to the
surveyed ones after a rigid alignment; the same alignment serves the trajectory.

- By the defaults, ``trailmark map`` with and without identities. NEES: of each landmark's aligned error by the
  covariance of its obstacle, 2 is right. Growth is what ``--confidence 0.99`` adds to a disc at its widest; inside are
  the discs that the grown ones contain. A reading is wrong if most readings of its feature are of another barcode.
- Robust batch: gtsam by other code (benchmarks/smoother.py) on the filter's factors, with the noise that these settings
  state, taken at the range that was read, Huber's kernel, without the readings that the filter's gate refused.

    python -m benchmarks.mrclam [--data FOLDER]
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.alignment import Alignment, aligned, rms
from benchmarks.machine import describe_machine, markdown_table
from benchmarks.smoother import smooth
from trailmark.estimation import EkfSlam, MapSettings, RangeBearing, SlamResult, SlamSettings, Unicycle, map_log
from trailmark.estimation.logs import load_log
from trailmark.estimation.logs.records import Detection, Log, Pose, Record

FloatArray = NDArray[np.float64]

RESULTS = Path(__file__).resolve().parent / "results"
ROOT = Path(__file__).resolve().parents[1]

# Measured on the logs against the motion capture: the spread of ranges grows from 6 cm at 1 m to some 20 cm at 8 m;
# dead reckoning over 0.1 to 2 s spreads by 0.012 m and 0.04 rad times the square root of the seconds.
RANGE_BEARING = RangeBearing(0.06, 0.015, growth=0.3)
VELOCITIES = Unicycle(0.012, 0.04, period=1.0)

KNOWN = SlamSettings(outlier_gate=0.9999)

RADIUS, CONFIDENCE = 0.055, 0.99
"""Metres, of the tubes that carry the barcodes; what the maps are grown for."""


class Course(NamedTuple):
    """One robot's log."""

    robot: int
    records: list[Record]
    """Without poses."""
    surveyed: dict[int, FloatArray]
    """Barcodes, shape (2,), metres."""
    truth: FloatArray
    """Rows t, x, y, shape (n, 3)."""


def load(folder: Path, robot: int) -> Course:
    """Read a robot's log."""
    log = load_log(folder, robot=robot, skip_bad=True)
    truth = np.array([record[:3] for record in log.records if isinstance(record, Pose)])
    records: list[Record] = [record for record in log.records if not isinstance(record, Pose)]
    return Course(robot, records, {int(i): np.array([x, y]) for i, x, y in log.landmarks}, truth)


def with_noise(record: Record) -> Record:
    """Return a record with the noise of its range, if it is a reading: filter and smoother then have the same."""
    if not isinstance(record, Detection):
        return record
    ahead = np.array([max(float(record.z[0]), 0.0), 0.0])
    return record._replace(covariance=RANGE_BEARING.noise(np.zeros(3), ahead))


def run(records: list[Record], sensor: RangeBearing, settings: SlamSettings) -> tuple[SlamResult, float]:
    """Return the filter's result and its seconds."""
    begin = perf_counter()
    slam = EkfSlam({"range-bearing": sensor}, velocity=VELOCITIES, settings=settings)
    return slam.run(records), perf_counter() - begin


def trajectory_rmse(course: Course, rows: FloatArray, motion: Alignment) -> float:
    """Return the root mean squared distance of poses, rows t, x, y, from the truth of their times."""
    truth = course.truth
    rows = rows[(rows[:, 0] >= truth[0, 0]) & (rows[:, 0] <= truth[-1, 0])]
    path = np.column_stack([np.interp(rows[:, 0], truth[:, 0], truth[:, j]) for j in (1, 2)])
    return rms(motion(rows[:, 1:3]) - path)


def robust_batch(course: Course) -> dict[str, Any]:
    """Return the row of a batch on the filter's own factors."""
    records = [with_noise(record) for record in course.records]
    result, seconds = run(records, RANGE_BEARING, KNOWN)
    begin = perf_counter()
    batch = smooth(records, VELOCITIES, result)
    batch_seconds = perf_counter() - begin
    order = sorted(batch.landmarks)
    expected = np.array([course.surveyed[i] for i in order])
    means = {f.identity: f.mean for f in result.features}
    ours, theirs = np.array([means[i] for i in order]), np.array([batch.landmarks[i] for i in order])
    to_truth, batch_to_truth = aligned(ours, expected), aligned(theirs, expected)
    return {
        "robot": course.robot,
        "filter: landmark RMSE m": rms(to_truth(ours) - expected),
        "batch: landmark RMSE m": rms(batch_to_truth(theirs) - expected),
        "filter: trajectory RMSE m": trajectory_rmse(course, result.trajectory[:, :3], to_truth),
        "batch: trajectory RMSE m": trajectory_rmse(course, batch.trajectory, batch_to_truth),
        "readings left out": result.counts.outliers / result.counts.detections,
        "filter s": seconds,
        "batch s": batch_seconds,
    }


def defaults(course: Course, log: Log, identities: bool) -> dict[str, Any]:
    """Return the row of the map that the shell makes."""
    settings = MapSettings(radius=RADIUS)
    if not identities:
        settings = replace(settings, slam=replace(settings.slam, association="joint"))
    mapped = map_log(log, settings, confidence=CONFIDENCE, even_if_uncertain=True)
    assert mapped.slam is not None
    result, owner = mapped.slam, owners(mapped.slam)
    rows = [
        (feature, estimate, shape)
        for feature, estimate, shape in zip(
            result.features, mapped.world.estimates, mapped.world.obstacles, strict=True
        )
        if feature.id in owner and estimate is not None
    ]
    found = np.array([feature.mean for feature, _, _ in rows])
    expected = np.array([course.surveyed[owner[feature.id]] for feature, _, _ in rows])
    motion = aligned(found, expected)
    errors = (motion(found) - expected) @ motion.R
    nees = [float(e @ np.linalg.solve(p.covariance[:2, :2], e)) for e, (_, p, _) in zip(errors, rows, strict=True)]
    true = (expected - motion.t) @ motion.R
    grown = [shape.polygon(1e-4).shapely().buffer(1e-3) for _, _, shape in rows]
    boxes = np.array([shape.bounding_box() for _, _, shape in rows])
    growth = 0.5 * (boxes[:, 2:] - boxes[:, :2]).max(axis=1) - RADIUS
    inside = [g.contains(shapely.Point(*centre).buffer(RADIUS)) for g, centre in zip(grown, true, strict=True)]
    pairs = [
        (owner[a.feature], a.identity)
        for a in result.assignments
        if a.feature in owner and a.identity is not None and a.feature is not None
    ]
    error = rms(errors)
    return {
        "robot": course.robot,
        "identities": "known" if identities else "unknown",
        "features": len(result.features),
        "barcodes": len(set(owner.values())),
        "landmark RMSE m": error,
        "trajectory RMSE m": trajectory_rmse(course, mapped.trajectory[:, :3], motion),
        "NEES": float(np.mean(nees)),
        "growth m": float(growth.mean()),
        "growth to error": float(growth.mean()) / error,
        "inside": f"{sum(inside)} of {len(inside)}",
        "readings used": len(pairs) / len(result.assignments),
        "wrong": sum(a != b for a, b in pairs) / len(pairs),
        "seconds": mapped.seconds,
    }


def owners(result: SlamResult) -> dict[int, int]:
    """Return the barcode that most readings of each feature are of."""
    readings: dict[int, list[int]] = {}
    for assignment in result.assignments:
        if assignment.feature is not None and assignment.identity is not None:
            readings.setdefault(assignment.feature, []).append(assignment.identity)
    return {feature: max(set(of), key=of.count) for feature, of in readings.items()}


def main() -> int:
    """Measure and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(os.environ.get("TRAILMARK_DATA", ROOT.parent / "shared" / "data"))
    parser.add_argument("--data", type=Path, default=default, help="folder with mrclam6")
    data = parser.parse_args().data
    rows: dict[str, list[dict[str, Any]]] = {"By the defaults": [], "Robust batch": []}
    with threadpool_limits(1):
        for robot in (1, 2, 3, 5):
            course = load(data / "mrclam6", robot)
            log = load_log(data / "mrclam6", robot=robot, skip_bad=True)
            rows["By the defaults"] += [defaults(course, log, identities) for identities in (True, False)]
            rows["Robust batch"].append(robust_batch(course))
    machine = f"{describe_machine()}, gtsam {version('gtsam')}"
    text = ["# Maps of MRCLAM 6", "", machine, "", *(__doc__ or "").strip().splitlines()[2:-2]]
    for title, table in rows.items():
        cells = [[f"{v:.3f}" if isinstance(v, float) else str(v) for v in row.values()] for row in table]
        text += ["", f"## {title}", "", markdown_table(list(table[0]), cells)]
    text += [
        "",
        "To reach: with identities a landmark RMSE of 0.10 m at most, a trajectory of 1.1 times a robust batch's at "
        "most, NEES 1 to 3, all true discs inside, growth 3 times the error at most; without them 15 ± 1 features, at "
        "most 5 % wrong.",
    ]
    print("\n".join(text))
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "mrclam.json").write_text(json.dumps({"machine": machine, "tables": rows}, indent=1) + "\n")
    (RESULTS / "mrclam.md").write_text("\n".join(text) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
