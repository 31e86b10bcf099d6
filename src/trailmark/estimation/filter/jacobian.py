"""The Jacobian of readings by the whole state, as sparse as it is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.se2 import FloatArray

__all__ = ["SparseJacobian"]


class SparseJacobian(NamedTuple):
    """H of k readings, each of which depends on the pose and on one feature: m rows and 3 + d columns each."""

    pose: FloatArray
    """∂ẑ/∂pose, shape (k, m, 3)."""
    feature: FloatArray
    """∂ẑ/∂feature, shape (k, m, d)."""
    at: NDArray[np.intp]
    """Where the features' numbers stand in the state, shape (k, d)."""

    def times(self, A: FloatArray) -> FloatArray:  # noqa: N803 # a matrix
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
