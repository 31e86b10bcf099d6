# ruff: noqa: N803, N806 # the names are the filter's own symbols: x, P, H, S, W, L, K
"""The Kalman gain of readings, and what it corrects where pose or map are given."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.covariance import subtract_square
from trailmark.estimation.filter.innovation import Innovation
from trailmark.estimation.filter.jacobian import SparseJacobian
from trailmark.se2 import FloatArray, wrap

__all__ = ["Gain", "correct_part", "gain_of"]


class Gain(NamedTuple):
    """What k readings of m numbers correct in a state of n numbers."""

    H: SparseJacobian
    """How the readings depend on the state."""
    y: FloatArray
    """z − ẑ, shape (k·m,)."""
    S: FloatArray
    """H P Hᵀ + R = L Lᵀ, shape (k·m, k·m)."""
    W: FloatArray
    """P Hᵀ L⁻ᵀ, shape (n, k·m): P becomes P − W Wᵀ, and K = W L⁻¹."""
    L_inverse: FloatArray
    """Shape (k·m, k·m)."""
    step: FloatArray
    """K y, shape (n,)."""
    nis: float
    """yᵀ S⁻¹ y."""

    @property
    def innovation(self) -> Innovation:
        """How far the readings lie from what was expected of them."""
        return Innovation(self.y, self.S, self.nis)


def gain_of(P: FloatArray, H: SparseJacobian, y: FloatArray, noise: FloatArray) -> Gain:
    """Return the gain; O(k n) beside the (k·m)³ of S.

    Args:
        P: covariance of the state, shape (n, n).
        H: Jacobian of k readings.
        y: z − ẑ, shape (k·m,).
        noise: covariance of each reading, shape (k, m, m).

    Raises:
        EstimationError: S is singular.
    """
    k, m, _ = noise.shape
    HP = H.times(P)
    S = H.times(HP.T)
    each = np.arange(k)
    S.reshape(k, m, k, m)[each, :, each, :] += noise
    S = 0.5 * (S + S.T)
    try:
        # scipy's triangular solvers start threads even for two rows, which costs a hundred times the work.
        L_inverse = np.asarray(np.linalg.inv(np.linalg.cholesky(S)), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise EstimationError("update: S is singular, allowed: noise R that is positive definite") from None
    W, scaled = HP.T @ L_inverse.T, L_inverse @ y
    return Gain(H, y, S, W, L_inverse, W @ scaled, float(scaled @ scaled))


def correct_part(x: FloatArray, P: FloatArray, gain: Gain, mode: Literal["localisation", "mapping"]) -> FloatArray:
    """Return the state with only its pose ("localisation") or only its features ("mapping") corrected, shape (n,).

    P is changed in place to what it is without the other part's gain: the errors of what is given still count
    (Schmidt's consider filter).
    """
    W, step, pose, features = gain.W, gain.step.copy(), slice(0, 3), slice(3, None)
    if mode == "localisation":
        step[features] = 0.0
        P[pose] -= W[pose] @ W.T
        P[pose, pose] = 0.5 * (P[pose, pose] + P[pose, pose].T)
        P[features, pose] = P[pose, features].T
    else:
        step[pose] = 0.0
        P[pose, features] -= W[pose] @ W[features].T
        P[features, pose] = P[pose, features].T
        subtract_square(P, W, 3)
    after = x + step
    after[2] = wrap(float(after[2]))
    return np.asarray(after)
