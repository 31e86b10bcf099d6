"""Where a log's scans were taken from: the poses that they carry, or those that its odometry adds up to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np

from trailmark.errors import did_you_mean
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.logs.records import Increment, Log, Odometry, Pose, Scan
from trailmark.se2 import FloatArray, compose

__all__ = ["Poses", "records_of", "scan_poses"]

Poses = Literal["auto", "log", "odometry"]


def scan_poses(log: Log | Sequence[Scan], source: Poses = "auto") -> tuple[list[Scan], FloatArray]:
    """Return a log's scans, and where they were taken from, shape (m, 3).

    Args:
        log: with scans.
        source: ``log`` takes the poses that the scans carry; ``odometry`` adds up increments and velocities from
            the log's first pose on, or the first scan's, or else the origin; ``auto`` takes the scans' own if all
            carry one.

    Raises:
        EstimationError: an unknown source, or ``log`` and a scan without a pose.
    """
    if source not in get_args(Poses):
        raise EstimationError(f"poses {source!r} given, {did_you_mean(source, get_args(Poses))}")
    records = records_of(log)
    scans = [record for record in records if isinstance(record, Scan)]
    stated = [scan.pose for scan in scans if scan.pose is not None]
    if source == "log" and len(stated) < len(scans):
        raise EstimationError(f"poses: {len(scans) - len(stated)} of {len(scans)} scans carry none, allowed: odometry")
    if source != "odometry" and len(stated) == len(scans):
        return scans, np.array(stated, dtype=np.float64).reshape(-1, 3)
    return scans, _dead_reckoning(records, stated[0] if stated else (0.0, 0.0, 0.0))


def records_of(log: Log | Sequence[Scan]) -> Sequence[object]:
    """Return a log's records; scans are their own."""
    return log.records if isinstance(log, Log) else log


def _dead_reckoning(records: Sequence[object], start: tuple[float, float, float]) -> FloatArray:
    """Return the poses of the scans, shape (m, 3), by odometry alone."""
    from trailmark.estimation.filter.motion import Unicycle

    drive = Unicycle(0.0, 0.0)
    x, poses, odometry, begun = np.array(start), list[FloatArray](), None, False
    for record in records:
        if isinstance(record, Odometry | Scan) and odometry is not None:
            x = drive.f(x, np.array([odometry.v, odometry.omega, record.t - odometry.t]))
            odometry = odometry._replace(t=record.t)
        if isinstance(record, Odometry):
            odometry = record
        elif isinstance(record, Increment):
            x = compose(x, np.array(record[1:4]))
        elif isinstance(record, Pose) and not record.truth and not begun:
            x = np.array(record[1:4], dtype=np.float64)
        elif isinstance(record, Scan):
            poses.append(x)
        begun = begun or isinstance(record, Odometry | Increment | Scan)
    return np.array(poses).reshape(-1, 3)
