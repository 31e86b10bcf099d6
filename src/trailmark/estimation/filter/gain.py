# ruff: noqa: N803, N806 # the names are the filter's own symbols: x, P, A, H, S, W, L, K
"""What a filter expects of readings, how far they lie from it, and what they correct: prediction, innovation, gain."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.covariance import subtract_square
from trailmark.se2 import FloatArray, wrap

__all__ = [
    "Gain",
    "Innovation",
    "Prediction",
    "SparseJacobian",
    "carried",
    "correct_covariance",
    "correct_features",
    "gain_of",
    "moved",
    "turned",
]


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

    pose: FloatArray
    """∂ẑ/∂pose, shape (k, m, 3)."""
    feature: FloatArray
    """∂ẑ/∂feature, shape (k, m, d)."""
    at: NDArray[np.intp]
    """Where the features' numbers stand in the state, shape (k, d)."""

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
