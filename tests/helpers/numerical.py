"""Numerical Jacobians: the oracle for the analytic ones."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def jacobian(
    function: Callable[[FloatArray], FloatArray],
    at: FloatArray,
    step: float = 1e-4,
    difference: Callable[[FloatArray, FloatArray], FloatArray] = np.subtract,
) -> FloatArray:
    """Return ∂function/∂at, shape (m, n), by central differences of fourth order; error about step⁴ + 1e-16/step."""
    columns = []
    for i in range(len(at)):
        e = np.zeros(len(at))
        e[i] = step
        near = difference(function(at + e), function(at - e))
        far = difference(function(at + 2 * e), function(at - 2 * e))
        columns.append((8 * near - far) / (12 * step))
    return np.stack(columns, axis=1)


def turned(*angles: int) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Return a difference in which the entries of these indices are angles."""

    def difference(a: FloatArray, b: FloatArray) -> FloatArray:
        delta = np.array(a - b)
        for i in angles:
            delta[i] = np.angle(np.exp(1j * delta[i]))
        return delta

    return difference
