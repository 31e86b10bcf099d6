"""Records of a sensor log, in the order of time: what moved the robot, what it saw, where it truly was.

All lengths are metres, angles radians counter-clockwise, times seconds of one clock. Covariances are those of the
sensor's noise, where the log states them; None leaves them to the model's settings.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby, pairwise
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.errors import RecordError

FloatArray = NDArray[np.float64]


class Odometry(NamedTuple):
    """Velocities that hold from ``t`` until the next odometry record."""

    t: float  #: Seconds.
    v: float  #: Forward speed, m/s.
    omega: float  #: Turning rate, rad/s.


class Increment(NamedTuple):
    """A motion since the last increment, in the robot's frame before it."""

    t: float  #: Seconds, at the end of the motion.
    dx: float  #: Metres, forward.
    dy: float  #: Metres, to the left.
    dtheta: float  #: Radians.
    covariance: FloatArray | None = None  #: (3, 3) of (dx, dy, dtheta), or None.

    @classmethod
    def between(cls, t: float, a: tuple[float, float, float], b: tuple[float, float, float]) -> Increment:
        """Return the motion that leads from pose a to pose b by the time t."""
        cos, sin, dx, dy = math.cos(a[2]), math.sin(a[2]), b[0] - a[0], b[1] - a[1]
        return cls(t, cos * dx + sin * dy, cos * dy - sin * dx, math.remainder(b[2] - a[2], 2.0 * math.pi))


class Detection(NamedTuple):
    """One feature seen from the robot."""

    t: float  #: Seconds.
    z: FloatArray  #: (2,), range (metres) and bearing (radians), or x and y in the robot's frame (metres).
    kind: str = "range-bearing"  #: ``range-bearing`` or ``cartesian``.
    identity: int | None = None  #: The feature's number if the sensor identifies it, else None.
    covariance: FloatArray | None = None  #: (2, 2) of z, or None.


class Scan(NamedTuple):
    """One sweep of a laser scanner."""

    t: float  #: Seconds.
    #: (n,), metres; infinite or from ``range_max`` on where nothing was met, NaN where the reading was lost.
    ranges: FloatArray
    angle_min: float  #: Bearing of the first beam in the scanner's frame, radians.
    angle_increment: float  #: From one beam to the next, radians.
    range_max: float  #: Metres; readings from there on say only that nothing was met before.
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: The scanner's x, y, theta in the robot's frame.
    pose: tuple[float, float, float] | None = None  #: The robot's x, y, theta where the log states a corrected one.


class Pose(NamedTuple):
    """Where the robot was, by the log: ground truth, or the estimate of whoever wrote the log."""

    t: float  #: Seconds.
    x: float  #: Metres.
    y: float  #: Metres.
    theta: float  #: Radians.
    truth: bool = False  #: Whether it is ground truth (for evaluation, never used for estimates).


Record = Odometry | Increment | Detection | Scan | Pose


class Log(NamedTuple):
    """A whole log."""

    name: str  #: What reports call it.
    records: tuple[Record, ...]  #: In the order of the file.
    landmarks: FloatArray  #: (m, 3) rows identity, x, y of surveyed features for evaluation.
    dropped: int = 0  #: How many bad records were left out (with ``skip_bad``).
    notes: tuple[str, ...] = ()  #: One sentence each on good records that were left out or changed, with their count.
    #: Side of the cells of the map by which a robot explored as it took the scans, metres; None if not stated.
    cell: float | None = None
    whole: bool = False  #: Whether each increment holds all that was driven since the one before.


def first_pose(records: Sequence[Record]) -> tuple[float, float, float] | None:
    """Return the pose that records state before the first motion and the first scan, truth left out; None without."""
    for record in records:
        if isinstance(record, Odometry | Increment | Scan):
            break
        if isinstance(record, Pose) and not record.truth:
            return record.x, record.y, record.theta
    return None


def with_own_times(log: Log) -> Log:
    """Return the log with times that tell its records apart, where its clock is too coarse to do so.

    A clock is too coarse where different motions with readings between them have the same stamp: their readings would
    count as made at one place, and a velocity that holds for no time as no motion. Such records are
    spread evenly over the time until the next stamp, in their order in the log. Records that are merely written twice,
    and logs of which the order of the records is all that is used (increments and scans), stay as they are.
    """
    if not any(isinstance(record, Detection | Odometry) or _states_pose(record) for record in log.records[1:]):
        return log
    runs = [list(run) for _, run in groupby(log.records, key=lambda record: record.t)]
    several = [run for run in runs if sum(map(_moves, run)) > 1]
    if not any(map(_moves_between_readings, several)) and not is_often(sum(map(_motions_too_many, several)), len(runs)):
        return log
    groups = [_groups(run) for run in runs]
    stamps = [run[0].t for run in runs]
    if len(runs) == 1 and any(isinstance(record, Odometry) for record in log.records):
        raise RecordError(f"expected velocities with times of their own, got {stamps[0]:g} s for all")
    tick = median(b - a for a, b in pairwise(stamps)) if len(runs) > 1 else 1.0
    spans = [min(tick, b - a) for a, b in zip(stamps, [*stamps[1:], math.inf], strict=True)]
    steps = [span / len(parts) for span, parts in zip(spans, groups, strict=True)]
    # The first and the last tick may be there in part only.
    step = median(steps[1:-1]) if len(steps) > 2 else min(steps)
    records: list[Record] = []
    for k, (stamp, span, parts) in enumerate(zip(stamps, spans, groups, strict=True)):
        own = min(step, span / len(parts))
        # A log begins somewhere between two ticks, and then its first records are the last ones of their tick.
        first = stamp + span - own * len(parts) if k == 0 and len(parts) > 1 else stamp
        for i, part in enumerate(parts):
            records += [record._replace(t=first + i * own) for record in part]
    count = sum(len(parts) > 1 for parts in groups)
    note = f"{count:,} of {len(runs):,} stamps are of several instants: spread over {tick:.3g} s, the clock's tick"
    return log._replace(records=tuple(records), notes=(*log.notes, note))


def is_often(repeated: int, total: int) -> bool:
    """Return whether stamps repeat more often than where a recorder wrote something twice (one in 10,000)."""
    return repeated > max(2, total // 100)


def _states_pose(record: Record) -> bool:
    return isinstance(record, Pose) and not record.truth


def _moves(record: Record) -> bool:
    return isinstance(record, Odometry | Increment) or _states_pose(record)


def _parts(run: Sequence[Record]) -> list[list[Record]]:
    """Return the records of one stamp, a part for each motion and what was read after it."""
    parts: list[list[Record]] = [[]]
    for record in run:
        if _moves(record) and parts[-1]:
            parts.append([])
        parts[-1].append(record)
    return parts


def _motions_too_many(run: Sequence[Record]) -> int:
    """Return how many different motions of one kind records of one stamp hold, beyond one of each kind."""
    motions = {_content(record) for record in run if _moves(record)}
    return len(motions) - len({kind for kind, *_ in motions})


def _moves_between_readings(run: Sequence[Record]) -> bool:
    """Return whether records of one stamp hold two motions of one kind, and were read after the first one, too."""
    found: dict[type[Record], set[tuple[Any, ...]]] = {}
    for part in _parts(run):
        if _moves(part[0]):
            own = tuple(map(_content, part))
            if any(len(other) > 1 and other != own for other in found.get(type(part[0]), ())):
                return True
            found.setdefault(type(part[0]), set()).add(own)
    return False


def _content(record: Record) -> tuple[Any, ...]:
    """Return what a record says, its kind first, for comparison."""
    return type(record), *(field.tobytes() if isinstance(field, np.ndarray) else field for field in record)


def _groups(run: Sequence[Record]) -> list[list[Record]]:
    """Return the records of one stamp by the instants that they were written at, as far as that can be told."""
    if sum(map(_moves, run)) < 2 and not any(isinstance(record, Increment) for record in run):
        return [list(run)]
    groups: list[list[Record]] = []
    for part in _parts(run):
        seen: dict[object, tuple[object, ...]] = {}
        groups.append([])
        for record in part:
            source: object = None
            if isinstance(record, Detection) and record.identity is not None:
                source = (record.kind, record.identity)
            elif isinstance(record, Scan):
                source = record.mount
            content = _content(record)
            if source is not None and seen.get(source, content) != content:
                seen = {}
                groups.append([])
            seen[source] = content
            groups[-1].append(record)
    return groups
