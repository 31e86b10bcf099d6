"""Records of a sensor log, in the order of time: what moved the robot, what it saw, where it truly was.

All lengths are metres, angles radians counter-clockwise, times seconds of one clock. Covariances are those of the
sensor's noise, where the log states them; None leaves them to the model's settings.
"""

# Tested by tests/estimation/logs/test_jsonl.py.

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Detection", "Increment", "Log", "Odometry", "Pose", "Record", "Scan", "first_pose"]

FloatArray = NDArray[np.float64]


class Odometry(NamedTuple):
    """Velocities that hold from ``t`` until the next odometry record.

    Attributes:
        t: seconds.
        v: forward speed, m/s.
        omega: turning rate, rad/s.
    """

    t: float
    v: float
    omega: float


class Increment(NamedTuple):
    """A motion since the last increment, in the robot's frame before it.

    Attributes:
        t: seconds, at the end of the motion.
        dx: metres, forward.
        dy: metres, to the left.
        dtheta: radians.
        covariance: (3, 3) of (dx, dy, dtheta), or None.
    """

    t: float
    dx: float
    dy: float
    dtheta: float
    covariance: FloatArray | None = None

    @classmethod
    def between(cls, t: float, a: tuple[float, float, float], b: tuple[float, float, float]) -> Increment:
        """Return the motion that leads from pose a to pose b by the time t."""
        cos, sin, dx, dy = math.cos(a[2]), math.sin(a[2]), b[0] - a[0], b[1] - a[1]
        return cls(t, cos * dx + sin * dy, cos * dy - sin * dx, math.remainder(b[2] - a[2], 2.0 * math.pi))


class Detection(NamedTuple):
    """One feature seen from the robot.

    Attributes:
        t: seconds.
        z: (2,), range (metres) and bearing (radians), or x and y in the robot's frame (metres): see ``kind``.
        kind: ``range-bearing`` or ``cartesian``.
        identity: the feature's number if the sensor identifies it, else None.
        covariance: (2, 2) of z, or None.
    """

    t: float
    z: FloatArray
    kind: str = "range-bearing"
    identity: int | None = None
    covariance: FloatArray | None = None


class Scan(NamedTuple):
    """One sweep of a laser scanner.

    Attributes:
        t: seconds.
        ranges: (n,), metres; infinite or from ``range_max`` on where nothing was met, NaN where the reading was lost.
        angle_min: bearing of the first beam in the scanner's frame, radians.
        angle_increment: from one beam to the next, radians.
        range_max: metres; readings from there on say only that nothing was met before.
        mount: the scanner's configuration (x, y, theta) in the robot's frame.
        pose: the robot's configuration (x, y, theta) where the log states a corrected one, else None.
    """

    t: float
    ranges: FloatArray
    angle_min: float
    angle_increment: float
    range_max: float
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pose: tuple[float, float, float] | None = None


class Pose(NamedTuple):
    """Where the robot was, by the log: ground truth, or the estimate of whoever wrote the log.

    Attributes:
        t: seconds.
        x: metres.
        y: metres.
        theta: radians.
        truth: whether it is ground truth (for evaluation, never used for estimates).
    """

    t: float
    x: float
    y: float
    theta: float
    truth: bool = False


Record = Odometry | Increment | Detection | Scan | Pose


class Log(NamedTuple):
    """A whole log.

    Attributes:
        name: what reports call it.
        records: in the order of the file.
        landmarks: (m, 3) rows identity, x, y of surveyed features for evaluation; empty if the log has none.
        dropped: how many bad records were left out (with ``skip_bad``).
        notes: one sentence each on good records that the reader left out or changed, with their count.
        cell: side of the cells of the map by which a robot explored as it took the scans, metres; None if not stated.
    """

    name: str
    records: tuple[Record, ...]
    landmarks: FloatArray
    dropped: int = 0
    notes: tuple[str, ...] = ()
    cell: float | None = None


def first_pose(records: Sequence[Record]) -> tuple[float, float, float] | None:
    """Return the pose that records state before the first motion and the first scan, truth left out; None without."""
    for record in records:
        if isinstance(record, Odometry | Increment | Scan):
            break
        if isinstance(record, Pose) and not record.truth:
            return record.x, record.y, record.theta
    return None
