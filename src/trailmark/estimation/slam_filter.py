# ruff: noqa: N803, N806 # the names are the filter's own symbols: x, P, F, W, Q, H, R, S, L, K
"""The extended Kalman filter of a robot's pose and of the point features that it sees, whose number grows and shrinks.

The state is x = [pose, feature, feature, …]. A motion changes the pose alone, and a reading depends on the pose and on
one feature: a prediction costs O(n) and an update O(n²), where a dense one costs O(n³). The method is that of Thrun,
Burgard & Fox 2005, Probabilistic Robotics, section 10.2, with the right-invariant error: features turn and shift with
the robot, so that no reading tells how the map is turned (Barrau & Bonnabel 2015, An EKF-SLAM algorithm with
consistency properties). What a linearised h misses may count as noise of the reading: the second-order term of
Bar-Shalom, Li & Kirubarajan 2001, Estimation with Applications to Tracking and Navigation, section 10.3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import NonNegative, brief, checked, checked_arguments, number_array, shaped
from trailmark.estimation.covariance import checked_covariance
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.models import MotionModel, RangeBearing
from trailmark.se2 import FloatArray, configurations, wrap

IntArray = NDArray[np.intp]


class Innovation(NamedTuple):
    """How far readings lie from what was expected of them."""

    y: FloatArray  #: z − ẑ, shape (m,); of several readings one after the other.
    S: FloatArray  #: Its covariance, H P Hᵀ + V R Vᵀ, shape (m, m).
    nis: float  #: yᵀ S⁻¹ y: the normalised innovation squared, chi-square with m degrees of freedom.

    @property
    def dof(self) -> int:
        """m, the degrees of freedom of the NIS."""
        return len(self.y)


class Prediction(NamedTuple):
    """What the sensor should read of k features."""

    ids: tuple[int, ...]  #: Which features.
    z_hat: FloatArray  #: ẑ, shape (k, 2).
    H_pose: FloatArray  #: ∂ẑ/∂pose, shape (k, 2, 3).
    H_feature: FloatArray  #: ∂ẑ/∂feature, shape (k, 2, 2).
    R: FloatArray  #: V R Vᵀ, the sensor's noise, shape (k, 2, 2).
    S: FloatArray  #: H P Hᵀ + V R Vᵀ of each feature by itself, shape (k, 2, 2).

    def select(self, which: IntArray) -> Prediction:
        """Return the prediction of some of the features only, by their numbers in this one, shape (j,)."""
        return Prediction(tuple(self.ids[j] for j in which), *(array[which] for array in self[1:]))


class SparseJacobian(NamedTuple):
    """H of k readings, each of which depends on the pose and on one feature."""

    pose: FloatArray  # ∂ẑ/∂pose, shape (k, 2, 3)
    feature: FloatArray  # ∂ẑ/∂feature, shape (k, 2, 2)
    at: IntArray  # where the features' numbers stand in the state, shape (k, 2)

    def times(self, A: FloatArray) -> FloatArray:
        """Return H A, shape (2k, c), for A of shape (n, c); O(k c)."""
        rows = 2 * len(self.pose)
        return np.asarray((self.feature @ A[self.at]).reshape(rows, A.shape[1]) + self.pose.reshape(rows, 3) @ A[:3])


class Gain(NamedTuple):
    """What k readings correct in a state of n numbers."""

    innovation: Innovation
    W: FloatArray  # P Hᵀ L⁻ᵀ, shape (n, 2k), S = L Lᵀ: P becomes P − W Wᵀ, and K = W L⁻¹
    step: FloatArray  # K y, shape (n,)


class SlamFilter:
    """An EKF with a state that grows, and with H and F as sparse as they are; features have ids.

    The covariance stays symmetric to the bit and positive definite: an update takes W Wᵀ from it, where
    W = P Hᵀ L⁻ᵀ and S = L Lᵀ, so that W Wᵀ = K S Kᵀ.

    Attributes:
        x: the state, shape (n,): x, y, theta of the robot, then x, y of each feature.
        P: its covariance, shape (n, n).

    Args:
        pose: x, y, theta to begin with; metres and radians.
        P: its covariance, shape (3, 3); None for a pose that is certain.
        curvature: by what the mean square of what a linearised reading misses is multiplied, to count as its noise.

    Raises:
        EstimationError: a covariance that is not symmetric positive semidefinite.
    """

    x: FloatArray
    P: FloatArray

    @checked_arguments(EstimationError)
    def __init__(
        self,
        pose: ArrayLike = (0.0, 0.0, 0.0),
        P: ArrayLike | None = None,
        *,
        curvature: NonNegative = 0.0,
    ) -> None:
        self.x, self.P, self.curvature = np.zeros(3), np.zeros((3, 3)), curvature
        self._starts: dict[int, int] = {}
        self._next_id = 0
        self.set_pose(pose, P)

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
        return {i: slice(start, start + 2) for i, start in self._starts.items()}

    def feature(self, feature_id: int) -> FloatArray:
        """Return a feature's estimate, shape (2,)."""
        return self.x[self._place(feature_id)].copy()

    def feature_covariance(self, feature_id: int) -> FloatArray:
        """Return a feature's covariance, shape (2, 2)."""
        place = self._place(feature_id)
        return self.P[place, place].copy()

    def add_feature(self, z: ArrayLike, sensor: RangeBearing, R: ArrayLike | None = None) -> int:
        """Add the feature that a reading shows, with the correlations that the pose gives it; return its id; O(n²).

        Args:
            z: its first reading, shape (2,).
            sensor: what read it.
            R: covariance of z itself, shape (2, 2), where the log states one; None for the sensor's V R Vᵀ.

        Raises:
            EstimationError: a reading that is not finite.
        """
        checked(sensor, RangeBearing, "add_feature: sensor", EstimationError)
        reading = _finite(z, (2,), "reading")
        point, G_pose, G_z = sensor.inverse(self.pose, reading)
        noise = sensor.noise(self.pose, point) if R is None else checked_covariance(R, 2, "reading")
        noise = noise + self.curvature * sensor.curvature(reading, noise)
        block = G_pose @ self.P[:3, :3] @ G_pose.T + G_z @ noise @ G_z.T
        return self._append(point, 0.5 * (block + block.T), G_pose @ self.P[:3])

    @checked_arguments(EstimationError)
    def add_known_feature(self, feature: Annotated[ArrayLike, shaped(2)], P: ArrayLike | None = None) -> int:
        """Add a feature of a known map, shape (2,), uncorrelated with the rest; return its id; P None: certain."""
        block = np.zeros((2, 2)) if P is None else checked_covariance(P, 2, "feature")
        return self._append(np.asarray(feature), block, np.zeros((2, len(self.x))))

    def remove_feature(self, feature_id: int) -> None:
        """Take a feature out of the state: exact, since the rest of a Gaussian stays what it was."""
        gone = self._place(feature_id)
        keep = np.r_[0 : gone.start, gone.stop : len(self.x)]
        self.x, self.P = self.x[keep], self.P[np.ix_(keep, keep)]
        ids = [i for i in self._starts if i != feature_id]
        self._starts = dict(zip(ids, range(3, len(self.x), 2), strict=True))

    def predict(self, motion: MotionModel, u: ArrayLike, Q: ArrayLike | None = None) -> None:
        """Move the robot: pose = f(pose, u, 0), P = F P Fᵀ + W Q Wᵀ in the pose's rows and columns; O(n).

        Args:
            motion: the model.
            u: its odometry, shape (3,).
            Q: covariance of w for this step, shape (q, q), where the log states one; None for the model's.

        Raises:
            EstimationError: odometry that is not finite.
        """
        checked(motion, MotionModel, "predict: motion", EstimationError)
        u = _finite(u, (3,), "odometry")
        pose, F, W = motion.step(self.x[:3], u)
        noise = motion.Q(u) if Q is None else checked_covariance(Q, W.shape[1], "odometry")
        pose_block = F @ self.P[:3, :3] @ F.T + W @ noise @ W.T
        self.x[:3] = pose
        self.P[:3, 3:] = F @ self.P[:3, 3:]
        self.P[3:, :3] = self.P[:3, 3:].T
        self.P[:3, :3] = 0.5 * (pose_block + pose_block.T)

    def set_pose(self, pose: ArrayLike, P: ArrayLike | None = None) -> None:
        """Put the robot where something else than this filter's state says that it is; O(n).

        Args:
            pose: x, y, theta.
            P: its covariance, shape (3, 3), independent of all before; None for a pose that is certain.
        """
        q = configurations(pose, name="pose")
        if q.ndim != 1:
            raise EstimationError(f"pose: expected shape (3,), got {q.shape}")
        block = np.zeros((3, 3)) if P is None else checked_covariance(P, 3, "pose")
        self.x[:3] = q
        self.P[:3], self.P[:, :3] = 0.0, 0.0
        self.P[:3, :3] = block

    def predict_readings(self, sensor: RangeBearing) -> Prediction:
        """Return what the sensor should read of all features; O(k)."""
        checked(sensor, RangeBearing, "predict_readings: sensor", EstimationError)
        ids = tuple(self._starts)
        at = self._places(ids)
        x, points = np.broadcast_to(self.pose, (len(at), 3)), self.x[at]
        (z_hat, H_pose, H_feature), R = sensor.linearised(x, points), sensor.noise(x, points)
        cross = H_pose @ np.moveaxis(self.P[:3, at], 1, 0) @ np.swapaxes(H_feature, 1, 2)
        S = H_pose @ self.P[:3, :3] @ np.swapaxes(H_pose, 1, 2) + cross + np.swapaxes(cross, 1, 2) + R
        S += H_feature @ self.P[at[:, :, None], at[:, None, :]] @ np.swapaxes(H_feature, 1, 2)
        return Prediction(ids, z_hat, H_pose, H_feature, R, S)

    def joint_covariance(self, prediction: Prediction) -> FloatArray:
        """Return H P Hᵀ of all the predicted readings together, shape (k, 2, k, 2), without the sensor's noise."""
        k = len(prediction.ids)
        H = SparseJacobian(prediction.H_pose, prediction.H_feature, self._places(prediction.ids))
        return H.times(H.times(self.P).T).reshape(k, 2, k, 2)

    def innovation(self, z: ArrayLike, sensor: RangeBearing, feature_id: int, R: ArrayLike | None = None) -> Innovation:
        """Return what :meth:`update` would make of a reading, and leave the filter as it is."""
        z = number_array(z, "readings", error=EstimationError)
        readings, at, noise = self._checked(z[None], sensor, [feature_id], [R])
        return self._gain(readings, sensor, at, noise).innovation

    def update(self, z: ArrayLike, sensor: RangeBearing, feature_id: int, R: ArrayLike | None = None) -> Innovation:
        """Correct the state by one reading of a feature; see :meth:`update_batch`."""
        return self.update_batch(number_array(z, "readings", error=EstimationError)[None], sensor, [feature_id], [R])

    def update_batch(
        self, z: ArrayLike, sensor: RangeBearing, ids: Sequence[int], R: Sequence[ArrayLike | None] | None = None
    ) -> Innovation:
        """Correct the state by k readings of k different features at once; O(k n²).

        Args:
            z: the readings, shape (k, 2).
            sensor: what read them.
            ids: of which features.
            R: covariance of each reading, shape (2, 2), or None for the sensor's V R Vᵀ; None for all of them.

        Raises:
            EstimationError: no such feature, a reading that is not finite, a covariance that is not positive definite.
        """
        readings, at, noise = self._checked(z, sensor, ids, R)
        if len(readings) == 0:
            return Innovation(np.zeros(0), np.zeros((0, 0)), 0.0)
        before, gain = self.x, self._gain(readings, sensor, at, noise)
        self.x = moved(before, gain.step)
        correct_covariance(self.P, gain.W, carried(before, self.x))
        return gain.innovation

    def _gain(self, readings: FloatArray, sensor: RangeBearing, at: IntArray, noise: FloatArray) -> Gain:
        z_hat, H_pose, H_feature = sensor.linearised(self.x[:3], self.x[at])
        y, each = sensor.residual(readings, z_hat).reshape(-1), np.arange(len(noise))
        H = SparseJacobian(H_pose, H_feature, at)
        HP = H.times(self.P)
        S = H.times(HP.T)
        own = S.reshape(len(each), 2, len(each), 2)
        own[each, :, each, :] += noise + self.curvature * sensor.curvature(z_hat, own[each, :, each, :])
        S = 0.5 * (S + S.T)
        try:
            # scipy's triangular solvers start threads even for two rows, which costs a hundred times the work.
            L_inverse = np.asarray(np.linalg.inv(np.linalg.cholesky(S)), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise EstimationError("update: expected noise R that is positive definite, got a singular S") from None
        W, scaled = HP.T @ L_inverse.T, L_inverse @ y
        return Gain(Innovation(y, S, float(scaled @ scaled)), W, W @ scaled)

    def _checked(
        self, z: ArrayLike, sensor: RangeBearing, ids: Sequence[int], R: Sequence[ArrayLike | None] | None
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return readings (k, 2), where their features stand (k, 2), and the covariance of each (k, 2, 2)."""
        checked(sensor, RangeBearing, "update: sensor", EstimationError)
        places = self._places(checked(ids, Sequence[Any], "update: ids", EstimationError))
        k = len(places)
        readings = _finite(z, (k, 2), "readings")
        if len(set(ids)) < k:
            raise EstimationError("update: expected one reading of each feature, got two of one at once")
        stated = [None] * k if R is None else checked(R, Sequence[Any], "update: R", EstimationError)
        if len(stated) != k:
            raise EstimationError(f"update: expected {k} covariances, one for each reading, got {len(stated)}")
        noise = np.empty((k, 2, 2))
        if any(covariance is None for covariance in stated):
            noise[:] = sensor.noise(self.pose, self.x[places])
        for i, covariance in enumerate(stated):
            if covariance is not None:
                noise[i] = checked_covariance(covariance, 2, "reading")
        return readings, places, noise

    def _append(self, feature: FloatArray, block: FloatArray, cross: FloatArray) -> int:
        n = len(self.x)
        P = np.empty((n + 2, n + 2))
        P[:n, :n], P[n:, :n], P[:n, n:], P[n:, n:] = self.P, cross, cross.T, block
        self.x, self.P = np.concatenate([self.x, feature]), P
        feature_id, self._next_id = self._next_id, self._next_id + 1
        self._starts[feature_id] = n
        return feature_id

    def _place(self, feature_id: int) -> slice:
        if not isinstance(feature_id, int | np.integer) or feature_id not in self._starts:
            ids = f"the id of one of the {len(self._starts)} features"
            raise EstimationError(f"feature: expected {ids}, got {brief(feature_id)}")
        return slice(self._starts[feature_id], self._starts[feature_id] + 2)

    def _places(self, ids: Sequence[int]) -> IntArray:
        """Return where the features' numbers stand in the state, shape (k, 2)."""
        return np.array([self._place(i).start for i in ids], dtype=np.intp)[:, None] + np.arange(2)

    def __repr__(self) -> str:
        return f"SlamFilter(pose={self.pose.tolist()}, features={len(self._starts)})"


def _finite(value: ArrayLike, shape: tuple[int, ...], name: str) -> FloatArray:
    array = number_array(value, name, error=EstimationError)
    if array.shape != shape or not np.isfinite(array).all():
        raise EstimationError(f"{name}: expected finite numbers of shape {shape}, got {array.tolist()}")
    return array


def _points(x: FloatArray) -> FloatArray:
    """Return the places of the robot and of the features, shape (k, 2), in a state."""
    return np.concatenate([x[:2], x[3:]]).reshape(-1, 2)


def moved(x: FloatArray, step: FloatArray) -> FloatArray:
    """Return the state after a correction, exp(ξ) x, shape (n,).

    In the usual error, δ = (δ_p, δ_θ, δ_l, …), the exponential is p + V(δ_θ) δ_p for each point and addition for the
    heading, with V(θ) = [sin θ, cos θ − 1; 1 − cos θ, sin θ]/θ.
    """
    after, turn = x + step, float(step[2])
    if abs(turn) > 1e-12:
        s, c = math.sin(turn) / turn, (1.0 - math.cos(turn)) / turn
        points = _points(x) + _points(step) @ np.array([[s, c], [-c, s]])
        after[:2], after[3:] = points[0], points[1:].reshape(-1)
    after[2] = wrap(float(after[2]))
    return np.asarray(after)


def carried(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return a = J Δ, shape (n,): how the usual error at one estimate follows from that at another, e' = e + a e_θ."""
    delta = _points(after) - _points(before)
    across = np.column_stack([-delta[:, 1], delta[:, 0]])
    return np.concatenate([across[0], [0.0], across[1:].reshape(-1)])


def correct_covariance(P: FloatArray, W: FloatArray, a: FloatArray) -> None:
    """Set P to (I + a e_θᵀ) (P − W Wᵀ) (I + a e_θᵀ)ᵀ in place; O(n²), symmetric to the bit."""
    P -= W @ W.T
    # With p the column of the heading, the change by a is a bᵀ + b aᵀ.
    b = P[:, 2] + 0.5 * P[2, 2] * a
    P += np.multiply.outer(a, b) + np.multiply.outer(b, a)
