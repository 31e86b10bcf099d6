"""What makes a map of what a robot senses, while it explores, and which records it can use."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from trailmark.estimation.covariance import is_covariance
from trailmark.estimation.ekf_slam import repeats
from trailmark.estimation.mapping import map_log
from trailmark.estimation.records import Detection, Increment, Log, Odometry, Pose, Record, Scan
from trailmark.exploration.known_map import KnownMap
from trailmark.exploration.result import ExplorationSettings
from trailmark.se2 import FloatArray, between
from trailmark.world import Robot, World

__all__ = ["CARRIED", "Belief", "Mapper", "RecordChecks"]


# Share of the sensor's range that a robot cannot drive from one record to the next: nothing would be seen again.
JUMP: Final = 0.5
# Covariance, in metres and radians, of the motion that a mapper writes down when a robot that was carried away is
# found again. As large a one may be a jump.
CARRIED: Final = np.diag([0.05**2, 0.05**2, 0.02**2])
STRANGE: Final = 3  # Readings in a row that do not fit the map, after which the robot is lost.
MOMENT: Final = 0.1  # Seconds for which a velocity holds at least, until the next one.
READS: Final = {Scan: "scans", Detection: "detections"}


class RecordChecks:
    """Goes through records in the order in which they come.

    Args:
        reading: the kind of reading that is expected.
        max_range: the sensor's, metres.
    """

    def __init__(self, reading: type[Scan] | type[Detection], max_range: float) -> None:
        self._reading, self._range = reading, max_range
        self._time, self._last, self._beams = -math.inf, -math.inf, 0
        self._instant = list[Detection]()
        self._increment: Increment | None = None

    def refusal(self, record: Record) -> str:
        """Return why a record cannot be used, in a sentence; empty if it can, which then counts as the last one."""
        problem = self._problem(record)
        if problem:
            return f"{type(record).__name__.lower()} at {record.t:.3f} s left out: {problem}"
        self._time = record.t
        if isinstance(record, Scan):
            self._last, self._beams = record.t, len(record.ranges)
        elif isinstance(record, Detection):
            self._instant = [*(other for other in self._instant if other.t == record.t), record]
        elif isinstance(record, Increment):
            self._increment = record
        return ""

    def _problem(self, record: Record) -> str:
        if not math.isfinite(record.t):
            return "expected its time, got none"
        if record.t < self._time:
            return f"expected records in the order of time, got it after one at {self._time:.3f} s"
        if isinstance(record, Pose) or (isinstance(record, Scan | Detection) and not isinstance(record, self._reading)):
            return f"expected odometry and {READS[self._reading]}, got another record"
        match record:
            case Scan():
                return self._problem_of_scan(record)
            case Detection():
                return self._problem_of_detection(record)
            case Increment():
                return self._problem_of_increment(record)
            case Odometry():
                return self._problem_of_motion(MOMENT * record.v, MOMENT * record.omega)
        return ""

    def _problem_of_scan(self, scan: Scan) -> str:
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        if scan.t <= self._last:
            return "expected a new one, got its time again"
        if ranges.ndim != 1 or (self._beams and len(ranges) != self._beams):
            return f"expected {self._beams or 'one or more'} ranges as before, got {ranges.size}"
        if not np.isfinite([scan.angle_min, scan.angle_increment, *scan.mount]).all() or not scan.range_max > 0.0:
            return "expected finite angles and a range_max above 0, got others"
        if (ranges < 0.0).any():
            return f"expected ranges of 0 or more, got {float(np.nanmin(ranges)):g}"
        if not (ranges > 0.0).any():
            return f"expected ranges, got {len(ranges)} beams without any"
        return ""

    def _problem_of_detection(self, detection: Detection) -> str:
        z = np.asarray(detection.z, dtype=np.float64)
        if z.shape != (2,) or not np.isfinite(z).all():
            return f"expected two finite numbers, got {z.tolist()}"
        far = float(z[0]) if detection.kind == "range-bearing" else math.hypot(*z.tolist())
        if not 0.0 <= far <= 2.0 * self._range:
            return f"expected a range from 0 to the sensor's {self._range:g} m, got {far:g} m"
        if detection.covariance is not None and not is_covariance(detection.covariance, 2):
            return "expected a covariance of shape (2, 2), symmetric and not negative, got another"
        if any(other.t == detection.t and repeats(other, detection) for other in self._instant):
            return "expected a new one, got it again"
        return ""

    def _problem_of_increment(self, increment: Increment) -> str:
        if increment.covariance is not None and not is_covariance(increment.covariance, 3):
            return "expected a covariance of shape (3, 3), symmetric and not negative, got another"
        last = self._increment
        if last is not None and increment[:4] == last[:4]:
            return "expected a new one, got it again"
        stated = increment.covariance
        may_jump = stated is not None and bool((np.diag(stated) >= np.diag(CARRIED)).all())
        return self._problem_of_motion(math.hypot(increment.dx, increment.dy), increment.dtheta, may_jump)

    def _problem_of_motion(self, length: float, turn: float, may_jump: bool = False) -> str:
        if not (math.isfinite(length) and math.isfinite(turn)):
            return "expected finite numbers, got others"
        if not may_jump and (abs(length) > JUMP * self._range or abs(turn) > math.pi):
            return (
                f"expected at most {JUMP * self._range:g} m and half a turn, got a jump of {abs(length):g} m, "
                f"{abs(turn):g} rad"
            )
        return ""


class Belief(NamedTuple):
    """What became of the records of one reading."""

    readings: int  # Scans or detections that were used.
    refused: tuple[str, ...]  # One sentence for each record that was not used: repeated, late, impossible.
    lost: bool  # Whether the innovations say that the robot is not where it should be (carried away).
    redrawn: bool  # Whether poses of the past were corrected, so that the map was drawn anew (a loop was closed).


class Mapper(ABC):
    """Takes records in, and says where the robot is and what is known of the world.

    Args:
        start: where the robot stands first, shape (3,).
        known: the cells to fill in, nothing known so far; what no reading has reached stays unknown.
        robot: of the world.
        settings: the confidence asked for.
        reading: the kind of reading that is expected.
        max_range: the sensor's, metres.

    Attributes:
        known: the cells.
        records: all that were used, in the order of time, as the log will hold them; first a ``Pose``, where it began.
    """

    def __init__(
        self,
        start: FloatArray,
        known: KnownMap,
        robot: Robot,
        settings: ExplorationSettings,
        reading: type[Scan] | type[Detection],
        max_range: float,
    ) -> None:
        self.known, self.records = known, list[Record]()
        self._start, self._robot, self._confidence = np.asarray(start, dtype=np.float64), robot, settings.confidence
        self._checks, self._strange = RecordChecks(reading, max_range), 0

    @property
    @abstractmethod
    def pose(self) -> FloatArray:
        """Where the robot is, shape (3,)."""

    @property
    @abstractmethod
    def covariance(self) -> FloatArray:
        """Of the pose, shape (3, 3), in the frame of the start."""

    @property
    @abstractmethod
    def trajectory(self) -> FloatArray:
        """Where it was, as is known now, shape (n, 4), rows t, x, y, theta."""

    @property
    @abstractmethod
    def covariances(self) -> FloatArray:
        """Of the trajectory's poses, shape (n, 3, 3), in the world's axes."""

    @property
    @abstractmethod
    def margin(self) -> float:
        """Metres to keep from what is occupied or unknown for the confidence asked for; 0 without one. Constant."""

    @abstractmethod
    def take(self, records: Sequence[Record]) -> Belief:
        """Take in what was sensed, and bring pose and map up to date."""

    @abstractmethod
    def relocate(self) -> bool:
        """Look for the robot in the map, after it was lost; return whether it was found."""

    def finished_log(self, log: Log) -> Log:
        """Return a log of all that was recorded, with what was found out since about where it was."""
        return log

    def finished_map(self, log: Log) -> World:
        """Return the world that ``trailmark map`` makes of the finished log: obstacles with covariances."""
        return map_log(log, robot=self._robot).world

    def _usable(self, records: Sequence[Record], refused: list[str]) -> Iterator[Record]:
        """Yield the records that can be used, poses left out; a sentence for each other one is added to ``refused``."""
        for record in records:
            if isinstance(record, Pose):
                continue
            if problem := self._checks.refusal(record):
                refused.append(problem)
                continue
            if not self.records:
                self.records.append(Pose(record.t, *self._start.tolist()))
            yield record

    def _belief(self, readings: int, refused: list[str], redrawn: bool = False) -> Belief:
        return Belief(readings, tuple(refused), self._strange >= STRANGE, redrawn)

    def _carry(self, t: float, pose: FloatArray, covariance: FloatArray) -> Increment:
        """Return the motion to where the robot was found again, which no odometry has told: the log leads there too."""
        dx, dy, turn = between(self.pose, pose).tolist()
        self._strange = 0
        return Increment(t, dx, dy, turn, covariance)
