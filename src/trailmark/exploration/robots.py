"""What exploration asks of a robot: to sense, and to drive.

A real robot, a ROS node or the simulator stands behind it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from trailmark.estimation.logs.records import Record
from trailmark.se2 import FloatArray

__all__ = ["DriveReport", "ExploringRobot"]


class DriveReport(NamedTuple):
    """What became of a command to drive, as the robot itself knows it."""

    distance: float
    """Metres that it drove, by its odometry."""
    arrived: bool
    """Whether it drove to the path's end."""
    blocked: bool
    """Whether it cannot go on: a bumper, a motor that stalls."""


class ExploringRobot(Protocol):
    """A robot that explores: two methods."""

    def sense(self) -> Sequence[Record]:
        """Return what was recorded since the last call, in the order of time.

        That is odometry (``Increment``, with its covariance if it is known, or ``Odometry``) and the readings of one
        sensor (``Scan``, or ``Detection``). Without readings the sensor is silent.
        """

    def drive(self, states: FloatArray, seconds: float) -> DriveReport:
        """Drive along a path for a while, then stop or be told to go on.

        Args:
            states: shape (n, 3), in the robot's own frame as it is now: x ahead, y to the left, metres and radians. The
                first row is (0, 0, 0); one row means to stand still.
            seconds: how long to drive at most.
        """
