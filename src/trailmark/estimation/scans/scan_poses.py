"""The poses of a log's scans: those that it states, or those that its odometry adds up to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from trailmark.arguments import checked_arguments
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.motion import Unicycle
from trailmark.estimation.logs.records import Increment, Log, Odometry, Pose, Record, Scan, first_pose
from trailmark.se2 import FloatArray, compose, wrap

__all__ = ["DeadReckoning", "missing_odometry", "scan_poses"]

BoolArray = NDArray[np.bool_]

USUAL = 3
"""Records of odometry between two scans, by the median, from which on a gap without any shows that some are missing:
of fewer, none may lie between two scans by chance."""


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

    Raises:
        EstimationError: an unknown source, or ``log`` and no poses.
    """
    records = log.records if isinstance(log, Log) else log
    scans = [record for record in records if isinstance(record, Scan)]
    carried = [scan.pose for scan in scans if scan.pose is not None]
    if source != "odometry" and len(carried) == len(scans):
        return scans, np.array(carried, dtype=np.float64).reshape(-1, 3)
    if source == "log":
        return scans, _between(records, scans)
    first = start or first_pose(records) or (carried[0] if carried else (0.0, 0.0, 0.0))
    return scans, _dead_reckoning(records, np.array(first, dtype=np.float64))


def _between(records: Sequence[Record], scans: Sequence[Scan]) -> FloatArray:
    """Return the poses of scans between the stated poses around them, shape (m, 3)."""
    rows = np.array([record[:4] for record in records if isinstance(record, Pose) and not record.truth])
    if len(rows) == 0:
        lacking = sum(scan.pose is None for scan in scans)
        raise EstimationError(f"poses: expected them in the log, got {lacking} of {len(scans)} scans without one")
    t = [scan.t for scan in scans]
    x, y, theta = (np.interp(t, rows[:, 0], column) for column in (rows[:, 1], rows[:, 2], np.unwrap(rows[:, 3])))
    return np.column_stack([x, y, np.asarray(wrap(theta))])


def _dead_reckoning(records: Sequence[Record], x: FloatArray) -> FloatArray:
    """Return the poses of the scans, shape (m, 3), by odometry alone, from x on."""
    reckoning, poses = DeadReckoning(x), list[FloatArray]()
    for record in records:
        reckoning.add(record)
        if isinstance(record, Scan):
            poses.append(reckoning.pose)
    return np.array(poses).reshape(-1, 3)


def missing_odometry(log: Log) -> BoolArray:
    """Return before which scans the log lacks odometry, shape (m,): there is none since the scan before."""
    scan = np.array([isinstance(record, Scan) for record in log.records], dtype=bool)
    moved = np.array([isinstance(record, Odometry | Increment) for record in log.records], dtype=bool)
    counts = np.diff(np.cumsum(moved)[scan], prepend=0)
    # Velocities hold until others come.
    if len(counts) < 2 or any(isinstance(record, Odometry) for record in log.records):
        return np.zeros(len(counts), dtype=bool)
    lacking = (counts == 0) & (float(np.median(counts[1:])) >= USUAL)
    lacking[0] = False
    return np.asarray(lacking)


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
