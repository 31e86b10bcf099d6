"""What a filter expects of readings, and how far they lie from it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.se2 import FloatArray

__all__ = ["Innovation", "Prediction"]


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
