# ruff: noqa: N802 # the names are the filter's own symbols: x, u, w, f, F, W, Q
"""Motion models x' = f(x, u, w), w ~ N(0, Q), with their Jacobians.

x is the robot's pose (x, y, theta), u what its odometry says, and w the noise of that, which enters f as it likes.
All functions but Q broadcast over leading dimensions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import NonNegative, Positive, checked_fields
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.covariance import draw_noise
from trailmark.se2 import FloatArray, compose, wrap

__all__ = ["MotionModel", "PoseIncrement", "Step", "Unicycle"]


class Step(NamedTuple):
    """A motion, linearised."""

    pose: FloatArray
    """f(x, u, 0), shape (3,)."""
    F: FloatArray
    """∂f/∂x, shape (3, 3)."""
    W: FloatArray
    """∂f/∂w, shape (3, q)."""


@runtime_checkable
class MotionModel(Protocol):
    """A motion with p numbers of odometry and q of noise.

    Subclass it, with f, Q, and either :meth:`step` or F and W, to get the others.
    """

    def f(self, x: ArrayLike, u: ArrayLike, w: ArrayLike | None = None) -> FloatArray:
        """Return the next pose, shape (..., 3), from x (..., 3), u (..., p) and w (..., q); w None stands for 0."""
        ...

    def F(self, x: ArrayLike, u: ArrayLike) -> FloatArray:
        """Return ∂f/∂x at w = 0, shape (..., 3, 3)."""
        return np.asarray(np.vectorize(lambda *pair: self.step(*pair).F, signature="(n),(p)->(n,n)")(x, u))

    def W(self, x: ArrayLike, u: ArrayLike) -> FloatArray:
        """Return ∂f/∂w at w = 0, shape (..., 3, q)."""
        return np.asarray(np.vectorize(lambda *pair: self.step(*pair).W, signature="(n),(p)->(n,q)")(x, u))

    def Q(self, u: ArrayLike) -> FloatArray:
        """Return the covariance of w in the step u, shape (p,): shape (q, q)."""
        ...

    def step(self, x: FloatArray, u: FloatArray) -> Step:
        """Return one pose's step, x of shape (3,) and u of shape (p,): what the filter calls, once per record."""
        return Step(self.f(x, u), self.F(x, u), self.W(x, u))

    def sample(self, x: ArrayLike, u: ArrayLike, rng: np.random.Generator) -> FloatArray:
        """Return simulated next poses, shape (..., 3), of the step u (p,) from x (..., 3): f with w from N(0, Q)."""
        return self.f(x, u, draw_noise(self.Q(u), np.shape(x)[:-1], rng))


@dataclass(frozen=True)
class Unicycle(MotionModel):
    """Velocities held over a time step: the robot drives an exact arc, straight ahead where ω = 0.

    u = (v, ω, dt): forward velocity (m/s), angular velocity (rad/s), seconds. w = (w_v, w_ω) is added to v and ω.
    The velocity motion model of Thrun, Burgard & Fox 2005, Probabilistic Robotics, section 5.3, without its third
    noise (of the final heading). The variances are

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
        ahead = (
            pose[..., 0] + chord * np.cos(direction),
            pose[..., 1] + chord * np.sin(direction),
            wrap(direction + half),
        )
        return np.stack(np.broadcast_arrays(*ahead), axis=-1)

    def Q(self, u: ArrayLike) -> FloatArray:
        """Return diag(Var w_v, Var w_ω), shape (2, 2)."""
        v, omega, dt = (float(number) for number in np.asarray(u, dtype=np.float64))
        a = self.alpha
        variances = np.array(
            [
                self.sigma_v**2 + a[0] * v**2 + a[1] * omega**2,
                self.sigma_omega**2 + a[2] * v**2 + a[3] * omega**2,
            ]
        )
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
        return Step(
            np.array([px + dx, py + dy, wrap(theta + omega * dt)]),
            np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]]),
            np.array(
                [
                    [along * cos, shorter * cos - across * sin],
                    [along * sin, shorter * sin + across * cos],
                    [0.0, dt],
                ]
            ),
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
