"""A log's detections as arrays of ranges and bearings: what a batch estimates features and noise from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.filter.sensors import Cartesian, RangeBearing
from trailmark.estimation.logs.records import Detection
from trailmark.se2 import FloatArray

__all__ = ["Readings", "SensorCalibration", "polar_readings"]


@dataclass(frozen=True)
class SensorCalibration:
    """Systematic errors of ranges, by the bearing β: what is read is r·exp(a (β − β₁) + b (β² − β₂)), r the range.

    A camera that reads the depth of what it sees in place of its range has b = −1/2, since cos β is about 1 − β²/2. β₁
    and β₂ are the means over the log's readings: on average, ranges are right.
    """

    tilt: float = 0.0
    """a, by each radian."""
    projection: float = 0.0
    """b, by each square radian."""
    middle: tuple[float, float] = (0.0, 0.0)
    """β₁ and β₂."""

    def basis(self, bearings: FloatArray) -> FloatArray:
        """Return β − β₁ and β² − β₂ of bearings (n,), shape (n, 2)."""
        first, second = self.middle
        return np.column_stack([bearings - first, bearings**2 - second])

    def array(self) -> FloatArray:
        """Return a and b, shape (2,)."""
        return np.array([self.tilt, self.projection])

    def corrected(self, z: FloatArray) -> FloatArray:
        """Return ranges and bearings, shape (n, 2), without these errors."""
        return np.column_stack([z[:, 0] * np.exp(-self.basis(z[:, 1]) @ self.array()), z[:, 1]])


class Readings(NamedTuple):
    """Ranges and bearings of n detections."""

    instant: NDArray[np.intp]
    """The number of each one's instant, shape (n,)."""
    z: FloatArray
    """Metres and radians, shape (n, 2)."""
    covariance: FloatArray
    """Of z, shape (n, 2, 2)."""
    stated: bool
    """Whether the log states all covariances."""


def polar_readings(
    detections: Sequence[Detection], instants: FloatArray, range_bearing: RangeBearing, cartesian: Cartesian
) -> Readings:
    """Return detections of either kind as ranges and bearings.

    Args:
        detections: n of them.
        instants: when poses are estimated, shape (m,), ascending; the times of all detections are among them.
        range_bearing: the noise of those that state none.
        cartesian: likewise.
    """
    n = len(detections)
    z = np.array([detection.z for detection in detections], dtype=np.float64).reshape(n, 2)
    flat = np.array([detection.kind == "cartesian" for detection in detections], dtype=bool)
    own = np.zeros((n, 2, 2))
    own[:, 0, 0] = (range_bearing.sigma_range * (1.0 + range_bearing.growth * np.maximum(z[:, 0], 0.0))) ** 2
    own[:, 1, 1] = range_bearing.sigma_bearing**2
    own[flat] = np.diag([cartesian.sigma_x**2, cartesian.sigma_y**2])
    stated = np.zeros(n, dtype=bool)
    for i, detection in enumerate(detections):
        if detection.covariance is not None:
            own[i], stated[i] = detection.covariance, True
    if flat.any():
        x, y = z[flat].T
        r = np.maximum(np.hypot(x, y), 1e-6)
        J = np.array([[x / r, y / r], [-y / r**2, x / r**2]]).transpose(2, 0, 1)  # noqa: N806 # a Jacobian
        own[flat] = J @ own[flat] @ J.transpose(0, 2, 1)
        z[flat] = np.column_stack([r, np.arctan2(y, x)])
    times = np.array([detection.t for detection in detections], dtype=np.float64)
    return Readings(np.searchsorted(instants, times), z, own, bool(n and stated.all()))
