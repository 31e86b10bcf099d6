"""Victoria Park: maps and the filter against the batch optimum and against iSAM2. Writes results/victoria.{json,md}.

The log's noise is read as GTSAM reads it (``gtsam.load2D``; bearing σ = √(c/10), range σ = √c), and the graph that
``load2D`` builds is what GTSAM solves, with the first pose held. The batch optimum is Levenberg-Marquardt from iSAM2's
result: from dead reckoning it ends in a local minimum with 40 times the error. Landmarks are compared as they stand,
in the frame of the first pose, and again after a rigid alignment.

The filter's threshold for another iteration was picked on this log (0.1 standard deviations: 1.61 m, 0.03: 1.495 m,
0.003: 1.495 m), so the margin under 1.5 m is thin.

iSAM2 runs with its default parameters, the filter with those of ``EkfSlam``; both in one thread, in this process,
each record by record, the best of several runs. iSAM2 is timed twice: updated at each pose that reads something (the
odometry in between goes with it), and at each pose, as the filter is. Neither time holds the reading of the file.

    python -m benchmarks.victoria [--data FOLDER] [--repeats N]
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.alignment import aligned, rms
from benchmarks.machine import describe_machine, markdown_table
from trailmark.estimation import EkfSlam, PoseIncrement, RangeBearing, SlamResult, SlamSettings, map_log
from trailmark.estimation.logs import load_log
from trailmark.estimation.logs.records import Detection, Increment, Log, Record

FloatArray = NDArray[np.float64]
Landmarks = dict[int, FloatArray]

RESULTS = Path(__file__).resolve().parent / "results"
ROOT = Path(__file__).resolve().parents[1]


def held_graph(path: Path) -> Any:
    """Return GTSAM's graph of the file, its first pose held."""
    graph, _ = gtsam.load2D(str(path))
    tight = gtsam.noiseModel.Diagonal.Sigmas(np.full(3, 1e-6))
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(), tight))
    return graph


def isam2(graph: Any, every_pose: bool) -> tuple[Any, float, int]:
    """Return iSAM2's estimate, its seconds, and how many updates it made."""
    prior, factors = graph.at(graph.size() - 1), [graph.at(i) for i in range(graph.size() - 1)]
    begin = perf_counter()
    solver = gtsam.ISAM2(gtsam.ISAM2Params())
    new, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    new.add(prior)
    values.insert(0, gtsam.Pose2())
    pose, last, known, updates = gtsam.Pose2(), 0, set(), 0
    due = True
    for factor in factors:
        if isinstance(factor, gtsam.BetweenFactorPose2):
            if every_pose or due:
                solver.update(new, values)
                pose, updates, due = solver.calculateEstimatePose2(last), updates + 1, False
                new, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
            _, last = factor.keys()
            pose = pose.compose(factor.measured())
            values.insert(last, pose)
        else:
            _, landmark = factor.keys()
            due = True
            if landmark not in known:
                known.add(landmark)
                reading = factor.measured()
                ahead = reading.bearing().rotate(np.array([reading.range(), 0.0]))
                values.insert(landmark, pose.transformFrom(ahead))
        new.add(factor)
    solver.update(new, values)
    return solver.calculateEstimate(), perf_counter() - begin, updates + 1


def run_filter(records: list[Record], settings: SlamSettings) -> tuple[SlamResult, float]:
    """Return the filter's result and its seconds."""
    slam = EkfSlam({"range-bearing": RangeBearing(1.0, 0.1)}, increment=PoseIncrement(0.1, 0.1, 0.1), settings=settings)
    begin = perf_counter()
    result = slam.run(records)
    return result, perf_counter() - begin


def scaled(log: Log, odometry: float, sensor: float) -> Log:
    """Return a log whose stated deviations are these factors times what they were."""
    factor = {Increment: odometry**2, Detection: sensor**2}
    records = [
        r._replace(covariance=r.covariance * factor[type(r)])
        if isinstance(r, Increment | Detection) and r.covariance is not None
        else r
        for r in log.records
    ]
    return log._replace(records=tuple(records))


def maps(path: Path, optimum: Landmarks, limit: float) -> list[dict[str, Any]]:
    """Return the rows of maps by the shell's defaults, with the noise as stated and larger or smaller."""
    log, rows = load_log(path), []
    for name, odometry, sensor in (
        ("trailmark map, defaults", 1.0, 1.0),
        ("  odometry's noise 20 % larger", 1.2, 1.0),
        ("  odometry's noise 20 % smaller", 0.8, 1.0),
        ("  sensor's noise 20 % larger", 1.0, 1.2),
        ("  sensor's noise 20 % smaller", 1.0, 0.8),
    ):
        mapped = map_log(scaled(log, odometry, sensor))
        assert mapped.slam is not None
        found = {f.identity: f.mean for f in mapped.slam.features if f.identity is not None}
        nothing = {"updates": "", "NIS": "", "expected": "", "95 % band": ""}
        rows.append(row(name, found, optimum, mapped.seconds, limit, **nothing))
    return rows


def best_of(repeats: int, run: Callable[[], tuple[Any, ...]]) -> tuple[Any, float]:
    """Return the first result of a run, and the least of its seconds."""
    outcomes = [run() for _ in range(repeats)]
    return outcomes[0], min(outcome[1] for outcome in outcomes)


def landmarks_of(values: Any, identities: set[int]) -> Landmarks:
    """Return GTSAM's landmarks by their identity."""
    return {i: np.asarray(values.atPoint2(gtsam.symbol("l", i))) for i in identities}


def row(
    name: str, found: Landmarks, optimum: Landmarks, seconds: float, limit: float, **more: object
) -> dict[str, Any]:
    """Return a row of the table: errors to the optimum, time, and its share of iSAM2's."""
    order = sorted(optimum)
    a, b = np.array([found[i] for i in order]), np.array([optimum[i] for i in order])
    return {
        "estimator": name,
        "landmarks": len(found),
        "RMSE m": rms(a - b),
        "largest m": float(np.hypot(*(a - b).T).max()),
        "RMSE aligned m": rms(aligned(a, b)(a) - b),
        "seconds": seconds,
        "of iSAM2's time": seconds / limit,
        **more,
    }


def main() -> int:
    """Measure and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(os.environ.get("TRAILMARK_DATA", ROOT.parent / "shared" / "data"))
    parser.add_argument("--data", type=Path, default=default, help="folder with victoria")
    parser.add_argument(
        "--repeats", type=int, default=3, help="runs of the filter and of iSAM2, of which the best counts"
    )
    given = parser.parse_args()
    path = given.data / "victoria" / "victoria_park.txt"
    records, graph = list(load_log(path).records), held_graph(path)
    identities = {r.identity for r in records if isinstance(r, Detection) and r.identity is not None}
    with threadpool_limits(1):
        (sparse, _, updates), sparse_seconds = best_of(given.repeats, lambda: isam2(graph, every_pose=False))
        (result, _), seconds = best_of(given.repeats, lambda: run_filter(records, SlamSettings()))
        dense, dense_seconds, dense_updates = isam2(graph, every_pose=True)
        books, books_seconds = run_filter(records, SlamSettings(error="additive", iterations=1))
        once, once_seconds = run_filter(records, SlamSettings(iterations=1))
    batch = gtsam.LevenbergMarquardtOptimizer(graph, sparse, gtsam.LevenbergMarquardtParams()).optimize()
    optimum = landmarks_of(batch, identities)
    with threadpool_limits(1):
        rows = maps(path, optimum, sparse_seconds)
    for name, found, took in (
        ("EkfSlam (invariant error, iterated)", result, seconds),
        ("  without iteration", once, once_seconds),
        ("  as the books have it (additive error)", books, books_seconds),
    ):
        map_found = {f.identity: f.mean for f in found.features if f.identity is not None}
        nis = found.nis()
        figures = {"NIS": nis.mean, "expected": nis.expected, "95 % band": f"{nis.low:.2f}..{nis.high:.2f}"}
        rows.append(row(name, map_found, optimum, took, sparse_seconds, updates=len(found.updates), **figures))
    for name, values, took, count in (
        ("iSAM2, poses that read something", sparse, sparse_seconds, updates),
        ("iSAM2, each pose", dense, dense_seconds, dense_updates),
    ):
        nothing = {"NIS": "", "expected": "", "95 % band": ""}
        rows.append(
            row(name, landmarks_of(values, identities), optimum, took, sparse_seconds, updates=count, **nothing)
        )
    machine = f"{describe_machine()}, gtsam {version('gtsam')}"
    cells = [[f"{v:.3f}" if isinstance(v, float) else str(v) for v in r.values()] for r in rows]
    text = ["# Victoria Park", "", machine, "", *(__doc__ or "").strip().splitlines()[2:-2]]
    text += ["", markdown_table(list(rows[0]), cells), "", f"Batch optimum: error {graph.error(batch):.1f}."]
    reached = rows[0]["RMSE m"] <= 0.2 and rows[0]["seconds"] <= sparse_seconds
    text += [
        f"To reach: the map at most 0.2 m from the optimum, in less time than iSAM2 ({'' if reached else 'not '}"
        "reached); at most 0.3 m with other noise, by which the optimum itself moves by 0.29 to 0.38 m.",
    ]
    print("\n".join(text))
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "victoria.json").write_text(json.dumps({"machine": machine, "rows": rows}, indent=1) + "\n")
    (RESULTS / "victoria.md").write_text("\n".join(text) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
