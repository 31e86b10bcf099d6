"""EKF-SLAM on real logs, and what an update costs. Writes results/slam.{json,md}.

1. MRCLAM 6, robots 1 and 3 (UTIAS; 15 barcodes in 6 groups, their nearest neighbours 18 to 25 cm away): with the
   barcodes' identities, and without, by gated nearest neighbour and by joint compatibility. Landmarks are compared to
   the surveyed ones after a rigid alignment; the same alignment serves the trajectory, which is the filter's estimate
   at each moment, not smoothed by what came later. A reading is wrongly assigned if most readings of its feature are
   of another barcode; it is of another group if that barcode stands in another group.
2. Victoria Park with known identities: time for the whole log, NIS.
3. One update of a state of n numbers, all of them correlated, against filterpy's own dense update; one thread.

    python -m benchmarks.slam [--data FOLDER]
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.machine import describe_machine, markdown_table
from trailmark.estimation import EkfSlam, PoseIncrement, RangeBearing, SlamFilter, SlamResult, SlamSettings, Unicycle
from trailmark.estimation.logs import load_log
from trailmark.estimation.records import Detection, Pose, Record

FloatArray = NDArray[np.float64]

RESULTS = Path(__file__).resolve().parent / "results"
ROOT = Path(__file__).resolve().parents[1]

# Measured on the logs against the motion capture: the spread of ranges grows from 6 cm at 1 m to some 20 cm at 8 m;
# dead reckoning over 0.1 to 2 s spreads by 0.012 m and 0.04 rad times the square root of the seconds.
RANGE_BEARING = RangeBearing(0.06, 0.015, growth=0.3)
VELOCITIES = Unicycle(0.012, 0.04, period=1.0)

GROUP = 0.5
"""Metres: barcodes nearer to one another than this are of one group."""


class Alignment(NamedTuple):
    """A rigid motion, p to R p + t."""

    R: FloatArray
    t: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return points, shape (n, 2), moved."""
        return np.asarray(points @ self.R.T + self.t)


def aligned(points: FloatArray, to: FloatArray) -> Alignment:
    """Return the rigid motion that brings points nearest to their partners, both (n, 2) (Umeyama 1991, no scale)."""
    a, b = points.mean(axis=0), to.mean(axis=0)
    u, _, vt = np.linalg.svd((points - a).T @ (to - b))
    flip = np.diag([1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    rotation = vt.T @ flip @ u.T
    return Alignment(rotation, b - rotation @ a)


def rms(errors: FloatArray) -> float:
    """Return the root of the mean squared length of errors, shape (n, 2)."""
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


def mrclam(folder: Path, robot: int, association: str) -> dict[str, object]:
    """Run one robot's log and return the row of the table."""
    log = load_log(folder, robot=robot, skip_bad=True)
    truth = np.array([record[:4] for record in log.records if isinstance(record, Pose)])
    records = [record for record in log.records if not isinstance(record, Pose)]
    surveyed = {int(i): np.array([x, y]) for i, x, y in log.landmarks}
    group = {i: min(j for j in surveyed if np.hypot(*(surveyed[i] - surveyed[j])) < GROUP) for i in surveyed}
    settings = SlamSettings(
        association=association,  # type: ignore[arg-type]  # one of the three that main names
        outlier_gate=0.9999,
        new_gate=0.9999,
        confirm=5,
        timeout=np.inf,
    )
    begin = perf_counter()
    result = EkfSlam({"range-bearing": RANGE_BEARING}, velocity=VELOCITIES, settings=settings).run(records)
    seconds = perf_counter() - begin

    owner = owners(result)
    features = [feature for feature in result.features if feature.id in owner]
    found = np.array([feature.mean for feature in features])
    expected = np.array([surveyed[owner[feature.id]] for feature in features])
    motion = aligned(found, expected)
    inside = (result.trajectory[:, 0] >= truth[0, 0]) & (result.trajectory[:, 0] <= truth[-1, 0])
    rows = result.trajectory[inside]
    path = np.column_stack([np.interp(rows[:, 0], truth[:, 0], truth[:, j]) for j in (1, 2)])
    kept = {feature.id for feature in features}
    # Assignments to None and to features never confirmed are not in the map.
    pairs = [(owner[a.feature], a.identity) for a in result.assignments if a.feature in kept and a.identity is not None]
    nis = result.nis()
    return {
        "robot": robot,
        "identities": "known" if association == "known" else f"unknown, {association}",
        "features": len(features),
        "barcodes": len({owner[i] for i in kept}),
        "landmark RMSE m": rms(motion(found) - expected),
        "trajectory RMSE m": rms(motion(rows[:, 1:3]) - path),
        "readings used": len(pairs) / result.counts.detections,
        "wrong": sum(a != b for a, b in pairs) / len(pairs),
        "of another group": sum(group[a] != group[b] for a, b in pairs if b is not None) / len(pairs),
        "NIS": nis.mean,
        "expected": nis.expected,
        "95 % band": f"{nis.low:.2f}..{nis.high:.2f}",
        "ms per update": 1e3 * result.seconds_per_update,
        "seconds": seconds,
    }


def owners(result: SlamResult) -> dict[int, int]:
    """Return the barcode that most readings of each feature are of."""
    readings: dict[int, list[int]] = {}
    for assignment in result.assignments:
        if assignment.feature is not None and assignment.identity is not None:
            readings.setdefault(assignment.feature, []).append(assignment.identity)
    return {feature: max(set(of), key=of.count) for feature, of in readings.items()}


def victoria(path: Path) -> dict[str, object]:
    """Run the Victoria Park log, read as GTSAM reads it: range σ = √c, bearing σ = √(c/10)."""
    records: list[Record] = []
    for record in load_log(path).records:
        if isinstance(record, Detection) and record.covariance is not None:
            x, y = record.z
            c = float(record.covariance[0, 0])
            polar = np.array([np.hypot(x, y), np.arctan2(y, x)])
            records.append(record._replace(z=polar, kind="range-bearing", covariance=np.diag([c, c / 10.0])))
        else:
            records.append(record)
    slam = EkfSlam({"range-bearing": RangeBearing(1.0, 0.1)}, increment=PoseIncrement(0.1, 0.1, 0.1))
    begin = perf_counter()
    result = slam.run(records)
    seconds = perf_counter() - begin
    nis = result.nis()
    return {
        "records": result.counts.records,
        "features": len(result.features),
        "NIS": nis.mean,
        "expected": nis.expected,
        "95 % band": f"{nis.low:.2f}..{nis.high:.2f}",
        "ms per update": 1e3 * result.seconds_per_update,
        "seconds": seconds,
    }


def update_cost(features: int, repeats: int = 30) -> dict[str, object]:
    """Return the least time of one update of a state with so many features: SlamFilter's, and filterpy's dense one."""
    rng = np.random.default_rng(features)
    sensor, slam = RangeBearing(0.1, 0.02), SlamFilter()
    for _ in range(features):
        # A step before each: from a certain pose features would not be correlated, and updates would touch few rows.
        slam.predict(VELOCITIES, [0.1, 0.1, 0.1])
        slam.add_feature([rng.uniform(1.0, 50.0), rng.uniform(-np.pi, np.pi)], sensor)
    ids = list(slam.features)
    n = len(slam.x)
    dense = ExtendedKalmanFilter(dim_x=n, dim_z=2)
    sparse_times, dense_times = [], []
    for k in range(repeats):
        i = ids[int(rng.integers(features))]
        place, z = slam.features[i], sensor.sample(slam.pose, slam.feature(i), rng)
        dense.x, dense.P = slam.x.copy(), slam.P.copy()

        def jacobian(x: FloatArray, place: slice = place) -> FloatArray:
            H = np.zeros((2, n))  # noqa: N806 # the filter's own symbol
            H[:, :3], H[:, place] = sensor.H_pose(x[:3], x[place]), sensor.H_feature(x[:3], x[place])
            return H

        if k < 5:
            begin = perf_counter()
            dense.update(
                z, jacobian, lambda x, place=place: sensor.h(x[:3], x[place]), R=sensor.R, residual=sensor.residual
            )
            dense_times.append(perf_counter() - begin)
        begin = perf_counter()
        slam.update(z, sensor, i)
        sparse_times.append(perf_counter() - begin)
    ours, theirs = min(sparse_times), min(dense_times)
    return {"n": n, "SlamFilter ms": 1e3 * ours, "filterpy ms": 1e3 * theirs, "times faster": theirs / ours}


def main() -> int:
    """Measure and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(os.environ.get("TRAILMARK_DATA", ROOT.parent / "shared" / "data"))
    parser.add_argument("--data", type=Path, default=default, help="folder with mrclam6 and victoria")
    data = parser.parse_args().data
    tables = {
        "MRCLAM 6": [
            mrclam(data / "mrclam6", robot, association)
            for robot in (1, 3)
            for association in ("known", "nearest", "joint")
        ],
        "Victoria Park": [victoria(data / "victoria" / "victoria_park.txt")],
    }
    with threadpool_limits(1):
        tables["One update"] = [update_cost(features) for features in (20, 50, 100, 150, 300, 600)]
    machine = describe_machine()
    text = ["# EKF-SLAM on real logs", "", machine, "", *(__doc__ or "").strip().splitlines()[2:-2]]
    for title, rows in tables.items():
        cells = [[f"{v:.3f}" if isinstance(v, float) else str(v) for v in row.values()] for row in rows]
        text += ["", f"## {title}", "", markdown_table(list(rows[0]), cells)]
    print("\n".join(text))
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "slam.json").write_text(json.dumps({"machine": machine, "tables": tables}, indent=1) + "\n")
    (RESULTS / "slam.md").write_text("\n".join(text) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
