# ruff: noqa: N803 # P is the filter's own symbol
"""Does a filter know how wrong it is? NEES and NIS, and the bands that they should lie in.

If the stated covariances are those of the errors, the normalised estimation error squared (NEES) and the normalised
innovation squared (NIS) have chi-square distributions. Averages above their band mean a filter that is too sure of
itself, below it one that is not sure enough. Bar-Shalom, Li & Kirubarajan 2001, Estimation with Applications to
Tracking and Navigation, section 5.4.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from trailmark.arguments import Probability, checked_arguments
from trailmark.estimation.errors import EstimationError
from trailmark.se2 import FloatArray

__all__ = ["Consistency", "average", "chi_square_quantile", "nees"]


class Consistency(NamedTuple):
    """An average of chi-square values, and the band that it should lie in."""

    mean: float
    """Average of the values; NaN if there are none."""
    low: float
    """Lower end of the band."""
    high: float
    """Upper end of the band."""
    expected: float
    """The average number of degrees of freedom, which the mean should be near."""
    size: int
    """How many values."""

    @property
    def inside(self) -> bool:
        """Whether the mean lies in the band."""
        return self.low <= self.mean <= self.high


def chi_square_quantile(probability: ArrayLike, dof: ArrayLike) -> Any:
    """Return the value that chi-square of ``dof`` degrees of freedom stays under with that probability; any shape."""
    # scipy.stats, the usual source, takes a second to import.
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
    of one run's moments, which share their errors.

    Args:
        values: NEES or NIS, shape (n,).
        dof: degrees of freedom, one number or shape (n,).
        probability: of the band, two-sided, in (0, 1).

    Raises:
        EstimationError: a probability out of range.
    """
    chi = np.asarray(values, dtype=np.float64).reshape(-1)
    n = len(chi)
    if n == 0:
        return Consistency(np.nan, 0.0, np.inf, np.nan, 0)
    # A sum of chi-square values is one of the sum of their degrees of freedom.
    total = float(np.broadcast_to(np.asarray(dof, dtype=np.float64), chi.shape).sum())
    low, high = chi_square_quantile([0.5 - 0.5 * probability, 0.5 + 0.5 * probability], total) / n
    return Consistency(float(chi.mean()), float(low), float(high), total / n, n)
