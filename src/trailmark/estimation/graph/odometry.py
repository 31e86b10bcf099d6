# ruff: noqa: N806 # the names are the filter's own symbols: F, P, W
"""A log's odometry between any two instants, as one motion with its covariance; its detections as arrays.

A batch needs poses only where something was read. What lies in between is put together into one motion, by the same
model as the filter's, and its covariance is kept as a sum of components: one matrix for each source of noise, to be
multiplied by that source's variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.filter.motion import PoseIncrement, Unicycle
from trailmark.estimation.filter.sensors import Cartesian, RangeBearing
from trailmark.estimation.logs.records import Detection, Increment, Odometry, Record
from trailmark.jit import njit
from trailmark.se2 import FloatArray

__all__ = ["Motions", "OdometryCalibration", "OdometryTrack", "Readings", "SensorCalibration", "polar_readings"]


@dataclass(frozen=True)
class OdometryCalibration:
    """Systematic errors of odometry; the defaults are those of odometry without any."""

    distance: float = 1.0
    """Metres driven for each metre that odometry states."""
    turn: float = 1.0
    """Radians turned for each radian that odometry states."""
    curvature: float = 0.0
    """Radians turned besides, for each metre driven: wheels of unequal size."""
    direction: float = 0.0
    """Radians from the direction that the sensor calls ahead to the one that the robot drives in."""
    delay: float = 0.0
    """Seconds by which the motion follows its record; for velocities only."""

    def array(self) -> FloatArray:
        """Return the five numbers, shape (5,)."""
        return np.array([self.distance, self.turn, self.curvature, self.direction, self.delay])


class Motions(NamedTuple):
    """The motions from each of n instants to the next."""

    u: FloatArray
    """Each in the frame that it begins in, shape (n − 1, 3)."""
    components: FloatArray
    """Covariance of u for a variance of one of each source of noise, shape (n − 1, k, 3, 3)."""

    def covariance(self, variances: FloatArray) -> FloatArray:
        """Return the covariances of u, shape (n − 1, 3, 3), for the variances of the sources, shape (k,)."""
        return np.asarray(np.einsum("k,nkij->nij", variances, self.components))


class OdometryTrack:
    """All odometry of a log.

    Velocities have four sources of noise, those of :class:`trailmark.estimation.Unicycle` with a period of one second:
    σ_v², α₁, σ_ω², α₄. Increments have five, those of :class:`trailmark.estimation.PoseIncrement`: σ of place, a, σ of
    heading, b, c; where all state their covariances, these are the two sources, place and heading. Sources of distances
    come before those of headings. The motion of a log with both is what velocities and increments add up to.

    Args:
        records: of the log, in the order of time.
    """

    def __init__(self, records: Sequence[Record]) -> None:
        self._velocities = np.array([r for r in records if isinstance(r, Odometry)], dtype=np.float64).reshape(-1, 3)
        increments = [record for record in records if isinstance(record, Increment)]
        repeated = [a[:4] == b[:4] for a, b in zip(increments[1:], increments, strict=False)]
        increments = [record for record, again in zip(increments, [False, *repeated], strict=False) if not again]
        self._increments = np.array([record[:4] for record in increments], dtype=np.float64).reshape(-1, 4)
        stated = [record.covariance for record in increments if record.covariance is not None]
        self._stated = np.array(stated) if increments and len(stated) == len(increments) else None

    @property
    def by_velocities(self) -> bool:
        """Whether there are velocities in it."""
        return len(self._velocities) > 0

    @property
    def states_noise(self) -> bool:
        """Whether all of it states its covariance."""
        return self._stated is not None and not self.by_velocities

    def stated_variances(self, velocity: Unicycle, increment: PoseIncrement) -> FloatArray:
        """Return the variances of the sources of noise by the log, or by the settings where it states none."""
        sources = []
        if self.by_velocities:
            a1, *_, a4 = velocity.alpha
            period = velocity.period or 1.0
            sources.append(
                ([velocity.sigma_v**2 * period, a1 * period], [velocity.sigma_omega**2 * period, a4 * period])
            )
        if self._stated is not None:
            sources.append(([1.0], [1.0]))
        elif len(self._increments) or not self.by_velocities:
            a, b, c = increment.growth
            place = 0.5 * (increment.sigma_x**2 + increment.sigma_y**2)
            sources.append(([place, a], [increment.sigma_theta**2, b, c]))
        return np.concatenate([part for kind in zip(*sources, strict=True) for part in kind])

    def motions(self, instants: FloatArray, calibration: OdometryCalibration, *, covariances: bool = True) -> Motions:
        """Return what lies between instants, shape (n,) in ascending order; without covariances in half of the time."""
        times, pieces, components = self._increment_pieces(calibration)
        if self.by_velocities:
            velocities = self._velocity_pieces(instants, calibration, covariances)
            times, pieces, components = _merged(velocities, (times, pieces, components))
        # A piece belongs to the instants between which it ends.
        bounds = np.searchsorted(times, instants, side="right").astype(np.int64)
        return Motions(*_put_together(pieces, components if covariances else components[:, :0], bounds))

    def _velocity_pieces(
        self, instants: FloatArray, calibration: OdometryCalibration, covariances: bool
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        t = self._velocities[:, 0] + calibration.delay
        cuts = np.unique(np.concatenate([t, instants, self._increments[:, 0]]))
        dt = np.diff(cuts)
        held = np.searchsorted(t, cuts[:-1], side="right") - 1
        v, omega = np.where(held >= 0, self._velocities[held, 1:].T, 0.0)
        moving = held >= 0
        v = calibration.distance * v
        omega = calibration.turn * omega + calibration.curvature * v
        turn, chord = omega * dt, v * dt
        half = 0.5 * turn
        sinc = np.sinc(half / np.pi)
        direction = half + calibration.direction
        cos, sin = np.cos(direction), np.sin(direction)
        pieces = np.column_stack([chord * sinc * cos, chord * sinc * sin, turn])
        if not covariances:
            return cuts[1:], pieces, np.zeros((len(dt), 0, 3, 3))
        small = np.abs(half) < 1e-4
        slope = np.where(small, -half / 3.0, (np.cos(half) - sinc) / np.where(small, 1.0, half))
        # ∂/∂v and ∂/∂ω, as in Unicycle.
        by_v = np.column_stack([dt * sinc * cos, dt * sinc * sin, np.zeros(len(dt))])
        along, across = 0.5 * chord * dt * slope, 0.5 * chord * dt * sinc
        by_omega = np.column_stack([along * cos - across * sin, along * sin + across * cos, dt])
        scale = np.where(moving, 1.0 / dt, 0.0)
        components = np.empty((len(dt), 4, 3, 3))
        for j, (column, rate) in enumerate(((by_v, v), (by_omega, omega))):
            np.multiply(column[:, :, None], (scale[:, None] * column)[:, None, :], out=components[:, 2 * j])
            np.multiply(components[:, 2 * j], (rate**2)[:, None, None], out=components[:, 2 * j + 1])
        return cuts[1:], pieces, components

    def _increment_pieces(self, calibration: OdometryCalibration) -> tuple[FloatArray, FloatArray, FloatArray]:
        t, dx, dy, turn = self._increments.T
        cos, sin = np.cos(calibration.direction), np.sin(calibration.direction)
        x, y = calibration.distance * (cos * dx - sin * dy), calibration.distance * (sin * dx + cos * dy)
        d = np.hypot(x, y)
        turn = calibration.turn * turn + calibration.curvature * d
        place, heading = np.diag([1.0, 1.0, 0.0]), np.diag([0.0, 0.0, 1.0])
        if self._stated is not None:
            components = np.stack([place @ self._stated @ place, heading @ self._stated @ heading], axis=1)
        else:
            each = np.ones(len(t))
            weights = np.array([each, d, each, d, np.abs(turn)]).T
            components = weights[:, :, None, None] * np.array([place, place, heading, heading, heading])
        return t, np.column_stack([x, y, turn]), components


def _merged(
    velocities: tuple[FloatArray, FloatArray, FloatArray], increments: tuple[FloatArray, FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, pieces and components of both kinds in one order: an increment after what ends at its time."""
    if len(increments[0]) == 0:
        return velocities
    times = np.concatenate([velocities[0], increments[0]])
    order = np.argsort(times, kind="stable")
    n, k = len(velocities[0]), [part[2].shape[1] for part in (velocities, increments)]
    along = [sources // 2 for sources in k]
    components = np.zeros((len(times), sum(k), 3, 3))
    components[:n, np.r_[: along[0], sum(along) : k[0] + along[1]]] = velocities[2]
    components[n:, np.r_[along[0] : sum(along), k[0] + along[1] : sum(k)]] = increments[2]
    return times[order], np.concatenate([velocities[1], increments[1]])[order], components[order]


@njit
def _put_together(
    pieces: FloatArray, components: FloatArray, bounds: np.ndarray[tuple[int], np.dtype[np.int64]]
) -> tuple[FloatArray, FloatArray]:
    """Return the motion and its covariance's components of each run of pieces, bounds[i] to bounds[i + 1]."""
    n, k = len(bounds) - 1, components.shape[1]
    u, P = np.zeros((n, 3)), np.zeros((n, k, 3, 3))
    turned = np.empty((3, 3))
    for i in range(n):
        for p in range(bounds[i], bounds[i + 1]):
            cos, sin = np.cos(u[i, 2]), np.sin(u[i, 2])
            dx, dy = cos * pieces[p, 0] - sin * pieces[p, 1], sin * pieces[p, 0] + cos * pieces[p, 1]
            for j in range(k):
                # P ← F P Fᵀ + R B Rᵀ; F adds −dy and dx times the heading's error to the place.
                C = P[i, j]
                for row in range(3):
                    C[row, 0] -= dy * C[row, 2]
                    C[row, 1] += dx * C[row, 2]
                for column in range(3):
                    C[0, column] -= dy * C[2, column]
                    C[1, column] += dx * C[2, column]
                B = components[p, j]
                for row in range(3):
                    turned[row, 0] = cos * B[row, 0] - sin * B[row, 1]
                    turned[row, 1] = sin * B[row, 0] + cos * B[row, 1]
                    turned[row, 2] = B[row, 2]
                for column in range(3):
                    C[0, column] += cos * turned[0, column] - sin * turned[1, column]
                    C[1, column] += sin * turned[0, column] + cos * turned[1, column]
                    C[2, column] += turned[2, column]
            u[i, 0] += dx
            u[i, 1] += dy
            u[i, 2] += pieces[p, 2]
    return u, P


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
        J = np.array([[x / r, y / r], [-y / r**2, x / r**2]]).transpose(2, 0, 1)  # a Jacobian
        own[flat] = J @ own[flat] @ J.transpose(0, 2, 1)
        z[flat] = np.column_stack([r, np.arctan2(y, x)])
    times = np.array([detection.t for detection in detections], dtype=np.float64)
    return Readings(np.searchsorted(instants, times), z, own, bool(n and stated.all()))
