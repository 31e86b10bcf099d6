# ruff: noqa: N803, N806 # the names are those of the literature: A, H, J, P, R, S
"""The batch optimum of poses and point features, by gtsam, with its covariances.

The factors are those of Dellaert & Kaess 2006, Square Root SAM (International Journal of Robotics Research 25(12)): one
between each pose and the next, one for each reading. A reading far from what the rest says is weighed down by Huber's
kernel (Huber 1964, Robust estimation of a location parameter); readings within the gate count in full, so that without
outliers this is the least-squares optimum.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.covariance import chi_square_quantile
from trailmark.estimation.models import RangeBearing
from trailmark.estimation.records import Detection
from trailmark.se2 import FloatArray, wrap

IntArray = NDArray[np.intp]

PROBES = 8  # draws that the redundancy is estimated from; the relative error of a mean over k rows is 1/√(PROBES k)
FLOOR = 1e-4  # metres and radians: standard deviation added to each motion, since gtsam takes no noise of 0
HELD = 1e-6  # metres and radians: standard deviation of the first pose, where the factors' frame is
# Where Gauss-Hermite quadrature takes two standard normal deviates, exact up to the fifth degree, shape (9, 2).
NODES = np.array(list(product([-(3.0**0.5), 0.0, 3.0**0.5], repeat=2)))
WEIGHTS = np.prod(np.where(NODES == 0.0, 2.0 / 3.0, 1.0 / 6.0), axis=1)


class Readings(NamedTuple):
    """Ranges and bearings of n detections."""

    instant: IntArray  # the number of each one's instant, shape (n,)
    z: FloatArray  # metres and radians, shape (n, 2)
    covariance: FloatArray  # of z, shape (n, 2, 2)
    stated: bool  # whether the log states all covariances


def polar_readings(detections: Sequence[Detection], instants: FloatArray, sensor: RangeBearing) -> Readings:
    """Return detections by range and bearing, with the sensor's noise where they state none.

    The times of all detections are among the instants, shape (m,), ascending.
    """
    z = np.array([detection.z for detection in detections], dtype=np.float64).reshape(-1, 2)
    sigma = sensor.sigma_range * (1.0 + sensor.growth * np.maximum(z[:, 0], 0.0))
    stated = [detection.covariance for detection in detections]
    own = [np.diag([s**2, sensor.sigma_bearing**2]) if R is None else R for s, R in zip(sigma, stated, strict=True)]
    instant = np.searchsorted(instants, [detection.t for detection in detections])
    all_stated = bool(stated) and all(R is not None for R in stated)
    return Readings(instant, z, np.array(own, dtype=np.float64).reshape(-1, 2, 2), all_stated)


class LinearSystem:
    """Whitened residuals b − A x of an estimate's error x; A from its entries, counted from 1, in ``width`` columns."""

    def __init__(self, rows: FloatArray, columns: FloatArray, entries: FloatArray, width: int) -> None:
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        own = columns <= width
        places = rows[own].astype(np.intp) - 1, columns[own].astype(np.intp) - 1
        self.A = csc_array((entries[own], places), shape=(int(rows.max()), width))
        symmetric = {"SymmetricMode": True}
        AtA = (self.A.T @ self.A).tocsc()
        self.factor = splu(AtA, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric)

    def estimate(self, right: FloatArray) -> FloatArray:
        """Return (AᵀA)⁻¹ Aᵀ b for columns b, shape (rows, k)."""
        return np.asarray(self.factor.solve(np.asarray(self.A.T @ right)))

    def unexplained(self, right: FloatArray) -> FloatArray:
        """Return what is left of columns b once the estimate has followed them, b − A (AᵀA)⁻¹ Aᵀ b, shape (rows, k)."""
        return np.asarray(right - self.A @ self.estimate(right))

    def redundancy(self, rng: np.random.Generator) -> FloatArray:
        """Return the share of each row's noise that its residual still shows, shape (rows,): noisy, to be averaged.

        The mean square of what is left of unit noise is the redundancy number (Förstner 1979, Zeitschrift für
        Vermessungswesen 104), by the random signs of Hutchinson 1990 (Communications in Statistics 19(2)).
        """
        signs: FloatArray = rng.choice([-1.0, 1.0], (self.A.shape[0], PROBES))
        return np.asarray((self.unexplained(signs) ** 2).mean(axis=1))

    def covariance(self, columns: IntArray) -> FloatArray:
        """Return the covariance of these columns' errors together, shape (k, k)."""
        unit = np.zeros((self.A.shape[1], len(columns)))
        unit[columns, np.arange(len(columns))] = 1.0
        joint = np.asarray(self.factor.solve(unit))[columns]
        return np.asarray(0.5 * (joint + joint.T))


class Solution(NamedTuple):
    """Poses and features that fit the factors best."""

    poses: FloatArray  # shape (n, 3)
    features: FloatArray  # shape (m, 2)
    error: float  # half the sum of the squared, whitened residuals, beyond the gate by Huber's kernel


class Smoother:
    """The factors of one log.

    Args:
        u: the motions between n poses, each in the frame that it begins in, shape (n − 1, 3).
        P: their covariances, shape (n − 1, 3, 3).
        readings: of m features.
        feature: for each reading the number of its feature, or a negative one to leave it out.
        gate: probability that a good reading counts in full.
    """

    def __init__(
        self, u: FloatArray, P: FloatArray, readings: Readings, feature: IntArray, gate: float = 0.9999
    ) -> None:
        import gtsam

        self.used = np.flatnonzero(feature >= 0)
        self._u, self._readings, self._feature = u, readings, feature
        self._limit = float(np.sqrt(chi_square_quantile(gate, 2)))
        # A frame's covariance in gtsam is in the frame that the motion ends in.
        self.motion_roots = _square_roots(turned(P, -u[:, 2]) + FLOOR**2 * np.eye(3))
        self.reading_roots = _square_roots(readings.covariance[self.used])
        factors, n = gtsam.NonlinearFactorGraph(), len(u) + 1
        between, gaussian = gtsam.BetweenFactorPose2, gtsam.noiseModel.Gaussian.SqrtInformation
        for i, (motion, root) in enumerate(zip(u.tolist(), self.motion_roots, strict=True)):
            factors.add(between(i, i + 1, gtsam.Pose2(*motion), gaussian(root)))
        huber = gtsam.noiseModel.mEstimator.Huber.Create(self._limit)
        robust, reading = gtsam.noiseModel.Robust.Create, gtsam.BearingRangeFactor2D
        columns = (column[self.used].tolist() for column in (readings.instant, readings.z, feature))
        for root, at, (r, bearing), of in zip(self.reading_roots[:, :, ::-1], *columns, strict=True):
            factors.add(reading(at, n + of, gtsam.Rot2(bearing), r, robust(huber, gaussian(root))))
        self._factors, self._poses = factors, n

    def solve(self, poses: FloatArray, features: FloatArray, tolerance: float = 1e-7) -> Solution:
        """Return the optimum that is reached from poses (n, 3), the first of which stays, and features (m, 2).

        It ends once the error changes by less than the tolerance, relatively.
        """
        import gtsam

        graph = self._held(poses[0])
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setRelativeErrorTol(tolerance)
        parameters.setlambdaInitial(1e-9)
        best = gtsam.LevenbergMarquardtOptimizer(graph, self._values(poses, features), parameters).optimize()
        points = np.array([best.atPoint2(self._poses + j) for j in range(len(features))]).reshape(-1, 2)
        return Solution(np.asarray(gtsam.utilities.extractPose2(best)), points, float(graph.error(best)))

    def residuals(self, solution: Solution) -> tuple[FloatArray, FloatArray]:
        """Return what motions, (n − 1, 3) in the frames that they end in, and readings, (r, 2), say beyond a solution.

        Those of readings that are of no feature are NaN.
        """
        return self.at_end(self._u - motions_of(solution.poses)), self.reading_residuals(solution, self._feature)

    def reading_residuals(self, solution: Solution, feature: IntArray) -> FloatArray:
        """Return z − ẑ of each reading, (r, 2), were they of these features; NaN for those that are of none."""
        pose, point = solution.poses[self._readings.instant], solution.features[np.maximum(feature, 0)]
        dx, dy = (point - pose[:, :2]).T
        y = self._readings.z - np.column_stack([np.hypot(dx, dy), np.arctan2(dy, dx) - pose[:, 2]])
        y[:, 1] = wrap(y[:, 1])
        y[feature < 0] = np.nan
        return np.asarray(y)

    def at_end(self, changes: FloatArray) -> FloatArray:
        """Return changes of the motions, shape (n − 1, 3), in the frames that these end in."""
        return _into(changes, self._u[:, 2])

    def components_at_end(self, components: FloatArray) -> FloatArray:
        """Return components of the motions' covariances, shape (n − 1, k, 3, 3), in the frames that these end in."""
        flat = turned(components.reshape(-1, 3, 3), np.repeat(-self._u[:, 2], components.shape[1]))
        return flat.reshape(components.shape)

    def whitened(self, solution: Solution, motions: FloatArray, readings: FloatArray) -> FloatArray:
        """Return changes of motions at their ends, (n − 1, 3, k), and of readings, (r, 2, k), as rows of the system."""
        _, y = self.residuals(solution)
        length = np.linalg.norm(self.reading_roots @ y[self.used, :, None], axis=(1, 2))
        weights = np.minimum(1.0, self._limit / np.maximum(length, 1e-300))
        rows = self.motion_roots @ motions, (self.reading_roots @ readings[self.used]) * weights[:, None, None] ** 0.5
        k = motions.shape[2]
        return np.concatenate([rows[0].reshape(-1, k), rows[1].reshape(-1, k), np.zeros((3, k))])

    def linearised(self, solution: Solution) -> LinearSystem:
        """Return the whitened factors at a solution: motions, then readings, then the first pose."""
        linear = self._held(solution.poses[0]).linearize(self._values(solution.poses, solution.features))
        rows, columns, entries = linear.sparseJacobian_()
        return LinearSystem(rows, columns, entries, 3 * self._poses + 2 * len(solution.features))

    def pair_covariances(self, solution: Solution) -> tuple[FloatArray, FloatArray]:
        """Return the covariance of each pose and the next together, shape (n − 1, 6, 6), in the map's axes.

        The second pose's is that of a pose at the first one's place, fixed to it. Likewise, shape (…, 3, 3), the
        noise that each motion has at least.
        """
        import gtsam

        values, poses = self._values(solution.poses, solution.features), solution.poses
        try:
            marginals = gtsam.Marginals(self._held(poses[0]), values)
            pairs = [marginals.jointMarginalCovariance([i, i + 1]).fullMatrix() for i in range(len(poses) - 1)]
        except RuntimeError:
            # gtsam refuses systems in which some directions are known thousands of times better than others.
            system = self.linearised(solution)
            pairs = [system.covariance(np.arange(3 * i, 3 * i + 6)) for i in range(len(poses) - 1)]
        local = np.array(pairs)
        to = np.zeros((len(local), 6, 6))
        to[:, :3, :3] = rotations(poses[:-1, 2])
        to[:, 3:, 3:] = _arms(poses[:-1, :2] - poses[1:, :2]) @ rotations(poses[1:, 2])
        least = np.tile(FLOOR**2 * np.eye(3), (len(local), 1, 1))
        return _transformed(local, to), _transformed(least, to[:, 3:, 3:])

    def _held(self, pose: FloatArray) -> Any:
        import gtsam

        graph = self._factors.clone()
        tight = gtsam.noiseModel.Diagonal.Sigmas(np.full(3, HELD))
        graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*pose.tolist()), tight))
        return graph

    def _values(self, poses: FloatArray, features: FloatArray) -> Any:
        """Return gtsam's values; the keys of features follow those of poses, as do their columns."""
        import gtsam

        values = gtsam.Values()
        for i, pose in enumerate(poses.tolist()):
            values.insert(i, gtsam.Pose2(*pose))
        for j, point in enumerate(features, start=self._poses):
            values.insert(j, point)
        return values


class Estimate(NamedTuple):
    """What a batch comes to."""

    solution: Solution
    feature: IntArray  # for each reading the number of its feature, negative where it was left out, shape (r,)
    smoother: Smoother
    system: LinearSystem  # the factors, linearised at the solution
    calibrated: FloatArray  # how the whitened residuals change with calibration, shape (rows, c)
    precision: FloatArray  # of the calibration before the log, shape (c,)

    def feature_covariance(self) -> FloatArray:
        """Return the covariance of all features' errors together, those of the calibration included, shape (2m, 2m)."""
        columns = 3 * len(self.solution.poses) + np.arange(2 * len(self.solution.features))
        joint = self.system.covariance(columns)
        if self.calibrated.shape[1] == 0:
            return joint
        follow = self.system.estimate(self.calibrated)
        left = self.calibrated - self.system.A @ follow
        own = np.linalg.inv(self.calibrated.T @ left + np.diag(self.precision))
        return np.asarray(joint + follow[columns] @ own @ follow[columns].T)

    def missed(self) -> FloatArray:
        """Return the mean square of what features' errors miss of the readings' curvature, shape (m, 2, 2).

        An error e of the features, given the poses, changes what is read by H e and by a rest q(e), which moves the
        estimate by (AᵀA)⁻¹ Aᵀ q. Exact to the second order of e.
        """
        m, first = len(self.solution.features), 3 * len(self.solution.poses)
        H, each = self.system.A[:, first:], np.arange(m)
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


def gauge_free(points: FloatArray) -> FloatArray:
    """Return the matrix, shape (2m, 2m), that takes off errors x₁, y₁, x₂, … what a rigid motion explains.

    What S leaves of errors are those after the best rigid alignment with the true points, to first order; S Σ Sᵀ is
    their covariance relative to all points (Baarda's S-transformation).
    """
    away = points - points.mean(axis=0)
    G = np.zeros((2 * len(points), 3))
    G[0::2, 0] = G[1::2, 1] = 1.0
    G[0::2, 2], G[1::2, 2] = -away[:, 1], away[:, 0]
    return np.asarray(np.eye(len(G)) - G @ np.linalg.pinv(G))


def relative_covariance(points: FloatArray, joint: FloatArray) -> FloatArray:
    """Return the covariance (2m, 2m) of points (m, 2) relative to all of them, from that in any frame."""
    S = gauge_free(points)
    return np.asarray(S @ joint @ S.T)


def motions_of(poses: FloatArray) -> FloatArray:
    """Return the motions between poses (n, 3), each in the frame that it begins in, shape (n − 1, 3)."""
    return _into(np.diff(poses, axis=0), poses[:-1, 2])


def _square_roots(covariances: FloatArray) -> FloatArray:
    """Return upper triangular R with RᵀR the inverse of each covariance, shape (n, d, d)."""
    return np.swapaxes(np.linalg.cholesky(np.linalg.inv(covariances)), 1, 2)


def _into(vectors: FloatArray, headings: FloatArray) -> FloatArray:
    """Return vectors (n, 3) of the plane, with an angle, in frames of these headings (n,)."""
    cos, sin = np.cos(headings), np.sin(headings)
    x, y, turn = vectors.T
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, wrap(turn)])


def turned(P: FloatArray, angle: FloatArray) -> FloatArray:
    """Return covariances (n, 3, 3) of poses in a frame turned by angles (n,)."""
    return _transformed(P, rotations(angle))


def moved(P: FloatArray, to: FloatArray) -> FloatArray:
    """Return covariances (n, 3, 3) of poses as those of poses that lie farther by (n, 2) and are fixed to these."""
    return _transformed(P, _arms(to))


def _transformed(P: FloatArray, by: FloatArray) -> FloatArray:
    return np.asarray(by @ P @ by.transpose(0, 2, 1))


def rotations(angle: FloatArray) -> FloatArray:
    """Return what turns x, y and theta by angles (n,), shape (n, 3, 3)."""
    cos, sin, zero, one = np.cos(angle), np.sin(angle), np.zeros(len(angle)), np.ones(len(angle))
    return np.array([[cos, -sin, zero], [sin, cos, zero], [zero, zero, one]]).transpose(2, 0, 1)


def _arms(to: FloatArray) -> FloatArray:
    """Return how the errors of a pose, x, y and theta, are those of one that lies farther by (n, 2)."""
    arms = np.tile(np.eye(3), (len(to), 1, 1))
    arms[:, 0, 2], arms[:, 1, 2] = -to[:, 1], to[:, 0]
    return arms
