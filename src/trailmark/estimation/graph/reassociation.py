# ruff: noqa: N806 # the names are those of the literature: D, P, S
"""Which reading is of which feature, once the whole log is known: merged, assigned anew, split and dropped.

A filter decides each reading when it comes. With all poses smoothed, two features that were begun for one thing lie in
one place, and a reading that went to the wrong one lies nearer to another.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.filter.consistency import chi_square_quantile
from trailmark.estimation.graph.odometry import Readings
from trailmark.se2 import FloatArray, wrap

__all__ = ["Labels", "assigned", "merged", "seen_from", "split", "without_unseen"]

IntArray = NDArray[np.intp]

TOGETHER = 0.02
"""The share of readings that two features may have at common instants and still be one: some were read twice."""

SELDOM = 0.2
"""A feature read so many times less often than usual, where it should be seen, is none."""


class Labels(NamedTuple):
    """Features, and which reading is of which."""

    places: FloatArray
    """Shape (m, 2)."""
    feature: IntArray
    """For each reading the number of its feature, or -1, shape (r,)."""

    def only(self, wanted: NDArray[np.bool_]) -> Labels:
        """Return some of the features, those that are wanted, shape (m,); readings of others are of none."""
        number = np.where(wanted, np.cumsum(wanted) - 1, -1)
        return Labels(self.places[wanted], np.where(self.feature >= 0, number[self.feature], -1))

    def counts(self) -> IntArray:
        """Return how many readings each feature has, shape (m,)."""
        return np.bincount(self.feature[self.feature >= 0], minlength=len(self.places))


def merged(labels: Labels, joint: FloatArray, instant: IntArray, probability: float) -> Labels:
    """Return the features with those that are one merged, the nearest pair first.

    Two are one if they were not read at the same instants and their difference passes the gate by its covariance, which
    counts what their errors have in common. Taking them for equal corrects all others, before the next pair.

    Args:
        labels: the features.
        joint: covariance of all of them together, shape (2m, 2m).
        instant: of each reading, shape (r,).
        probability: of the gate.
    """
    x, P = labels.places.copy(), joint.copy()
    m, limit = len(x), float(chi_square_quantile(probability, 2))
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


def assigned(labels: Labels, poses: FloatArray, readings: Readings, place_sigma: float, probability: float) -> Labels:
    """Return each reading assigned to the feature that it fits best, by instants, each feature once; or to none.

    Args:
        labels: the features.
        poses: of the instants, shape (n, 3).
        readings: with the noise of single ones.
        place_sigma: metres, how far features may be off.
        probability: that a reading passes the gate of its own feature.
    """
    from scipy.optimize import linear_sum_assignment

    limit = float(chi_square_quantile(probability, 2))
    pose = poses[readings.instant]
    dx, dy = (labels.places[None] - pose[:, None, :2]).transpose(2, 0, 1)
    r = np.hypot(dx, dy)
    y = np.stack([readings.z[:, :1] - r, wrap(readings.z[:, 1:] - np.arctan2(dy, dx) + pose[:, 2:])], axis=2)
    variance = np.diagonal(readings.covariance, axis1=1, axis2=2)[:, None] + place_sigma**2
    variance = np.broadcast_to(variance, y.shape).copy()
    variance[:, :, 1] += place_sigma**2 * (1.0 / np.maximum(r, 0.1) ** 2 - 1.0)
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


def split(labels: Labels, poses: FloatArray, readings: Readings, place_sigma: float, confirm: int) -> Labels:
    """Return the features with those that unassigned readings show, at least ``confirm`` in one place.

    Args:
        labels: the features.
        poses: of the instants, shape (n, 3).
        readings: with the noise of single ones.
        place_sigma: metres, how far apart readings of one thing may lie besides their own noise.
        confirm: how many readings a feature needs.
    """
    free = np.flatnonzero(labels.feature < 0)
    pose, z = poses[readings.instant[free]], readings.z[free]
    direction = pose[:, 2] + z[:, 1]
    seen = pose[:, :2] + z[:, :1] * np.column_stack([np.cos(direction), np.sin(direction)])
    spread = np.maximum(readings.covariance[free, 0, 0], z[:, 0] ** 2 * readings.covariance[free, 1, 1])
    reach = 3.0 * np.sqrt(spread + place_sigma**2)
    places, feature = list(labels.places), labels.feature.copy()
    left = np.ones(len(free), dtype=bool)
    while left.sum() >= confirm:
        rows = np.flatnonzero(left)
        apart = np.hypot(*(seen[rows, None] - seen[None, rows]).transpose(2, 0, 1))
        near = apart <= np.minimum(reach[rows, None], reach[None, rows])
        best = int(near.sum(axis=1).argmax())
        members = rows[near[best]]
        # One reading of each instant.
        members = members[np.unique(readings.instant[free[members]], return_index=True)[1]]
        if len(members) < confirm:
            break
        feature[free[members]] = len(places)
        places.append(np.median(seen[members], axis=0))
        left[members] = False
    return Labels(np.array(places).reshape(-1, 2), feature)


def seen_from(poses: FloatArray, places: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ranges and bearings, shape (n, m) each, of places (m, 2) from poses (n, 3)."""
    dx, dy = (places[None] - poses[:, None, :2]).transpose(2, 0, 1)
    return np.hypot(dx, dy), np.asarray(wrap(np.arctan2(dy, dx) - poses[:, 2:]))


def without_unseen(labels: Labels, poses: FloatArray, readings: Readings, confirm: int) -> Labels:
    """Return the features without those that hardly any reading shows, or much fewer than should.

    A feature should be seen where it lies in the box of the middle 90 % of ranges and bearings.

    Args:
        labels: the features.
        poses: of the instants, shape (n, 3).
        readings: of these instants.
        confirm: how many readings a feature needs.
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
