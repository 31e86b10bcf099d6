# ruff: noqa: N802, N803, N806 # the names are the filter's own symbols: x, P, F, W, Q, H, R, S, K
"""The extended Kalman filter of a robot's pose and of the features that it sees.

The state is x = [pose, feature, feature, …]. A motion changes the pose alone, and a reading depends on the pose and on
one feature: a prediction costs O(n) and an update O(n²), where filterpy's own dense update costs O(n³). The method
is that of Thrun, Burgard & Fox 2005, Probabilistic Robotics, section 10.2.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import ArrayLike

from trailmark.errors import did_you_mean
from trailmark.estimation.covariance import checked_covariance, subtract_square
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.innovation import Innovation, Prediction
from trailmark.estimation.motion import MotionModel
from trailmark.estimation.sensor_model import SensorModel
from trailmark.se2 import FloatArray, configurations, wrap

__all__ = ["Innovation", "Mode", "Prediction", "SlamFilter"]

Mode = Literal["slam", "localisation", "mapping"]
"""What an update may change: pose and features, the pose alone, or the features alone."""


class SlamFilter(ExtendedKalmanFilter):  # type: ignore[misc]  # filterpy ships no type information
    """filterpy's EKF with a state that grows, and with H and F as sparse as they are.

    The covariance stays symmetric to the bit and positive definite: an update takes W Wᵀ from it, where
    W = P Hᵀ L⁻ᵀ and S = L Lᵀ, so that W Wᵀ = K S Kᵀ.

    Modes:
        slam: pose and features are estimated together.
        localisation: the map is known and stays as it is; its features' covariances (0 for a map known exactly) and
            their correlations with the pose are accounted for, as in Schmidt's consider filter.
        mapping: each pose is given (:meth:`set_pose`) and stays as it is, with the covariance given for it.

    Of filterpy's attributes x (shape (n,)), P, z, y, S, K, the likelihoods and ``mahalanobis`` are kept; the copies
    before and after each step are not, since making them would cost O(n²) per prediction.

    Args:
        pose: x, y, theta to begin with; metres and radians.
        P: its covariance, shape (3, 3); None for a pose that is certain.
        mode: one of the above.

    Raises:
        EstimationError: an unknown mode, a covariance that is not symmetric positive semidefinite.
    """

    x: FloatArray
    P: FloatArray

    def __init__(self, pose: ArrayLike = (0.0, 0.0, 0.0), P: ArrayLike | None = None, mode: Mode = "slam") -> None:
        if mode not in get_args(Mode):
            raise EstimationError(f"SlamFilter: mode {mode!r} given, {did_you_mean(str(mode), get_args(Mode))}")
        super().__init__(dim_x=3, dim_z=2)
        self.mode: Mode = mode
        self.x = _checked_pose(pose)
        self.P = np.zeros((3, 3)) if P is None else checked_covariance(P, 3, "pose")
        self.x_prior = self.P_prior = self.x_post = self.P_post = None
        self._places: dict[int, slice] = {}
        self._kinds: dict[int, str] = {}
        self._next_id = 0

    @property
    def pose(self) -> FloatArray:
        """x, y, theta, shape (3,); metres, radians in (−π, π]."""
        return self.x[:3].copy()

    @property
    def pose_covariance(self) -> FloatArray:
        """Shape (3, 3)."""
        return self.P[:3, :3].copy()

    @property
    def features(self) -> Mapping[int, slice]:
        """The features' ids, in the order of the state, and where in x and P each stands."""
        return MappingProxyType(self._places)

    def feature(self, feature_id: int) -> FloatArray:
        """Return a feature's estimate, shape (d,)."""
        return self.x[self._place(feature_id)].copy()

    def feature_covariance(self, feature_id: int) -> FloatArray:
        """Return a feature's covariance, shape (d, d)."""
        place = self._place(feature_id)
        return self.P[place, place].copy()

    def kind(self, feature_id: int) -> str:
        """Return what a feature is: the kind of the sensors that see it."""
        self._place(feature_id)
        return self._kinds[feature_id]

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
            raise EstimationError("predict: the poses of mode 'mapping' are given, allowed: set_pose")
        u = np.asarray(u, dtype=np.float64)
        if not all(map(math.isfinite, u.tolist())):
            raise EstimationError(f"predict: odometry {u.tolist()} given, allowed: finite numbers")
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
            raise EstimationError(f"set_pose: mode {self.mode!r} estimates the pose, allowed: mode 'mapping'")
        self.x[:3] = _checked_pose(pose)
        self.P[:3], self.P[:, :3] = 0.0, 0.0
        if P is not None:
            self.P[:3, :3] = checked_covariance(P, 3, "pose")

    def predict_readings(self, sensor: SensorModel, ids: Sequence[int] | None = None) -> Prediction:
        """Return what the sensor should read of features; O(k).

        Args:
            sensor: the model.
            ids: which features; None for all of the sensor's kind.
        """
        if ids is None:
            ids = [i for i, kind in self._kinds.items() if kind == sensor.feature_kind]
        d = sensor.feature_dim
        start = np.array([self._place(i).start for i in ids], dtype=np.intp)
        at = start[:, None] + np.arange(d)
        x, l = np.broadcast_to(self.pose, (len(at), 3)), self.x[at]  # noqa: E741 # features
        H_pose, H_feature, R = sensor.H_pose(x, l), sensor.H_feature(x, l), sensor.noise(x, l)
        cross = H_pose @ np.moveaxis(self.P[:3, at], 1, 0) @ np.swapaxes(H_feature, 1, 2)
        S = H_pose @ self.P[:3, :3] @ np.swapaxes(H_pose, 1, 2) + cross + np.swapaxes(cross, 1, 2) + R
        S += H_feature @ self.P[at[:, :, None], at[:, None, :]] @ np.swapaxes(H_feature, 1, 2)
        return Prediction(tuple(ids), sensor.h(x, l), H_pose, H_feature, R, S)

    def joint_covariance(self, prediction: Prediction) -> FloatArray:
        """Return H P Hᵀ of all the predicted readings together, shape (k, m, k, m), without the sensor's noise."""
        k, m, _ = prediction.H_pose.shape
        if k == 0:
            return np.zeros((0, m, 0, m))
        PHT = self._P_HT(prediction)
        return self._H_times(prediction, PHT).reshape(k, m, k, m)

    def innovation(self, z: ArrayLike, sensor: SensorModel, feature_id: int, R: ArrayLike | None = None) -> Innovation:
        """Return what :meth:`update` would make of a reading, and leave the filter as it is."""
        return self._innovation(np.asarray(z, dtype=np.float64)[None], sensor, [feature_id], [R])[0]

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
        return self.update_batch(np.asarray(z, dtype=np.float64)[None], sensor, [feature_id], [R])

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
        if len(ids) == 0:
            return Innovation(np.zeros(0), np.zeros((0, 0)), 0.0)
        innovation, PHT, L_inverse = self._innovation(z, sensor, ids, R)
        W = PHT @ L_inverse.T
        K = W @ L_inverse
        pose, features = slice(0, 3), slice(3, None)
        if self.mode == "localisation":
            K[features] = 0.0
            self.P[pose] -= W[pose] @ W.T
            self.P[pose, pose] = 0.5 * (self.P[pose, pose] + self.P[pose, pose].T)
            self.P[features, pose] = self.P[pose, features].T
        elif self.mode == "mapping":
            K[pose] = 0.0
            self.P[pose, features] -= W[pose] @ W[features].T
            self.P[features, pose] = self.P[pose, features].T
            subtract_square(self.P, W, 3)
        else:
            subtract_square(self.P, W, 0)
        self.x = self.x + K @ innovation.y
        self.x[2] = wrap(float(self.x[2]))
        self.z, self.y, self.S, self.K = np.asarray(z), innovation.y, innovation.S, K
        self._log_likelihood = self._likelihood = None
        self._mahalanobis = float(np.sqrt(innovation.nis))
        return innovation

    def predict_update(self, *_: Any, **__: Any) -> None:
        """Not for a state that grows.

        Raises:
            EstimationError: always.
        """
        raise EstimationError("predict_update: not for a state that grows, allowed: predict, then update")

    def add_feature(self, z: ArrayLike, sensor: SensorModel, R: ArrayLike | None = None) -> int:
        """Add the feature that a reading shows, with the correlations that the pose gives it; return its id; O(n²).

        Args:
            z: its first reading, shape (m,).
            sensor: what read it.
            R: covariance of z itself, shape (m, m), where the log states one; None for the sensor's V R Vᵀ.

        Raises:
            EstimationError: in mode "localisation", whose map is known; a reading that is not finite.
        """
        if self.mode == "localisation":
            raise EstimationError("add_feature: the map of mode 'localisation' is known, allowed: add_known_feature")
        reading = np.asarray(z, dtype=np.float64)
        if reading.shape != (sensor.reading_dim,) or not np.isfinite(reading).all():
            raise EstimationError(
                f"add_feature: reading {reading.tolist()} given, allowed: {sensor.reading_dim} finite numbers"
            )
        l, G_pose, G_z = sensor.inverse(self.pose, reading)  # noqa: E741 # a feature
        noise = sensor.noise(self.pose, l) if R is None else checked_covariance(R, sensor.reading_dim, "reading")
        block = G_pose @ self.P[:3, :3] @ G_pose.T + G_z @ noise @ G_z.T
        return self._append(l, 0.5 * (block + block.T), G_pose @ self.P[:3], sensor.feature_kind)

    def add_known_feature(self, feature: ArrayLike, P: ArrayLike | None = None, *, kind: str = "point") -> int:
        """Add a feature of a known map, uncorrelated with the rest; return its id.

        Args:
            feature: shape (d,).
            P: its covariance, shape (d, d); None for one that is certain.
            kind: "point" or "line", as the sensors that see it have it.
        """
        l = np.array(feature, dtype=np.float64)  # noqa: E741 # a feature
        if l.ndim != 1 or not np.isfinite(l).all():
            raise EstimationError(f"add_known_feature: {l.tolist()} given, allowed: finite numbers, shape (d,)")
        block = np.zeros((len(l), len(l))) if P is None else checked_covariance(P, len(l), "feature")
        return self._append(l, block, np.zeros((len(l), len(self.x))), kind)

    def remove_feature(self, feature_id: int) -> None:
        """Take a feature out of the state: exact, since the rest of a Gaussian stays what it was."""
        gone = self._place(feature_id)
        keep = np.r_[0 : gone.start, gone.stop : len(self.x)]
        self.x, self.P = self.x[keep], self.P[np.ix_(keep, keep)]
        del self._places[feature_id], self._kinds[feature_id]
        d = gone.stop - gone.start
        for other, place in self._places.items():
            if place.start > gone.start:
                self._places[other] = slice(place.start - d, place.stop - d)
        self.dim_x = len(self.x)

    def _append(self, feature: FloatArray, block: FloatArray, cross: FloatArray, kind: str) -> int:
        n, d = len(self.x), len(feature)
        P = np.empty((n + d, n + d))
        P[:n, :n], P[n:, :n], P[:n, n:], P[n:, n:] = self.P, cross, cross.T, block
        self.x, self.P, self.dim_x = np.concatenate([self.x, feature]), P, n + d
        feature_id, self._next_id = self._next_id, self._next_id + 1
        self._places[feature_id], self._kinds[feature_id] = slice(n, n + d), kind
        return feature_id

    def _place(self, feature_id: int) -> slice:
        if feature_id not in self._places:
            raise EstimationError(f"feature {feature_id!r} given, allowed: one of the {len(self._places)} in the state")
        return self._places[feature_id]

    def _innovation(
        self, z: ArrayLike, sensor: SensorModel, ids: Sequence[int], R: Sequence[ArrayLike | None] | None
    ) -> tuple[Innovation, FloatArray, FloatArray]:
        """Return the innovation of k readings, P Hᵀ, shape (n, k·m), and L⁻¹ of S = L Lᵀ."""
        readings, k, m = np.asarray(z, dtype=np.float64), len(ids), sensor.reading_dim
        if readings.shape != (k, m) or not np.isfinite(readings).all():
            raise EstimationError(f"readings {readings.tolist()} given, allowed: {k} times {m} finite numbers")
        if len(set(ids)) < k:
            raise EstimationError("update: two readings of one feature at once given, allowed: one after the other")
        prediction = self.predict_readings(sensor, ids)
        if any(self._kinds[i] != sensor.feature_kind for i in ids):
            raise EstimationError(f"update: a sensor of {sensor.feature_kind}s reads another kind of feature")
        noise = (
            prediction.R
            if R is None
            else [
                own if stated is None else checked_covariance(stated, m, "reading")
                for own, stated in zip(prediction.R, R, strict=True)
            ]
        )
        PHT = self._P_HT(prediction)
        S = self._H_times(prediction, PHT)
        for i in range(k):
            S[i * m : (i + 1) * m, i * m : (i + 1) * m] += noise[i]
        S = 0.5 * (S + S.T)
        try:
            # scipy's triangular solvers start threads even for two rows, which costs a hundred times the work.
            L_inverse = np.asarray(np.linalg.inv(np.linalg.cholesky(S)), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise EstimationError("update: S is singular, allowed: noise R that is positive definite") from None
        y = sensor.residual(readings, prediction.z_hat).reshape(-1)
        scaled = L_inverse @ y
        return Innovation(y, S, float(scaled @ scaled)), PHT, L_inverse

    def _P_HT(self, prediction: Prediction) -> FloatArray:
        """Return P Hᵀ, shape (n, k·m), from the pose's columns of P and the features'."""
        k, m, _ = prediction.H_pose.shape
        PHT = self.P[:, :3] @ prediction.H_pose.reshape(k * m, 3).T
        for i, place in self._blocks(prediction):
            PHT[:, i * m : (i + 1) * m] += self.P[:, place] @ prediction.H_feature[i].T
        return PHT

    def _H_times(self, prediction: Prediction, columns: FloatArray) -> FloatArray:
        """Return H A, shape (k·m, c), for A of shape (n, c)."""
        k, m, _ = prediction.H_pose.shape
        product = prediction.H_pose.reshape(k * m, 3) @ columns[:3]
        for i, place in self._blocks(prediction):
            product[i * m : (i + 1) * m] += prediction.H_feature[i] @ columns[place]
        return product

    def _blocks(self, prediction: Prediction) -> Iterator[tuple[int, slice]]:
        for i, feature_id in enumerate(prediction.ids):
            yield i, self._places[feature_id]

    def __repr__(self) -> str:
        return f"SlamFilter(mode={self.mode!r}, pose={self.pose.tolist()}, features={len(self._places)})"


def _checked_pose(pose: ArrayLike) -> FloatArray:
    q = configurations(pose, name="pose")
    if q.ndim != 1:
        raise EstimationError(f"pose: shape {q.shape} given, allowed: (3,)")
    return q
