# ruff: noqa: N803, N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""What a filter expects of readings, how far they lie from it, and what they correct: prediction, innovation, gain.

The state of a SLAM filter: the robot's pose and features, whose number grows and shrinks.

The extended Kalman filter of a robot's pose and of the features that it sees.

The state is x = [pose, feature, feature, …]. A motion changes the pose alone, and a reading depends on the pose and on
one feature: a prediction costs O(n) and an update O(n²), where filterpy's own dense update costs O(n³). The method
is that of Thrun, Burgard & Fox 2005, Probabilistic Robotics, section 10.2, with the error of
:mod:`trailmark.estimation.slam_filter` and with updates that are iterated where h is not straight enough
(Bell & Cathey 1993, The iterated Kalman filter update as a Gauss-Newton method). What a linearised h still
misses may count as noise of the reading: the second-order term of Bar-Shalom, Li & Kirubarajan 2001, Estimation with
Applications to Tracking and Navigation, section 10.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import brief, number_array
from trailmark.checked import Count, NonNegative, checked, checked_arguments, shaped
from trailmark.estimation.covariance import checked_covariance, subtract_square
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.models import MotionModel, SensorModel
from trailmark.se2 import FloatArray, configurations, wrap


class Innovation(NamedTuple):
    """How far readings lie from what was expected of them."""

    y: FloatArray
    """z − ẑ, shape (m,); of several readings one after the other."""
    S: FloatArray
    """Its covariance, H P Hᵀ + V R Vᵀ, shape (m, m)."""
    nis: float
    """yᵀ S⁻¹ y: the normalised innovation squared, of chi-square distribution with m degrees of freedom."""

    @property
    def dof(self) -> int:
        """m, the degrees of freedom of the NIS."""
        return len(self.y)


class Prediction(NamedTuple):
    """What a sensor should read of k features."""

    ids: tuple[int, ...]
    """Which features, k of them."""
    z_hat: FloatArray
    """ẑ, shape (k, m)."""
    H_pose: FloatArray
    """∂ẑ/∂pose, shape (k, m, 3)."""
    H_feature: FloatArray
    """∂ẑ/∂feature, shape (k, m, d)."""
    R: FloatArray
    """V R Vᵀ, the sensor's noise, shape (k, m, m)."""
    S: FloatArray
    """H P Hᵀ + V R Vᵀ of each feature by itself, shape (k, m, m)."""

    def select(self, which: NDArray[np.intp]) -> Prediction:
        """Return the prediction of some of the features only, by their numbers in this one, shape (j,)."""
        rest = (array[which] for array in self[1:])
        return Prediction(tuple(self.ids[j] for j in which), *rest)


class SparseJacobian(NamedTuple):
    """H of k readings, each of which depends on the pose and on one feature: m rows and 3 + d columns each."""

    pose: FloatArray  # ∂ẑ/∂pose, shape (k, m, 3).
    feature: FloatArray  # ∂ẑ/∂feature, shape (k, m, d).
    at: NDArray[np.intp]  # Where the features' numbers stand in the state, shape (k, d).

    def times(self, A: FloatArray) -> FloatArray:
        """Return H A, shape (k·m, c), for A of shape (n, c); O(k c).

        P Hᵀ is the transpose of H P, since P is symmetric: rows of P are read, which lie together in memory.
        """
        k, m, _ = self.pose.shape
        product = (self.feature @ A[self.at]).reshape(k * m, A.shape[1])
        product += self.pose.reshape(k * m, 3) @ A[:3]
        return np.asarray(product)

    def times_vector(self, step: FloatArray) -> FloatArray:
        """Return H δ, shape (k·m,), for δ of shape (n,)."""
        ahead = self.pose @ step[:3] + (self.feature @ step[self.at][..., None])[..., 0]
        return np.asarray(ahead.reshape(-1))


class Gain(NamedTuple):
    """What k readings of m numbers correct in a state of n numbers."""

    H: SparseJacobian  # How the readings depend on the state.
    y: FloatArray  # z − ẑ, shape (k·m,).
    S: FloatArray  # H P Hᵀ + R = L Lᵀ, shape (k·m, k·m).
    W: FloatArray  # P Hᵀ L⁻ᵀ, shape (n, k·m): P becomes P − W Wᵀ, and K = W L⁻¹.
    L_inverse: FloatArray  # Shape (k·m, k·m).
    step: FloatArray  # K y, shape (n,).
    nis: float  # yᵀ S⁻¹ y.

    @property
    def innovation(self) -> Innovation:
        """How far the readings lie from what was expected of them."""
        return Innovation(self.y, self.S, self.nis)


def gain_of(
    P: FloatArray, H: SparseJacobian, y: FloatArray, noise: FloatArray, missed: Callable[[FloatArray], FloatArray]
) -> Gain:
    """Return the gain; O(k n) beside the (k·m)³ of S.

    Args:
        P: covariance of the state, shape (n, n).
        H: Jacobian of k readings.
        y: z − ẑ, shape (k·m,).
        noise: covariance of each reading, shape (k, m, m).
        missed: further noise of each for H P Hᵀ of each, both of shape (k, m, m): what a linearised h misses.

    Raises:
        EstimationError: S is singular.
    """
    k, m, _ = noise.shape
    HP = H.times(P)
    S = H.times(HP.T)
    each = np.arange(k)
    own = S.reshape(k, m, k, m)
    own[each, :, each, :] += noise + missed(own[each, :, each, :])
    S = 0.5 * (S + S.T)
    try:
        # scipy's triangular solvers start threads even for two rows, which costs a hundred times the work.
        L_inverse = np.asarray(np.linalg.inv(np.linalg.cholesky(S)), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise EstimationError("update: expected noise R that is positive definite, got a singular S") from None
    W, scaled = HP.T @ L_inverse.T, L_inverse @ y
    return Gain(H, y, S, W, L_inverse, W @ scaled, float(scaled @ scaled))


def correct_features(x: FloatArray, P: FloatArray, gain: Gain) -> FloatArray:
    """Return the state with only its features corrected, shape (n,), for a pose that is given.

    P is changed in place to what it is without the pose's gain: the errors of what is given still count (Schmidt's
    consider filter).
    """
    W, step, pose, features = gain.W, gain.step.copy(), slice(0, 3), slice(3, None)
    step[pose] = 0.0
    P[pose, features] -= W[pose] @ W[features].T
    P[features, pose] = P[pose, features].T
    subtract_square(P, W, 3)
    return np.asarray(x + step)


def moved(x: FloatArray, step: FloatArray, points: NDArray[np.intp]) -> FloatArray:
    """Return the state after a correction, exp(ξ) x, shape (n,).

    In the usual error, δ = (δ_p, δ_θ, δ_l, …), the exponential is p + V(δ_θ) δ_p for each point and addition for the
    rest, with V(θ) = [sin θ, cos θ − 1; 1 − cos θ, sin θ]/θ.

    Args:
        x: the state, shape (n,).
        step: the correction δ, shape (n,).
        points: where x and y of robot and points stand in the state, shape (k, 2).
    """
    after = x + step
    turn = float(step[2])
    if abs(turn) > 1e-12:
        s, c = math.sin(turn) / turn, (1.0 - math.cos(turn)) / turn
        after[points] = x[points] + step[points] @ np.array([[s, c], [-c, s]])
    after[2] = wrap(float(after[2]))
    return np.asarray(after)


def carried(before: FloatArray, after: FloatArray, points: NDArray[np.intp]) -> FloatArray:
    """Return a = J Δ, shape (n,): how the usual error at one estimate follows from that at another, e' = e + a e_θ."""
    a = np.zeros(len(before))
    delta = after[points] - before[points]
    a[points[:, 0]], a[points[:, 1]] = -delta[:, 1], delta[:, 0]
    return a


def turned(H: SparseJacobian, a: FloatArray) -> SparseJacobian:
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


Mode = Literal["slam", "mapping"]  # What an update may change: pose and features, or the features alone.


class SlamState(ExtendedKalmanFilter):  # type: ignore[misc]  # filterpy ships no type information
    """filterpy's EKF with x = [pose, feature, feature, …] and its covariance P, in which features have ids.

    Args:
        pose: x, y, theta to begin with; metres and radians.
        P: its covariance, shape (3, 3); None for a pose that is certain.

    Raises:
        EstimationError: a covariance that is not symmetric positive semidefinite.
    """

    x: FloatArray
    P: FloatArray
    mode: Mode = "slam"
    curvature: float = 0.0

    def __init__(self, pose: ArrayLike = (0.0, 0.0, 0.0), P: ArrayLike | None = None) -> None:
        super().__init__(dim_x=3, dim_z=2)
        self.x = checked_pose(pose)
        self.P = np.zeros((3, 3)) if P is None else checked_covariance(P, 3, "pose")
        self.x_prior = self.P_prior = self.x_post = self.P_post = None
        self._places: dict[int, slice] = {}
        self._points: NDArray[np.intp] | None = None
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
        l, G_pose, G_z = sensor.inverse(self.pose, reading)  # noqa: E741 # a feature
        noise = sensor.noise(self.pose, l) if R is None else checked_covariance(R, sensor.reading_dim, "reading")
        noise = noise + self.curvature * sensor.curvature(reading, noise)
        block = G_pose @ self.P[:3, :3] @ G_pose.T + G_z @ noise @ G_z.T
        return self._append(l, 0.5 * (block + block.T), G_pose @ self.P[:3])

    @checked_arguments(EstimationError)
    def add_known_feature(self, feature: Annotated[ArrayLike, shaped(2)], P: ArrayLike | None = None) -> int:
        """Add a feature of a known map, uncorrelated with the rest; return its id.

        Args:
            feature: shape (2,).
            P: its covariance, shape (2, 2); None for one that is certain.
        """
        l = np.asarray(feature)  # noqa: E741 # a feature
        block = np.zeros((len(l), len(l))) if P is None else checked_covariance(P, len(l), "feature")
        return self._append(l, block, np.zeros((len(l), len(self.x))))

    def remove_feature(self, feature_id: int) -> None:
        """Take a feature out of the state: exact, since the rest of a Gaussian stays what it was."""
        gone = self._place(feature_id)
        keep = np.r_[0 : gone.start, gone.stop : len(self.x)]
        self.x, self.P = self.x[keep], self.P[np.ix_(keep, keep)]
        del self._places[feature_id]
        d = gone.stop - gone.start
        for other, place in self._places.items():
            if place.start > gone.start:
                self._places[other] = slice(place.start - d, place.stop - d)
        self.dim_x, self._points = len(self.x), None

    @property
    def points(self) -> NDArray[np.intp]:
        """Where x and y of the robot and of each feature stand in the state, shape (k, 2)."""
        if self._points is None:
            starts = [0, *(place.start for place in self._places.values())]
            self._points = np.array(starts, dtype=np.intp)[:, None] + np.arange(2)
        return self._points

    def places(self, sensor: SensorModel, ids: Sequence[int]) -> NDArray[np.intp]:
        """Return where the features' numbers stand in the state, shape (k, d)."""
        places = [self._place(i) for i in checked(ids, Sequence[Any], "ids", EstimationError)]
        starts = np.array([place.start for place in places], dtype=np.intp)
        return starts[:, None] + np.arange(sensor.feature_dim)

    def checked_readings(
        self, z: ArrayLike, sensor: SensorModel, ids: Sequence[int], R: Sequence[ArrayLike | None] | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return readings of features, shape (k, m), and the covariance of each, shape (k, m, m).

        Args:
            z: the readings, shape (k, m).
            sensor: what read them.
            ids: of which features, no two the same.
            R: covariance of each reading, shape (m, m), or None for the sensor's V R Vᵀ; None for all of them.

        Raises:
            EstimationError: what of this is wrong.
        """
        checked(sensor, SensorModel, "update: sensor", EstimationError)
        places = self.places(sensor, checked(ids, Sequence[Any], "update: ids", EstimationError))
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
        return readings, noise

    def _append(self, feature: FloatArray, block: FloatArray, cross: FloatArray) -> int:
        n, d = len(self.x), len(feature)
        P = np.empty((n + d, n + d))
        P[:n, :n], P[n:, :n], P[:n, n:], P[n:, n:] = self.P, cross, cross.T, block
        self.x, self.P, self.dim_x = np.concatenate([self.x, feature]), P, n + d
        feature_id, self._next_id = self._next_id, self._next_id + 1
        self._places[feature_id] = slice(n, n + d)
        self._points = None
        return feature_id

    def _place(self, feature_id: int) -> slice:
        if not isinstance(feature_id, int | np.integer) or feature_id not in self._places:
            ids = f"the id of one of the {len(self._places)} features"
            raise EstimationError(f"feature: expected {ids}, got {brief(feature_id)}")
        return self._places[feature_id]


def checked_pose(pose: ArrayLike) -> FloatArray:
    """Return a copy of a pose, shape (3,), its heading in (−π, π], or say what is wrong with it."""
    q = configurations(pose, name="pose")
    if q.ndim != 1:
        raise EstimationError(f"pose: expected shape (3,), got {q.shape}")
    return q


STRAIGHT = 0.03  # Standard deviations of a reading: an update whose linearisation was off by less is not iterated.


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
