"""Maps from logs against the truth: MRCLAM, Victoria Park, lasers, and whether the filter knows how wrong it is.

    python -m benchmarks.maps [--only mrclam victoria lasers consistency] [--runs 100]

- mrclam: ``trailmark map`` by the shell's defaults, with and without identities, against the survey.
- victoria: landmarks against the batch optimum that GTSAM finds for the file's own graph.
- lasers: trajectories from raw odometry and scans against the poses that a SLAM program put into the logs.
- consistency: simulated runs with known truth; averages of NEES and NIS and their 95 % chi-square bands.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.helpers.alignment import aligned, rms
from threadpoolctl import threadpool_limits

from benchmarks.problems import data_folder
from benchmarks.report import Claim, keep
from trailmark import World
from trailmark.estimation import EkfSlam, MapSettings, RangeBearing, Unicycle, map_log
from trailmark.estimation.covariance import average, nees
from trailmark.estimation.readers import load_log
from trailmark.estimation.records import Pose
from trailmark.estimation.simulation import simulate
from trailmark.estimation.virtual_sensors import Detector
from trailmark.se2 import wrap
from trailmark.shapes import Disc

FloatArray = NDArray[np.float64]

CONFIDENCE = 0.99
POST = 0.055
"""Metres: radius of the tubes that carry MRCLAM's barcodes."""

LASERS = ("intel", "aces", "csail", "freiburg-101")


def mrclam(runs: int) -> Iterator[Claim]:
    """Yield a row for each robot of MRCLAM 6, with identities and without."""
    del runs
    for robot in (1, 2, 3, 5):
        log = load_log(data_folder() / "mrclam6", robot=robot, skip_bad=True)
        truth = np.array([record[:3] for record in log.records if isinstance(record, Pose)])
        surveyed = {int(i): np.array([x, y]) for i, x, y in log.landmarks}
        for identities in (True, False):
            settings = MapSettings(radius=POST)
            if not identities:
                settings = replace(settings, slam=replace(settings.slam, association="joint"))
            mapped = map_log(log, settings)
            assert mapped.slam is not None
            readings: dict[int, list[int]] = {}
            for reading in mapped.slam.assignments:
                if reading.feature is not None and reading.identity is not None:
                    readings.setdefault(reading.feature, []).append(reading.identity)
            owner = {feature: max(set(of), key=of.count) for feature, of in readings.items()}
            features = [feature for feature in mapped.slam.features if feature.id in owner]
            found = np.array([feature.mean for feature in features])
            expected = np.array([surveyed[owner[feature.id]] for feature in features])
            motion = aligned(found, expected)
            errors = (motion(found) - expected) @ motion.R
            scores = [e @ np.linalg.solve(f.covariance, e) for e, f in zip(errors, features, strict=True)]
            rows = mapped.trajectory[
                (mapped.trajectory[:, 0] >= truth[0, 0]) & (mapped.trajectory[:, 0] <= truth[-1, 0])
            ]
            way = np.column_stack([np.interp(rows[:, 0], truth[:, 0], truth[:, j]) for j in (1, 2)])
            yield Claim(
                f"MRCLAM 6, robot {robot}, identities {'known' if identities else 'unknown'}",
                f"{len(mapped.slam.features)} features, landmarks {rms(errors):.3f} m, "
                f"trajectory {rms(motion(rows[:, 1:3]) - way):.3f} m, NEES {np.mean(scores):.1f}",
                f"survey: {len(surveyed)} landmarks; NEES 2",
            )


def victoria(runs: int) -> Iterator[Claim]:
    """Yield landmarks of Victoria Park against the optimum of the file's graph."""
    del runs
    import gtsam

    path = data_folder() / "victoria" / "victoria_park.txt"
    # The graph takes the file's noise as it is stated, which a fit would find to be far too small.
    mapped = map_log(load_log(path), MapSettings(fit_noise="off"))
    assert mapped.slam is not None
    found = {f.identity: f.mean for f in mapped.slam.features if f.identity is not None}
    graph, initial = gtsam.load2D(str(path))
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(), gtsam.noiseModel.Diagonal.Sigmas(np.full(3, 1e-6))))
    # From dead reckoning the optimum of the graph is not found; from the map's own landmarks and poses it is.
    poses = {int(t): pose for t, *pose in mapped.trajectory.tolist()}
    values = gtsam.Values()
    for key in (key for key in initial.keys() if key < 1 << 56):  # noqa: SIM118  # gtsam's Values
        values.insert(key, gtsam.Pose2(*poses[key]) if key in poses else initial.atPose2(key))
    for i, place in found.items():
        values.insert(gtsam.symbol("l", i), np.asarray(place))
    batch = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    optimum = {i: np.asarray(batch.atPoint2(gtsam.symbol("l", i))) for i in found}
    errors = np.array([found[i] - optimum[i] for i in sorted(found)])
    yield Claim(
        "Victoria Park, trailmark map", f"{len(found)} landmarks, {rms(errors):.3f} m off", "GTSAM's batch optimum"
    )


def lasers(runs: int) -> Iterator[Claim]:
    """Yield trajectories from raw odometry and scans against the logs' corrected poses."""
    del runs
    for name in LASERS:
        path = data_folder() / "carmen" / f"{name}-corrected.log.gz"
        log = load_log(path)
        poses = np.array([record[:4] for record in log.records if isinstance(record, Pose)])
        mapped = map_log(log, MapSettings(poses="match"))
        times = mapped.trajectory[:, 0]
        inside = (times >= poses[0, 0]) & (times <= poses[-1, 0])
        truth = np.column_stack([np.interp(times[inside], poses[:, 0], poses[:, j]) for j in (1, 2)])
        own = mapped.trajectory[inside, 1:3]
        yield Claim(
            f"{name}: trajectory by scan matching", f"{rms(aligned(own, truth)(own) - truth):.3f} m", "corrected poses"
        )


def consistency(runs: int) -> Iterator[Claim]:
    """Yield NEES and NIS of simulated runs round a square loop with posts, identities known."""
    for noise, laps in ((1.0, 2), (4.0, 2), (1.0, 6)):
        poses, maps, innovations, degrees, sizes = [], [], [], [], []
        for seed in range(runs):
            pose, landmarks, size, total, dof = _judged(noise, laps, seed)
            poses.append(pose)
            maps.append(landmarks)
            sizes.append(2 * size)
            innovations.append(total)
            degrees.append(dof)
        named = {
            "pose NEES": (average(poses, 3), 1.0),
            "map NEES": (average(maps, np.array(sizes)), float(np.mean(sizes)) / 2.0),
            "NIS": (average(innovations, np.array(degrees)), float(np.mean(degrees))),
        }
        figure = ", ".join(f"{name} {of.mean / by:.2f}" for name, (of, by) in named.items())
        bands = ", ".join(f"{of.low / by:.2f} to {of.high / by:.2f}" for of, by in named.values())
        outside = ", ".join(name for name, (of, _) in named.items() if not of.inside)
        missed = f"outside: {outside}" if outside else ""
        yield Claim(
            f"simulated loop, noise x {noise:g}, {laps} laps, {runs} runs", figure, f"95 % bands {bands}", missed
        )


def _judged(noise: float, laps: int, seed: int) -> tuple[float, float, int, float, int]:
    """Return pose NEES, joint map NEES, landmarks, summed NIS and its degrees of freedom of one simulated run."""
    corners = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 20.0], [0.0, 20.0], [0.0, 0.0]])
    posts = []
    for a, b in pairwise(corners):
        along = (b - a) / 20.0
        left = np.array([-along[1], along[0]])
        posts += [a + s * along + (1.8 if k % 2 else -1.8) * left for k, s in enumerate(np.arange(2.0, 20.0, 4.0))]
    discs = tuple(Disc((float(x), float(y)), 0.05) for x, y in posts)
    world, way = World("loop", (-3.0, -3.0, 23.0, 23.0), discs), np.concatenate([*[corners[:-1]] * laps, corners[:1]])
    sensor, motion = RangeBearing(0.1 * noise, 0.02 * noise), Unicycle(0.05 * noise, 0.02 * noise, period=1.0)
    log, truth = simulate(
        world, way, motion, detector=Detector(sensor, max_range=7.0, period=1.0), speed=1.0, turn_rate=1.0, period=0.25,
        random_state=seed,
    )  # fmt: skip
    slam = EkfSlam({"range-bearing": sensor}, velocity=motion, start=truth[0, 1:])
    result = slam.run(log.records)
    places = {int(i): np.array([x, y]) for i, x, y in log.landmarks}
    error = slam.filter.pose - truth[-1, 1:]
    error[2] = wrap(error[2])
    off = np.concatenate([f.mean - places[f.identity] for f in result.features if f.identity is not None])
    rows = np.concatenate([np.arange(*slam.filter.features[f.id].indices(len(slam.filter.x))) for f in result.features])
    nis = [float(update.nis) for update in result.updates]
    dof = sum(int(update.dof) for update in result.updates)
    joint = slam.filter.P[np.ix_(rows, rows)]
    return float(nees(error, slam.filter.P[:3, :3])), float(nees(off, joint)), len(result.features), sum(nis), dof


PARTS: dict[str, Callable[[int], Iterator[Claim]]] = {
    "mrclam": mrclam,
    "victoria": victoria,
    "lasers": lasers,
    "consistency": consistency,
}


def main() -> int:
    """Measure and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--runs", type=int, default=100, help="simulated, of each setting")
    options = parser.parse_args()
    found: list[Any] = []
    with threadpool_limits(1):
        for name in options.only:
            for claim in PARTS[name](options.runs):
                print(*claim, sep=" | ", file=sys.stderr, flush=True)
                found.append(claim)
    keep("maps", found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
