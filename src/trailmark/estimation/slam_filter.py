# ruff: noqa: N803, N806 # the names are the filter's own symbols: x, P, F, W, Q, H, R, S, L, K
"""The extended Kalman filter of a robot's pose and of the point features that it sees, whose number grows and shrinks.

The state is x = [pose, feature, feature, …]. A motion changes the pose alone, and a reading depends on the pose and on
one feature: a prediction costs O(n) and an update O(n²), where a dense one costs O(n³). The method is that of Thrun,
Burgard & Fox 2005, Probabilistic Robotics, section 10.2, with the right-invariant error: features turn and shift with
the robot, so that no reading tells how the map is turned (Barrau & Bonnabel 2015, An EKF-SLAM algorithm with
consistency properties). Updates are iterated where h is not straight enough (Bell & Cathey 1993, The iterated Kalman
filter update as a Gauss-Newton method). What a linearised h still misses may count as noise of the reading: the
second-order term of Bar-Shalom, Li & Kirubarajan 2001, Estimation with Applications to Tracking and Navigation, 10.3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import Count, NonNegative, brief, checked, checked_arguments, number_array, shaped
from trailmark.estimation.covariance import checked_covariance, subtract_square
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.models import MotionModel, SensorModel
from trailmark.se2 import FloatArray, configurations, wrap

IntArray = NDArray[np.intp]
Mode = Literal["slam", "mapping"]  # what an update may change: pose and features, or the features alone

STRAIGHT = 0.03  # standard deviations of a reading: an update whose linearisation was off by less is not iterated


class Innovation(NamedTuple):
    """How far readings lie from what was expected of them.

    Attributes:
        y: z − ẑ, shape (m,); of several readings one after the other.
        S: its covariance, H P Hᵀ + V R Vᵀ, shape (m, m).
        nis: yᵀ S⁻¹ y: the normalised innovation squared, of chi-square distribution with m degrees of freedom.
    """

    y: FloatArray
    S: FloatArray
    nis: float

    @property
    def dof(self) -> int:
        """m, the degrees of freedom of the NIS."""
        return len(self.y)


class Prediction(NamedTuple):
    """What a sensor should read of k features.

    Attributes:
        ids: which features, k of them.
        z_hat: ẑ, shape (k, m).
        H_pose: ∂ẑ/∂pose, shape (k, m, 3).
        H_feature: ∂ẑ/∂feature, shape (k, m, 2).
        R: V R Vᵀ, the sensor's noise, shape (k, m, m).
        S: H P Hᵀ + V R Vᵀ of each feature by itself, shape (k, m, m).
    """

    ids: tuple[int, ...]
    z_hat: FloatArray
    H_pose: FloatArray
    H_feature: FloatArray
    R: FloatArray
    S: FloatArray

    def select(self, which: IntArray) -> Prediction:
        """Return the prediction of some of the features only, by their numbers in this one, shape (j,)."""
        return Prediction(tuple(self.ids[j] for j in which), *(array[which] for array in self[1:]))


class SparseJacobian(NamedTuple):
    """H of k readings, each of which depends on the pose and on one feature."""

    pose: FloatArray  # ∂ẑ/∂pose, shape (k, m, 3)
    feature: FloatArray  # ∂ẑ/∂feature, shape (k, m, 2)
    at: IntArray  # where the features' numbers stand in the state, shape (k, 2)

    def times(self, A: FloatArray) -> FloatArray:
        """Return H A, shape (k·m, c), for A of shape (n, c); O(k c)."""
        k, m, _ = self.pose.shape
        product = (self.feature @ A[self.at]).reshape(k * m, A.shape[1])
        product += self.pose.reshape(k * m, 3) @ A[:3]
        return np.asarray(product)

    def times_vector(self, step: FloatArray) -> FloatArray:
        """Return H δ, shape (k·m,), for δ of shape (n,)."""
        return np.asarray((self.pose @ step[:3] + (self.feature @ step[self.at][..., None])[..., 0]).reshape(-1))


class Gain(NamedTuple):
    """What k readings of m numbers correct in a state of n numbers."""

    H: SparseJacobian
    innovation: Innovation
    W: FloatArray  # P Hᵀ L⁻ᵀ, shape (n, k·m), S = L Lᵀ: P becomes P − W Wᵀ, and K = W L⁻¹
    step: FloatArray  # K y, shape (n,)


class SlamFilter:
    """An EKF with a state that grows, and with H and F as sparse as they are; features have ids.

    The covariance stays symmetric to the bit and positive definite: an update takes W Wᵀ from it, where
    W = P Hᵀ L⁻ᵀ and S = L Lᵀ, so that W Wᵀ = K S Kᵀ.

    Modes:
        slam: pose and features are estimated together.
        mapping: each pose is given (:meth:`set_pose`) and stays as it is, with the covariance given for it.

    Attributes:
        x: the state, shape (n,): x, y, theta of the robot, then x, y of each feature.
        P: its covariance, shape (n, n).

    Args:
        pose: x, y, theta to begin with; metres and radians.
        P: its covariance, shape (3, 3); None for a pose that is certain.
        mode: one of the above.
        iterations: in mode "slam", how often at most an update is linearised anew, at what it gave the last time.
        curvature: by what the mean square of what a linearised reading misses is multiplied, to count as its noise.

    Raises:
        EstimationError: an unknown mode, no iteration, a covariance that is not symmetric positive semidefinite.
    """

    x: FloatArray
    P: FloatArray

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
        self.x = _checked_pose(pose)
        self.P = np.zeros((3, 3)) if P is None else checked_covariance(P, 3, "pose")
        self.mode, self.iterations, self.curvature = mode, iterations, curvature
        self._starts: dict[int, int] = {}
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
        return {i: slice(start, start + 2) for i, start in self._starts.items()}

    def feature(self, feature_id: int) -> FloatArray:
        """Return a feature's estimate, shape (2,)."""
        return self.x[self._place(feature_id)].copy()

    def feature_covariance(self, feature_id: int) -> FloatArray:
        """Return a feature's covariance, shape (2, 2)."""
        place = self._place(feature_id)
        return self.P[place, place].copy()

    def add_feature(self, z: ArrayLike, sensor: SensorModel, R: ArrayLike | None = None) -> int:
        """Add the feature that a reading shows, with the correlations that the pose gives it; return its id; O(n²).

        Args:
            z: its first reading, shape (m,).
            sensor: what read it.
            R: covariance of z itself, shape (m, m), where the log states one; None for the sensor's V R Vᵀ.

        Raises:
            EstimationError: a reading that is not finite.
        """
        checked(sensor, SensorModel, "add_feature: sensor", EstimationError)
        reading = number_array(z, "reading", error=EstimationError)
        if reading.shape != (sensor.reading_dim,) or not np.isfinite(reading).all():
            raise EstimationError(f"reading: expected {sensor.reading_dim} finite numbers, got {reading.tolist()}")
        point, G_pose, G_z = sensor.inverse(self.pose, reading)
        noise = sensor.noise(self.pose, point) if R is None else checked_covariance(R, sensor.reading_dim, "reading")
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
        """Put the robot where it is known to be, in mode "mapping" alone; O(n).

        Args:
            pose: x, y, theta.
            P: its covariance, shape (3, 3), None for a pose that is certain; independent of that of other poses.

        Raises:
            EstimationError: in another mode.
        """
        if self.mode != "mapping":
            raise EstimationError(f"set_pose: expected mode 'mapping', got {self.mode!r}, which estimates the pose")
        self.x[:3] = _checked_pose(pose)
        self.P[:3], self.P[:, :3] = 0.0, 0.0
        if P is not None:
            self.P[:3, :3] = checked_covariance(P, 3, "pose")

    def predict_readings(self, sensor: SensorModel, ids: Sequence[int] | None = None) -> Prediction:
        """Return what the sensor should read of features, of all where ``ids`` is None; O(k)."""
        checked(sensor, SensorModel, "predict_readings: sensor", EstimationError)
        ids = list(self._starts) if ids is None else ids
        at = self._places(ids)
        x, points = np.broadcast_to(self.pose, (len(at), 3)), self.x[at]
        (z_hat, H_pose, H_feature), R = sensor.linearised(x, points), sensor.noise(x, points)
        cross = H_pose @ np.moveaxis(self.P[:3, at], 1, 0) @ np.swapaxes(H_feature, 1, 2)
        S = H_pose @ self.P[:3, :3] @ np.swapaxes(H_pose, 1, 2) + cross + np.swapaxes(cross, 1, 2) + R
        S += H_feature @ self.P[at[:, :, None], at[:, None, :]] @ np.swapaxes(H_feature, 1, 2)
        return Prediction(tuple(ids), z_hat, H_pose, H_feature, R, S)

    def joint_covariance(self, prediction: Prediction) -> FloatArray:
        """Return H P Hᵀ of all the predicted readings together, shape (k, m, k, m), without the sensor's noise."""
        k, m, _ = prediction.H_pose.shape
        H = SparseJacobian(prediction.H_pose, prediction.H_feature, self._places(prediction.ids))
        return H.times(H.times(self.P).T).reshape(k, m, k, m)

    def innovation(self, z: ArrayLike, sensor: SensorModel, feature_id: int, R: ArrayLike | None = None) -> Innovation:
        """Return what :meth:`update` would make of a reading, and leave the filter as it is."""
        z = number_array(z, "readings", error=EstimationError)
        readings, at, noise = self._checked(z[None], sensor, [feature_id], [R])
        return self._gain(readings, sensor, at, noise).innovation

    def update(self, z: ArrayLike, sensor: SensorModel, feature_id: int, R: ArrayLike | None = None) -> Innovation:
        """Correct the state by one reading of a feature; see :meth:`update_batch`."""
        return self.update_batch(number_array(z, "readings", error=EstimationError)[None], sensor, [feature_id], [R])

    def update_batch(
        self, z: ArrayLike, sensor: SensorModel, ids: Sequence[int], R: Sequence[ArrayLike | None] | None = None
    ) -> Innovation:
        """Correct the state by k readings of k different features at once; O(k n²).

        Args:
            z: the readings, shape (k, m).
            sensor: what read them.
            ids: of which features.
            R: covariance of each reading, shape (m, m), or None for the sensor's V R Vᵀ; None for all of them.

        Raises:
            EstimationError: no such feature, a reading that is not finite, a covariance that is not positive definite.
        """
        readings, at, noise = self._checked(z, sensor, ids, R)
        if len(readings) == 0:
            return Innovation(np.zeros(0), np.zeros((0, 0)), 0.0)
        gain = self._gain(readings, sensor, at, noise)
        innovation = gain.innovation
        if self.mode == "slam":
            self._correct(gain, readings, sensor, noise)
            return innovation
        # The pose is given, and the errors of what is given still count (Schmidt's consider filter).
        step = gain.step.copy()
        step[:3] = 0.0
        self.P[:3, 3:] -= gain.W[:3] @ gain.W[3:].T
        self.P[3:, :3] = self.P[:3, 3:].T
        subtract_square(self.P, gain.W, 3)
        self.x = self.x + step
        return innovation

    def merge_features(self, keep: int, drop: int) -> None:
        """Merge two points: they become equal, and ``drop`` is removed; O(n²).

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
        self.x = moved(before, W @ (L_inverse @ (before[other] - before[one])))
        correct_covariance(self.P, W, carried(before, self.x))
        self.remove_feature(drop)

    def _correct(self, gain: Gain, readings: FloatArray, sensor: SensorModel, noise: FloatArray) -> None:
        """Correct pose and features, linearising anew while that changes much."""
        before = self.x
        for _ in range(self.iterations - 1):
            after = moved(before, gain.step)
            # The error of h's linearisation, by one evaluation of h; mostly it is zero.
            y = sensor.residual(readings, sensor.h(after[:3], after[gain.H.at]))
            expected = (gain.innovation.y - gain.H.times_vector(gain.step)).reshape(readings.shape)
            missed = np.abs(sensor.residual(y, expected))
            if (missed <= STRAIGHT * np.sqrt(np.diagonal(noise, axis1=1, axis2=2))).all():
                break
            gain = self._gain(readings, sensor, gain.H.at, noise, after, gain.step)
        self.x = moved(before, gain.step)
        correct_covariance(self.P, gain.W, carried(before, self.x))

    def _gain(
        self,
        readings: FloatArray,
        sensor: SensorModel,
        at: IntArray,
        noise: FloatArray,
        x: FloatArray | None = None,
        step: FloatArray | None = None,
    ) -> Gain:
        """Return the correction by readings, with h linearised at the estimate, or at x, an earlier step's result."""
        place, (k, m, _) = self.x if x is None else x, noise.shape
        z_hat, H_pose, H_feature = sensor.linearised(place[:3], place[at])
        H = SparseJacobian(H_pose, H_feature, at)
        y = sensor.residual(readings, z_hat).reshape(-1)
        if x is not None and step is not None:
            H = _turned(H, carried(self.x, x))
            y = y + H.times_vector(step)
        HP = H.times(self.P)
        S, each = H.times(HP.T), np.arange(k)
        own = S.reshape(k, m, k, m)
        own[each, :, each, :] += noise + self.curvature * sensor.curvature(z_hat, own[each, :, each, :])
        S = 0.5 * (S + S.T)
        try:
            # scipy's triangular solvers start threads even for two rows, which costs a hundred times the work.
            L_inverse = np.asarray(np.linalg.inv(np.linalg.cholesky(S)), dtype=np.float64)
        except np.linalg.LinAlgError:
            raise EstimationError("update: expected noise R that is positive definite, got a singular S") from None
        W, scaled = HP.T @ L_inverse.T, L_inverse @ y
        return Gain(H, Innovation(y, S, float(scaled @ scaled)), W, W @ scaled)

    def _checked(
        self, z: ArrayLike, sensor: SensorModel, ids: Sequence[int], R: Sequence[ArrayLike | None] | None
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Return readings (k, m), where their features stand (k, 2), and the covariance of each (k, m, m)."""
        checked(sensor, SensorModel, "update: sensor", EstimationError)
        places = self._places(checked(ids, Sequence[Any], "update: ids", EstimationError))
        readings, k, m = number_array(z, "readings", error=EstimationError), len(places), sensor.reading_dim
        if readings.shape != (k, m) or not np.isfinite(readings).all():
            raise EstimationError(f"readings: expected {k} times {m} finite numbers, got {readings.tolist()}")
        if len(set(ids)) < k:
            raise EstimationError("update: expected one reading of each feature, got two of one at once")
        stated = [None] * k if R is None else checked(R, Sequence[Any], "update: R", EstimationError)
        if len(stated) != k:
            raise EstimationError(f"update: expected {k} covariances, one for each reading, got {len(stated)}")
        noise = np.empty((k, m, m))
        if any(covariance is None for covariance in stated):
            noise[:] = sensor.noise(self.pose, self.x[places])
        for i, covariance in enumerate(stated):
            if covariance is not None:
                noise[i] = checked_covariance(covariance, m, "reading")
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
        starts = [self._place(i).start for i in checked(ids, Sequence[Any], "ids", EstimationError)]
        return np.array(starts, dtype=np.intp)[:, None] + np.arange(2)

    def __repr__(self) -> str:
        return f"SlamFilter(mode={self.mode!r}, pose={self.pose.tolist()}, features={len(self._starts)})"


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


def _turned(H: SparseJacobian, a: FloatArray) -> SparseJacobian:
    """Return H, evaluated at another estimate than P's, for the error at P's estimate: H (I + a e_θᵀ)."""
    pose = H.pose.copy()
    pose[..., 2] += H.pose @ a[:3] + (H.feature @ a[H.at][..., None])[..., 0]
    return H._replace(pose=pose)


def correct_covariance(P: FloatArray, W: FloatArray, a: FloatArray) -> None:
    """Set P to (I + a e_θᵀ) (P − W Wᵀ) (I + a e_θᵀ)ᵀ in place; O(n²), symmetric to the bit.

    With p the column of the heading and b = p + a P_θθ/2 the change by a is a bᵀ + b aᵀ: half the difference of the
    squares of s a + b/s and of s a − b/s; s makes the two equally long, so that little cancels out.
    """
    p = P[:, 2] - W @ W[2]
    b = p + 0.5 * p[2] * a
    long_a, long_b = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if long_a * long_b == 0.0:
        subtract_square(P, W, 0)
        return
    s = math.sqrt(long_b / long_a)
    one, other = math.sqrt(0.5) * s * a, math.sqrt(0.5) / s * b
    subtract_square(P, np.column_stack([W, one - other]), 0)
    P += np.multiply.outer(one + other, one + other)


def _checked_pose(pose: ArrayLike) -> FloatArray:
    q = configurations(pose, name="pose")
    if q.ndim != 1:
        raise EstimationError(f"pose: expected shape (3,), got {q.shape}")
    return q
