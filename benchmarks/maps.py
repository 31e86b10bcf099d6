"""Maps from logs against the truth: MRCLAM, Victoria Park, lasers, and whether the filter knows how wrong it is.

    python -m benchmarks.maps [--only mrclam victoria lasers consistency start] [--runs 100]

- mrclam: ``trailmark map`` by the shell's defaults, with and without identities, against the survey.
- victoria: landmarks against the batch optimum that GTSAM finds for the file's own graph.
- lasers: poses and maps from raw odometry and scans against the poses that a SLAM program put into the logs.
- consistency: simulated runs with known truth; averages of NEES and NIS and their 95 % chi-square bands.
- start: the same runs by ``trailmark map``, poses and landmarks in the start's frame.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise
from time import process_time
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from tests.helpers.alignment import aligned, rms
from threadpoolctl import threadpool_limits

from benchmarks.problems import data_folder
from benchmarks.report import Claim, keep
from trailmark import Robot, World
from trailmark.estimation import EkfSlam, MapSettings, RangeBearing, SlamSettings, Unicycle, map_log
from trailmark.estimation.covariance import average, chi_square_quantile, nees
from trailmark.estimation.readers import load_log
from trailmark.estimation.records import Log, Pose, Scan
from trailmark.estimation.simulation import simulate
from trailmark.estimation.virtual_sensors import Detector
from trailmark.se2 import between, wrap
from trailmark.shapes import Disc

FloatArray = NDArray[np.float64]

CONFIDENCE = 0.99
POST = 0.055
"""Metres: radius of the tubes that carry MRCLAM's barcodes."""

NEAR, VISIT, EXPLAINED = 4.0, 20, 0.15
"""Metres between two scans of different visits to a place, scans between two visits, metres from an end to a wall."""

LASERS = ("intel", "aces", "csail", "freiburg-101")


def mrclam(runs: int) -> Iterator[Claim]:
    """Yield a row for each robot of MRCLAM 6, with identities, with noise stated twice too large, and without."""
    del runs
    plain, hidden = MapSettings(radius=POST), SlamSettings("joint", confirm=MapSettings().slam.confirm)
    twice = replace(plain, range_bearing=RangeBearing(0.12, 0.03, 0.3), velocity=Unicycle(0.024, 0.08, period=1.0))
    cases = {"known": plain, "known, noise x 2": twice, "unknown": replace(plain, slam=hidden)}
    for robot, (name, settings) in itertools.product((1, 2, 3, 5), cases.items()):
        log = load_log(data_folder() / "mrclam6", robot=robot, skip_bad=True)
        truth = np.array([record[:3] for record in log.records if isinstance(record, Pose)])
        surveyed = {int(i): np.array([x, y]) for i, x, y in log.landmarks}
        mapped = map_log(log, settings)
        assert mapped.slam is not None
        readings: dict[int, list[int]] = {}
        for reading in mapped.slam.assignments:
            if reading.feature is not None and reading.identity is not None:
                readings.setdefault(reading.feature, []).append(reading.identity)
        owner = {feature: max(set(of), key=of.count) for feature, of in readings.items()}
        kept = [i for i, feature in enumerate(mapped.slam.features) if feature.id in owner]
        features = [mapped.slam.features[i] for i in kept]
        found = np.array([feature.mean for feature in features])
        expected = np.array([surveyed[owner[feature.id]] for feature in features])
        motion = aligned(found, expected)
        covariances = [e.covariance[:2, :2] for e in (mapped.world.estimates[i] for i in kept) if e is not None]
        scores = nees((motion(found) - expected) @ motion.R, covariances)
        rows = mapped.trajectory[(mapped.trajectory[:, 0] >= truth[0, 0]) & (mapped.trajectory[:, 0] <= truth[-1, 0])]
        way = np.column_stack([np.interp(rows[:, 0], truth[:, 0], truth[:, j]) for j in (1, 2)])
        inside = int(np.count_nonzero(scores <= chi_square_quantile(CONFIDENCE, 2)))
        doubt = mapped.world.not_certified
        yield Claim(
            f"MRCLAM 6, robot {robot}, identities {name}",
            f"{len(mapped.slam.features)} features, landmarks {rms(motion(found) - expected):.3f} m, "
            f"trajectory {rms(motion(rows[:, 1:3]) - way):.3f} m, NEES {scores.mean():.1f}, {inside} discs inside",
            f"survey: {len(surveyed)} landmarks; NEES 2; all discs inside at {CONFIDENCE:g}",
            "" if doubt is None else f"not certified: {doubt}",
        )


def victoria(runs: int) -> Iterator[Claim]:
    """Yield landmarks of Victoria Park against the optimum of the file's graph."""
    del runs
    import gtsam

    path = data_folder() / "victoria" / "victoria_park.txt"
    # The graph takes the file's noise as it is stated, which a fit would find to be far too small.
    mapped = map_log(load_log(path), MapSettings(fit_noise=False))
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
    """Yield poses and maps from raw odometry and scans, against the poses that a SLAM program put into the logs.

    Mean errors of relations between poses are those of Kümmerle et al. 2009 ("On measuring the accuracy of SLAM
    algorithms"): of consecutive scans, and of as many pairs from different visits to a place.
    """
    del runs
    for name in LASERS:
        log = load_log(data_folder() / "carmen" / f"{name}-corrected.log.gz")
        scans = [record for record in log.records if isinstance(record, Scan)]
        reference = np.array([scan.pose for scan in scans])
        raw = tuple(record._replace(pose=None) if isinstance(record, Scan) else record for record in log.records)
        begin = process_time()
        mapped = map_log(log._replace(records=raw), MapSettings(poses="match"), robot=Robot.disc(0.2))
        seconds, poses = process_time() - begin, mapped.trajectory[:, 1:]
        apart = np.hypot(*(reference[:, None, :2] - reference[None, :, :2]).transpose(2, 0, 1))
        visits = np.argwhere(np.triu(apart < NEAR, VISIT))
        chosen = np.random.default_rng(0).permutation(len(visits))[: len(scans) - 1]
        pairs = np.concatenate([np.column_stack([np.arange(len(scans) - 1), np.arange(1, len(scans))]), visits[chosen]])
        true, found = (between(each[pairs[:, 0]], each[pairs[:, 1]]) for each in (reference, poses))
        error = between(true, found)
        met = [scan.ranges < scan.range_max for scan in scans]
        ends = np.concatenate(
            [
                pose[:2] + scan.ranges[m][:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
                for scan, pose, m in zip(scans, poses, met, strict=True)
                for angles in [pose[2] + scan.angle_min + scan.angle_increment * np.flatnonzero(m)]
            ]
        )
        solid = np.array([shape.polygon(1e-4).shapely() for shape in mapped.world.obstacles])
        tree = shapely.STRtree(shapely.boundary(solid))
        _, off = tree.query_nearest(shapely.points(ends), return_distance=True, all_matches=False)
        doubt = mapped.world.not_certified
        yield Claim(
            f"{name}: {len(scans)} scans matched",
            f"relations {np.hypot(*error[:, :2].T).mean():.3f} m, {np.degrees(np.abs(error[:, 2]).mean()):.2f} degrees"
            f", {100.0 * (off <= EXPLAINED).mean():.1f} % of ends within {EXPLAINED} m, {seconds:.0f} s",
            "corrected poses",
            "" if doubt is None else f"not certified: {doubt}",
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


def start(runs: int) -> Iterator[Claim]:
    """Yield NEES by its expectation in the start's frame, of ``map_log`` with the right noise, identities known."""
    for noise, laps in itertools.product((0.5, 1.0, 2.0, 4.0), (1, 2, 4)):
        found, fitted = [], 0
        for seed in range(runs):
            log, truth, sensor, motion = _loop(noise, laps, seed)
            s = MapSettings(range_bearing=sensor, velocity=motion, start=tuple(truth[0, 1:].tolist()), frame="start")
            mapped = map_log(log, s)
            assert mapped.slam is not None
            assert mapped.batch is not None
            fitted += mapped.batch.figures["fitted"]
            places = {int(i): np.array([x, y]) for i, x, y in log.landmarks}
            features, rows = mapped.slam.features, mapped.trajectory[20::20]
            off = np.array([f.mean - places[f.identity] for f in features if f.identity is not None])
            error = rows[:, 1:] - np.column_stack(
                [np.interp(rows[:, 0], truth[:, 0], column) for column in np.unwrap(truth[:, 1:], axis=0).T]
            )
            error[:, 2] = wrap(error[:, 2])
            of_poses = nees(error, mapped.slam.covariances[20::20]).mean() / 3.0
            found.append([of_poses, nees(off, np.array([f.covariance for f in features])).mean() / 2.0])
        (pose, place), sigma = np.mean(found, axis=0), np.std(found, axis=0) / np.sqrt(runs)
        outside = not (0.8 <= pose <= 1.3 and 0.8 <= place <= 1.3)
        yield Claim(
            f"start's frame, noise x {noise:g}, {laps} laps, {runs} runs",
            f"NEES of poses {pose:.2f} ± {sigma[0]:.2f}, of landmarks {place:.2f} ± {sigma[1]:.2f} of what is expected",
            f"1; noise estimated in {fitted} runs",
            "outside 0.8 to 1.3" if outside else "",
        )


def _judged(noise: float, laps: int, seed: int) -> tuple[float, float, int, float, int]:
    """Return pose NEES, joint map NEES, landmarks, summed NIS and its degrees of freedom of one simulated run."""
    log, truth, sensor, motion = _loop(noise, laps, seed)
    slam = EkfSlam(sensor, velocity=motion, start=truth[0, 1:])
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


def _loop(noise: float, laps: int, seed: int) -> tuple[Log, FloatArray, RangeBearing, Unicycle]:
    """Return a drive round a square loop with posts, the true poses, and the noise of sensor and odometry."""
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
    return log, truth, sensor, motion


PARTS: dict[str, Callable[[int], Iterator[Claim]]] = {
    "mrclam": mrclam,
    "victoria": victoria,
    "lasers": lasers,
    "consistency": consistency,
    "start": start,
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
