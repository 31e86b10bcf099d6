# ruff: noqa: N806 # the names are the filter's own symbols: z, H, P, R, S, L
"""Data association: which reading is of which feature.

Readings of one instant are told apart by the squared Mahalanobis distance d² = yᵀ S⁻¹ y to what each feature should
read, which has a chi-square distribution where reading and feature belong together. There are two thresholds: under
the first a reading may be of the feature, above the second of all features it shows a new one. In between it may be
either, and is ignored: a wrong feature, or one feature as two, harms a filter more than a reading less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.estimation.filter.consistency import chi_square_quantile
from trailmark.estimation.filter.innovation import Prediction
from trailmark.estimation.filter.sensor_model import SensorModel
from trailmark.se2 import FloatArray

__all__ = [
    "IGNORED",
    "NEW",
    "Compatibility",
    "JointAssociation",
    "clear",
    "compatibility",
    "distinct",
    "joint_compatibility",
    "nearest",
]

NEW = -1
"""Stands for a feature not seen before."""
IGNORED = -2
"""Stands for no feature: the reading is ambiguous."""

IntArray = NDArray[np.intp]


class Compatibility(NamedTuple):
    """How well each of r readings fits each of k features by itself."""

    y: FloatArray
    """z − ẑ, shape (r, k, m)."""
    R: FloatArray
    """Covariance of each reading, were it of that feature, shape (r, k, m, m)."""
    d2: FloatArray
    """yᵀ S⁻¹ y, shape (r, k)."""

    def select(self, which: IntArray) -> Compatibility:
        """Return the fit to some of the features only, by their numbers in this one, shape (j,)."""
        return Compatibility(self.y[:, which], self.R[:, which], self.d2[:, which])


class JointAssociation(NamedTuple):
    """The readings and features that fit together best, as a whole."""

    assigned: IntArray
    """For each reading the number of its feature in the prediction, or NEW or IGNORED, shape (r,)."""
    nis: float
    """Joint d² of all pairs."""
    complete: bool
    """False if the search was cut short: then there may be a better one."""


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


def clear(assigned: ArrayLike, d2: ArrayLike, margin: float) -> IntArray:
    """Return the association, shape (r,), without the readings that fit another feature nearly as well.

    Only features that no other reading went to count: where readings of an instant compete, they settle it together.

    Args:
        assigned: for each reading its feature's number, or NEW or IGNORED, shape (r,).
        d2: squared Mahalanobis distances, shape (r, k).
        margin: by how much the d² to each other feature must be larger.
    """
    result, distance = np.array(assigned, dtype=np.intp), np.array(d2, dtype=np.float64)
    pairs = np.flatnonzero(result >= 0)
    own = distance[pairs, result[pairs]]
    distance[:, result[pairs]] = np.inf
    unclear = (distance[pairs] < (own + margin)[:, None]).any(axis=1)
    result[pairs[unclear]] = IGNORED
    return result


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
        node_limit: how many sets to look at; the number grows exponentially where many features are close together.
    """
    r, k, m = compatible.y.shape
    search = _Search(
        compatible,
        joint,
        [np.flatnonzero(row <= gate)[np.argsort(row[row <= gate], kind="stable")].tolist() for row in compatible.d2],
        np.concatenate([[0.0], chi_square_quantile(probability, m * np.arange(1, r + 1))]),
        node_limit,
    )
    search.extend(_Set((), np.zeros((0, 0)), np.zeros(0), 0.0), 0)
    assigned = np.full(r, NEW, dtype=np.intp)
    if k:
        assigned[compatible.d2.min(axis=1) <= new_gate] = IGNORED
    for i, j in search.best.pairs:
        assigned[i] = j
    return JointAssociation(assigned, search.best.d2, search.nodes <= node_limit)


class _Set(NamedTuple):
    """Pairs, with L⁻¹ of their joint S = L Lᵀ and L⁻¹ y, which grow by rows as pairs are added."""

    pairs: tuple[tuple[int, int], ...]
    L_inverse: FloatArray
    scaled: FloatArray
    d2: float


@dataclass
class _Search:
    compatible: Compatibility
    joint: FloatArray
    candidates: list[list[int]]
    limits: FloatArray
    node_limit: int
    nodes: int = 0
    best: _Set = field(default_factory=lambda: _Set((), np.zeros((0, 0)), np.zeros(0), 0.0))

    def extend(self, pairs: _Set, i: int) -> None:
        """Try all ways to go on with readings i, i + 1 and so on."""
        best, found = self.best, len(pairs.pairs)
        if i == len(self.candidates):
            if found > len(best.pairs) or (found == len(best.pairs) and pairs.d2 < best.d2):
                self.best = pairs
            return
        taken = {j for _, j in pairs.pairs}
        for j in self.candidates[i]:
            if j in taken:
                continue
            self.nodes += 1
            if self.nodes > self.node_limit:
                break
            more = self._with(pairs, i, j)
            if more.d2 <= self.limits[found + 1] and self._may_win(more, i + 1):
                self.extend(more, i + 1)
        if self._may_win(pairs, i + 1):
            self.extend(pairs, i + 1)

    def _may_win(self, pairs: _Set, i: int) -> bool:
        """Whether more pairs than the best set has, or as many with a smaller d², can still come of it."""
        most = len(pairs.pairs) + sum(1 for row in self.candidates[i:] if row)
        return most > len(self.best.pairs) or (most == len(self.best.pairs) and pairs.d2 < self.best.d2)

    def _with(self, pairs: _Set, i: int, j: int) -> _Set:
        """Return the set with reading i as one of feature j, too."""
        y, R, _ = self.compatible
        m, size = y.shape[2], len(pairs.scaled)
        others = [other for _, other in pairs.pairs]
        cross = self.joint[j][:, others].reshape(m, size)
        # Cholesky by blocks: S = [S₁, Cᵀ; C, S₂], L = [L₁, 0; C L₁⁻ᵀ, L₂].
        C = cross @ pairs.L_inverse.T
        corner = np.linalg.inv(np.linalg.cholesky(self.joint[j, :, j] + R[i, j] - C @ C.T))
        tail = corner @ (y[i, j] - C @ pairs.scaled)
        L_inverse = np.zeros((size + m, size + m))
        L_inverse[:size, :size], L_inverse[size:, size:] = pairs.L_inverse, corner
        L_inverse[size:, :size] = -corner @ C @ pairs.L_inverse
        return _Set(
            (*pairs.pairs, (i, j)), L_inverse, np.concatenate([pairs.scaled, tail]), pairs.d2 + float(tail @ tail)
        )
