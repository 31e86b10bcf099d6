"""Poses and point features of a log with detections: EKF-SLAM, and after it a batch that smooths and fits the noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from trailmark.estimation.covariance import checked_covariance
from trailmark.estimation.ekf_slam import CURVATURE, AssociationMethod, EkfSlam, Gates, MapFeature, SlamResult
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.landmark_graph import (
    Estimate,
    IntArray,
    Solution,
    moved,
    polar_readings,
    relative_covariance,
    turned,
)
from trailmark.estimation.map_settings import MappingSettings, MapSettings
from trailmark.estimation.models import as_range_bearing
from trailmark.estimation.noise_fit import Batch, disagreement, figures, misfit
from trailmark.estimation.noise_fit import scale as scale_of
from trailmark.estimation.odometry import OdometryTrack
from trailmark.estimation.records import Detection, Increment, Log, Pose, Record, Scan, first_pose
from trailmark.estimation.unnamed_features import Labels, associated
from trailmark.se2 import FloatArray, between, compose, wrap

OnProgress = Callable[[str, int, int], None]

OUTLIER_GATE = 0.9999  # Probability that a good reading passes. Misread barcodes, some in a thousand, lie far outside.
FARTHEST = 1e6  # Metres (and radians): no sensor reads farther, and squares of larger numbers lose what is near.
SUREST = 1e-6  # Metres (and radians): no sensor errs less, and a reading without any error would settle all.
_ALLOWED = "expected values that a robot can have"
_REPORT_EVERY = 64  # Records from one report of progress to the next.
# Least number of features that make a frame of their own: of the 2 m coordinates of fewer, the 3 degrees of freedom
# of a rigid motion are half or more, and of one feature all.
FEWEST = 4


class BatchResult(NamedTuple):
    """What a batch makes of a log that EKF-SLAM went through."""

    # Poses and features of the batch, with covariances in the start's frame; the rest as EKF-SLAM had it.
    result: SlamResult
    # Covariance of each feature in the frame that the features make, shape (m, 2, 2); None for fewer than FEWEST.
    relative: FloatArray | None
    figures: dict[str, Any]  # What was found, as plain data.


class SlamRun(NamedTuple):
    """What EKF-SLAM made of a log."""

    result: SlamResult
    association: AssociationMethod
    tentative: FloatArray  # Where features were that were still to be confirmed at the end, shape (k, 2).
    start: FloatArray  # The pose before the first record, shape (3,).
    batch: BatchResult | None = None  # The batch that followed.
    failure: str | None = None  # Why none did, though one was tried.

    def poses_of(self, scans: Sequence[Scan]) -> FloatArray:
        """Return where the robot was at each scan, shape (m, 3)."""
        return _poses_at(self.result.trajectory, np.array([scan.t for scan in scans]), self.start)

    def with_pose_sigma(self, scans: Sequence[Scan], mapping: MappingSettings) -> MappingSettings:
        """Return settings whose poses are as uncertain as these are on average, and no surer than they were."""
        seen = np.searchsorted(self.result.trajectory[:, 0], [scan.t for scan in scans], side="right") - 1
        if not (seen >= 0).any():
            return mapping
        P = self.result.covariances[seen[seen >= 0]].mean(axis=0)  # noqa: N806 # the filter's own symbol
        sigma = math.sqrt(0.5 * (P[0, 0] + P[1, 1])), math.sqrt(P[2, 2])
        x, theta = mapping.pose_sigma
        return replace(mapping, pose_sigma=(max(x, sigma[0]), max(theta, sigma[1])))


def run_slam(log: Log, settings: MapSettings, poses: str, on_progress: OnProgress | None = None) -> SlamRun:
    """Run EKF-SLAM over a log, and a batch after it; with poses "log" the features alone are estimated."""
    records = [_checked(record, settings) for record in log.records]
    association = settings.slam.association
    if association == "auto":
        named = any(isinstance(record, Detection) and record.identity is not None for record in records)
        association = "known" if named else "joint"
    # Where the filter errs, not the readings, a gate refuses the very readings that would set it right: where a batch
    # follows, that judges each of them.
    gates = Gates(known=OUTLIER_GATE if poses == "log" else None)
    run = _filtered(records, settings, gates, poses, association, on_progress)
    if poses == "log" or not run.result.features:
        return run
    report = None if on_progress is None else lambda done, total: on_progress("rounds", done, total)
    times = np.unique([record.t for record in records if not isinstance(record, Pose | Scan)])
    try:
        batch = _smoothed(records, settings, run.result, run.start, times, report)
    except (RuntimeError, ArithmeticError, np.linalg.LinAlgError) as error:
        return run._replace(failure=str(error).strip().partition("\n")[0])
    return run._replace(result=batch.result, batch=batch)


def _checked(record: Record, settings: MapSettings) -> Record:
    """Return a record as the estimators take it, without the noise that it states where that is not to count."""
    if isinstance(record, Detection | Increment) and not settings.stated_noise:
        record = record._replace(covariance=None)
    if not isinstance(record, Detection):
        return record
    name = f"detection at {record.t:g} s"
    if not np.abs(record.z).max() <= FARTHEST:
        raise EstimationError(f"{name}: expected z of at most {FARTHEST:g}, got {np.asarray(record.z).tolist()}")
    if record.covariance is not None:
        stated = checked_covariance(record.covariance, 2, name)
        if not np.linalg.eigvalsh(stated)[0] >= SUREST**2:
            least = f"a covariance of standard deviations of at least {SUREST:g}"
            raise EstimationError(f"{name}: expected {least}, got {stated.tolist()}")
    return as_range_bearing(record)


def _filtered(
    records: Sequence[Record],
    s: MapSettings,
    gates: Gates,
    poses: str,
    association: AssociationMethod,
    on_progress: OnProgress | None,
) -> SlamRun:
    """Run EKF-SLAM until the log ends."""
    start = np.array(s.start or first_pose(records) or (0.0, 0.0, 0.0))
    x, theta = s.mapping.pose_sigma
    slam = EkfSlam(
        s.range_bearing,
        velocity=s.velocity,
        increment=s.increment,
        settings=replace(s.slam, association=association),
        gates=gates,
        start=start,
        mode="mapping" if poses == "log" else "slam",
        pose_covariance=np.diag([x**2, x**2, theta**2]),
    )
    total = len(records)
    for i, record in enumerate(records, start=1):
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
    confirmed = {feature.id for feature in result.features}
    tentative = [feature.mean for feature in slam.features(tentative=True) if feature.id not in confirmed]
    return SlamRun(result, association, np.array(tentative).reshape(-1, 2), start)


def _smoothed(
    records: Sequence[Record],
    settings: MapSettings,
    result: SlamResult,
    start: FloatArray,
    times: FloatArray,
    on_round: Callable[[int, int], None] | None = None,
) -> BatchResult:
    """Return the batch optimum of the readings that EKF-SLAM assigned to the features of its map, at these times."""
    detections = [assignment.detection for assignment in result.assignments]
    # The start is a second before the first record, since an increment ends at its time.
    instants = np.unique([times[0] - 1.0, *(detection.t for detection in detections)])
    feature = _features_of(result)
    track = OdometryTrack(records)
    readings = polar_readings(detections, instants, settings.range_bearing)
    batch = Batch(track, readings, instants, track.stated_variances(settings.velocity, settings.increment))
    poses = _poses_at(result.trajectory, instants, start)
    estimate = batch.solve(poses, np.array([f.mean for f in result.features]), feature)
    stated, auto = misfit(batch, estimate), settings.fit_noise == "auto"
    if any(f.identity is not None for f in result.features):
        if settings.fit_noise is True or (auto and (stated.understated or stated.overstated)):
            estimate = batch.fit(estimate.solution.poses, estimate.solution.features, feature, on_round)
    else:
        # Wrong assignments look like noise: whether it is wrong cannot be told before.
        fit = settings.fit_noise is True or (auto and not (readings.stated and track.states_noise))
        labels = Labels(estimate.solution.features, feature)
        labels, estimate = associated(batch, labels, estimate.solution.poses, settings.slam, fit, on_round)
        result, feature = _relabelled(result, labels), labels.feature
    halves = disagreement(batch, estimate)
    plain = figures(batch, estimate, stated, halves)
    return _result(batch, estimate, halves, feature, start, result, times, plain)


def _begun_at(estimate: Estimate, pose: FloatArray) -> Estimate:
    """Return an estimate, moved as a whole so that its first pose is this one."""
    solution = estimate.solution
    first, points = solution.poses[0], np.column_stack([solution.features, np.zeros(len(solution.features))])
    poses, places = (compose(pose, between(first, each)) for each in (solution.poses, points))
    moved_there = solution._replace(poses=poses, features=places[:, :2])
    return estimate._replace(solution=moved_there, system=estimate.smoother.linearised(moved_there))


def _relabelled(result: SlamResult, labels: Labels) -> SlamResult:
    """Return EKF-SLAM's result with these features, and which reading is of which."""
    identity = np.zeros((2, 2))
    features = tuple(
        MapFeature(i, None, place, identity, int(count))
        for i, (place, count) in enumerate(zip(labels.places, labels.counts(), strict=True))
    )
    assignments = tuple(
        a._replace(feature=int(j) if j >= 0 else None) for a, j in zip(result.assignments, labels.feature, strict=True)
    )
    counts = replace(result.counts, ambiguous=int(np.count_nonzero(labels.feature < 0)))
    return result._replace(features=features, assignments=assignments, counts=counts)


def _features_of(result: SlamResult) -> IntArray:
    """Return the number of each reading's feature, -1 for none: by its name where it has one, refused or not."""
    by_id: dict[int | None, int] = {f.id: i for i, f in enumerate(result.features)}
    by_name: dict[int | None, int] = {f.identity: i for i, f in enumerate(result.features) if f.identity is not None}
    numbers = [by_name.get(a.identity, -1) if by_name else by_id.get(a.feature, -1) for a in result.assignments]
    return np.array(numbers, dtype=np.intp)


def _result(
    batch: Batch,
    estimate: Estimate,
    halves: float,
    feature: IntArray,
    start: FloatArray,
    result: SlamResult,
    times: FloatArray,
    plain: dict[str, Any],
) -> BatchResult:
    """Return what the batch came to in the start's frame and in that of the features, with the scale's uncertainty."""
    estimate = _begun_at(estimate, start)
    solution, scale, origin = estimate.solution, scale_of(batch, estimate), start[:2]
    joint = halves * estimate.feature_covariance()
    means = origin + scale.factor * (solution.features - origin)
    poses = solution.poses.copy()
    poses[:, :2] = origin + scale.factor * (poses[:, :2] - origin)
    away = (means - origin).reshape(-1)
    own = np.arange(2 * len(means)).reshape(-1, 2)
    joint[own[:, :, None], own[:, None, :]] += CURVATURE * estimate.missed()
    joint = joint * scale.factor**2 + scale.sigma**2 * np.outer(away, away)
    blocks, within = (
        0.5 * (P[own[:, :, None], own[:, None, :]] + P[own[:, None, :], own[:, :, None]])
        for P in (joint, relative_covariance(means, joint))
    )
    blocks += _bent(means - origin, _led(batch, solution, start))
    smooth_poses, covariances = _poses_between(batch, estimate, poses, times, halves)
    off = smooth_poses[:, :2] - origin
    covariances[:, :2, :2] += scale.sigma**2 * off[:, :, None] * off[:, None, :]
    used = estimate.feature[estimate.feature >= 0]
    readings = np.bincount(used, minlength=len(means)).tolist()
    features = tuple(
        f._replace(mean=mean, covariance=block, readings=count)
        for f, mean, block, count in zip(result.features, means, blocks, readings, strict=True)
    )
    outliers = int(np.count_nonzero((feature >= 0) & (estimate.feature < 0)))
    smooth = result._replace(
        trajectory=np.column_stack([times, smooth_poses]),
        covariances=covariances,
        features=features,
        counts=replace(result.counts, outliers=outliers, used=len(used)),
    )
    return BatchResult(smooth, within if len(means) >= FEWEST else None, plain)


def _led(batch: Batch, solution: Solution, start: FloatArray) -> FloatArray:
    """Return the covariance of features by what was driven before the first reading, shape (m, 2, 2)."""
    P = turned(batch.motion_covariance(batch.motions())[:1], start[2:])  # noqa: N806 # a covariance
    away = solution.features - solution.poses[1, :2]
    return moved(np.tile(P, (len(away), 1, 1)), away)[:, :2, :2]


def _bent(away: FloatArray, lead: FloatArray) -> FloatArray:
    """Return how far the arc of a turn about the start leads from what linear errors say, shape (m, 2, 2)."""
    across = np.column_stack([-away[:, 1], away[:, 0]])
    far = np.maximum((away**2).sum(axis=1), 1e-12) ** 2
    # No more than a radian.
    turn = np.minimum(np.einsum("ni,nij,nj->n", across, lead, across) / far, 1.0)
    return np.asarray(1.5 * turn[:, None, None] ** 2 * (away[:, :, None] * away[:, None, :]))


def _poses_between(
    batch: Batch, estimate: Estimate, poses: FloatArray, times: FloatArray, halves: float
) -> tuple[FloatArray, FloatArray]:
    """Return poses at times (k,), ascending, from estimated ones (n, 3): shape (k, 3), and covariances (k, 3, 3).

    They are by odometry from the last estimated pose, led to the next one: what the odometry misses that by is spread
    over the time between the two.
    """
    instants = batch.instants
    every = np.union1d(times, instants)
    motions = batch.motions(every)
    u = motions.u
    heading = np.concatenate([[0.0], np.cumsum(u[:, 2])])
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    steps = np.column_stack([cos * u[:, 0] - sin * u[:, 1], sin * u[:, 0] + cos * u[:, 1]])
    reckoned = np.column_stack([np.vstack([np.zeros(2), np.cumsum(steps, axis=0)]), heading])
    anchors = np.searchsorted(every, instants)
    last = np.clip(np.searchsorted(instants, every, side="right") - 1, 0, None)
    there = compose(poses[last], between(reckoned[anchors[last]], reckoned))
    following = np.minimum(last + 1, len(anchors) - 1)
    missed = poses[following] - compose(poses[last], between(reckoned[anchors[last]], reckoned[anchors[following]]))
    missed[:, 2] = wrap(missed[:, 2])
    # After the last one there is none to be led to.
    part = (every - instants[last]) / np.where(following > last, instants[following] - instants[last], np.inf)
    there += part[:, None] * missed
    there[:, 2] = wrap(there[:, 2])
    # As errors of a motion of the whole plane about one place, those of successive motions add up.
    steps, number = turned(batch.motion_covariance(motions), there[:-1, 2]), np.arange(len(every))
    steps = moved(steps, poses[0, :2] - there[1:, :2])
    grown = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(steps, axis=0)])
    pair = np.minimum(last, len(instants) - 2)
    first, second = anchors[pair], anchors[pair + 1]
    place, inside = poses[pair, :2], np.minimum(number, second)
    before, whole, beyond = (
        moved(grown[i] - grown[j], place - poses[0, :2])
        for i, j in ((inside, first), (second, first), (number, inside))
    )
    estimated, least = estimate.smoother.pair_covariances(estimate.solution)
    share = before @ np.linalg.inv(whole + least[pair])
    both = np.concatenate([np.eye(3) - share, share], axis=2)
    P = both @ (halves * estimated[pair]) @ np.swapaxes(both, 1, 2) + before - share @ before + beyond  # noqa: N806 # a covariance
    P = moved(P, there[:, :2] - place)  # noqa: N806
    covariances = 0.5 * (P + np.swapaxes(P, 1, 2))
    wanted = np.searchsorted(every, times)
    return there[wanted], covariances[wanted]


def _poses_at(trajectory: FloatArray, instants: FloatArray, start: FloatArray) -> FloatArray:
    """Return a trajectory's poses, rows t, x, y, theta, at instants, shape (n, 3), as they were last."""
    rows = np.vstack([[-np.inf, *start], trajectory])
    return np.asarray(rows[np.searchsorted(rows[:, 0], instants, side="right") - 1, 1:])
