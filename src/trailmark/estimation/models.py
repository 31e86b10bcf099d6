# ruff: noqa: E741, N802, N803, N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""Motion models x' = f(x, u, w), w ~ N(0, Q), and sensor models z = h(x, l, v), v ~ N(0, R), with their Jacobians.

x is the robot's pose (x, y, theta), u what its odometry says, l = (x, y) a point; the noises w and v enter f and h as
they like. The models are those of Thrun, Burgard & Fox 2005, Probabilistic Robotics, sections 5.3, 6.6 and 10.2.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import NonNegative, Positive, checked_fields
from trailmark.estimation.covariance import draw_noise
from trailmark.estimation.errors import EstimationError
from trailmark.se2 import FloatArray, compose, wrap


class Step(NamedTuple):
    """A motion, linearised."""

    pose: FloatArray  # f(x, u, 0), shape (3,)
    F: FloatArray  # ∂f/∂x, shape (3, 3)
    W: FloatArray  # ∂f/∂w, shape (3, q)


@runtime_checkable
class MotionModel(Protocol):
    """A motion with three numbers of odometry and q of noise; subclass it, with f, Q and step."""

    def f(self, x: ArrayLike, u: ArrayLike, w: ArrayLike | None = None) -> FloatArray:
        """Return the next pose, shape (..., 3), from x (..., 3), u (..., 3) and w (..., q); w None stands for 0."""
        ...

    def Q(self, u: ArrayLike) -> FloatArray:
        """Return the covariance of w in the step u, shape (3,): shape (q, q)."""
        ...

    def step(self, x: FloatArray, u: FloatArray) -> Step:
        """Return one pose's step at w = 0, x and u of shape (3,): what the filter calls, once per record."""
        ...

    def sample(self, x: ArrayLike, u: ArrayLike, rng: np.random.Generator) -> FloatArray:
        """Return simulated next poses, shape (..., 3), of the step u from x (..., 3): f with w from N(0, Q)."""
        return self.f(x, u, draw_noise(self.Q(u), np.shape(x)[:-1], rng))


@dataclass(frozen=True)
class Unicycle(MotionModel):
    """Velocities held over a time step: the robot drives an exact arc, straight ahead where ω = 0.

    u = (v, ω, dt): forward velocity (m/s), angular velocity (rad/s), seconds. w = (w_v, w_ω) is added to v and ω.
    The book's velocity motion model without its third noise (of the final heading). The variances are

        Var w_v = σ_v² + α₁·v² + α₂·ω²,   Var w_ω = σ_ω² + α₃·v² + α₄·ω².

    With ``period`` None they hold for each step whatever its length: what two half steps add up to is then less
    than what the whole one has. With a period they are the variances of a mean over that time, and a step of dt has
    them times period/dt: what an interval adds to the pose no longer depends on how a log or a reading cuts it up.

    Attributes:
        sigma_v: σ_v, m/s, >= 0.
        sigma_omega: σ_ω, rad/s, >= 0.
        alpha: α₁..α₄, each >= 0; α₂ in (m/rad)², α₃ in (rad/m)².
        period: seconds, above 0, or None.

    Raises:
        EstimationError: a value out of these ranges.
    """

    sigma_v: NonNegative
    sigma_omega: NonNegative
    alpha: tuple[NonNegative, NonNegative, NonNegative, NonNegative] = (0.0, 0.0, 0.0, 0.0)
    period: Positive | None = None

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)

    def f(self, x: ArrayLike, u: ArrayLike, w: ArrayLike | None = None) -> FloatArray:
        """Return the pose at the arc's end, shape (..., 3), heading in (−π, π]."""
        pose, step = np.asarray(x, dtype=np.float64), np.asarray(u, dtype=np.float64)
        v, omega, dt = step[..., 0], step[..., 1], step[..., 2]
        if w is not None:
            noise = np.asarray(w, dtype=np.float64)
            v, omega = v + noise[..., 0], omega + noise[..., 1]
        half = 0.5 * omega * dt
        chord, direction = v * dt * np.sinc(half / np.pi), pose[..., 2] + half
        x, y = pose[..., 0] + chord * np.cos(direction), pose[..., 1] + chord * np.sin(direction)
        return np.stack(np.broadcast_arrays(x, y, wrap(direction + half)), axis=-1)

    def Q(self, u: ArrayLike) -> FloatArray:
        """Return diag(Var w_v, Var w_ω), shape (2, 2)."""
        v, omega, dt = (float(number) for number in np.asarray(u, dtype=np.float64))
        a = self.alpha
        of_v, of_omega = a[0] * v**2 + a[1] * omega**2, a[2] * v**2 + a[3] * omega**2
        variances = np.array([self.sigma_v**2 + of_v, self.sigma_omega**2 + of_omega])
        if self.period is not None:
            # Over no time there is no motion, whatever its velocity.
            variances *= self.period / dt if dt > 0.0 else 0.0
        return np.diag(variances)

    def step(self, x: FloatArray, u: FloatArray) -> Step:
        """Return one pose's step in plain numbers, ten times as fast as by arrays, since odometry comes often."""
        px, py, theta = x.tolist()
        v, omega, dt = u.tolist()
        half, drive = 0.5 * omega * dt, v * dt
        sinc = math.sin(half) / half if half else 1.0
        # The derivative of sinc. The closed form loses all digits near 0; there the Taylor series is exact to rounding.
        series = -half / 3.0 * (1.0 - half**2 / 10.0 * (1.0 - half**2 / 28.0 * (1.0 - half**2 / 54.0)))
        slope = series if abs(half) < 0.1 else (math.cos(half) - sinc) / half
        cos, sin = math.cos(theta + half), math.sin(theta + half)
        # A turn changes the chord's length by sinc' and its direction by half of itself.
        along, across, shorter = dt * sinc, 0.5 * drive * sinc * dt, 0.5 * drive * dt * slope
        dx, dy = drive * sinc * cos, drive * sinc * sin
        dx_turned, dy_turned = shorter * cos - across * sin, shorter * sin + across * cos
        return Step(
            np.array([px + dx, py + dy, wrap(theta + omega * dt)]),
            np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]]),
            np.array([[along * cos, dx_turned], [along * sin, dy_turned], [0.0, dt]]),
        )


@dataclass(frozen=True)
class PoseIncrement(MotionModel):
    """A step in the robot's own frame, as g2o and GTSAM files give odometry: x' = x ⊕ (u + w).

    u = (dx, dy, dθ): metres ahead, metres to the left, radians. w = (w_x, w_y, w_θ) is added to it. With
    d = ‖(dx, dy)‖ its variances are

        Var w_x = σ_x² + a·d,   Var w_y = σ_y² + a·d,   Var w_θ = σ_θ² + b·d + c·|dθ|:

    σ is what each record adds, and a, b, c what each metre and each radian add, however many records it takes.

    Attributes:
        sigma_x: σ_x, metres, >= 0.
        sigma_y: σ_y, metres, >= 0.
        sigma_theta: σ_θ, radians, >= 0.
        growth: a (m²/m), b (rad²/m), c (rad²/rad), each >= 0.

    Raises:
        EstimationError: a value below 0 or not finite.
    """

    sigma_x: NonNegative
    sigma_y: NonNegative
    sigma_theta: NonNegative
    growth: tuple[NonNegative, NonNegative, NonNegative] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)

    def f(self, x: ArrayLike, u: ArrayLike, w: ArrayLike | None = None) -> FloatArray:
        """Return the pose after the step, shape (..., 3), heading in (−π, π]."""
        step = np.asarray(u, dtype=np.float64)
        return compose(x, step if w is None else step + np.asarray(w, dtype=np.float64))

    def Q(self, u: ArrayLike) -> FloatArray:
        """Return diag(Var w_x, Var w_y, Var w_θ), shape (3, 3)."""
        dx, dy, dtheta = (float(number) for number in np.asarray(u, dtype=np.float64))
        (a, b, c), d = self.growth, math.hypot(dx, dy)
        variances = self.sigma_x**2 + a * d, self.sigma_y**2 + a * d, self.sigma_theta**2 + b * d + c * abs(dtheta)
        return np.diag(variances)

    def step(self, x: FloatArray, u: FloatArray) -> Step:
        """Return one pose's step in plain numbers, ten times as fast as by arrays, since odometry comes often."""
        px, py, theta = x.tolist()
        forward, left, turn = u.tolist()
        cos, sin = math.cos(theta), math.sin(theta)
        dx, dy = cos * forward - sin * left, sin * forward + cos * left
        return Step(
            np.array([px + dx, py + dy, wrap(theta + turn)]),
            np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]]),
            np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]),
        )


# Metres: a feature nearer than this has no bearing that could be differentiated; it counts as this far away.
NEAREST = 1e-9


class Inverse(NamedTuple):
    """A feature as one reading shows it, and how it depends on pose and reading."""

    feature: FloatArray  # l, shape (..., 2)
    G_pose: FloatArray  # ∂l/∂x, shape (..., 2, 3)
    G_z: FloatArray  # ∂l/∂z, shape (..., 2, m)


class Linearised(NamedTuple):
    """The readings of features, and how they depend on pose and features."""

    z_hat: FloatArray  # h(x, l, 0), shape (..., m)
    H_pose: FloatArray  # ∂h/∂x, shape (..., m, 3)
    H_feature: FloatArray  # ∂h/∂l, shape (..., m, 2)


@runtime_checkable
class SensorModel(Protocol):
    """A sensor that reads m numbers of a point, with noise of as many as R has rows; all but R broadcast.

    Subclass it, with all that has no body here, to get the others.
    """

    reading_dim: ClassVar[int]  #: m

    @property
    def R(self) -> FloatArray:
        """Covariance of v, shape (q, q)."""
        ...

    def h(self, x: ArrayLike, l: ArrayLike, v: ArrayLike | None = None) -> FloatArray:
        """Return the reading, shape (..., m), of features (..., 2) from poses (..., 3); v None stands for 0."""
        ...

    def V(self, x: ArrayLike, l: ArrayLike) -> FloatArray:
        """Return ∂h/∂v at v = 0, shape (..., m, q)."""
        ...

    def linearised(self, x: ArrayLike, l: ArrayLike) -> Linearised:
        """Return h and its Jacobians by pose and feature at v = 0."""
        ...

    def inverse(self, x: ArrayLike, z: ArrayLike) -> Inverse:
        """Return the feature l for which h(x, l, 0) = z, and its Jacobians."""
        ...

    def residual(self, z: ArrayLike, z_hat: ArrayLike) -> FloatArray:
        """Return z − ẑ, shape (..., m), angles going the shorter way round."""
        ...

    def noise(self, x: ArrayLike, l: ArrayLike) -> FloatArray:
        """Return the covariance of a reading about its true value, V R Vᵀ, shape (..., m, m)."""
        V = self.V(x, l)
        return np.asarray(V @ self.R @ np.swapaxes(V, -1, -2))

    def curvature(self, z_hat: FloatArray, C: FloatArray) -> FloatArray:
        """Return the mean square of what a linearised h misses, shape (..., m, m): none, unless overridden.

        Args:
            z_hat: readings, shape (..., m).
            C: their covariance by that of pose and feature, H P Hᵀ, shape (..., m, m).
        """
        return np.zeros_like(C)

    def sample(self, x: ArrayLike, l: ArrayLike, rng: np.random.Generator) -> FloatArray:
        """Return simulated readings, shape (..., m): h with v drawn anew from N(0, R) for each."""
        shape = np.broadcast_shapes(np.shape(x)[:-1], np.shape(l)[:-1])
        return self.h(x, l, draw_noise(self.R, shape, rng))


class _TwoNumbers(SensorModel):
    """Readings of two numbers of a feature that has two, each with its own noise: the dataclass's first two fields."""

    reading_dim: ClassVar[int] = 2

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)

    @cached_property
    def R(self) -> FloatArray:
        """The two variances on the diagonal."""
        first, second = astuple(self)[:2]  # type: ignore[call-overload]  # all that derive from it are dataclasses
        return np.diag([first**2, second**2])

    def V(self, x: ArrayLike, l: ArrayLike) -> FloatArray:
        """Return the identity, shape (..., 2, 2)."""
        shape = np.broadcast_shapes(np.shape(x)[:-1], np.shape(l)[:-1])
        return np.broadcast_to(np.eye(2), (*shape, 2, 2))


@dataclass(frozen=True)
class RangeBearing(_TwoNumbers):
    """Range and bearing of a point: z = (r + (1 + c·r)·v_r, β + v_β), l = (x, y) in the world.

    r = ‖l − (x, y)‖, β = atan2(l_y − y, l_x − x) − θ in (−π, π].

    Attributes:
        sigma_range: standard deviation of v_r, metres.
        sigma_bearing: standard deviation of v_β, radians.
        growth: c, how much of sigma_range each metre of range adds to the range's noise, 1/m; 0 for a sensor
            whose error does not grow.

    Raises:
        EstimationError: a deviation that is not positive, or growth below 0.
    """

    sigma_range: Positive
    sigma_bearing: Positive
    growth: NonNegative = 0.0

    def h(self, x: ArrayLike, l: ArrayLike, v: ArrayLike | None = None) -> FloatArray:
        """Return (range, bearing), shape (..., 2)."""
        dx, dy, theta = _offset(x, l)
        r, beta = np.hypot(dx, dy), np.arctan2(dy, dx) - theta
        if v is not None:
            v = np.asarray(v, dtype=np.float64)
            r, beta = r + (1.0 + self.growth * r) * v[..., 0], beta + v[..., 1]
        return np.stack(np.broadcast_arrays(r, wrap(beta)), axis=-1)

    def linearised(self, x: ArrayLike, l: ArrayLike) -> Linearised:
        """Return (range, bearing) with ∂/∂(x, y, θ) (..., 2, 3) and ∂/∂l (..., 2, 2)."""
        dx, dy, theta = _offset(x, l)
        far = np.hypot(dx, dy)
        r = np.maximum(far, NEAREST)
        z = np.empty((*r.shape, 2))
        z[..., 0], z[..., 1] = far, wrap(np.arctan2(dy, dx) - theta)
        cos, sin = dx / r, dy / r
        H = np.empty((*r.shape, 2, 3))
        H[..., 0, 0], H[..., 0, 1], H[..., 0, 2] = -cos, -sin, 0.0
        H[..., 1, 0], H[..., 1, 1], H[..., 1, 2] = sin / r, -cos / r, -1.0
        # Only the difference of pose and feature counts.
        return Linearised(z, H, -H[..., :2])

    def V(self, x: ArrayLike, l: ArrayLike) -> FloatArray:
        """Return diag(1 + c·r, 1), shape (..., 2, 2)."""
        dx, dy, _ = _offset(x, l)
        V = np.zeros((*dx.shape, 2, 2))
        V[..., 0, 0], V[..., 1, 1] = 1.0 + self.growth * np.hypot(dx, dy), 1.0
        return V

    def inverse(self, x: ArrayLike, z: ArrayLike) -> Inverse:
        """Return the point that pose x reads as z, shape (..., 2), with ∂/∂x (..., 2, 3) and ∂/∂z (..., 2, 2)."""
        pose, reading = np.broadcast_arrays(np.asarray(x, dtype=np.float64)[..., :3], _padded(z))
        r, direction = reading[..., 0], pose[..., 2] + reading[..., 1]
        cos, sin = np.cos(direction), np.sin(direction)
        G_z = np.empty((*r.shape, 2, 2))
        G_z[..., 0, 0], G_z[..., 1, 0] = cos, sin
        G_z[..., 0, 1], G_z[..., 1, 1] = -r * sin, r * cos
        return _point_at(pose, r[..., None] * np.stack([cos, sin], axis=-1), G_z)

    def curvature(self, z_hat: FloatArray, C: FloatArray) -> FloatArray:
        """Return the mean squares of what r loses to errors (ρ, β) of covariance C, r β²/2, and β, ρ β / r."""
        r, added = np.maximum(z_hat[..., 0], NEAREST), np.zeros_like(C)
        # No more than all of the error across the line of sight, and a radian.
        added[..., 0, 0] = r**2 * C[..., 1, 1] * np.minimum(0.75 * C[..., 1, 1], 1.0)
        added[..., 1, 1] = np.minimum((C[..., 0, 0] * C[..., 1, 1] + 2.0 * C[..., 0, 1] ** 2) / r**2, 1.0)
        return added

    def residual(self, z: ArrayLike, z_hat: ArrayLike) -> FloatArray:
        """Return z − ẑ, shape (..., 2), the bearing in (−π, π]."""
        y = np.asarray(z, dtype=np.float64) - np.asarray(z_hat, dtype=np.float64)
        y[..., 1] = wrap(y[..., 1])
        return y


@dataclass(frozen=True)
class Cartesian(_TwoNumbers):
    """A point in the robot's frame: z = R(θ)ᵀ (l − (x, y)) + v, l = (x, y) in the world.

    Attributes:
        sigma_x: standard deviation ahead, metres.
        sigma_y: standard deviation to the left, metres.

    Raises:
        EstimationError: a deviation that is not positive.
    """

    sigma_x: Positive
    sigma_y: Positive

    def h(self, x: ArrayLike, l: ArrayLike, v: ArrayLike | None = None) -> FloatArray:
        """Return the point in the robot's frame, shape (..., 2), metres."""
        dx, dy, theta = _offset(x, l)
        cos, sin = np.cos(theta), np.sin(theta)
        z = np.stack([cos * dx + sin * dy, cos * dy - sin * dx], axis=-1)
        return z if v is None else z + np.asarray(v, dtype=np.float64)

    def linearised(self, x: ArrayLike, l: ArrayLike) -> Linearised:
        """Return the point with ∂/∂(x, y, θ) (..., 2, 3) and ∂/∂l = R(θ)ᵀ (..., 2, 2)."""
        z, (*_, theta) = self.h(x, l), _offset(x, l)
        H_feature = np.swapaxes(_rotation(theta), -1, -2)
        H_pose = np.empty((*z.shape[:-1], 2, 3))
        H_pose[..., :2] = -H_feature
        H_pose[..., 0, 2], H_pose[..., 1, 2] = z[..., 1], -z[..., 0]
        return Linearised(z, H_pose, H_feature)

    def inverse(self, x: ArrayLike, z: ArrayLike) -> Inverse:
        """Return the point in the world, shape (..., 2), with ∂/∂x (..., 2, 3) and ∂/∂z (..., 2, 2)."""
        pose, reading = np.broadcast_arrays(np.asarray(x, dtype=np.float64)[..., :3], _padded(z))
        G_z = _rotation(pose[..., 2])
        return _point_at(pose, (G_z @ reading[..., :2, None])[..., 0], G_z)

    def residual(self, z: ArrayLike, z_hat: ArrayLike) -> FloatArray:
        """Return z − ẑ, shape (..., 2)."""
        return np.asarray(z, dtype=np.float64) - np.asarray(z_hat, dtype=np.float64)


def _offset(x: ArrayLike, l: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return l_x − x, l_y − y and theta, broadcast to one shape."""
    pose, point = np.asarray(x, dtype=np.float64), np.asarray(l, dtype=np.float64)
    dx, dy = point[..., 0] - pose[..., 0], point[..., 1] - pose[..., 1]
    return dx, dy, np.broadcast_to(pose[..., 2], dx.shape)


def _point_at(pose: FloatArray, away: FloatArray, G_z: FloatArray) -> Inverse:
    """Return the point that lies ``away``, shape (..., 2), from the robot in the world's directions."""
    G_pose = np.zeros((*away.shape[:-1], 2, 3))
    G_pose[..., 0, 0] = G_pose[..., 1, 1] = 1.0
    G_pose[..., 0, 2], G_pose[..., 1, 2] = -away[..., 1], away[..., 0]
    return Inverse(pose[..., :2] + away, G_pose, G_z)


def _padded(z: ArrayLike) -> FloatArray:
    """Return readings, shape (..., 2), with a third column, so that they broadcast with poses."""
    reading = np.asarray(z, dtype=np.float64)
    return np.concatenate([reading, np.zeros((*reading.shape[:-1], 1))], axis=-1)


def _rotation(theta: FloatArray) -> FloatArray:
    """Return rotation matrices, shape (..., 2, 2), counter-clockwise by theta."""
    cos, sin = np.cos(theta), np.sin(theta)
    return np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
