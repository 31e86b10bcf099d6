# ruff: noqa: E741, N802, N803, N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""Motion models x' = f(x, u, w), w ~ N(0, Q), and the sensor's z = h(x, l, v), v ~ N(0, R), with their Jacobians.

x is the robot's pose (x, y, theta), u what its odometry says, l = (x, y) a point; the noises w and v enter f and h as
they like. The models are those of Thrun, Burgard & Fox 2005, Probabilistic Robotics, sections 5.3, 6.6 and 10.2.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import NonNegative, Positive, checked_fields
from trailmark.estimation.covariance import checked_covariance, draw_noise
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.records import Detection
from trailmark.se2 import FloatArray, compose, wrap


class Step(NamedTuple):
    """A motion, linearised."""

    pose: FloatArray  # f(x, u, 0), shape (3,)
    F: FloatArray  # ∂f/∂x, shape (3, 3)
    W: FloatArray  # ∂f/∂w, shape (3, q)


class MotionModel(ABC):
    """A motion with three numbers of odometry and q of noise."""

    @abstractmethod
    def f(self, x: ArrayLike, u: ArrayLike, w: ArrayLike | None = None) -> FloatArray:
        """Return the next pose, shape (..., 3), from x (..., 3), u (..., 3) and w (..., q); w None stands for 0."""

    @abstractmethod
    def Q(self, u: ArrayLike) -> FloatArray:
        """Return the covariance of w in the step u, shape (3,): shape (q, q)."""

    @abstractmethod
    def step(self, x: FloatArray, u: FloatArray) -> Step:
        """Return one pose's step at w = 0, x and u of shape (3,): plain numbers, since the filter calls it so often."""

    def sample(self, x: ArrayLike, u: ArrayLike, rng: np.random.Generator) -> FloatArray:
        """Return simulated next poses, shape (..., 3), of the step u from x (..., 3): f with w from N(0, Q)."""
        return self.f(x, u, draw_noise(self.Q(u), np.shape(x)[:-1], rng))


@dataclass(frozen=True)
class Unicycle(MotionModel):
    """Velocities held over a time step: the robot drives an exact arc, straight ahead where ω = 0.

    u = (v, ω, dt): forward velocity (m/s), angular velocity (rad/s), seconds. w = (w_v, w_ω) is added to v and ω.
    The book's velocity motion model without its third noise (of the final heading). The variances are

        Var w_v = σ_v² + α₁·v² + α₂·ω²,   Var w_ω = σ_ω² + α₃·v² + α₄·ω².

    With ``period`` None they hold for each step, whatever its length, so that two half steps add less than a whole one.
    With a period they are the variances of a mean over that time, and a step of dt has them times period/dt: then the
    noise of an interval does not depend on how it is divided into steps.

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
        """Return one pose's step; see :class:`MotionModel`."""
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
        """Return one pose's step; see :class:`MotionModel`."""
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
    G_z: FloatArray  # ∂l/∂z, shape (..., 2, 2)


class Linearised(NamedTuple):
    """The readings of features, and how they depend on pose and features."""

    z_hat: FloatArray  # h(x, l, 0), shape (..., 2)
    H_pose: FloatArray  # ∂h/∂x, shape (..., 2, 3)
    H_feature: FloatArray  # ∂h/∂l, shape (..., 2, 2)


@dataclass(frozen=True)
class RangeBearing:
    """Range and bearing of a point: z = (r + (1 + c·r)·v_r, β + v_β), l = (x, y) in the world; all but R broadcast.

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

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)

    @cached_property
    def R(self) -> FloatArray:
        """Covariance of v, shape (2, 2)."""
        return np.diag([self.sigma_range**2, self.sigma_bearing**2])

    def h(self, x: ArrayLike, l: ArrayLike, v: ArrayLike | None = None) -> FloatArray:
        """Return the reading, shape (..., 2), of features (..., 2) from poses (..., 3); v None stands for 0."""
        dx, dy, theta = _offset(x, l)
        r, beta = np.hypot(dx, dy), np.arctan2(dy, dx) - theta
        if v is not None:
            v = np.asarray(v, dtype=np.float64)
            r, beta = r + (1.0 + self.growth * r) * v[..., 0], beta + v[..., 1]
        return np.stack(np.broadcast_arrays(r, wrap(beta)), axis=-1)

    def linearised(self, x: ArrayLike, l: ArrayLike) -> Linearised:
        """Return h and its Jacobians by pose and feature at v = 0."""
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
        """Return ∂h/∂v at v = 0, diag(1 + c·r, 1), shape (..., 2, 2)."""
        dx, dy, _ = _offset(x, l)
        V = np.zeros((*dx.shape, 2, 2))
        V[..., 0, 0], V[..., 1, 1] = 1.0 + self.growth * np.hypot(dx, dy), 1.0
        return V

    def noise(self, x: ArrayLike, l: ArrayLike) -> FloatArray:
        """Return the covariance of a reading about its true value, V R Vᵀ, shape (..., 2, 2)."""
        V = self.V(x, l)
        return np.asarray(V @ self.R @ np.swapaxes(V, -1, -2))

    def inverse(self, x: ArrayLike, z: ArrayLike) -> Inverse:
        """Return the feature l for which h(x, l, 0) = z, and its Jacobians."""
        poses, readings = np.asarray(x, dtype=np.float64), np.asarray(z, dtype=np.float64)
        r, direction = np.broadcast_arrays(readings[..., 0], poses[..., 2] + readings[..., 1])
        cos, sin = np.cos(direction), np.sin(direction)
        G_pose, G_z = np.zeros((*r.shape, 2, 3)), np.empty((*r.shape, 2, 2))
        G_z[..., 0, 0], G_z[..., 1, 0] = cos, sin
        G_z[..., 0, 1], G_z[..., 1, 1] = -r * sin, r * cos
        G_pose[..., 0, 0] = G_pose[..., 1, 1] = 1.0
        G_pose[..., 2] = G_z[..., 1]
        return Inverse(poses[..., :2] + r[..., None] * np.stack([cos, sin], axis=-1), G_pose, G_z)

    def curvature(self, z_hat: FloatArray, C: FloatArray) -> FloatArray:
        """Return the mean square of what a linearised h misses, shape (..., 2, 2): r β²/2 of r, and ρ β / r of β.

        Args:
            z_hat: readings, shape (..., 2).
            C: covariance of their errors (ρ, β) by that of pose and feature, H P Hᵀ, shape (..., 2, 2).
        """
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

    def sample(self, x: ArrayLike, l: ArrayLike, rng: np.random.Generator) -> FloatArray:
        """Return simulated readings, shape (..., 2): h with v drawn anew from N(0, R) for each."""
        shape = np.broadcast_shapes(np.shape(x)[:-1], np.shape(l)[:-1])
        return self.h(x, l, draw_noise(self.R, shape, rng))


def as_range_bearing(detection: Detection) -> Detection:
    """Return a detection by x and y in the robot's frame as one by range and bearing, with its covariance."""
    if detection.kind != "cartesian" or np.shape(detection.z) != (2,):
        return detection
    x, y = np.asarray(detection.z, dtype=np.float64).tolist()
    r = max(math.hypot(x, y), 1e-6)
    z, P = np.array([r, math.atan2(y, x)]), detection.covariance
    if P is not None:
        J = np.array([[x / r, y / r], [-y / r**2, x / r**2]])
        P = J @ checked_covariance(P, 2, "reading") @ J.T
    return detection._replace(z=z, kind="range-bearing", covariance=P)


def _offset(x: ArrayLike, l: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return l_x − x, l_y − y and theta, broadcast to one shape."""
    pose, point = np.asarray(x, dtype=np.float64), np.asarray(l, dtype=np.float64)
    dx, dy = point[..., 0] - pose[..., 0], point[..., 1] - pose[..., 1]
    return dx, dy, np.broadcast_to(pose[..., 2], dx.shape)
