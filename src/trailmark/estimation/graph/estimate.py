# ruff: noqa: N806 # the names are those of the literature: G, S
# the names are those of the literature: A, P
"""What a batch is made with and what it comes to."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.graph.odometry import OdometryCalibration, SensorCalibration
from trailmark.estimation.graph.smoother import LinearSystem, Smoother, Solution
from trailmark.se2 import FloatArray, wrap

__all__ = ["Estimate", "IntArray", "NoiseModel", "gauge_free", "relative_covariance"]

IntArray = NDArray[np.intp]

NODES = np.array(list(product([-(3.0**0.5), 0.0, 3.0**0.5], repeat=2)))
"""Where Gauss-Hermite quadrature takes two standard normal deviates, exact up to the fifth degree, shape (9, 2)."""

WEIGHTS = np.prod(np.where(NODES == 0.0, 2.0 / 3.0, 1.0 / 6.0), axis=1)


@dataclass(frozen=True)
class NoiseModel:
    """What readings and odometry are taken to be like."""

    odometry: OdometryCalibration
    """Systematic errors of odometry."""
    sensor: SensorCalibration
    """Systematic errors of ranges."""
    motion_variances: FloatArray
    """Of each source of odometry's noise, shape (k,)."""
    motion_times: FloatArray
    """How many successive errors of odometry are worth one, for the same sources, shape (k,)."""
    reading_variances: FloatArray
    """Of each source of the readings' noise, shape (j,)."""
    reading_times: FloatArray
    """How many successive errors of readings are worth one, for the same sources, shape (j,)."""


class Estimate(NamedTuple):
    """What a batch comes to."""

    solution: Solution
    """Poses and features."""
    feature: IntArray
    """For each reading the number of its feature, negative where it was left out, shape (r,)."""
    smoother: Smoother
    """The factors."""
    system: LinearSystem
    """The factors, linearised at the solution."""
    calibrated: FloatArray
    """How the whitened residuals change with calibration, shape (rows, c)."""
    precision: FloatArray
    """Of the calibration before the log, shape (c,)."""

    def feature_covariance(self, moves: FloatArray | None = None) -> FloatArray:
        """Return the covariance of all features' errors together, those of the calibration included, shape (2m, 2m).

        Args:
            moves: how calibration moves the features besides, shape (2m, c).
        """
        first = 3 * len(self.solution.poses)
        columns = first + np.arange(2 * len(self.solution.features))
        joint = self.system.covariance(columns)
        if self.calibrated.shape[1] == 0:
            return joint
        follow = self.system.estimate(self.calibrated)
        left = self.calibrated - self.system.A @ follow
        own = np.linalg.inv(self.calibrated.T @ left + np.diag(self.precision))
        by = follow[columns] if moves is None else follow[columns] + moves
        return np.asarray(joint + by @ own @ by.T)

    def missed(self) -> FloatArray:
        """Return the mean square of what features' errors miss of the readings' curvature, shape (m, 2, 2).

        An error e of the features, given the poses, changes what is read by H e and by a rest q(e), which moves the
        estimate by (AᵀA)⁻¹ Aᵀ q. Exact to the second order of e.
        """
        m, first = len(self.solution.features), 3 * len(self.solution.poses)
        H, each = self.system.A[:, first:], np.arange(m)  # a Jacobian
        information = (H.T @ H).toarray().reshape(m, 2, m, 2)[each, :, each, :]
        e = np.linalg.cholesky(np.linalg.inv(information)) @ NODES.T
        moved = [self.solution._replace(features=self.solution.features + step) for step in np.moveaxis(e, 2, 0)]
        now, *after = (self.smoother.reading_residuals(s, self.feature) for s in (self.solution, *moved))
        change = np.nan_to_num(now[:, :, None] - np.stack(after, axis=2))
        change[:, 1] = wrap(change[:, 1])
        still = np.zeros((len(self.solution.poses) - 1, 3, len(NODES)))
        rest = self.smoother.whitened(self.solution, still, change) - H @ e.reshape(2 * m, -1)
        off = self.system.estimate(rest)[first:].reshape(m, 2, -1)
        return np.asarray((WEIGHTS * off) @ np.swapaxes(off, 1, 2))


def relative_covariance(points: FloatArray, joint: FloatArray) -> FloatArray:
    """Return the covariance of points relative to all of them, shape (2m, 2m).

    The errors that are left are those after the best rigid alignment with the true points, to first order.

    Args:
        points: shape (m, 2), metres.
        joint: covariance of x₁, y₁, x₂, y₂, … in any frame, shape (2m, 2m).
    """
    S = gauge_free(points)
    return np.asarray(S @ joint @ S.T)


def gauge_free(points: FloatArray) -> FloatArray:
    """Return the matrix, shape (2m, 2m), that takes off errors x₁, y₁, x₂, … what a rigid motion explains."""
    away = points - points.mean(axis=0)
    G = np.zeros((2 * len(points), 3))
    G[0::2, 0] = G[1::2, 1] = 1.0
    G[0::2, 2], G[1::2, 2] = -away[:, 1], away[:, 0]
    return np.asarray(np.eye(len(G)) - G @ np.linalg.pinv(G))
