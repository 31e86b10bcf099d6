"""What makes a map of what a robot senses, while it explores: poses, cells, and how sure they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from trailmark.estimation.logs.records import Log, Record
from trailmark.exploration.known_map import KnownMap
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["Draw", "Intake", "Mapper"]

Draw = Callable[[Callable[[], bool]], KnownMap]
"""Draws a map, in any thread; what it is given is asked between scans whether to end early, with part of a map."""


class Intake(NamedTuple):
    """What became of the records of one reading."""

    readings: int
    """Scans or detections that were used."""
    refused: tuple[str, ...]
    """One sentence for each record that was not used: repeated, late, impossible."""
    lost: bool
    """Whether the innovations say that the robot is not where it should be (carried away)."""
    moved: bool
    """Whether poses of the past were corrected, so that the map was drawn anew (a loop was closed)."""


class Mapper(Protocol):
    """Takes records in, and says where the robot is and what is known of the world."""

    known: KnownMap
    """Cells; what no reading has reached stays unknown."""
    records: list[Record]
    """All that were used, in the order of time, as the log will hold them; first a ``Pose``, where it began."""

    @property
    def pose(self) -> FloatArray:
        """Where the robot is, shape (3,)."""

    @property
    def covariance(self) -> FloatArray:
        """Of the pose, shape (3, 3), relative to the map around the robot."""

    @property
    def trajectory(self) -> FloatArray:
        """Where it was, as is known now, shape (n, 4), rows t, x, y, theta."""

    @property
    def covariances(self) -> FloatArray:
        """Of the trajectory's poses, shape (n, 3, 3), in the world's axes."""

    @property
    def drifts(self) -> FloatArray:
        """How each pose of the trajectory is related to the last one, shape (n, 2).

        Metres driven from one to the next, loops that were closed taken into account, and the standard deviation of the
        place, metres, that this comes to.
        """

    @property
    def margin(self) -> float:
        """Metres to keep from what is occupied or unknown for the confidence asked for; 0 without one. Constant."""

    def take(self, records: Sequence[Record]) -> Intake:
        """Take in what was sensed, and bring pose and map up to date."""

    def divided(self) -> Draw | None:
        """Return what draws a map of cells of half the side of all that was read up to now, which takes a while.

        None if noise or settings do not let cells be divided.
        """

    def go_on_with(self, known: KnownMap) -> None:
        """Replace the map by the one that :meth:`divided` drew, and enter what has been read since that was called."""

    def relocate(self) -> bool:
        """Look for the robot in the map, after it was lost; return whether it was found."""

    def finished_log(self, log: Log) -> Log:
        """Return a log of all that was recorded, with what was found out since about where it was."""

    def finished_map(self, log: Log) -> World:
        """Return the world that ``trailmark map`` makes of the finished log: obstacles with covariances."""
