# ruff: noqa: N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""Which reading is of which feature.

Readings of one instant are distinguished by the squared Mahalanobis distance d² = yᵀ S⁻¹ y to what each feature should
read, which has a chi-square distribution where reading and feature belong together. There are two thresholds: under
the first a reading may be of the feature, above the second of all features it shows a new one. In between it may be
either, and is ignored: a wrong feature, or one feature as two, harms a filter more than a reading less.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import Count, PositiveOrInfinite, Probability, checked_fields
from trailmark.estimation.covariance import chi_square_quantile
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.models import SensorModel
from trailmark.estimation.records import Detection
from trailmark.estimation.slam_filter import Prediction, SlamFilter
from trailmark.se2 import FloatArray

AssociationMethod = Literal["known", "nearest", "joint"]


@dataclass(frozen=True)
class SlamSettings:
    """How readings find their features, and when a feature counts.

    The choice "auto" is for :func:`trailmark.estimation.map_log`, which reads the whole log before it runs.

    Raises:
        EstimationError: a value that is not allowed.
    """

    #: "known": by the identity that the sensor reports; "nearest": gated nearest neighbour; "joint": JCBB; "auto":
    #: known if any detection of the log has an identity, else joint.
    association: AssociationMethod | Literal["auto"] = "known"
    #: Probability that a reading passes the gate of its own feature; also of JCBB's joint gate.
    gate: Probability = 0.99
    #: Probability that a reading of a feature passes that feature's second gate: what passes none is new.
    new_gate: Probability = 0.999999
    #: Without identities: whether a reading whose near features all went to others of its instant shows a new one.
    distinct: bool = False
    #: Without identities: probability that two estimates of one point pass as one; None merges none.
    merge_gate: Probability | None = None
    #: With known identities: probability that a reading passes, those that do not are ignored; None lets all pass.
    #: "auto": 0.9999; where much fails it, the noise is estimated.
    outlier_gate: Probability | Literal["auto"] | None = None
    confirm: Count = 3  #: Readings after which a feature is confirmed. One of known identity is from the first on.
    timeout: PositiveOrInfinite = 10.0  #: Seconds without a reading after which a tentative feature is dropped.

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)
        if self.gate > self.new_gate:
            raise EstimationError(f"SlamSettings: expected gate <= new_gate, got {self.gate}, {self.new_gate}")


@dataclass
class Counts:
    """How many records there were, and what became of them."""

    records: int = 0  # All of them.
    detections: int = 0  # Detections.
    used: int = 0  # Detections that corrected the state or started a feature.
    repeated: int = 0  # Records that say again what one of the same instant said, skipped.
    ambiguous: int = 0  # Detections between the two gates, ignored.
    outliers: int = 0  # Detections of a known identity too far from what they should have read, ignored.
    unidentified: int = 0  # Detections without the identity that the association asks for, ignored.
    not_estimated_from: int = 0  # Poses that are truth or a reference, and scans.
    dropped: int = 0  # Tentative features that were not seen again in time.
    merged: int = 0  # Features that turned out to be another one.
    cut_short: int = 0  # Joint associations whose search was cut short.


NEW = -1  # Stands for a feature not seen before.
IGNORED = -2  # Stands for no feature: the reading is ambiguous.

IntArray = NDArray[np.intp]


class Compatibility(NamedTuple):
    """How well each of r readings fits each of k features by itself."""

    y: FloatArray  # z − ẑ, shape (r, k, m).
    R: FloatArray  # Covariance of each reading, were it of that feature, shape (r, k, m, m).
    d2: FloatArray  # yᵀ S⁻¹ y, shape (r, k).

    def select(self, which: IntArray) -> Compatibility:
        """Return the fit to some of the features only, by their numbers in this one, shape (j,)."""
        return Compatibility(self.y[:, which], self.R[:, which], self.d2[:, which])


class JointAssociation(NamedTuple):
    """The readings and features that fit together best, as a whole."""

    assigned: IntArray  # For each reading the number of its feature in the prediction, or NEW or IGNORED, shape (r,).
    nis: float  # Joint d² of all pairs.
    complete: bool  # False if the search was cut short: then there may be a better one.


def compatibility(
    z: ArrayLike, prediction: Prediction, sensor: SensorModel, stated: Sequence[FloatArray | None] | None = None
) -> Compatibility:
    """Return how well each reading fits each feature by itself; O(r k).

    Args:
        z: readings, shape (r, m).
        prediction: of k features.
        sensor: what read them.
        stated: for each reading its covariance (m, m) where the log states one, else None; None where it never does.
    """
    readings = np.asarray(z, dtype=np.float64).reshape(-1, sensor.reading_dim)
    y = sensor.residual(readings[:, None], prediction.z_hat[None])
    R = np.broadcast_to(prediction.R, (len(readings), *prediction.R.shape))
    S = prediction.S
    if stated is not None and any(covariance is not None for covariance in stated):
        R = R.copy()
        for i, covariance in enumerate(stated):
            if covariance is not None:
                R[i] = covariance
        S = S - prediction.R + R
    d2 = (y[..., None, :] @ np.linalg.inv(S) @ y[..., None])[..., 0, 0]
    return Compatibility(y, R, d2)


def nearest(d2: ArrayLike, gate: float, new_gate: float) -> IntArray:
    """Return for each reading its nearest feature, if within the gate, or NEW or IGNORED, shape (r,).

    A feature takes one reading of an instant, the nearest. A reading whose nearest feature takes another one is
    ignored: it does not go to its second nearest.

    Args:
        d2: squared Mahalanobis distances, shape (r, k).
        gate: largest d² of a reading to its own feature.
        new_gate: least d² of a reading of a new feature to all others, >= gate.
    """
    distance = np.asarray(d2, dtype=np.float64)
    assigned = np.full(len(distance), NEW, dtype=np.intp)
    if distance.size == 0:
        return assigned
    feature, least = distance.argmin(axis=1), distance.min(axis=1)
    assigned[least <= new_gate] = IGNORED
    for i in np.argsort(least, kind="stable"):
        if least[i] <= gate and feature[i] not in assigned:
            assigned[i] = feature[i]
    return assigned


def distinct(assigned: ArrayLike, d2: ArrayLike, new_gate: float) -> IntArray:
    """Return the association, shape (r,), in which an ignored reading is new if it can be of no feature known so far.

    The readings of an instant are of distinct features. A reading near features that all went to other readings of
    its instant is therefore of none of them, however near it is.

    Args:
        assigned: for each reading its feature's number, or NEW or IGNORED, shape (r,).
        d2: squared Mahalanobis distances, shape (r, k).
        new_gate: least d² of a reading of a new feature to all features that are left.
    """
    result, distance = np.array(assigned, dtype=np.intp), np.asarray(d2, dtype=np.float64)
    left = np.ones(distance.shape[1], dtype=bool)
    left[result[result >= 0]] = False
    near = (distance[:, left] <= new_gate).any(axis=1)
    result[(result == IGNORED) & ~near] = NEW
    return result


def joint_compatibility(
    compatible: Compatibility,
    joint: FloatArray,
    gate: float,
    new_gate: float,
    *,
    probability: float,
    node_limit: int = 20_000,
) -> JointAssociation:
    """Return the largest set of pairs that fit together: Neira & Tardós 2001's JCBB (IEEE T-RA 17(6), 890–897).

    Pairs that fit one by one may not fit together, since the readings share the error of the pose. The readings are
    gone through in order, each with its compatible features, the nearest first, or with none; a set is followed as
    long as it is jointly compatible, d² of all its pairs under the chi-square quantile of their number, and as long
    as it may still have more pairs than the best one found, or as many and a smaller d².

    Args:
        compatible: of r readings and k features.
        joint: H P Hᵀ of the features' readings together, shape (k, m, k, m).
        gate: largest d² of a reading to its own feature.
        new_gate: least d² of a reading of a new feature to all others, >= gate.
        probability: of the joint gate, in (0, 1).
        node_limit: how many sets to consider; the number grows exponentially where many features are close together.
    """
    r, k, m = compatible.y.shape
    rows = compatible.d2
    candidates = [np.flatnonzero(row <= gate)[np.argsort(row[row <= gate], kind="stable")].tolist() for row in rows]
    limits = np.concatenate([[0.0], chi_square_quantile(probability, m * np.arange(1, r + 1))])
    best, nodes = _Pairs((), np.zeros((0, 0)), np.zeros(0), 0.0), 0

    def may_win(found: _Pairs, i: int) -> bool:
        """Whether more pairs than the best set has, or as many with a smaller d², can still come of it."""
        possible = len(found.pairs) + sum(1 for row in candidates[i:] if row)
        return possible > len(best.pairs) or (possible == len(best.pairs) and found.d2 < best.d2)

    def extend(found: _Pairs, i: int) -> None:
        """Try all assignments of the readings i, i + 1 and so on."""
        nonlocal best, nodes
        if i == r:
            best = found if may_win(found, i) else best
            return
        assigned = {j for _, j in found.pairs}
        for j in candidates[i]:
            if j in assigned:
                continue
            nodes += 1
            if nodes > node_limit:
                break
            more = _extended(found, i, j, compatible, joint)
            if more.d2 <= limits[len(more.pairs)] and may_win(more, i + 1):
                extend(more, i + 1)
        if may_win(found, i + 1):
            extend(found, i + 1)

    extend(best, 0)
    assigned = np.full(r, NEW, dtype=np.intp)
    if k:
        assigned[rows.min(axis=1) <= new_gate] = IGNORED
    for i, j in best.pairs:
        assigned[i] = j
    return JointAssociation(assigned, best.d2, nodes <= node_limit)


class Associator:
    """Assigns detections to a filter's features, and counts what it leaves out.

    Args:
        ekf: the filter; it is only read.
        settings: by identity, nearest neighbour or joint compatibility, and the gates.
        counts: where detections that are left out are counted.
    """

    def __init__(self, ekf: SlamFilter, settings: SlamSettings, counts: Counts) -> None:
        self._filter, self._settings, self._counts = ekf, settings, counts

    def assign(self, sensor: SensorModel, detections: Sequence[Detection], ids: Mapping[int, int]) -> list[int]:
        """Return the feature's id of each detection, or NEW or IGNORED."""
        if self._settings.association == "known":
            return [self._known(sensor, detection, ids) for detection in detections]
        settings = self._settings
        prediction = self._filter.predict_readings(sensor)
        gate, new_gate = chi_square_quantile([settings.gate, settings.new_gate], sensor.reading_dim)
        z, stated = [detection.z for detection in detections], [detection.covariance for detection in detections]
        fit = compatibility(z, prediction, sensor, stated)
        if settings.association == "nearest":
            assigned = nearest(fit.d2, gate, new_gate)
        else:
            # Features that no reading comes near have no part in it, and would make it slow.
            near = np.flatnonzero((fit.d2 <= new_gate).any(axis=0))
            prediction, fit = prediction.select(near), fit.select(near)
            joint = self._filter.joint_covariance(prediction)
            found = joint_compatibility(fit, joint, gate, new_gate, probability=settings.gate)
            assigned = found.assigned
            self._counts.cut_short += not found.complete
        if settings.distinct:
            assigned = distinct(assigned, fit.d2, new_gate)
        self._counts.ambiguous += int(np.count_nonzero(assigned == IGNORED))
        return [prediction.ids[j] if j >= 0 else int(j) for j in assigned]

    def _known(self, sensor: SensorModel, detection: Detection, ids: Mapping[int, int]) -> int:
        if detection.identity is None:
            self._counts.unidentified += 1
            return IGNORED
        feature = ids.get(detection.identity, NEW)
        if feature != NEW and self._settings.outlier_gate is not None:
            innovation = self._filter.innovation(detection.z, sensor, feature, detection.covariance)
            if innovation.nis > chi_square_quantile(self._settings.outlier_gate, innovation.dof):
                self._counts.outliers += 1
                return IGNORED
        return feature


def repeats(a: Detection, b: Detection) -> bool:
    """Return whether two detections of one instant are one: of the same feature by name, or the same reading."""
    if a.kind != b.kind or a.identity != b.identity:
        return False
    return a.identity is not None or np.array_equal(a.z, b.z)


class _Pairs(NamedTuple):
    """Pairs, with L⁻¹ of their joint S = L Lᵀ and L⁻¹ y, which grow by rows as pairs are added."""

    pairs: tuple[tuple[int, int], ...]
    L_inverse: FloatArray
    scaled: FloatArray
    d2: float


def _extended(found: _Pairs, i: int, j: int, compatible: Compatibility, joint: FloatArray) -> _Pairs:
    """Return the pairs with reading i as one of feature j, too."""
    y, R, _ = compatible
    m, size = y.shape[2], len(found.scaled)
    others = [other for _, other in found.pairs]
    cross = joint[j][:, others].reshape(m, size)
    # Cholesky by blocks: S = [S₁, Cᵀ; C, S₂], L = [L₁, 0; C L₁⁻ᵀ, L₂].
    C = cross @ found.L_inverse.T
    corner = np.linalg.inv(np.linalg.cholesky(joint[j, :, j] + R[i, j] - C @ C.T))
    tail = corner @ (y[i, j] - C @ found.scaled)
    L_inverse = np.zeros((size + m, size + m))
    L_inverse[:size, :size], L_inverse[size:, size:] = found.L_inverse, corner
    L_inverse[size:, :size] = -corner @ C @ found.L_inverse
    scaled = np.concatenate([found.scaled, tail])
    return _Pairs((*found.pairs, (i, j)), L_inverse, scaled, found.d2 + float(tail @ tail))
