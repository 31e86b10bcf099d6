# ruff: noqa: N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""Features without identities: filter and batch in turns, until each reading is of the feature that fits it best.

The first run of the filter knows neither the log's noise nor its systematic errors. What it confuses hardly harms
these, which all readings share: once they are estimated, the filter runs again, over motions and readings set right,
and after it the batch, which merges, assigns anew and drops. Then it runs from the log's end to its start, in
the map that there is: where it had lost its way before, it comes from the other side. After a third run the best one
counts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.covariance import chi_square_quantile
from trailmark.estimation.ekf_slam import EkfSlam, Gates, SlamSettings
from trailmark.estimation.landmark_graph import Estimate, IntArray, Readings, moved, relative_covariance, turned
from trailmark.estimation.models import PoseIncrement, RangeBearing
from trailmark.estimation.noise_fit import GATE as BATCH_GATE
from trailmark.estimation.noise_fit import Batch
from trailmark.estimation.records import Detection, Increment, Record
from trailmark.se2 import FloatArray, between, wrap

# The share of readings that two features may have at common instants and still be one: some were read twice.
TOGETHER = 0.02
TURNS = 3  # Filter and batch: forwards, backwards, forwards.
SELDOM = 0.2  # A feature read so many times less often than usual, where it should be seen, is none.
# By how much larger the odometry's variances are while the filter associates: where it skidded once, a pose that is
# too sure of itself takes a neighbour for the feature itself.
CAUTION = 4.0
# Wide gates: a feature begun in vain is merged later, a reading lost in between costs little.
GATES = Gates(own=0.999, new=1.0 - 1e-8)
# Metres: how far off features may be from where their readings show them, besides the readings' noise: what stands
# somewhere is not a point.
PLACE_SIGMA = 0.03


class Labels(NamedTuple):
    """Features, and which reading is of which."""

    places: FloatArray  # Shape (m, 2).
    feature: IntArray  # For each reading the number of its feature, or -1, shape (r,).

    def only(self, wanted: NDArray[np.bool_]) -> Labels:
        """Return some of the features, those that are wanted, shape (m,); readings of others are of none."""
        number = np.where(wanted, np.cumsum(wanted) - 1, -1)
        return Labels(self.places[wanted], np.where(self.feature >= 0, number[self.feature], -1))

    def counts(self) -> IntArray:
        """Return how many readings each feature has, shape (m,)."""
        return np.bincount(self.feature[self.feature >= 0], minlength=len(self.places))


def _merged(labels: Labels, joint: FloatArray, instant: IntArray) -> Labels:
    """Return the features with those that are one merged, the nearest pair first; ``joint`` is their covariance.

    Two are one if they were not read at the same instants and their difference passes the gate by its covariance, which
    counts what their errors have in common. Taking them for equal corrects all others, before the next pair.
    """
    x, P = labels.places.copy(), joint.copy()
    m, limit = len(x), float(chi_square_quantile(BATCH_GATE, 2))
    owner, counts = np.arange(m), labels.counts().astype(float)
    seen = np.zeros((m, int(instant.max(initial=0)) + 1), dtype=np.float32)
    used = labels.feature >= 0
    seen[labels.feature[used], instant[used]] = 1.0
    together = seen @ seen.T
    alive = counts > 0
    while True:
        rows = np.flatnonzero(alive)
        if len(rows) < 2:
            break
        i, j = (rows[index] for index in np.triu_indices(len(rows), 1))
        apart = together[i, j] <= np.maximum(1.0, TOGETHER * np.minimum(counts[i], counts[j]))
        i, j = i[apart], j[apart]
        if not len(i):
            break
        at, to = (2 * index[:, None] + np.arange(2) for index in (i, j))
        cross = P[at[:, :, None], to[:, None, :]]
        D = P[at[:, :, None], at[:, None, :]] + P[to[:, :, None], to[:, None, :]] - cross - np.swapaxes(cross, 1, 2)
        gap = x[j] - x[i]
        d2 = np.einsum("ni,nij,nj->n", gap, np.linalg.inv(D + 1e-8 * np.eye(2)), gap)
        best = int(d2.argmin())
        if d2[best] > limit:
            break
        a, b = int(i[best]), int(j[best])
        one, other = slice(2 * a, 2 * a + 2), slice(2 * b, 2 * b + 2)
        gain = (P[:, one] - P[:, other]) @ np.linalg.inv(D[best] + 1e-8 * np.eye(2))
        x += (gain @ gap[best]).reshape(-1, 2)
        P -= gain @ (P[one] - P[other])
        together[a] += together[b]
        together[:, a] = together[a]
        counts[a] += counts[b]
        alive[b] = False
        owner[owner == b] = a
    return Labels(x, np.where(used, owner[labels.feature], -1)).only(alive)


def _assigned(labels: Labels, poses: FloatArray, readings: Readings) -> Labels:
    """Return each reading assigned to the feature that it fits best, by instants, each feature once; or to none."""
    from scipy.optimize import linear_sum_assignment

    limit = float(chi_square_quantile(BATCH_GATE, 2))
    pose = poses[readings.instant]
    dx, dy = (labels.places[None] - pose[:, None, :2]).transpose(2, 0, 1)
    r = np.hypot(dx, dy)
    y = np.stack([readings.z[:, :1] - r, wrap(readings.z[:, 1:] - np.arctan2(dy, dx) + pose[:, 2:])], axis=2)
    variance = np.diagonal(readings.covariance, axis1=1, axis2=2)[:, None] + PLACE_SIGMA**2
    variance = np.broadcast_to(variance, y.shape).copy()
    variance[:, :, 1] += PLACE_SIGMA**2 * (1.0 / np.maximum(r, 0.1) ** 2 - 1.0)
    d2 = (y**2 / variance).sum(axis=2)
    feature = np.full(len(y), -1, dtype=np.intp)
    order = np.argsort(readings.instant, kind="stable")
    starts = np.flatnonzero(np.diff(readings.instant[order], prepend=-1))
    for group in np.split(order, starts[1:]):
        # A reading that fits none costs as much as the gate allows.
        costs = np.hstack([np.minimum(d2[group], 1e6), np.full((len(group), len(group)), limit)])
        rows, columns = linear_sum_assignment(costs)
        own = columns < d2.shape[1]
        feature[group[rows[own]]] = columns[own]
    return Labels(labels.places, feature)


def seen_from(poses: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ranges and bearings, shape (n, m) each, of places (m, 2) from poses (n, 3)."""
    dx, dy = (places[None] - poses[:, None, :2]).transpose(2, 0, 1)
    return np.hypot(dx, dy), np.asarray(wrap(np.arctan2(dy, dx) - poses[:, 2:]))


def _without_unseen(labels: Labels, poses: FloatArray, readings: Readings, confirm: int) -> Labels:
    """Return the features without those that hardly any reading shows, or much fewer than should.

    A feature should be seen where it lies in the box of the middle 90 % of ranges and bearings.
    """
    counts = labels.counts()
    used = readings.z[labels.feature >= 0]
    if not len(used):
        return labels
    low, high = np.quantile(used, [0.05, 0.95], axis=0)
    r, bearing = seen_from(poses, labels.places)
    inside = (r >= low[0]) & (r <= high[0]) & (bearing >= low[1]) & (bearing <= high[1])
    share = counts / np.maximum(inside.sum(axis=0), counts)
    usual = float(np.average(share, weights=counts)) if counts.sum() else 0.0
    return labels.only((counts >= confirm) & (share >= SELDOM * usual))


def associated(
    batch: Batch,
    labels: Labels,
    poses: FloatArray,
    settings: SlamSettings,
    fit: bool,
    on_turn: Callable[[int, int], None] | None = None,
) -> tuple[Labels, Estimate]:
    """Return which reading is of which feature, and the batch's optimum with that.

    Args:
        batch: the log.
        labels: features and readings as the filter had them.
        poses: of the batch's instants, shape (n, 3).
        settings: the filter's.
        fit: whether noise is estimated.
        on_turn: called with the number of turns done, and how many there are.
    """
    run = batch.fit if fit else batch.solve
    estimate = run(poses, labels.places, labels.feature)
    known: Labels | None = None
    best, least = (labels, estimate, batch.noise), np.inf
    for turn in range(TURNS):
        labels, poses = _filtered(batch, estimate, known, settings, back=turn % 2 == 1)
        estimate = run(poses, labels.places, labels.feature)
        labels = Labels(estimate.solution.features, labels.feature)
        labels, estimate = _settled(batch, labels, estimate, settings.confirm)
        known, cost = labels, description_length(batch, estimate, labels)
        if cost < least:
            best, least = (labels, estimate, batch.noise), cost
        if on_turn is not None:
            on_turn(turn + 1, TURNS)
    labels, estimate, batch.noise = best
    return labels, estimate


def description_length(batch: Batch, estimate: Estimate, labels: Labels) -> float:
    """Return how badly features explain the readings: less for a better association, fewer features among the like.

    The criterion of Schwarz 1978 (Estimating the dimension of a model, Annals of Statistics 6(2)), in which a
    reading that is of no feature costs as much as the gate allows.
    """
    limit = float(chi_square_quantile(BATCH_GATE, 2))
    y, R = (
        estimate.smoother.reading_residuals(estimate.solution, labels.feature),
        batch.readings(single=True).covariance,
    )
    # Those of no feature have no residual.
    d2 = np.fmin(np.einsum("ni,nij,nj->n", y, np.linalg.inv(R), y), limit)
    return float((d2 + np.log(np.linalg.det(R))).sum() + 2.0 * len(labels.places) * np.log(max(2, len(d2))))


def _settled(batch: Batch, labels: Labels, estimate: Estimate, confirm: int) -> tuple[Labels, Estimate]:
    """Return the features after merging, assigning and dropping."""
    poses = estimate.solution.poses
    for _ in range(2):
        readings = batch.readings(single=True)
        labels = _merged(labels, estimate.feature_covariance(), readings.instant)
        labels = _assigned(labels, poses, readings)
        labels = _without_unseen(labels, poses, readings, confirm)
        estimate = batch.solve(poses, labels.places, labels.feature)
        labels, poses = Labels(estimate.solution.features, labels.feature), estimate.solution.poses
    return labels, estimate


def _filtered(
    batch: Batch, estimate: Estimate, known: Labels | None, settings: SlamSettings, *, back: bool
) -> tuple[Labels, FloatArray]:
    """Return what the filter associates, beginning with known features at either end of the log, and its poses."""
    order = slice(None, None, -1 if back else 1)
    records, number = _records(batch, back)
    slam = EkfSlam(
        RangeBearing(1.0, 1.0),  # all records state their noise
        increment=PoseIncrement(1.0, 1.0, 1.0),
        settings=SlamSettings("joint", settings.confirm),
        gates=GATES,
        start=estimate.solution.poses[order][0],
    )
    if known is not None:
        relative = relative_covariance(known.places, estimate.feature_covariance())
        for j, place in enumerate(known.places):
            slam.add_landmark(place, relative[2 * j : 2 * j + 2, 2 * j : 2 * j + 2] + PLACE_SIGMA**2 * np.eye(2))
    result = slam.run(records)
    numbers = {feature.id: i for i, feature in enumerate(result.features)}
    feature = np.full(len(batch.raw.z), -1, dtype=np.intp)
    for assignment in result.assignments:
        if assignment.feature is not None:
            feature[number[id(assignment.detection)]] = numbers.get(assignment.feature, -1)
    labels = Labels(np.array([f.mean for f in result.features]).reshape(-1, 2), feature)
    rows = np.vstack([[-1.0, *estimate.solution.poses[order][0]], result.trajectory])
    at = np.searchsorted(rows[:, 0], np.arange(len(batch.instants)), side="right") - 1
    return labels.only(labels.counts() > 0), rows[at, 1:][order]


def _records(batch: Batch, back: bool) -> tuple[list[Record], dict[int, int]]:
    """Return motions and readings as records, and for each detection, by its ``id``, the number of its reading.

    The time of a record is its instant's number, counted from the last one where it goes back.
    """
    motions, readings = batch.motions(), batch.readings()
    u, P = motions.u, CAUTION * batch.motion_covariance(motions) + 1e-8 * np.eye(3)
    if back:
        # The error of where a motion ends is that of where it began, seen from its end.
        P = turned(moved(P, -u[:, :2]), -u[:, 2])[::-1]
        u = between(u, np.zeros(3))[::-1]
    seen: list[list[Detection]] = [[] for _ in batch.instants]
    number = {}
    for i, (instant, z, R) in enumerate(zip(readings.instant.tolist(), readings.z, readings.covariance, strict=True)):
        t = len(seen) - 1 - instant if back else instant
        seen[t].append(Detection(float(t), z, covariance=R))
        number[id(seen[t][-1])] = i
    records: list[Record] = list(seen[0])
    for t, (step, covariance) in enumerate(zip(u.tolist(), P, strict=True), start=1):
        records += [Increment(float(t), step[0], step[1], step[2], covariance), *seen[t]]
    return records, number
