"""Where the robot was while it recorded a log: by EKF-SLAM, as the log states it, or by odometry alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from trailmark.estimation.errors import EstimationError
from trailmark.estimation.logs.records import Detection, Increment, Log, Odometry, Pose, Record, Scan
from trailmark.estimation.maps.map_settings import MOST_OUTLIERS, OUTLIER_GATE, MapSettings, PoseSource
from trailmark.estimation.maps.mapping_settings import MappingSettings
from trailmark.estimation.scans.scan_poses import scan_poses
from trailmark.estimation.slam.ekf_slam import EkfSlam
from trailmark.estimation.slam.slam_result import SlamResult
from trailmark.estimation.slam.slam_settings import AssociationMethod, SlamSettings
from trailmark.se2 import FloatArray, compose, wrap

__all__ = ["OnProgress", "SlamRun", "Sources", "poses_of_scans", "run_slam", "sources_of"]

OnProgress = Callable[[str, int, int], None]

_ALLOWED = "allowed: values that a robot can have"

_REPORT_EVERY = 64
"""Records from one report of progress to the next."""


class Sources(NamedTuple):
    """What a log's obstacles are made of, and its poses."""

    obstacles: Literal["detections", "scans"]
    poses: Literal["slam", "log", "odometry"]


class SlamRun(NamedTuple):
    """What EKF-SLAM made of a log."""

    result: SlamResult
    association: AssociationMethod
    tentative: int
    """Features that were still to be confirmed at the end."""
    start: FloatArray
    """The pose before the first record, shape (3,)."""
    notes: tuple[str, ...] = ()
    """What a reader of the result should know."""

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
    there = {type(record) for record in log.records}
    obstacles, poses = settings.obstacles, settings.poses
    if obstacles == "auto":
        obstacles = "scans" if Scan in there else "detections"
    needed = Scan if obstacles == "scans" else Detection
    if needed not in there:
        asked = "neither scans nor detections" if settings.obstacles == "auto" else f"no {obstacles}"
        raise EstimationError(f"{asked} given, allowed: a log that shows obstacles")
    moves, stated = bool(there & {Odometry, Increment}), _states_poses(log, obstacles)
    possible = {
        "slam": moves and Detection in there,
        "log": stated,
        "odometry": moves and obstacles == "scans",
    }
    order: tuple[PoseSource, ...] = ("log", "slam", "odometry") if obstacles == "scans" else ("slam", "log")
    if poses == "auto":
        poses = next((source for source in order if possible[source]), "auto")
    if poses == "auto":
        raise EstimationError("neither odometry nor poses given, allowed: a log that says how the robot moved")
    if not possible[poses]:
        can = ", ".join(source for source in order if possible[source]) or "none"
        raise EstimationError(f"poses {poses!r} given for {obstacles}, allowed with what the log holds: {can}")
    return Sources(obstacles, poses)


def run_slam(log: Log, settings: MapSettings, poses: str, on_progress: OnProgress | None = None) -> SlamRun:
    """Run EKF-SLAM over a log; with poses "log" it takes those for its own and estimates the features only."""
    gate = settings.outlier_gate
    detections = sum(isinstance(record, Detection) for record in log.records)
    if gate != "auto":
        return _run(log, settings, poses, gate, detections, on_progress)
    run = _run(log, settings, poses, OUTLIER_GATE, int(MOST_OUTLIERS * detections), on_progress)
    if run.result.counts.outliers <= MOST_OUTLIERS * detections:
        return run
    note = (
        f"no gate against misread identities: one of {OUTLIER_GATE:g} refused over {MOST_OUTLIERS:.0%} of the readings"
    )
    return _run(log, settings, poses, None, detections, on_progress)._replace(notes=(note,))


def _run(
    log: Log, s: MapSettings, poses: str, outlier_gate: float | None, most: int, on_progress: OnProgress | None
) -> SlamRun:
    """Run EKF-SLAM until the log ends, or more than ``most`` readings are refused."""
    association = s.association
    if association == "auto":
        named = any(isinstance(record, Detection) and record.identity is not None for record in log.records)
        association = "known" if named else "joint"
    start = np.array(s.start or _first_pose(log) or (0.0, 0.0, 0.0))
    x, theta = s.mapping.pose_sigma
    slam = EkfSlam(
        {"range-bearing": s.range_bearing, "cartesian": s.cartesian},
        velocity=s.velocity,
        increment=s.increment,
        settings=SlamSettings(
            association=association,
            gate=s.gate,
            new_gate=s.new_gate,
            outlier_gate=outlier_gate,
            confirm=s.confirm,
            timeout=s.timeout,
        ),
        start=start,
        mode="mapping" if poses == "log" else "slam",
        pose_covariance=np.diag([x**2, x**2, theta**2]),
    )
    total = len(log.records)
    for i, record in enumerate(_records(log, s), start=1):
        try:
            slam.process(record)
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            raise _beyond(record, str(error)) from None
        if i % _REPORT_EVERY == 0 or i == total:
            if slam.counts.outliers > most:
                break
            if on_progress is not None:
                on_progress("records", i, total)
    slam.finish()
    result = slam.result()
    lost = ~np.isfinite(result.trajectory).all(axis=1)
    if lost.any():
        raise EstimationError(f"the estimate is no number from {result.trajectory[lost, 0].min():g} s on, {_ALLOWED}")
    return SlamRun(result, association, len(slam.filter.features) - len(result.features), start)


def poses_of_scans(log: Log, poses: Literal["log", "odometry"], start: Sequence[float] | None = None) -> FloatArray:
    """Return where a log's scans were taken from, shape (m, 3).

    Args:
        log: with scans.
        poses: "log": the poses that the scans carry, or else those between the log's ``Pose`` records around them,
            truth left out; "odometry": by odometry alone.
        start: where odometry begins, in place of the pose that the log states.
    """
    if poses == "odometry":
        _, x = scan_poses(log, "odometry")
        if start is None:
            return x
        stated = (record.pose for record in log.records if isinstance(record, Scan) and record.pose is not None)
        begun = _first_pose(log) or next(stated, (0.0, 0.0, 0.0))
        return compose(np.array(start), compose(_inverse(begun), x))
    scans = [record for record in log.records if isinstance(record, Scan)]
    if all(scan.pose is not None for scan in scans):
        return scan_poses(scans, "log")[1]
    rows = np.array([record[:4] for record in log.records if isinstance(record, Pose) and not record.truth])
    t = [scan.t for scan in scans]
    x, y, theta = (np.interp(t, rows[:, 0], column) for column in (rows[:, 1], rows[:, 2], np.unwrap(rows[:, 3])))
    return np.column_stack([x, y, np.asarray(wrap(theta))])


def _beyond(record: Record, problem: str) -> EstimationError:
    return EstimationError(f"{type(record).__name__} at {record.t:g} s cannot be used ({problem}), {_ALLOWED}")


def _states_poses(log: Log, obstacles: str) -> bool:
    """Return whether the log states the poses: at its scans, or by more than the one at which odometry begins."""
    scans = [record for record in log.records if isinstance(record, Scan)]
    if obstacles == "scans" and all(scan.pose is not None for scan in scans):
        return True
    stated = sum(isinstance(record, Pose) and not record.truth for record in log.records)
    moves = any(isinstance(record, Odometry | Increment) for record in log.records)
    return stated > (1 if moves else 0)


def _first_pose(log: Log) -> tuple[float, float, float] | None:
    """Return the pose that the log states before the first motion and the first scan."""
    for record in log.records:
        if isinstance(record, Pose) and not record.truth:
            return record.x, record.y, record.theta
        if isinstance(record, Odometry | Increment | Scan):
            return None
    return None


def _inverse(pose: tuple[float, float, float]) -> FloatArray:
    """Return the pose of the world in the frame of that pose."""
    x, y, theta = pose
    cos, sin = math.cos(theta), math.sin(theta)
    return np.array([-cos * x - sin * y, sin * x - cos * y, -theta])


def _records(log: Log, s: MapSettings) -> Iterator[Record]:
    """Yield the records, without the noise that they state where it is not to count."""
    for record in log.records:
        ignored = isinstance(record, Detection) and not s.stated_sensor_noise
        ignored = ignored or (isinstance(record, Increment) and not s.stated_motion_noise)
        yield record._replace(covariance=None) if ignored and isinstance(record, Detection | Increment) else record
