"""Faults of a robot that explores, by which its readings or its odometry are spoilt for a while."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from trailmark.estimation.records import Detection, Increment, Record, Scan
from trailmark.exploration.simulated_robot import DriveReport, ExploringRobot
from trailmark.se2 import FloatArray

Fault = Callable[[list[Record]], list[Record]]
"""Takes what a robot recorded since the last call, and returns what is told of it."""


class Faulty:
    """A robot whose records go through a fault from ``begin`` until ``end``, seconds of its clock."""

    def __init__(self, robot: ExploringRobot, fault: Fault, begin: float = 0.0, end: float = math.inf) -> None:
        self.robot, self.fault, self.begin, self.end, self.time = robot, fault, begin, end, 0.0

    def sense(self) -> Sequence[Record]:
        records = list(self.robot.sense())
        self.time = max([self.time, *(record.t for record in records)])
        return self.fault(records) if self.begin <= self.time < self.end else records

    def drive(self, states: FloatArray, seconds: float) -> DriveReport:
        return self.robot.drive(states, seconds)


def silence(records: list[Record]) -> list[Record]:
    """Leave out all readings."""
    return [record for record in records if not isinstance(record, Scan | Detection)]


def repeated(records: list[Record]) -> list[Record]:
    """Tell all readings twice."""
    return records + [record for record in records if isinstance(record, Scan | Detection)]


class Late:
    """Hold readings back until so many more calls have come: they bear their own, old times."""

    def __init__(self, calls: int) -> None:
        self.calls, self.held = calls, list[list[Record]]()

    def __call__(self, records: list[Record]) -> list[Record]:
        self.held.append([record for record in records if isinstance(record, Scan | Detection)])
        due = self.held.pop(0) if len(self.held) > self.calls else []
        return silence(records) + due


class Impossible:
    """Read one value everywhere, such as NaN, -1 or infinity; detections are rid of their bearing too."""

    def __init__(self, value: float) -> None:
        self.value = value

    def __call__(self, records: list[Record]) -> list[Record]:
        return [self._spoilt(record) for record in records]

    def _spoilt(self, record: Record) -> Record:
        if isinstance(record, Scan):
            return record._replace(ranges=np.full_like(record.ranges, self.value))
        return record._replace(z=np.full(2, self.value)) if isinstance(record, Detection) else record


def miscounted(records: list[Record]) -> list[Record]:
    """Leave out half of each scan's ranges, as if the beams were others, and a detection's bearing."""
    spoilt: list[Record] = []
    for record in records:
        if isinstance(record, Scan):
            record = record._replace(ranges=record.ranges[::2])
        elif isinstance(record, Detection):
            record = record._replace(z=record.z[:1])
        spoilt.append(record)
    return spoilt


def frozen_odometry(records: list[Record]) -> list[Record]:
    """Say that the robot did not move."""
    return [
        record._replace(dx=0.0, dy=0.0, dtheta=0.0) if isinstance(record, Increment) else record for record in records
    ]
