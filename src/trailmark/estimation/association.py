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

from trailmark.arguments import Count, checked_fields
from trailmark.estimation.covariance import chi_square_quantile
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.models import RangeBearing
from trailmark.estimation.records import Detection
from trailmark.estimation.slam_filter import Prediction, SlamFilter
from trailmark.se2 import FloatArray

AssociationMethod = Literal["known", "joint"]
IntArray = NDArray[np.intp]

NEW = -1  # Stands for a feature not seen before.
IGNORED = -2  # Stands for no feature: the reading is ambiguous.


@dataclass(frozen=True)
class SlamSettings:
    """How readings find their features, and when a feature counts.

    Raises:
        EstimationError: a value that is not allowed.
    """

    #: "known": by the identity that the sensor reports; "joint": by joint compatibility (JCBB); "auto": known if any
    #: detection of the log has an identity, else joint, which :func:`trailmark.estimation.map_log` alone can tell.
    association: AssociationMethod | Literal["auto"] = "known"
    confirm: Count = 3  #: Readings after which a feature is confirmed. One of known identity is from the first on.

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)


class Gates(NamedTuple):
    """What the distances of readings and features are held against, as probabilities that good ones pass.

    Real readings have more outliers than Gaussian ones, so that what is a little too far off counts as new.
    """

    own: float = 0.99  # of a reading at its own feature; of JCBB's joint gate, too
    new: float = 0.9999  # of a reading at a feature: what passes none is new
    known: float | None = None  # of a reading with an identity, others are ignored; None lets all pass


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
    cut_short: int = 0  # Joint associations whose search was cut short.


class Compatibility(NamedTuple):
    """How well each of r readings fits each of k features by itself."""

    y: FloatArray  # z − ẑ, shape (r, k, 2).
    R: FloatArray  # Covariance of each reading, were it of that feature, shape (r, k, 2, 2).
    d2: FloatArray  # yᵀ S⁻¹ y, shape (r, k).


class JointAssociation(NamedTuple):
    """The readings and features that fit together best, as a whole."""

    assigned: IntArray  # For each reading the number of its feature in the prediction, or NEW or IGNORED, shape (r,).
    nis: float  # Joint d² of all pairs.
    complete: bool  # False if the search was cut short: then there may be a better one.


def compatibility(
    z: FloatArray, prediction: Prediction, sensor: RangeBearing, stated: Sequence[FloatArray | None]
) -> Compatibility:
    """Return how well each reading, shape (r, 2), fits each of k features by itself; O(r k).

    ``stated`` holds for each reading its covariance (2, 2) where the log states one, else None.
    """
    y = sensor.residual(z[:, None], prediction.z_hat[None])
    R = np.repeat(prediction.R[None], len(z), axis=0)
    for own, covariance in zip(R, stated, strict=True):
        if covariance is not None:
            own[:] = covariance
    d2 = (y[..., None, :] @ np.linalg.inv(prediction.S - prediction.R + R) @ y[..., None])[..., 0, 0]
    return Compatibility(y, R, d2)


def distinct(assigned: ArrayLike, d2: FloatArray, new_gate: float) -> IntArray:
    """Return the association, shape (r,), in which an ignored reading is new if it can be of no feature known so far.

    The readings of an instant are of distinct features. A reading near features that all went to other readings of
    its instant is therefore of none of them, however near it is.

    Args:
        assigned: for each reading its feature's number, or NEW or IGNORED, shape (r,).
        d2: squared Mahalanobis distances, shape (r, k).
        new_gate: least d² of a reading of a new feature to all features that are left.
    """
    result = np.array(assigned, dtype=np.intp)
    left = np.ones(d2.shape[1], dtype=bool)
    left[result[result >= 0]] = False
    near = (d2[:, left] <= new_gate).any(axis=1)
    result[(result == IGNORED) & ~near] = NEW
    return result


def joint_compatibility(
    compatible: Compatibility,
    joint: FloatArray,
    gates: Gates,
    *,
    node_limit: int = 20_000,
) -> JointAssociation:
    """Return the largest set of pairs that fit together: Neira & Tardós 2001's JCBB (IEEE T-RA 17(6), 890–897).

    Pairs that fit one by one may not fit together, since the readings share the error of the pose. The readings are
    gone through in order, each with its compatible features, the nearest first, or with none; a set is followed as
    long as it is jointly compatible, d² of all its pairs under the chi-square quantile of their number, and as long
    as it may still have more pairs than the best one found, or as many and a smaller d².

    Args:
        compatible: of r readings and k features.
        joint: H P Hᵀ of the features' readings together, shape (k, 2, k, 2).
        gates: of single readings and of all together.
        node_limit: how many sets to consider; the number grows exponentially where many features are close together.
    """
    (r, k), rows = compatible.d2.shape, compatible.d2
    gate, new_gate = chi_square_quantile([gates.own, gates.new], 2)
    candidates = [np.flatnonzero(row <= gate)[np.argsort(row[row <= gate], kind="stable")].tolist() for row in rows]
    limits = np.concatenate([[0.0], chi_square_quantile(gates.own, 2 * np.arange(1, r + 1))])
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
    """Assigns detections to a filter's features, and counts what it leaves out; the filter is only read."""

    def __init__(
        self, ekf: SlamFilter, sensor: RangeBearing, association: AssociationMethod, gates: Gates, counts: Counts
    ) -> None:
        self._filter, self._sensor, self._association = ekf, sensor, association
        self._gates, self._counts = gates, counts

    def assign(self, detections: Sequence[Detection], ids: Mapping[int, int]) -> list[int]:
        """Return the feature's id of each detection, or NEW or IGNORED; ``ids`` are those of known identities."""
        if self._association == "known":
            return [self._known(detection, ids) for detection in detections]
        prediction, gates = self._filter.predict_readings(self._sensor), self._gates
        new_gate = float(chi_square_quantile(gates.new, 2))
        z = np.array([detection.z for detection in detections], dtype=np.float64)
        fit = compatibility(z, prediction, self._sensor, [detection.covariance for detection in detections])
        # Features that no reading comes near have no part in it, and would make it slow.
        near = np.flatnonzero((fit.d2 <= new_gate).any(axis=0))
        prediction, fit = prediction.select(near), Compatibility(*(part[:, near] for part in fit))
        found = joint_compatibility(fit, self._filter.joint_covariance(prediction), gates)
        assigned = distinct(found.assigned, fit.d2, new_gate)
        self._counts.cut_short += not found.complete
        self._counts.ambiguous += int(np.count_nonzero(assigned == IGNORED))
        return [prediction.ids[j] if j >= 0 else int(j) for j in assigned]

    def _known(self, detection: Detection, ids: Mapping[int, int]) -> int:
        if detection.identity is None:
            self._counts.unidentified += 1
            return IGNORED
        feature = ids.get(detection.identity, NEW)
        if feature != NEW and self._gates.known is not None:
            innovation = self._filter.innovation(detection.z, self._sensor, feature, detection.covariance)
            if innovation.nis > chi_square_quantile(self._gates.known, 2):
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
    size = len(found.scaled)
    others = [other for _, other in found.pairs]
    cross = joint[j][:, others].reshape(2, size)
    # Cholesky by blocks: S = [S₁, Cᵀ; C, S₂], L = [L₁, 0; C L₁⁻ᵀ, L₂].
    C = cross @ found.L_inverse.T
    corner = np.linalg.inv(np.linalg.cholesky(joint[j, :, j] + R[i, j] - C @ C.T))
    tail = corner @ (y[i, j] - C @ found.scaled)
    L_inverse = np.zeros((size + 2, size + 2))
    L_inverse[:size, :size], L_inverse[size:, size:] = found.L_inverse, corner
    L_inverse[size:, :size] = -corner @ C @ found.L_inverse
    scaled = np.concatenate([found.scaled, tail])
    return _Pairs((*found.pairs, (i, j)), L_inverse, scaled, found.d2 + float(tail @ tail))
