"""After EKF-SLAM, a batch over the same log: its noise estimated, all poses and features smoothed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.graph.batch import Batch
from trailmark.estimation.graph.odometry import OdometryTrack, Readings, polar_readings
from trailmark.estimation.graph.residual_checks import figures, inflation, misfit
from trailmark.estimation.graph.residual_checks import scale as scale_of
from trailmark.estimation.graph.smoother import Estimate, moved, relative_covariance, rotations, turned
from trailmark.estimation.logs.records import Record
from trailmark.estimation.maps.map_settings import MapSettings
from trailmark.estimation.maps.unnamed_features import Labels, associated
from trailmark.estimation.scans.clouds import relative
from trailmark.estimation.slam.ekf_slam import CURVATURE
from trailmark.estimation.slam.slam_result import MapFeature, SlamResult
from trailmark.se2 import FloatArray, compose, wrap

__all__ = ["BatchResult", "smoothed"]

IntArray = NDArray[np.intp]

FEWEST = 4
"""Least number of features that make a frame of their own: of the 2 m coordinates of fewer, the 3 degrees of freedom of
a rigid motion are half or more, and of one feature all."""

OnRound = Callable[[int, int], None]


class BatchResult(NamedTuple):
    """What a batch makes of a log that EKF-SLAM went through."""

    result: SlamResult
    """Poses and features of the batch, with covariances in the start's frame; the rest as EKF-SLAM had it."""
    relative: FloatArray | None
    """Covariance of each feature in the frame that the features make, shape (m, 2, 2); None for fewer than FEWEST."""
    figures: dict[str, Any]
    """What was found, as plain data."""


def smoothed(
    records: Sequence[Record],
    settings: MapSettings,
    begun: Sequence[SlamResult],
    start: FloatArray,
    times: FloatArray,
    on_round: OnRound | None = None,
) -> BatchResult:
    """Return the batch optimum of the readings that EKF-SLAM assigned to the features of its map.

    Args:
        records: of the log, in the order of time.
        settings: their noise, and whether it is estimated.
        begun: results of EKF-SLAM over these records, with the same features: the batch begins with each, and goes on
            with the one that leads to the least error.
        start: the first pose, shape (3,).
        times: of the trajectory's rows, shape (k,), ascending.
        on_round: called with the number of rounds done, and how many there are at most.
    """
    result = begun[0]
    detections = [assignment.detection for assignment in result.assignments]
    instants = np.unique([detection.t for detection in detections])
    feature = _features_of(result)
    track = OdometryTrack(records)
    readings = polar_readings(detections, instants, settings.range_bearing, settings.cartesian)
    variances = track.stated_variances(settings.velocity, settings.increment)
    batch = Batch(track, readings, instants, variances)
    guesses = [_poses_at(each.trajectory, instants, start) for each in begun]
    first = [(poses, _first_places(each, readings, poses, feature)) for each, poses in zip(begun, guesses, strict=True)]
    poses, places = batch.best_of(first, feature)
    named = any(f.identity is not None for f in result.features)
    estimate = batch.solve(poses, places, feature)
    stated = misfit(batch, estimate)
    wrong = stated.understated or (stated.overstated and settings.default_noise)
    auto = settings.fit_noise == "auto"
    if named and (settings.fit_noise == "on" or (auto and wrong)):
        estimate = batch.fit(estimate.solution.poses, estimate.solution.features, feature, on_round)
    if not named:
        # Wrong assignments look like noise: whether it is wrong cannot be told before.
        fit = settings.fit_noise == "on" or (auto and not (readings.stated and track.states_noise))
        labels = Labels(estimate.solution.features, feature)
        (labels, estimate) = associated(batch, labels, estimate.solution.poses, settings.slam, fit, on_round)
        result, feature = _relabelled(result, labels), labels.feature
    # Nothing but odometry says how the robot came to where it read first, so that it is no matter of the factors'. The
    # start is a second before the first record, since an increment ends at its time.
    ways = np.array([times[0] - 1.0, instants[0]])
    way = track.motions(ways, batch.noise.odometry)
    estimate = _begun_at(estimate, compose(start, way.u[0]))
    along = np.zeros((2 * len(estimate.solution.features), 3))
    along[0::2, 0] = along[1::2, 1] = 1.0
    x, y = (estimate.solution.features - estimate.solution.poses[0, :2]).T
    along[0::2, 2], along[1::2, 2] = -y, x
    turn = rotations(start[2:])[0]
    moves = np.zeros((len(along), estimate.calibrated.shape[1]))
    moves[:, :5] = (along @ turn @ batch.motion_changes(ways)[0])[:, : moves.shape[1]]
    joint = estimate.feature_covariance(moves)
    if batch.fitted:
        joint *= inflation(batch, estimate)
    lead = along @ turned(batch.motion_covariance(way), start[2:])[0] @ along.T
    found = _Found(batch, track, estimate, feature, joint, lead, start, figures(batch, estimate, stated))
    return _result(found, result, settings, times)


def _begun_at(estimate: Estimate, pose: FloatArray) -> Estimate:
    """Return an estimate, moved as a whole so that its first pose is this one."""
    solution = estimate.solution
    first, points = solution.poses[0], np.column_stack([solution.features, np.zeros(len(solution.features))])
    poses, places = (compose(pose, relative(first, each)) for each in (solution.poses, points))
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


def _first_places(result: SlamResult, readings: Readings, poses: FloatArray, feature: IntArray) -> FloatArray:
    """Return where to begin with each feature, shape (m, 2): the filter's estimate, or the middle of its readings.

    A feature that began with a misread name lies where that was, and the filter has refused all others.
    """
    z, pose = readings.z, poses[readings.instant]
    direction = pose[:, 2] + z[:, 1]
    seen = pose[:, :2] + z[:, :1] * np.column_stack([np.cos(direction), np.sin(direction)])
    places = np.array([f.mean for f in result.features])
    for i in range(len(places)):
        own = seen[feature == i]
        if len(own):
            middle = np.median(own, axis=0)
            far = [np.median(np.hypot(*(own - place).T)) for place in (places[i], middle)]
            places[i] = middle if 2.0 * far[1] < far[0] else places[i]
    return places


class _Found(NamedTuple):
    """What the batch came to."""

    batch: Batch
    track: OdometryTrack
    estimate: Estimate
    feature: IntArray
    joint: FloatArray
    """Covariance of the features beside the first reading's pose."""
    lead: FloatArray
    """What that pose's own, beside the start, adds."""
    start: FloatArray
    figures: dict[str, Any]


def _result(found: _Found, result: SlamResult, settings: MapSettings, times: FloatArray) -> BatchResult:
    batch, _, estimate, feature, joint, lead, start, plain = found
    scale, solution = scale_of(batch, estimate), estimate.solution
    origin = start[:2]
    means = origin + scale.factor * (solution.features - origin)
    poses = solution.poses.copy()
    poses[:, :2] = origin + scale.factor * (poses[:, :2] - origin)
    away = (means - origin).reshape(-1)
    own = np.arange(2 * len(means)).reshape(-1, 2)
    joint[own[:, :, None], own[:, None, :]] += CURVATURE * estimate.missed()
    joint = joint * scale.factor**2 + scale.sigma**2 * np.outer(away, away)
    blocks, within = (
        0.5 * (P[own[:, :, None], own[:, None, :]] + P[own[:, None, :], own[:, :, None]])
        for P in (joint + lead, relative_covariance(means, joint))
    )
    between, covariances = poses_between(found, poses, times)
    blocks += _bent(means - origin, lead[own[:, :, None], own[:, None, :]])
    features = tuple(
        f._replace(mean=mean, covariance=block, readings=int(np.count_nonzero(estimate.feature == i)))
        for i, (f, mean, block) in enumerate(zip(result.features, means, blocks, strict=True))
    )
    outliers = int(np.count_nonzero((feature >= 0) & (estimate.feature < 0)))
    used = int(np.count_nonzero(estimate.feature >= 0))
    counts = replace(result.counts, outliers=outliers, used=used)
    smooth = result._replace(
        trajectory=np.column_stack([times, between]),
        covariances=covariances,
        features=features,
        counts=counts,
    )
    return BatchResult(smooth, within if len(means) >= FEWEST else None, plain)


def _bent(away: FloatArray, lead: FloatArray) -> FloatArray:
    """Return how far the arc of a turn about the start leads from what linear errors say, shape (m, 2, 2).

    That is the square of an error, whose 0.99 quantile is 1.5 times that of normal ones of its size: twice its mean
    square counts.

    Args:
        away: of the features from the start, shape (m, 2).
        lead: covariances that the way to the first reading gives them, shape (m, 2, 2); across they are a turn's.
    """
    across = np.column_stack([-away[:, 1], away[:, 0]])
    far = np.maximum((away**2).sum(axis=1), 1e-12) ** 2
    # No more than a radian.
    turn = np.minimum(np.einsum("ni,nij,nj->n", across, lead, across) / far, 1.0)
    return np.asarray(1.5 * turn[:, None, None] ** 2 * (away[:, :, None] * away[:, None, :]))


def poses_between(found: _Found, poses: FloatArray, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return poses at times, shape (k, 3), and their covariances, shape (k, 3, 3).

    They are by odometry from the last estimated pose, led to the next one: what the odometry misses that by is spread
    over the time between the two.

    Args:
        found: the batch.
        poses: estimated, shape (n, 3).
        times: shape (k,), ascending.
    """
    batch, instants = found.batch, found.batch.instants
    every = np.union1d(times, [times[0] - 1.0, *instants])
    motions = found.track.motions(every, batch.noise.odometry)
    u = motions.u
    heading = np.concatenate([[0.0], np.cumsum(u[:, 2])])
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    steps = np.column_stack([cos * u[:, 0] - sin * u[:, 1], sin * u[:, 0] + cos * u[:, 1]])
    reckoned = np.column_stack([np.vstack([np.zeros(2), np.cumsum(steps, axis=0)]), heading])
    anchors = np.searchsorted(every, instants)
    last = np.clip(np.searchsorted(instants, every, side="right") - 1, 0, None)
    between = compose(poses[last], relative(reckoned[anchors[last]], reckoned))
    following = np.minimum(last + 1, len(anchors) - 1)
    ends = compose(poses[last], relative(reckoned[anchors[last]], reckoned[anchors[following]]))
    missed = poses[following] - ends
    missed[:, 2] = wrap(missed[:, 2])
    span = instants[following] - instants[last]
    part = np.where(span > 0.0, (every - instants[last]) / np.where(span > 0.0, span, 1.0), 0.0)
    between += np.clip(part, 0.0, 1.0)[:, None] * missed * (span > 0.0)[:, None]
    between[:, 2] = wrap(between[:, 2])
    # As errors of a motion of the whole plane about one place, those of successive motions add up.
    steps, number = turned(batch.motion_covariance(motions), between[:-1, 2]), np.arange(len(every))
    steps = moved(steps, poses[0, :2] - between[1:, :2])
    leading = (number[1:] <= anchors[0])[:, None, None]
    lead, grown = np.zeros((2, len(every), 3, 3))
    lead[1:], grown[1:] = np.cumsum(steps * leading, axis=0), np.cumsum(steps * ~leading, axis=0)
    pair = np.minimum(last, max(0, len(instants) - 2))
    first, second = anchors[pair], anchors[np.minimum(pair + 1, len(instants) - 1)]
    place, inside = poses[pair, :2], np.minimum(number, second)
    before, whole, beyond = (
        moved(grown[i] - grown[j], place - poses[0, :2])
        for i, j in ((inside, first), (second, first), (number, inside))
    )
    estimated, least = found.estimate.smoother.pair_covariances(found.estimate.solution)
    share = before @ np.linalg.inv(whole + least[pair])
    both = np.concatenate([np.eye(3) - share, share], axis=2)
    P = both @ estimated[pair] @ np.swapaxes(both, 1, 2) + before - share @ before + beyond  # noqa: N806 # a covariance
    P = moved(P, between[:, :2] - place) + moved(lead, between[:, :2] - poses[0, :2])  # noqa: N806
    covariances = 0.5 * (P + np.swapaxes(P, 1, 2))
    wanted = np.searchsorted(every, times)
    return between[wanted], covariances[wanted]


def _poses_at(trajectory: FloatArray, instants: FloatArray, start: FloatArray) -> FloatArray:
    """Return a trajectory's poses, rows t, x, y, theta, at instants, shape (n, 3), as they were last."""
    rows = np.vstack([[-np.inf, *start], trajectory])
    return np.asarray(rows[np.searchsorted(rows[:, 0], instants, side="right") - 1, 1:])
