# ruff: noqa: N803, N806 # the names are the filter's own symbols: x, P, F, W, Q, H, R, S, K
"""The extended Kalman filter of a robot's pose and of the features that it sees.

The state is x = [pose, feature, feature, …]. A motion changes the pose alone, and a reading depends on the pose and on
one feature: a prediction costs O(n) and an update O(n²), where filterpy's own dense update costs O(n³). The method
is that of Thrun, Burgard & Fox 2005, Probabilistic Robotics, section 10.2, with the error of
:mod:`trailmark.estimation.filter.gain` and with updates that are iterated where h is not straight enough
(Bell & Cathey 1993, The iterated Kalman filter update as a Gauss-Newton method). What a linearised h still
misses may count as noise of the reading: the second-order term of Bar-Shalom, Li & Kirubarajan 2001, Estimation with
Applications to Tracking and Navigation, section 10.3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import Count, NonNegative, checked, checked_arguments, number_array
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.covariance import checked_covariance
from trailmark.estimation.filter.gain import (
    Gain,
    Innovation,
    Prediction,
    SparseJacobian,
    carried,
    correct_covariance,
    correct_features,
    gain_of,
    moved,
    turned,
)
from trailmark.estimation.filter.motion import MotionModel
from trailmark.estimation.filter.sensors import SensorModel
from trailmark.estimation.filter.state import Mode, SlamState, checked_pose
from trailmark.se2 import FloatArray

__all__ = ["Innovation", "Mode", "Prediction", "SlamFilter"]

STRAIGHT = 0.03
"""Standard deviations of a reading: an update whose linearisation was off by less is not iterated."""


class SlamFilter(SlamState):
    """filterpy's EKF with a state that grows, and with H and F as sparse as they are.

    The covariance stays symmetric to the bit and positive definite: an update takes W Wᵀ from it, where
    W = P Hᵀ L⁻ᵀ and S = L Lᵀ, so that W Wᵀ = K S Kᵀ.

    Modes:
        slam: pose and features are estimated together.
        mapping: each pose is given (:meth:`set_pose`) and stays as it is, with the covariance given for it.

    Of filterpy's attributes x (shape (n,)), P, z, y, S, K, the likelihoods and ``mahalanobis`` are kept; the copies
    before and after each step are not, since making them would cost O(n²) per prediction.

    Args:
        pose: x, y, theta to begin with; metres and radians.
        P: its covariance, shape (3, 3); None for a pose that is certain.
        mode: one of the above.
        iterations: in mode "slam", how often at most an update is linearised anew, at what it gave the last time.
        curvature: by what the mean square of what a linearised reading misses is multiplied, to count as its noise.

    Raises:
        EstimationError: an unknown mode, no iteration, a covariance that is not symmetric positive
            semidefinite.
    """

    @checked_arguments(EstimationError)
    def __init__(
        self,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        P: ArrayLike | None = None,
        mode: Mode = "slam",
        *,
        iterations: Count = 1,
        curvature: NonNegative = 0.0,
    ) -> None:
        super().__init__(pose, P)
        self.mode = mode
        self.iterations = iterations
        self.curvature = curvature

    def predict(self, motion: MotionModel, u: ArrayLike, Q: ArrayLike | None = None) -> None:
        """Move the robot: pose = f(pose, u, 0), P = F P Fᵀ + W Q Wᵀ in the pose's rows and columns; O(n).

        Args:
            motion: the model.
            u: its odometry, shape (p,).
            Q: covariance of w for this step, shape (q, q), where the log states one; None for the model's.

        Raises:
            EstimationError: in mode "mapping", where poses are given; odometry that is not finite.
        """
        if self.mode == "mapping":
            raise EstimationError("predict: expected set_pose, since the poses of mode 'mapping' are given")
        checked(motion, MotionModel, "predict: motion", EstimationError)
        u = number_array(u, "odometry", error=EstimationError)
        if u.shape != (3,) or not all(map(math.isfinite, u.tolist())):
            raise EstimationError(f"odometry: expected three finite numbers, got {u.tolist()}")
        pose, F, W = motion.step(self.x[:3], u)
        noise = motion.Q(u) if Q is None else checked_covariance(Q, W.shape[1], "odometry")
        pose_block = F @ self.P[:3, :3] @ F.T + W @ noise @ W.T
        self.x[:3] = pose
        self.P[:3, 3:] = F @ self.P[:3, 3:]
        self.P[3:, :3] = self.P[:3, 3:].T
        self.P[:3, :3] = 0.5 * (pose_block + pose_block.T)

    def set_pose(self, pose: ArrayLike, P: ArrayLike | None = None) -> None:
        """Put the robot where it is known to be; only in mode "mapping"; O(n).

        Args:
            pose: x, y, theta.
            P: its covariance, shape (3, 3); None for a pose that is certain. Its error has nothing to do with that of
                other poses.

        Raises:
            EstimationError: in another mode.
        """
        if self.mode != "mapping":
            raise EstimationError(f"set_pose: expected mode 'mapping', got {self.mode!r}, which estimates the pose")
        self.x[:3] = checked_pose(pose)
        self.P[:3], self.P[:, :3] = 0.0, 0.0
        if P is not None:
            self.P[:3, :3] = checked_covariance(P, 3, "pose")

    def predict_readings(self, sensor: SensorModel, ids: Sequence[int] | None = None) -> Prediction:
        """Return what the sensor should read of features; O(k).

        Args:
            sensor: the model.
            ids: which features; None for all.
        """
        checked(sensor, SensorModel, "predict_readings: sensor", EstimationError)
        if ids is None:
            ids = list(self._places)
        at = self.places(sensor, ids)
        x, l = np.broadcast_to(self.pose, (len(at), 3)), self.x[at]  # noqa: E741 # features
        (z_hat, H_pose, H_feature), R = sensor.linearised(x, l), sensor.noise(x, l)
        cross = H_pose @ np.moveaxis(self.P[:3, at], 1, 0) @ np.swapaxes(H_feature, 1, 2)
        S = H_pose @ self.P[:3, :3] @ np.swapaxes(H_pose, 1, 2) + cross + np.swapaxes(cross, 1, 2) + R
        S += H_feature @ self.P[at[:, :, None], at[:, None, :]] @ np.swapaxes(H_feature, 1, 2)
        return Prediction(tuple(ids), z_hat, H_pose, H_feature, R, S)

    def joint_covariance(self, prediction: Prediction) -> FloatArray:
        """Return H P Hᵀ of all the predicted readings together, shape (k, m, k, m), without the sensor's noise."""
        k, m, _ = prediction.H_pose.shape
        if k == 0:
            return np.zeros((0, m, 0, m))
        starts = np.array([self._place(i).start for i in prediction.ids], dtype=np.intp)
        at = starts[:, None] + np.arange(prediction.H_feature.shape[2])
        H = SparseJacobian(prediction.H_pose, prediction.H_feature, at)
        return H.times(H.times(self.P).T).reshape(k, m, k, m)

    def innovation(self, z: ArrayLike, sensor: SensorModel, feature_id: int, R: ArrayLike | None = None) -> Innovation:
        """Return what :meth:`update` would make of a reading, and leave the filter as it is."""
        z = number_array(z, "readings", error=EstimationError)
        readings, noise = self.checked_readings(z[None], sensor, [feature_id], [R])
        gain = self._gain(readings, sensor, self.places(sensor, [feature_id]), noise)
        return gain.innovation

    def update(self, z: ArrayLike, sensor: SensorModel, feature_id: int, R: ArrayLike | None = None) -> Innovation:
        """Correct the state by one reading of a feature; O(n²).

        Args:
            z: the reading, shape (m,).
            sensor: what read it.
            feature_id: of which feature.
            R: covariance of z itself, shape (m, m), where the log states one; None for the sensor's V R Vᵀ.

        Raises:
            EstimationError: no such feature, a reading that is not finite, a covariance that is not positive definite.
        """
        return self.update_batch(number_array(z, "readings", error=EstimationError)[None], sensor, [feature_id], [R])

    def update_batch(
        self,
        z: ArrayLike,
        sensor: SensorModel,
        ids: Sequence[int],
        R: Sequence[ArrayLike | None] | None = None,
    ) -> Innovation:
        """Correct the state by k readings of k different features at once; O(k n²).

        Args:
            z: the readings, shape (k, m).
            sensor: what read them.
            ids: of which features.
            R: covariance of each reading, shape (m, m), or None for the sensor's V R Vᵀ; None for all of them.
        """
        readings, noise = self.checked_readings(z, sensor, ids, R)
        if len(readings) == 0:
            return Innovation(np.zeros(0), np.zeros((0, 0)), 0.0)
        at = self.places(sensor, ids)
        gain = self._gain(readings, sensor, at, noise)
        innovation = gain.innovation
        if self.mode == "slam":
            gain = self._correct(gain, readings, sensor, noise)
        else:
            self.x = correct_features(self.x, self.P, gain)
        self.z, self.y, self.S, self.K = readings, innovation.y, innovation.S, gain.W @ gain.L_inverse
        self._log_likelihood = self._likelihood = None
        self._mahalanobis = math.sqrt(innovation.nis)
        return innovation

    def predict_update(self, *_: Any, **__: Any) -> None:
        """Not for a state that grows.

        Raises:
            EstimationError: always.
        """
        raise EstimationError("predict_update: expected predict, then update, for a state that grows")

    def merge_features(self, keep: int, drop: int) -> None:
        """Merge two points: they become equal, and ``drop`` is removed; O(n²).

        Args:
            keep: the id that stays.
            drop: the other id.

        Raises:
            EstimationError: no such features, one and the same; a mode other than "slam".
        """
        one, other = self._place(keep), self._place(drop)
        if self.mode != "slam" or one == other:
            raise EstimationError(f"merge_features: expected two points, in mode 'slam', got {keep!r}, {drop!r}")
        PHT = self.P[:, one] - self.P[:, other]
        D = PHT[one] - PHT[other]
        # A tenth of a millimetre: the difference of two features may be certain already.
        L_inverse = np.linalg.inv(np.linalg.cholesky(0.5 * (D + D.T) + 1e-8 * np.eye(2)))
        W = PHT @ L_inverse.T
        before = self.x
        self.x = self._moved(before, W @ (L_inverse @ (before[other] - before[one])))
        self._correct_covariance(W, before)
        self.remove_feature(drop)

    def _correct(self, gain: Gain, readings: FloatArray, sensor: SensorModel, noise: FloatArray) -> Gain:
        """Correct pose and features, linearising anew while that changes much; return the last gain."""
        before = self.x
        for _ in range(self.iterations - 1):
            after = self._moved(before, gain.step)
            # The error of h's linearisation, by one evaluation of h; mostly it is zero.
            y = sensor.residual(readings, sensor.h(after[:3], after[gain.H.at])).reshape(-1)
            missed = sensor.residual(
                y.reshape(readings.shape), (gain.y - gain.H.times_vector(gain.step)).reshape(readings.shape)
            )
            if (np.abs(missed) <= STRAIGHT * np.sqrt(np.diagonal(noise, axis1=1, axis2=2))).all():
                break
            gain = self._gain(readings, sensor, gain.H.at, noise, after, gain.step)
        self.x = self._moved(before, gain.step)
        self._correct_covariance(gain.W, before)
        return gain

    def _correct_covariance(self, W: FloatArray, before: FloatArray) -> None:
        """Take W Wᵀ from P, which is then for the estimate as it is now."""
        correct_covariance(self.P, W, carried(before, self.x, self.points))

    def _moved(self, x: FloatArray, step: FloatArray) -> FloatArray:
        return moved(x, step, self.points)

    def _gain(
        self,
        readings: FloatArray,
        sensor: SensorModel,
        at: NDArray[np.intp],
        noise: FloatArray,
        x: FloatArray | None = None,
        step: FloatArray | None = None,
    ) -> Gain:
        """Return the correction by readings, with h linearised at the estimate, or at x, an earlier result."""
        place = self.x if x is None else x
        z_hat, H_pose, H_feature = sensor.linearised(place[:3], place[at])
        H = SparseJacobian(H_pose, H_feature, at)
        y = sensor.residual(readings, z_hat).reshape(-1)
        if x is not None and step is not None:
            H = turned(H, carried(self.x, x, self.points))
            y = y + H.times_vector(step)
        return gain_of(self.P, H, y, noise, lambda C: self.curvature * sensor.curvature(z_hat, C))

    def __repr__(self) -> str:
        return f"SlamFilter(mode={self.mode!r}, pose={self.pose.tolist()}, features={len(self._places)})"
