"""What a log's obstacles are made of, and where the robot was: by EKF-SLAM, by the log, or by odometry alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.covariance import checked_covariance
from trailmark.estimation.logs.records import Detection, Increment, Log, Odometry, Pose, Record, Scan, first_pose
from trailmark.estimation.maps.batch_slam import BatchResult, smoothed
from trailmark.estimation.maps.map_settings import MappingSettings, MapSettings, ObstacleSource, PoseSource
from trailmark.estimation.slam.ekf_slam import EkfSlam
from trailmark.estimation.slam.slam_result import AssociationMethod, SlamResult, SlamSettings
from trailmark.se2 import FloatArray

__all__ = ["OnProgress", "SlamRun", "Sources", "run_slam", "sources_of"]

OnProgress = Callable[[str, int, int], None]

OUTLIER_GATE = 0.9999
"""Probability that a good reading passes. Misread barcodes, some in a thousand, lie far outside."""

FARTHEST = 1e6
"""Metres (and radians): no sensor reads farther, and squares of larger numbers lose what is near."""

SUREST = 1e-6
"""Metres (and radians): no sensor errs less, and a reading without any error would settle all."""

MANY = 0.01
"""A hundred times as many refused readings as the gate refuses of good ones: some are good, or many are misread."""

_ALLOWED = "expected values that a robot can have"

_REPORT_EVERY = 64
"""Records from one report of progress to the next."""


class Sources(NamedTuple):
    """What a log's obstacles are made of, and its poses."""

    obstacles: ObstacleSource
    poses: PoseSource


class SlamRun(NamedTuple):
    """What EKF-SLAM made of a log."""

    result: SlamResult
    association: AssociationMethod
    tentative: int
    """Features that were still to be confirmed at the end."""
    start: FloatArray
    """The pose before the first record, shape (3,)."""
    batch: BatchResult | None = None
    """The batch that followed."""

    def poses_of(self, scans: Sequence[Scan]) -> FloatArray:
        """Return where the robot was at each scan, shape (m, 3), as it was estimated then."""
        rows = np.vstack([[-math.inf, *self.start], self.result.trajectory])
        return np.asarray(rows[np.searchsorted(rows[:, 0], [scan.t for scan in scans], side="right") - 1, 1:])

    def with_pose_sigma(self, scans: Sequence[Scan], mapping: MappingSettings) -> MappingSettings:
        """Return settings whose poses are as uncertain as these are on average, and no surer than they were."""
        seen = np.searchsorted(self.result.trajectory[:, 0], [scan.t for scan in scans], side="right") - 1
        if not (seen >= 0).any():
            return mapping
        P = self.result.covariances[seen[seen >= 0]].mean(axis=0)  # noqa: N806 # the filter's own symbol
        sigma = math.sqrt(0.5 * (P[0, 0] + P[1, 1])), math.sqrt(P[2, 2])
        x, theta = mapping.pose_sigma
        return replace(mapping, pose_sigma=(max(x, sigma[0]), max(theta, sigma[1])))


def sources_of(log: Log, settings: MapSettings) -> Sources:
    """Return what obstacles and poses come from, with "auto" resolved.

    Raises:
        EstimationError: the log does not hold what the settings ask for, or nothing that a world could be made of.
    """
    scans = [record for record in log.records if isinstance(record, Scan)]
    there = {type(record) for record in log.records}
    if not any((np.asarray(scan.ranges) > 0.0).any() for scan in scans):  # lost readings are NaN
        there.discard(Scan)
    obstacles, poses = settings.obstacles, settings.poses
    if obstacles == "auto":
        obstacles = "scans" if Scan in there else "detections"
    if (Scan if obstacles == "scans" else Detection) not in there:
        found = "neither scans nor detections" if settings.obstacles == "auto" else f"no {obstacles}"
        found += f" ({len(scans):,} scans without one reading)" if scans and Scan not in there else ""
        raise EstimationError(f"expected a log that shows obstacles, got {found}")
    moves = bool(there & {Odometry, Increment})
    carried = [scan.pose is not None for scan in scans]
    # By more than the one pose at which odometry begins.
    stated = sum(isinstance(record, Pose) and not record.truth for record in log.records) > (1 if moves else 0)
    possible = {
        "match": moves and Scan in there,
        "slam": moves and Detection in there,
        "log": stated or (obstacles == "scans" and all(carried)),
        "odometry": moves and obstacles == "scans",
    }
    order: tuple[PoseSource, ...] = ("log", "match", "slam", "odometry") if obstacles == "scans" else ("slam", "log")
    if poses == "auto":
        poses = next((source for source in order if possible[source]), "auto")
    if poses == "auto":
        raise EstimationError("expected a log that says how the robot moved, got neither odometry nor poses")
    if not possible[poses]:
        can = ", ".join(source for source in order if possible[source]) or "none"
        raise EstimationError(f"poses: expected what the log holds for {obstacles} ({can}), got {poses!r}")
    return Sources(obstacles, poses)


def run_slam(log: Log, settings: MapSettings, poses: str, on_progress: OnProgress | None = None) -> SlamRun:
    """Run EKF-SLAM over a log, and a batch after it; with poses "log" the features alone are estimated."""
    detections = [record for record in log.records if isinstance(record, Detection)]
    for detection in detections:
        if not np.abs(detection.z).max() <= FARTHEST:
            z = np.asarray(detection.z).tolist()
            raise EstimationError(f"detection at {detection.t:g} s: expected z of at most {FARTHEST:g}, got {z}")
        if settings.stated_noise and detection.covariance is not None:
            name = f"detection at {detection.t:g} s"
            stated = checked_covariance(detection.covariance, 2, name)
            if not np.linalg.eigvalsh(stated)[0] >= SUREST**2:
                least = f"a covariance of standard deviations of at least {SUREST:g}"
                raise EstimationError(f"{name}: expected {least}, got {stated.tolist()}")
    s, association = settings.slam, settings.slam.association
    if association == "auto":
        association = "known" if any(detection.identity is not None for detection in detections) else "joint"
    s = replace(s, association=association, outlier_gate=OUTLIER_GATE if s.outlier_gate == "auto" else s.outlier_gate)
    run = _run(log, settings, s, poses, association, on_progress)
    if poses == "log" or not settings.smooth or not run.result.features:
        return run
    begun = [run.result]
    if association == "known" and run.result.counts.outliers > MANY * run.result.counts.detections:
        # Where the filter errs, not the readings, the gate refuses the very readings that would set it right. The batch
        # finds out which it was: it begins with either, and judges each reading again.
        begun.append(_run(log, settings, replace(s, outlier_gate=None), poses, association, on_progress).result)
    report = None if on_progress is None else lambda done, total: on_progress("rounds", done, total)
    times = np.unique([record.t for record in log.records if not isinstance(record, Pose | Scan)])
    try:
        batch = smoothed(list(_records(log, settings)), settings, begun, run.start, times, report)
    except (RuntimeError, ArithmeticError, np.linalg.LinAlgError) as error:
        reason = str(error).strip().partition("\n")[0]
        raise EstimationError(f"{_ALLOWED}, got a log that no batch fits ({reason}); setting smooth: false") from None
    return run._replace(result=batch.result, batch=batch)


def _run(
    log: Log,
    s: MapSettings,
    slam_settings: SlamSettings,
    poses: str,
    association: AssociationMethod,
    on_progress: OnProgress | None,
) -> SlamRun:
    """Run EKF-SLAM until the log ends."""
    start = np.array(s.start or first_pose(log.records) or (0.0, 0.0, 0.0))
    x, theta = s.mapping.pose_sigma
    slam = EkfSlam(
        {"range-bearing": s.range_bearing, "cartesian": s.cartesian},
        velocity=s.velocity,
        increment=s.increment,
        settings=slam_settings,
        start=start,
        mode="mapping" if poses == "log" else "slam",
        pose_covariance=np.diag([x**2, x**2, theta**2]),
    )
    total = len(log.records)
    for i, record in enumerate(_records(log, s), start=1):
        try:
            slam.process(record)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            problem = f"{_ALLOWED}, got {type(record).__name__} at {record.t:g} s, which cannot be used ({error})"
            raise EstimationError(problem) from None
        if on_progress is not None and (i % _REPORT_EVERY == 0 or i == total):
            on_progress("records", i, total)
    slam.finish()
    result = slam.result()
    lost = ~np.isfinite(result.trajectory).all(axis=1)
    if lost.any():
        first = result.trajectory[lost, 0].min()
        raise EstimationError(f"{_ALLOWED}, got an estimate that is no number from {first:g} s on")
    return SlamRun(result, association, len(slam.filter.features) - len(result.features), start)


def _records(log: Log, s: MapSettings) -> Iterator[Record]:
    """Yield the records, without the noise that they state where it is not to count."""
    for record in log.records:
        if isinstance(record, Detection | Increment) and not s.stated_noise:
            record = record._replace(covariance=None)
        yield record
