"""What an update of EKF-SLAM costs. Writes results/slam.{json,md}.

One update of a state of n numbers, all of them correlated, against filterpy's own dense update; one thread, the least
time of several. What the filter makes of real logs is measured by benchmarks/mrclam.py and benchmarks/victoria.py, and
whether it knows its errors by benchmarks/consistency.py.

    python -m benchmarks.slam
"""

from __future__ import annotations

import json
from pathlib import Path
from time import perf_counter

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.machine import describe_machine, markdown_table
from trailmark.estimation import RangeBearing, SlamFilter, Unicycle

FloatArray = NDArray[np.float64]

RESULTS = Path(__file__).resolve().parent / "results"

VELOCITIES = Unicycle(0.012, 0.04, period=1.0)


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
    """Measure and write the table."""
    with threadpool_limits(1):
        rows = [update_cost(features) for features in (20, 50, 100, 150, 300, 600)]
    machine = describe_machine()
    cells = [[f"{v:.3f}" if isinstance(v, float) else str(v) for v in row.values()] for row in rows]
    text = ["# What an update of EKF-SLAM costs", "", machine, "", *(__doc__ or "").strip().splitlines()[2:-2]]
    text += ["", markdown_table(list(rows[0]), cells)]
    print("\n".join(text))
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "slam.json").write_text(json.dumps({"machine": machine, "rows": rows}, indent=1) + "\n")
    (RESULTS / "slam.md").write_text("\n".join(text) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
