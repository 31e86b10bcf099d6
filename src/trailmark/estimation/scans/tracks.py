# ruff: noqa: N806 # the names are the filter's own symbols: P, S, K, G, R
"""Features of scans over time: found again by gate and place, refined by the EKF, confirmed or dropped.

The poses of the scans are known up to a covariance. A feature does not move: F is the identity and
Q is 0, so each scan that shows it is one EKF update.

The errors of poses that follow one another are anything but independent, so what they do to a feature does not
average out over its scans. The update weighs a scan by its whole uncertainty, and :meth:`Tracks.covariance` adds
what a pose's errors do to the feature on average.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from trailmark.estimation.filter.consistency import chi_square_quantile
from trailmark.estimation.scans.fits import DiscFit, LineFit
from trailmark.se2 import FloatArray, transform, wrap

__all__ = ["DiscTracks", "LineTracks", "Observation", "Tracks"]


MAX_READINGS = 500
"""Scans whose end points a track keeps as they are; then one remains for each square of side THIN."""

THIN = 0.02
"""Metres: a scanner's noise."""


class Observation(NamedTuple):
    """A feature of one scan, in the world."""

    state: FloatArray
    """Shape (d,)."""
    R: FloatArray
    """Its covariance from the sensor's noise, shape (d, d)."""
    R_pose: FloatArray
    """Its covariance from the pose's errors, shape (d, d)."""
    readings: FloatArray
    """Its end points in the world, shape (n, 2)."""


class Tracks(ABC):
    """Features of one kind.

    Attributes:
        states: shape (n, d).
        P: shape (n, d, d), covariances as the filter has them.
        scans: shape (n,), how many scans showed each.
        readings: of each, the end points of its scans, arrays of shape (m, 2), thinned where they are very many.
        sightings: shape (n,), how many features of scans make up each.
        pose_covariance: of the scan that observations are made of next, shape (3, 3).

    Args:
        dim: d.
        gate: probability with which a reading of a feature passes its gate.
        pose_covariance: shape (3, 3), of x, y, theta.
    """

    def __init__(self, dim: int, gate: float, pose_covariance: FloatArray) -> None:
        self.states = np.empty((0, dim))
        self.P = np.empty((0, dim, dim))
        self.scans = np.empty(0, dtype=np.intp)
        self.sightings = np.empty(0, dtype=np.intp)
        self.readings: list[list[FloatArray]] = []
        self._pose_part = np.empty((0, dim, dim))
        self._gate = float(chi_square_quantile(gate, dim))
        self.pose_covariance = np.asarray(pose_covariance, dtype=np.float64)

    def __len__(self) -> int:
        return len(self.states)

    @abstractmethod
    def difference(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return a − b, shape (..., d)."""

    @abstractmethod
    def near(self, observed: Observation) -> FloatArray:
        """Return which tracks lie where the feature is, shape (n,)."""

    def update(self, found: list[Observation]) -> None:
        """Take in the features of one scan, each into the nearest track that lets it through its gate, or a new one.

        Args:
            found: the features.
        """
        updated = set[int]()
        for observed in found:
            at = self._match(observed)
            if at is None:
                at = self._start(observed)
            else:
                self._refine(at, observed)
            if at not in updated:
                self.scans[at] += 1
                updated.add(at)

    def covariance(self, at: int) -> FloatArray:
        """Return a track's covariance with the part of the poses, which does not average out, shape (d, d)."""
        return np.asarray(self.P[at] + self._pose_part[at] / self.sightings[at])

    def merge(self) -> None:
        """Join tracks that turn out to be one: those that let each other through their gates."""
        for at in range(len(self) - 1, -1, -1):
            readings = np.concatenate(self.readings[at])
            whole = Observation(self.states[at], self.P[at], self._pose_part[at] / self.sightings[at], readings)
            other = self._match(whole, without=at)
            if other is not None:
                self._refine(other, whole)
                self.readings[other][-1:] = self.readings[at]
                self._pose_part[other] += self._pose_part[at] - whole.R_pose
                self.scans[other] += self.scans[at]
                self.sightings[other] += self.sightings[at] - 1
                self._drop(at)

    def drop_unconfirmed(self, confirm: int) -> int:
        """Drop the tracks that fewer than ``confirm`` scans showed, and return how many."""
        stale = np.flatnonzero(self.scans < confirm)
        for at in stale[::-1]:
            self._drop(int(at))
        return len(stale)

    def _match(self, observed: Observation, without: int = -1) -> int | None:
        if len(self) == 0:
            return None
        candidates = np.flatnonzero(self.near(observed))
        candidates = candidates[candidates != without]
        if len(candidates) == 0:
            return None
        y = self.difference(observed.state, self.states[candidates])
        S = self.P[candidates] + observed.R + observed.R_pose
        d2 = np.einsum("ni,ni->n", y, np.linalg.solve(S, y[..., None])[..., 0])
        best = int(d2.argmin())
        return int(candidates[best]) if d2[best] <= self._gate else None

    def _start(self, observed: Observation) -> int:
        self.states = np.concatenate([self.states, observed.state[None]])
        self.P = np.concatenate([self.P, (observed.R + observed.R_pose)[None]])
        self._pose_part = np.concatenate([self._pose_part, observed.R_pose[None]])
        self.scans, self.sightings = np.append(self.scans, 0), np.append(self.sightings, 1)
        self.readings.append([observed.readings])
        return len(self) - 1

    def _refine(self, at: int, observed: Observation) -> None:
        P, R = self.P[at], observed.R + observed.R_pose
        K = P @ np.linalg.inv(P + R)
        self.states[at] += K @ self.difference(observed.state, self.states[at])
        I_K = np.eye(len(P)) - K
        self.P[at] = I_K @ P @ I_K.T + K @ R @ K.T
        self._pose_part[at] += observed.R_pose
        self.sightings[at] += 1
        self.readings[at].append(observed.readings)
        if len(self.readings[at]) > MAX_READINGS:
            points = np.concatenate(self.readings[at])
            _, one = np.unique(np.floor(points / THIN).astype(np.int64), axis=0, return_index=True)
            self.readings[at] = [points[np.sort(one)]]

    def _drop(self, at: int) -> None:
        self.states, self.P = np.delete(self.states, at, axis=0), np.delete(self.P, at, axis=0)
        self._pose_part, self.scans = np.delete(self._pose_part, at, axis=0), np.delete(self.scans, at)
        self.sightings = np.delete(self.sightings, at)
        del self.readings[at]


class LineTracks(Tracks):
    """Lines (ρ, α) of the world, each seen from the side that its normal points away from; d = 2.

    The two faces of a thin wall are two lines, and so are two stretches of one line with a wide gap between them.

    Args:
        gate: see :class:`Tracks`.
        pose_covariance: see :class:`Tracks`.
        gap: metres that a stretch may be away from a line's other stretches and still belong to it.
    """

    def __init__(self, gate: float, pose_covariance: FloatArray, gap: float) -> None:
        super().__init__(2, gate, pose_covariance)
        self._gap = gap
        self._ends = np.empty((0, 2, 2))  # first and last place of each track, in the world

    def observation(self, fit: LineFit, points: FloatArray, pose: FloatArray) -> Observation:
        """Return a line of a scan's end points (robot frame, shape (n, 2)), seen from a pose."""
        x, y, theta = pose
        rho, alpha = fit.line[0], fit.line[1] + theta
        cos, sin = math.cos(alpha), math.sin(alpha)
        lean = y * cos - x * sin
        state = np.array([rho + x * cos + y * sin, wrap(alpha)])
        G_z, G_pose = np.array([[1.0, lean], [0.0, 1.0]]), np.array([[cos, sin, lean], [0.0, 0.0, 1.0]])
        readings = transform(pose, points[fit.indices])
        return Observation(state, G_z @ fit.covariance @ G_z.T, G_pose @ self.pose_covariance @ G_pose.T, readings)

    def difference(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return a − b, shape (..., 2), the angle in (−π, π]."""
        y = np.asarray(a - b)
        y[..., 1] = wrap(y[..., 1])
        return y

    def near(self, observed: Observation) -> FloatArray:
        """Return which lines have the same direction and (nearly) overlap the stretch along themselves; shape (n,)."""
        along = np.column_stack([-np.sin(self.states[:, 1]), np.cos(self.states[:, 1])])
        new = _ends(observed.readings) @ along.T
        old = np.einsum("nki,ni->nk", self._ends, along)
        apart = np.maximum(new.min(axis=0) - old.max(axis=1), old.min(axis=1) - new.max(axis=0))
        turned = np.abs(wrap(observed.state[1] - self.states[:, 1]))
        return np.asarray((apart <= self._gap) & (turned < 0.5))

    def _start(self, observed: Observation) -> int:
        self._ends = np.concatenate([self._ends, _ends(observed.readings)[None]])
        return super()._start(observed)

    def _refine(self, at: int, observed: Observation) -> None:
        super()._refine(at, observed)
        _, alpha = self.states[at]
        both = np.concatenate([self._ends[at], observed.readings])
        along = both @ np.array([-math.sin(alpha), math.cos(alpha)])
        self._ends[at] = both[[along.argmin(), along.argmax()]]

    def _drop(self, at: int) -> None:
        super()._drop(at)
        self._ends = np.delete(self._ends, at, axis=0)


class DiscTracks(Tracks):
    """Discs (x, y, radius) of the world; d = 3."""

    def __init__(self, gate: float, pose_covariance: FloatArray) -> None:
        super().__init__(3, gate, pose_covariance)

    def observation(self, fit: DiscFit, points: FloatArray, pose: FloatArray) -> Observation:
        """Return a disc of a scan's end points (robot frame, shape (n, 2)), seen from a pose."""
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        centre = transform(pose, fit.disc[:2][None])[0]
        G_z = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        G_pose = np.zeros((3, 3))
        G_pose[:2] = [[1.0, 0.0, pose[1] - centre[1]], [0.0, 1.0, centre[0] - pose[0]]]
        readings = transform(pose, points[fit.indices])
        R_pose = G_pose @ self.pose_covariance @ G_pose.T
        return Observation(np.append(centre, fit.disc[2]), G_z @ fit.covariance @ G_z.T, R_pose, readings)

    def difference(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return a − b, shape (..., 3)."""
        return np.asarray(a - b)

    def near(self, observed: Observation) -> FloatArray:
        """Return which discs overlap the new one, shape (n,)."""
        apart = np.hypot(*(self.states[:, :2] - observed.state[:2]).T)
        return np.asarray(apart <= self.states[:, 2] + observed.state[2])


def _ends(readings: FloatArray) -> FloatArray:
    """Return two of the readings that lie farthest apart along their longer side, shape (2, 2)."""
    axis = int(np.ptp(readings, axis=0).argmax())
    return np.asarray(readings[[readings[:, axis].argmin(), readings[:, axis].argmax()]])
