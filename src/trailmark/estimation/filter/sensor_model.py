# ruff: noqa: E741, N802, N803, N806 # the names are the filter's own symbols: x, z, l, h, H, V, R
"""What a sensor model is: z = h(x, l, v), v ~ N(0, R), with its Jacobians and its inverse.

x is the robot's pose (x, y, theta), l a feature of the world, z the reading of it and v the sensor's noise. All
functions broadcast over leading dimensions, so that one call predicts the readings of many features.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from trailmark.estimation.filter.covariance import draw_noise
from trailmark.se2 import FloatArray

__all__ = ["Inverse", "Linearised", "SensorModel"]


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
