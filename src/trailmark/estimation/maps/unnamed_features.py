# ruff: noqa: N806 # the names are the filter's own symbols: P
"""Features without identities: filter and batch in turns, until each reading is of the feature that fits it best.

The first run of the filter knows neither the log's noise nor its systematic errors. What it confuses hardly harms
these, which all readings share: once they are estimated, the filter runs again, over motions and readings set right,
and after it the batch, which merges, assigns anew, splits and drops (:mod:`trailmark.estimation.graph.reassociation`).
From the second turn on the filter begins with the map that it has.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.filter.motion import PoseIncrement
from trailmark.estimation.filter.sensors import RangeBearing
from trailmark.estimation.graph.batch import GATE as BATCH_GATE
from trailmark.estimation.graph.batch import Batch
from trailmark.estimation.graph.estimate import Estimate, relative_covariance
from trailmark.estimation.graph.reassociation import Labels, assigned, merged, split, without_unseen
from trailmark.estimation.graph.residual_checks import description_length
from trailmark.estimation.logs.records import Detection, Increment, Record
from trailmark.estimation.slam.ekf_slam import EkfSlam
from trailmark.estimation.slam.slam_result import SlamSettings
from trailmark.se2 import FloatArray

__all__ = ["Association", "associated"]

TURNS = 2
"""Filter and batch, at most: after the second hardly anything changes."""

ALIKE = 0.98
"""The share of readings that are of the same feature as before, from which on nothing is to be gained."""

CAUTION = 4.0
"""By how much larger the odometry's variances are while the filter associates: where it skidded once, a pose that is
too sure of itself takes a neighbour for the feature itself."""

GATE, NEW_GATE = 0.999, 1.0 - 1e-8
"""Probabilities that a reading passes its own feature's gate, and the one beyond which it is of none known: a feature
begun in vain is merged later, a reading lost in between costs little."""

PLACE_SIGMA = 0.03
"""Metres: how far off features may be from where their readings show them, besides the readings' noise: what stands
somewhere is not a point."""


class Association(NamedTuple):
    """Features, and which reading is of which."""

    labels: Labels
    estimate: Estimate


def associated(
    batch: Batch,
    labels: Labels,
    poses: FloatArray,
    settings: SlamSettings,
    fit: bool,
    on_turn: Callable[[int, int], None] | None = None,
) -> Association:
    """Return which reading is of which feature, and the batch's optimum with that.

    Args:
        batch: the log.
        labels: features and readings as the filter had them.
        poses: of the batch's instants, shape (n, 3).
        settings: the filter's.
        fit: whether noise is estimated.
        on_turn: called with the number of turns done, and how many there are at most.
    """

    def optimum(labels: Labels, poses: FloatArray) -> tuple[Labels, Estimate]:
        run = batch.fit if fit else batch.solve
        estimate = run(poses, labels.places, labels.feature)
        return Labels(estimate.solution.features, labels.feature), estimate

    labels, estimate = optimum(labels, poses)
    known: Labels | None = None
    best, least = (labels, estimate, batch.noise), math.inf
    for turn in range(TURNS):
        before = labels.feature
        labels, poses = _filtered(batch, estimate, known, settings)
        labels, estimate = optimum(labels, poses)
        labels, estimate = _settled(batch, labels, estimate, settings.confirm)
        known = labels
        cost = description_length(batch, estimate, labels.feature)
        if cost < least:
            best, least = (labels, estimate, batch.noise), cost
        settled = turn == TURNS - 1 or _agreement(before, labels.feature) > ALIKE
        if on_turn is not None:
            on_turn(TURNS if settled else turn + 1, TURNS)
        if settled:
            break
    labels, estimate, batch.noise = best
    return Association(labels, estimate)


def _settled(batch: Batch, labels: Labels, estimate: Estimate, confirm: int) -> tuple[Labels, Estimate]:
    """Return the features after merging, assigning, splitting and dropping."""
    poses = estimate.solution.poses
    for _ in range(2):
        readings = batch.readings(single=True)
        labels = merged(labels, estimate.feature_covariance(), readings.instant, BATCH_GATE)
        labels = assigned(labels, poses, readings, PLACE_SIGMA, BATCH_GATE)
        labels = split(labels, poses, readings, PLACE_SIGMA, confirm)
        labels = without_unseen(labels, poses, readings, confirm)
        estimate = batch.solve(poses, labels.places, labels.feature)
        labels, poses = Labels(estimate.solution.features, labels.feature), estimate.solution.poses
    return labels, estimate


def _filtered(
    batch: Batch, estimate: Estimate, known: Labels | None, settings: SlamSettings
) -> tuple[Labels, FloatArray]:
    """Return what the filter associates, over motions and readings set right, and its poses."""
    records, number = _records(batch)
    poses = estimate.solution.poses
    slam = EkfSlam(
        # All records state their noise.
        {"range-bearing": RangeBearing(1.0, 1.0)},
        increment=PoseIncrement(1.0, 1.0, 1.0),
        settings=replace(
            settings,
            association="nearest" if settings.association == "nearest" else "joint",
            outlier_gate=None,
            distinct=True,
            merge_gate=GATE if known is None else None,
            gate=GATE,
            new_gate=NEW_GATE,
            timeout=np.inf,
        ),
        start=poses[0],
    )
    if known is not None:
        relative = relative_covariance(known.places, estimate.feature_covariance())
        for j, place in enumerate(known.places):
            slam.add_landmark(place, relative[2 * j : 2 * j + 2, 2 * j : 2 * j + 2] + PLACE_SIGMA**2 * np.eye(2))
    result = slam.run(records)
    order = {feature.id: i for i, feature in enumerate(result.features)}
    feature = np.full(len(batch.raw.z), -1, dtype=np.intp)
    for assignment in result.assignments:
        if assignment.feature is not None:
            feature[number[id(assignment.detection)]] = order.get(assignment.feature, -1)
    labels = Labels(np.array([f.mean for f in result.features]).reshape(-1, 2), feature)
    rows = result.trajectory
    at = np.searchsorted(rows[:, 0], batch.instants, side="right") - 1
    return labels.only(labels.counts() > 0), rows[np.maximum(at, 0), 1:]


def _records(batch: Batch) -> tuple[list[Record], dict[int, int]]:
    """Return motions and readings as records, and for each detection, by its ``id``, the number of its reading."""
    motions, readings = batch.motions(), batch.readings()
    P = CAUTION * batch.motion_covariance(motions) + 1e-8 * np.eye(3)
    by_instant: list[list[Detection]] = [[] for _ in batch.instants]
    number = {}
    for i, (instant, z, R) in enumerate(zip(readings.instant, readings.z, readings.covariance, strict=True)):
        detection = Detection(float(batch.instants[instant]), z, covariance=R)
        by_instant[instant].append(detection)
        number[id(detection)] = i
    records: list[Record] = list(by_instant[0])
    for t, u, covariance, seen in zip(batch.instants[1:], motions.u, P, by_instant[1:], strict=True):
        records += [Increment(float(t), float(u[0]), float(u[1]), float(u[2]), covariance), *seen]
    return records, number


def _agreement(a: NDArray[np.intp], b: NDArray[np.intp]) -> float:
    """Return the share of readings whose feature is, by the majority of its readings, the same in both."""
    same = 0
    for feature in np.unique(b[b >= 0]):
        partners = a[(b == feature) & (a >= 0)]
        same += int(np.bincount(partners).max()) if len(partners) else 0
    return same / max(1, int(np.count_nonzero(b >= 0)))
