# ruff: noqa: N803, N806 # the names are the filter's own symbols: P, W
"""Covariance matrices: what is accepted as one, and how one shrinks without losing its symmetry."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import number_array
from trailmark.estimation.errors import EstimationError
from trailmark.se2 import FloatArray

__all__ = ["checked_covariance", "draw_noise", "is_covariance", "subtract_square"]


def checked_covariance(value: ArrayLike, size: int, name: str) -> FloatArray:
    """Return a copy of a covariance, shape (size, size), or say what is wrong with it."""
    P = number_array(value, f"{name}: covariance", error=EstimationError)
    if P.shape != (size, size) or not np.isfinite(P).all():
        raise EstimationError(f"{name}: expected a finite covariance of shape ({size}, {size}), got shape {P.shape}")
    if np.count_nonzero(P - np.diag(np.diagonal(P))) == 0 and (np.diagonal(P) >= 0.0).all():
        return P
    scale, symmetric = float(np.abs(P).max()), 0.5 * (P + P.T)
    wrong = np.abs(P - symmetric).max() > 1e-9 * scale
    try:
        # A little more on the diagonal: a singular covariance is one too, and rounding may take it below 0.
        np.linalg.cholesky(symmetric + (1e-9 * scale + 1e-300) * np.eye(size))
    except np.linalg.LinAlgError:
        wrong = True
    if wrong:
        raise EstimationError(f"{name}: expected a symmetric, positive semidefinite covariance, got {P.tolist()}")
    return symmetric


def is_covariance(value: ArrayLike, size: int) -> bool:
    """Return whether a value is a covariance of shape (size, size)."""
    try:
        checked_covariance(value, size, "")
    except EstimationError:
        return False
    return True


def draw_noise(covariance: FloatArray, shape: tuple[int, ...], rng: np.random.Generator) -> FloatArray:
    """Return draws from N(0, covariance), shape (*shape, q); the covariance may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    scaled = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(rng.standard_normal((*shape, len(values))) @ scaled.T)


def subtract_square(P: FloatArray, W: FloatArray, first: int) -> None:
    """Subtract W Wᵀ from P in place, in the rows and columns from ``first`` on.

    numpy forms A Aᵀ as one symmetric product, so that P stays symmetric to the bit. Where most rows of W are 0, as in
    mapping from certain poses, only the others are touched.
    """
    rows = np.flatnonzero(W[first:].any(axis=1)) + first
    if 2 * len(rows) < len(P):
        A = W[rows]
        P[np.ix_(rows, rows)] -= A @ A.T
    else:
        A = W[first:]
        P[first:, first:] -= A @ A.T
