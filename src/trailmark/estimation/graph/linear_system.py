# the names are those of the literature: A, B, M
"""The sparse linear system that a batch estimate comes to, and what follows from it about its noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.se2 import FloatArray

__all__ = ["LinearSystem"]

PROBES = 8
"""Draws that the redundancy is estimated from; the relative error of a mean over k rows is about 1/√(PROBES k)."""


class LinearSystem:
    """Whitened residuals b − A x of an estimate's error x.

    Args:
        rows: of A's entries, from 1 on, shape (e,).
        columns: likewise; those beyond ``width`` are not A's.
        entries: shape (e,).
        width: how many columns A has.
    """

    def __init__(self, rows: FloatArray, columns: FloatArray, entries: FloatArray, width: int) -> None:
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        own = columns <= width
        places = rows[own].astype(np.intp) - 1, columns[own].astype(np.intp) - 1
        self.A = csc_array((entries[own], places), shape=(int(rows.max()), width))
        self._factor = splu(
            (self.A.T @ self.A).tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    def estimate(self, right: FloatArray) -> FloatArray:
        """Return (AᵀA)⁻¹ Aᵀ b for columns b, shape (rows, k)."""
        return np.asarray(self._factor.solve(np.asarray(self.A.T @ right)))

    def unexplained(self, right: FloatArray) -> FloatArray:
        """Return what is left of columns b once the estimate has followed them, b − A (AᵀA)⁻¹ Aᵀ b, shape (rows, k)."""
        return np.asarray(right - self.A @ self.estimate(right))

    def redundancy(self, rng: np.random.Generator) -> FloatArray:
        """Return the share of each row's noise that its residual still shows, shape (rows,): noisy, to be averaged.

        The mean square of what is left of unit noise is the redundancy number (Förstner 1979, Zeitschrift für
        Vermessungswesen 104), by the random signs of Hutchinson 1990 (Communications in Statistics 19(2)).
        """
        signs: FloatArray = rng.choice([-1.0, 1.0], (self.A.shape[0], PROBES))
        return np.asarray((self.unexplained(signs) ** 2).mean(axis=1))

    def covariance(self, columns: NDArray[np.intp]) -> FloatArray:
        """Return the covariance of these columns' errors together, shape (k, k)."""
        unit = np.zeros((self.A.shape[1], len(columns)))
        unit[columns, np.arange(len(columns))] = 1.0
        joint = np.asarray(self._factor.solve(unit))[columns]
        return np.asarray(0.5 * (joint + joint.T))
