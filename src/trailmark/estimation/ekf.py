# ruff: noqa: N802, N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""The extended Kalman filter as it was published, run by filterpy: the first step of the source method's Algorithm 2.

Its state holds the places (x, y) of some features, which stand: F is the identity, and W Q Wᵀ, which a prediction adds
to P, is 0. The poses of the readings are known here, and of which feature each is. The first reading places a feature
(the sensor's inverse), every further one is filterpy's update with V R Vᵀ as its noise.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import Numbers, checked_arguments, shaped
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.models import RangeBearing
from trailmark.se2 import FloatArray

Readings = Annotated[ArrayLike, shaped(None, 2, minimum=1)]
ReadingsOfMany = Annotated[ArrayLike, shaped(None, None, 2)]

GROUP = 32  # Features in the state of one filter, at most: an update costs the cube of their number.


class RefinedPoints(NamedTuple):
    """Point features, each estimated by itself."""

    points: FloatArray  # places in the world, shape (b, 2), metres
    covariances: FloatArray  # shape (b, 2, 2), square metres


@checked_arguments(EstimationError)
def refine_points(readings: ReadingsOfMany, poses: Numbers, sensor: RangeBearing) -> RefinedPoints:
    """Return many static point features, each from its own readings, by the extended Kalman filter.

    Args:
        readings: range (metres) and bearing (radians), shape (b, m, 2), m >= 1, in the order they were taken.
        poses: where from, shape (b, m, 3), (m, 3) or (3,).
        sensor: its noise.

    Raises:
        EstimationError: other shapes, or values that are not finite.
    """
    z = np.asarray(readings)
    x = _poses_of(poses, z.shape[:2])
    groups = [slice(i, i + GROUP) for i in range(0, max(1, len(z)), GROUP)]
    refined = [_refined(z[group], x[group], sensor) for group in groups]
    return RefinedPoints(*(np.concatenate(column) for column in zip(*refined, strict=True)))


def _refined(z: FloatArray, x: FloatArray, sensor: RangeBearing) -> RefinedPoints:
    """Return b points from their readings, shape (b, m, 2), from poses (b, m, 3), by one filter."""
    from filterpy.kalman import ExtendedKalmanFilter

    b, first = len(z), sensor.inverse(x[:, 0], z[:, 0])
    ekf = ExtendedKalmanFilter(dim_x=2 * b, dim_z=2 * b)
    ekf.x, ekf.Q = first.feature.reshape(-1), np.zeros((2 * b, 2 * b))
    ekf.P = _diagonal(first.G_z @ sensor.noise(x[:, 0], first.feature) @ np.swapaxes(first.G_z, 1, 2))

    def h(x: FloatArray, pose: FloatArray) -> FloatArray:
        return sensor.h(pose, x.reshape(b, 2)).reshape(-1)

    def H(x: FloatArray, pose: FloatArray) -> FloatArray:
        return _diagonal(sensor.linearised(pose, x.reshape(b, 2)).H_feature)

    def residual(z: FloatArray, z_hat: FloatArray) -> FloatArray:
        return sensor.residual(z.reshape(b, 2), z_hat.reshape(b, 2)).reshape(-1)

    for pose, reading in zip(np.swapaxes(x, 0, 1)[1:], np.swapaxes(z, 0, 1)[1:], strict=True):
        ekf.predict()
        R = _diagonal(sensor.noise(pose, ekf.x.reshape(b, 2)))
        ekf.update(reading.reshape(-1), H, h, R, args=(pose,), hx_args=(pose,), residual=residual)
    P = ekf.P.reshape(b, 2, b, 2)[np.arange(b), :, np.arange(b)]
    return RefinedPoints(ekf.x.reshape(b, 2), 0.5 * (P + np.swapaxes(P, 1, 2)))


def _diagonal(blocks: FloatArray) -> FloatArray:
    """Return a matrix, shape (b m, b n), with these blocks (b, m, n) along its diagonal."""
    b, m, n = blocks.shape
    matrix, each = np.zeros((b, m, b, n)), np.arange(b)
    matrix[each, :, each] = blocks
    return matrix.reshape(b * m, b * n)


def _poses_of(poses: Numbers, shape: tuple[int, ...]) -> FloatArray:
    """Return poses, shape (*shape, 3): one for each reading."""
    try:
        return np.broadcast_to(np.asarray(poses), (*shape, 3))
    except ValueError:
        given = np.shape(poses)
        raise EstimationError(f"poses: expected one x, y, theta for each of {shape} readings, got {given}") from None
