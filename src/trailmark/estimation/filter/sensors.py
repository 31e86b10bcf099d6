# ruff: noqa: E741, N802, N803, N806 # the names are the filter's own symbols: x, z, l, h, H, V, R
"""Sensor models: range and bearing, or x and y, of points.

Range and bearing, and the inverse that starts a feature from its first reading, are those of Thrun, Burgard & Fox
2005, Probabilistic Robotics, sections 6.6 and 10.2.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import NonNegative, Positive, checked_fields
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.covariance import draw_noise
from trailmark.se2 import FloatArray, wrap

__all__ = ["Cartesian", "Inverse", "Linearised", "RangeBearing", "SensorModel"]


NEAREST = 1e-9
"""Metres: a feature nearer than this has no bearing that could be differentiated; it counts as this far away."""


class Inverse(NamedTuple):
    """A feature as one reading shows it, and how it depends on pose and reading."""

    feature: FloatArray
    """l, shape (..., d)."""
    G_pose: FloatArray
    """∂l/∂x, shape (..., d, 3)."""
    G_z: FloatArray
    """∂l/∂z, shape (..., d, m)."""


class Linearised(NamedTuple):
    """The readings of features, and how they depend on pose and features."""

    z_hat: FloatArray
    """h(x, l, 0), shape (..., m)."""
    H_pose: FloatArray
    """∂h/∂x, shape (..., m, 3)."""
    H_feature: FloatArray
    """∂h/∂l, shape (..., m, d)."""


@runtime_checkable
class SensorModel(Protocol):
    """A sensor that reads m numbers of a feature of d numbers, with noise of as many as R has rows.

    Subclass it, with either :meth:`linearised` or H_pose and H_feature, to get the others.
    """

    feature_dim: ClassVar[int]
    """d."""
    reading_dim: ClassVar[int]
    """m."""

    @property
    def R(self) -> FloatArray:
        """Covariance of v, shape (q, q)."""
        ...

    def h(self, x: ArrayLike, l: ArrayLike, v: ArrayLike | None = None) -> FloatArray:
        """Return the reading, shape (..., m), of features (..., d) from poses (..., 3); v None stands for 0."""
        ...

    def H_pose(self, x: ArrayLike, l: ArrayLike) -> FloatArray:
        """Return ∂h/∂x at v = 0, shape (..., m, 3)."""
        return self.linearised(x, l).H_pose

    def H_feature(self, x: ArrayLike, l: ArrayLike) -> FloatArray:
        """Return ∂h/∂l at v = 0, shape (..., m, d)."""
        return self.linearised(x, l).H_feature

    def V(self, x: ArrayLike, l: ArrayLike) -> FloatArray:
        """Return ∂h/∂v at v = 0, shape (..., m, q)."""
        ...

    def inverse(self, x: ArrayLike, z: ArrayLike) -> Inverse:
        """Return the feature l for which h(x, l, 0) = z, and its Jacobians."""
        ...

    def residual(self, z: ArrayLike, z_hat: ArrayLike) -> FloatArray:
        """Return z − ẑ, shape (..., m), angles going the shorter way round."""
        ...

    def linearised(self, x: ArrayLike, l: ArrayLike) -> Linearised:
        """Return h, H_pose and H_feature together, as a filter needs them at each update."""
        return Linearised(self.h(x, l), self.H_pose(x, l), self.H_feature(x, l))

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

    feature_dim: ClassVar[int] = 2
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
