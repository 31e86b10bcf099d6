# ruff: noqa: N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""What a log's odometry adds up to: the poses of its scans, and the motion between any two instants.

A batch needs poses only where something was read. What lies in between is put together into one motion, by the same
model as the filter's, and its covariance is kept as a sum of components: one matrix for each source of noise, to be
multiplied by that source's variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.arguments import checked_arguments
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.models import PoseIncrement, Unicycle
from trailmark.estimation.records import Increment, Log, Odometry, Pose, Record, Scan, first_pose
from trailmark.jit import njit
from trailmark.se2 import FloatArray, compose, wrap

BoolArray = NDArray[np.bool_]

# Odometry is missing where it is silent for longer than this many times what nine of ten of its steps take, and
# than these seconds, in which no robot turns by more than a search around the last heading covers.
LONG, SILENT = 2.0, 0.2
# Increments between two scans, by the median, from which on a gap without any shows that some are missing: of fewer,
# none may lie between two scans by chance.
USUAL = 3
# Share of the records expected around a gap, and in half of its length before and after, from which on none are
# missing: they came late, and together.
LATE = 0.65
# Share of the speed around it that the step after a gap has at least where it holds what was driven in the gap.
WHOLE = 0.5
AROUND = 5  # Steps before and after a gap that tell how fast the robot was.


@checked_arguments(EstimationError)
def scan_poses(
    log: Log | Sequence[Scan],
    source: Literal["auto", "log", "odometry"] = "auto",
    start: tuple[float, float, float] | None = None,
) -> tuple[list[Scan], FloatArray]:
    """Return a log's scans, and where they were taken from, shape (m, 3).

    Args:
        log: with scans.
        source: ``log`` takes the poses that the scans carry, or else those between the log's ``Pose`` records around
            them, truth left out; ``odometry`` adds up increments and velocities; ``auto`` takes the scans' own if all
            carry one, else odometry.
        start: where odometry begins; None for the log's first pose, or the first scan's, or else the origin.
    """
    records = log.records if isinstance(log, Log) else log
    scans = [record for record in records if isinstance(record, Scan)]
    carried = [scan.pose for scan in scans if scan.pose is not None]
    if source != "odometry" and len(carried) == len(scans):
        return scans, np.array(carried, dtype=np.float64).reshape(-1, 3)
    if source == "log":
        return scans, _between(records, scans)
    first = start or first_pose(records) or (carried[0] if carried else (0.0, 0.0, 0.0))
    reckoning, poses = DeadReckoning(np.array(first)), list[FloatArray]()
    for record in records:
        reckoning.add(record)
        if isinstance(record, Scan):
            poses.append(reckoning.pose)
    return scans, np.array(poses).reshape(-1, 3)


def _between(records: Sequence[Record], scans: Sequence[Scan]) -> FloatArray:
    """Return the poses of scans between the stated poses around them, shape (m, 3)."""
    rows = np.array([record[:4] for record in records if isinstance(record, Pose) and not record.truth])
    if len(rows) == 0:
        lacking = sum(scan.pose is None for scan in scans)
        raise EstimationError(f"poses: expected them in the log, got {lacking} of {len(scans)} scans without one")
    t = [scan.t for scan in scans]
    x, y, theta = (np.interp(t, rows[:, 0], column) for column in (rows[:, 1], rows[:, 2], np.unwrap(rows[:, 3])))
    return np.column_stack([x, y, np.asarray(wrap(theta))])


def missing_odometry(log: Log) -> BoolArray:
    """Return before which scans the log lacks odometry, shape (m,): for a part of the time since the scan before."""
    scans = np.array([record.t for record in log.records if isinstance(record, Scan)])
    moves = [record for record in log.records if isinstance(record, Odometry | Increment)]
    lacking = np.zeros(len(scans), dtype=bool)
    if len(moves) < 2 or len(scans) < 2:
        return lacking
    if isinstance(moves[0], Increment):
        # Whatever the times, that may be coarse, say.
        number = np.cumsum([isinstance(record, Increment) for record in log.records])
        between_scans = np.diff(number[[isinstance(record, Scan) for record in log.records]])
        lacking[1:] = (between_scans == 0) & (float(np.median(between_scans)) >= USUAL)
        if log.whole:
            return lacking
    t = np.array([record.t for record in moves])
    gaps = np.diff(t)
    usual = float(np.quantile(gaps[gaps > 0.0], 0.9)) if (gaps > 0.0).any() else np.inf
    silent = gaps > max(SILENT, LONG * usual)
    way = np.array([abs(r.dx) + abs(r.dy) + abs(r.dtheta) if isinstance(r, Increment) else 0.0 for r in moves[1:]])
    for i in np.flatnonzero(silent):
        begin, end, gap = t[i], t[i + 1], gaps[i]
        around = np.searchsorted(t, [begin - 0.5 * gap, end + 0.5 * gap])
        late = around[1] - around[0] >= LATE * 2.0 * gap / gaps[~silent].mean()
        # An increment that was made of two poses holds all that was driven between them.
        near = np.r_[max(0, i - AROUND) : i, i + 1 : min(len(gaps), i + 1 + AROUND)]
        speed = way[near].sum() / max(float(gaps[near].sum()), 1e-9)
        whole = way[i] / gap >= WHOLE * speed > 0.0
        if not (late or whole):
            lacking[1:] |= (scans[1:] > begin) & (scans[:-1] < end)
    # A robot that moves where odometry begins did so before, unknown how. Velocities hold until others come, the last
    # ones too.
    if any(any(record[1:4]) for record in moves[: AROUND + 1]):
        lacking[1:] |= scans[:-1] < t[0] - max(SILENT, LONG * usual)
    if isinstance(moves[-1], Odometry) and (moves[-1].v or moves[-1].omega):
        lacking |= scans > t[-1] + max(SILENT, LONG * usual)
    return lacking


class DeadReckoning:
    """Adds up odometry, record by record.

    Attributes:
        pose: where it has led to, shape (3,).

    Args:
        start: where it begins, shape (3,).
    """

    def __init__(self, start: FloatArray) -> None:
        self.pose = np.asarray(start, dtype=np.float64)
        self._odometry: Odometry | None = None
        self._arc = Unicycle(0.0, 0.0)

    def add(self, record: Record) -> None:
        """Go on to a record's time, by the velocities that hold until then, or by the increment that it is."""
        held = self._odometry
        if isinstance(record, Odometry | Increment | Scan) and held is not None:
            self.pose = self._arc.f(self.pose, np.array([held.v, held.omega, record.t - held.t]))
            self._odometry = held._replace(t=record.t)
        if isinstance(record, Odometry):
            self._odometry = record
        elif isinstance(record, Increment):
            self.pose = compose(self.pose, np.array(record[1:4]))


class Motions(NamedTuple):
    """The motions from each of n instants to the next."""

    u: FloatArray  # each in the frame that it begins in, shape (n − 1, 3)
    components: FloatArray  # covariance of u for a variance of one of each source of noise, shape (n − 1, k, 3, 3)

    def covariance(self, variances: FloatArray) -> FloatArray:
        """Return the covariances of u, shape (n − 1, 3, 3), for the variances of the sources, shape (k,)."""
        return np.asarray(np.einsum("k,nkij->nij", variances, self.components))


# Systematic errors of odometry, here without any: metres driven for each metre that it states, radians turned for each
# radian; radians from the direction that the sensor calls ahead to the one that the robot drives in.
UNCALIBRATED = np.array([1.0, 1.0, 0.0])


class OdometryTrack:
    """All odometry of a log.

    Velocities have four sources of noise, those of :class:`trailmark.estimation.Unicycle` with a period of one second:
    σ_v², α₁, σ_ω², α₄. Increments have five, those of :class:`trailmark.estimation.PoseIncrement`: σ of place, a, σ of
    heading, b, c; where all state their covariances, these are the two sources, place and heading. Sources of distances
    come before those of headings. The motion of a log with both is what velocities and increments add up to.
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
            of_v, of_omega = np.array([velocity.sigma_v**2, a1]), np.array([velocity.sigma_omega**2, a4])
            sources.append((period * of_v, period * of_omega))
        if self._stated is not None:
            sources.append((np.ones(1), np.ones(1)))
        elif len(self._increments) or not self.by_velocities:
            a, b, c = increment.growth
            place = 0.5 * (increment.sigma_x**2 + increment.sigma_y**2)
            sources.append((np.array([place, a]), np.array([increment.sigma_theta**2, b, c])))
        return np.concatenate([part for kind in zip(*sources, strict=True) for part in kind])

    def motions(
        self, instants: FloatArray, calibration: FloatArray = UNCALIBRATED, *, covariances: bool = True
    ) -> Motions:
        """Return what lies between instants, shape (n,), ascending; without covariances in half of the time."""
        times, pieces, components = self._increment_pieces(calibration)
        if self.by_velocities:
            velocities = self._velocity_pieces(instants, calibration, covariances)
            times, pieces, components = _in_one_order(velocities, (times, pieces, components))
        # A piece belongs to the instants between which it ends.
        bounds = np.searchsorted(times, instants, side="right").astype(np.int64)
        return Motions(*_put_together(pieces, components if covariances else components[:, :0], bounds))

    def _velocity_pieces(
        self, instants: FloatArray, calibration: FloatArray, covariances: bool
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        distance, turning, ahead = calibration
        t = self._velocities[:, 0]
        cuts = np.unique(np.concatenate([t, instants, self._increments[:, 0]]))
        dt = np.diff(cuts)
        held = np.searchsorted(t, cuts[:-1], side="right") - 1
        v, omega = np.where(held >= 0, self._velocities[held, 1:].T, 0.0)
        moving = held >= 0
        v = distance * v
        omega = turning * omega
        turn, chord = omega * dt, v * dt
        half = 0.5 * turn
        sinc = np.sinc(half / np.pi)
        direction = half + ahead
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

    def _increment_pieces(self, calibration: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        distance, turning, ahead = calibration
        t, dx, dy, turn = self._increments.T
        cos, sin = np.cos(ahead), np.sin(ahead)
        x, y = distance * (cos * dx - sin * dy), distance * (sin * dx + cos * dy)
        d = np.hypot(x, y)
        turn = turning * turn
        place, heading = np.diag([1.0, 1.0, 0.0]), np.diag([0.0, 0.0, 1.0])
        if self._stated is not None:
            components = np.stack([place @ self._stated @ place, heading @ self._stated @ heading], axis=1)
        else:
            each = np.ones(len(t))
            weights = np.array([each, d, each, d, np.abs(turn)]).T
            components = weights[:, :, None, None] * np.array([place, place, heading, heading, heading])
        return t, np.column_stack([x, y, turn]), components


def _in_one_order(
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
