# ruff: noqa: N806 # the names are those of the literature: P, R, V
"""The noise of odometry and of a sensor, from what a batch estimate leaves of it.

Covariances are sums of components, each with a variance of its own: Helmert's variance components, by the iteration of
Förstner 1979 (Zeitschrift für Vermessungswesen 104). What is left of the noise is divided by the redundancy, since an
estimate follows its readings. Errors that last from one reading to the next are counted by their autocorrelation: n of
them are worth n/τ independent ones, τ = 1 + 2 Σ ρ(k), summed as long as it stays positive (Geyer 1992, Statistical
Science 7(4)).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from trailmark.se2 import FloatArray

__all__ = ["correlation_time", "updated_variances"]

SMALLEST = 1e-12
"""The least variance, so that a source that shows no noise can come back."""


def updated_variances(
    variances: FloatArray, components: FloatArray, roots: FloatArray, left: FloatArray, redundancy: FloatArray
) -> FloatArray:
    """Return better variances of the sources of noise, shape (k,).

    Args:
        variances: those that the estimate was made with, shape (k,).
        components: covariance of each of n residuals for a variance of one of each source, shape (n, k, d, d).
        roots: what whitened the residuals, shape (n, d, d).
        left: the whitened residuals, shape (n, d).
        redundancy: share of the noise that each still shows, shape (n, d).
    """
    V = np.einsum("nij,nkjl,nml->nkim", roots, components, roots)
    shown = np.einsum("ni,nkij,nj->k", left, V, left)
    expected = np.einsum("nkii,ni->k", V, redundancy)
    ratio = np.where(expected > 0.0, shown / np.where(expected > 0.0, expected, 1.0), 1.0)
    return np.asarray(np.maximum(variances * ratio, SMALLEST))


def correlation_time(sequences: Iterable[FloatArray], longest: int = 200) -> float:
    """Return τ >= 1: how many successive residuals are worth one that is independent of the others.

    Args:
        sequences: of residuals in the order of time, each of one feature or of one axis.
        longest: lag, in residuals.
    """
    products, counts, square, size = np.zeros(longest + 1), np.zeros(longest + 1), 0.0, 0
    for sequence in sequences:
        n = len(sequence)
        square, size = square + float(sequence @ sequence), size + n
        for lag in range(1, min(longest, n - 1) + 1):
            products[lag] += sequence[lag:] @ sequence[:-lag]
            counts[lag] += n - lag
    if size == 0 or square == 0.0:
        return 1.0
    tau = 1.0
    for lag in range(1, longest + 1):
        if counts[lag] < 0.1 * size:
            break
        rho = products[lag] / counts[lag] / (square / size)
        if rho <= 0.0:
            break
        tau += 2.0 * rho
    return tau
