# ruff: noqa: N803, N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""Covariances: what is accepted as one, and whether they are those of the errors, by NEES and NIS.

If the stated covariances are those of the errors, the normalised estimation error squared (NEES) and the normalised
innovation squared (NIS) have chi-square distributions. Averages above their band mean a filter that is too sure of
itself, below it one that is not sure enough. Bar-Shalom, Li & Kirubarajan 2001, Estimation with Applications to
Tracking and Navigation, section 5.4.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import Probability, checked_arguments, number_array
from trailmark.estimation.errors import EstimationError
from trailmark.se2 import FloatArray


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


class Consistency(NamedTuple):
    """An average of chi-square values, and the band that it should lie in."""

    mean: float  # Average of the values; NaN if there are none.
    low: float  # Lower end of the band.
    high: float  # Upper end of the band.
    expected: float  # The average number of degrees of freedom, which the mean should be near.
    size: int  # How many values.

    @property
    def inside(self) -> bool:
        """Whether the mean lies in the band."""
        return self.low <= self.mean <= self.high


def chi_square_quantile(probability: ArrayLike, dof: ArrayLike) -> Any:
    """Return the value that chi-square of ``dof`` degrees of freedom stays under with that probability; any shape."""
    # scipy.stats, the usual source, takes a second to import.
    from scipy.special import chdtri  # here, since plans need none of it

    return chdtri(np.asarray(dof, dtype=np.float64), 1.0 - np.asarray(probability, dtype=np.float64))


def nees(error: ArrayLike, P: ArrayLike) -> FloatArray:
    """Return eᵀ P⁻¹ e, shape (...): how large errors are by the covariances that the filter states for them.

    Args:
        error: estimate − truth, angles going the shorter way round, shape (..., d).
        P: shape (..., d, d).
    """
    e, covariance = np.asarray(error, dtype=np.float64), np.asarray(P, dtype=np.float64)
    return np.asarray((e[..., None, :] @ np.linalg.solve(covariance, e[..., None]))[..., 0, 0])


@checked_arguments(EstimationError)
def average(values: ArrayLike, dof: ArrayLike, probability: Probability = 0.95) -> Consistency:
    """Return the average of independent chi-square values and the band that holds it with that probability.

    The values must be independent: the NEES at one time of many runs, or the NIS of one run's updates; not the NEES
    of one run's moments, which share their errors. ``dof`` is one number or of shape (n,), as the values are.
    """
    chi = np.asarray(values, dtype=np.float64).reshape(-1)
    n = len(chi)
    if n == 0:
        return Consistency(np.nan, 0.0, np.inf, np.nan, 0)
    # A sum of chi-square values is one of the sum of their degrees of freedom.
    total = float(np.broadcast_to(np.asarray(dof, dtype=np.float64), chi.shape).sum())
    low, high = chi_square_quantile([0.5 - 0.5 * probability, 0.5 + 0.5 * probability], total) / n
    return Consistency(float(chi.mean()), float(low), float(high), total / n, n)
