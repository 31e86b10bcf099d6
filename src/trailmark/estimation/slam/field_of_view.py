"""Where a sensor reads features, learned from its own readings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.se2 import FloatArray

__all__ = ["FieldOfView"]


class FieldOfView:
    """The box of readings that holds the middle of all readings so far, number by number.

    A feature that should be read inside of it, and is not, may not be there: outside, at the rim of what the sensor
    sees, it says little. Features hidden by others are not distinguished from absent ones.

    Args:
        tail: share of the readings that each end of each number leaves out, 0..0.5.
        fewest: readings before which nothing is known.
    """

    def __init__(self, tail: float = 0.05, fewest: int = 50) -> None:
        self._tail, self._fewest = tail, fewest
        self._readings: list[FloatArray] = []
        self._bounds: FloatArray | None = None

    def learn(self, z: FloatArray) -> None:
        """Take in readings, shape (k, m)."""
        before = len(self._readings)
        self._readings.extend(z)
        # Anew with each tenth more, so that the cost does not grow with the length of the log.
        if len(self._readings) >= self._fewest and (
            self._bounds is None or int(10 * np.log2(before)) < int(10 * np.log2(len(self._readings)))
        ):
            self._bounds = np.quantile(np.array(self._readings), [self._tail, 1.0 - self._tail], axis=0)

    def holds(self, z_hat: FloatArray) -> NDArray[np.bool_]:
        """Return which expected readings, shape (k, m), lie inside, shape (k,)."""
        if self._bounds is None:
            return np.zeros(len(z_hat), dtype=bool)
        low, high = self._bounds
        return np.asarray(((z_hat >= low) & (z_hat <= high)).all(axis=1))
