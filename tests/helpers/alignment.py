"""Maps and trajectories compared: the rigid motion that lays one over the other, and what is left."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Alignment", "aligned", "rms"]

FloatArray = NDArray[np.float64]


class Alignment(NamedTuple):
    """A rigid motion, p to R p + t."""

    R: FloatArray
    t: FloatArray

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return points, shape (n, 2), moved."""
        return np.asarray(points @ self.R.T + self.t)


def aligned(points: FloatArray, to: FloatArray) -> Alignment:
    """Return the rigid motion that brings points nearest to their partners, both (n, 2) (Umeyama 1991, no scale)."""
    a, b = points.mean(axis=0), to.mean(axis=0)
    u, _, vt = np.linalg.svd((points - a).T @ (to - b))
    flip = np.diag([1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    rotation = vt.T @ flip @ u.T
    return Alignment(rotation, b - rotation @ a)


def rms(errors: FloatArray) -> float:
    """Return the root of the mean squared length of errors, shape (n, 2)."""
    return float(np.sqrt((errors**2).sum(axis=1).mean()))
