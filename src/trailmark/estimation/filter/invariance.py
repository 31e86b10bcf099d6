# ruff: noqa: N803, N806 # the names are the filter's own symbols: x, P, V
"""The error of pose and map that a turn and a shift of the whole map leave alone.

No reading reveals where the map lies and how it is turned: shifting and turning pose and features together changes no
reading. An EKF whose error is estimate − truth forgets that. The direction in which the state moves when everything
turns, (J p, 1, J l₁, J l₂, …) with J a quarter turn, depends on the estimates; each update takes H at other ones, and
so seems to learn the heading from readings that cannot tell it. This is why EKF-SLAM grows too sure of its heading
(Bailey et al. 2006, Consistency of the EKF-SLAM algorithm; Huang, Mourikis & Roumeliotis 2010).

With the right-invariant error of SE₁₊ₙ(2), ξ = (e_p − J p e_θ, e_θ, e_l − J l e_θ, …), that direction is (0, 1, 0, …)
whatever the estimates (Barrau & Bonnabel 2015, An EKF-SLAM algorithm with consistency properties, arXiv 1510.06263).
The filter here keeps P for the usual error e, so that the steps stay as sparse as they are, and goes over to that of
the new estimate after each update: e = ξ + J p ξ_θ, so that a change of the estimate by Δ adds a e_θ, a = J Δ, to the
error. That is the whole difference, and costs O(n²), as the update itself. A prediction is the same for both errors.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.filter.covariance import subtract_square
from trailmark.estimation.filter.gain import SparseJacobian
from trailmark.se2 import FloatArray, wrap

__all__ = ["carried", "correct_covariance", "moved", "turned"]


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
