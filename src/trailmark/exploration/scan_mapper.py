"""The map of a robot that explores with a laser: poses by matching scans, cells by their beams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from trailmark.estimation.graph.graph_settings import GraphSettings
from trailmark.estimation.graph.scan_slam import ScanSlam
from trailmark.estimation.logs.records import Detection, Increment, Log, Odometry, Pose, Record, Scan
from trailmark.estimation.maps.log_map import map_log
from trailmark.estimation.scans.clouds import relative
from trailmark.estimation.scans.scan_poses import DeadReckoning
from trailmark.estimation.simulation.virtual_sensors import Scanner
from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.known_map import KnownMap
from trailmark.exploration.mapper import Intake
from trailmark.se2 import FloatArray, compose
from trailmark.world import Robot, World

__all__ = ["ScanMapper"]

TRUSTED: Final = 0.002, 0.001
"""Metres and radians: where the odometry states less than that as its error over ten metres, it is taken as exact, for
scans could not be matched as well."""


class ScanMapper:
    """A :class:`trailmark.exploration.mapper.Mapper` for a laser.

    Args:
        start: where the robot stands first, shape (3,).
        known: the cells to fill in, nothing known so far.
        sensor: the laser's range and noise.
        robot: of the world.
        settings: the confidence asked for.
    """

    def __init__(
        self, start: FloatArray, known: KnownMap, sensor: Scanner, robot: Robot, settings: ExplorationSettings
    ) -> None:
        self.known, self.records = known, list[Record]()
        known.noise = sensor.sigma
        self._start, self._sensor, self._robot, self._settings = np.asarray(start, float), sensor, robot, settings
        self._reckoning = DeadReckoning(self._start)
        self._slam: ScanSlam | None = None  # None as long as odometry is taken as exact
        self._scans = list[tuple[Scan, FloatArray]]()  # with their poses by odometry
        self._errors, self._driven = np.zeros(2), 0.0
        self._pose = self._at = self._start  # by odometry, of the last scan; and where it was found

    @property
    def pose(self) -> FloatArray:
        """Where the robot is, shape (3,)."""
        return compose(self._pose, relative(self._at, self._reckoning.pose))

    @property
    def covariance(self) -> FloatArray:
        """Of the pose, shape (3, 3), relative to the map around the robot."""
        return np.zeros((3, 3)) if self._slam is None else np.diag([1e-4, 1e-4, 1e-6])

    @property
    def trajectory(self) -> FloatArray:
        """Where the scans were taken, as is known now, shape (n, 4), rows t, x, y, theta."""
        poses = self._slam.poses if self._slam is not None else np.array([pose for _, pose in self._scans])
        return np.column_stack([[scan.t for scan, _ in self._scans], poses.reshape(-1, 3)])

    @property
    def covariances(self) -> FloatArray:
        """Of the trajectory's poses, shape (n, 3, 3), in the world's axes."""
        return np.broadcast_to(self.covariance, (len(self._scans), 3, 3))

    @property
    def margin(self) -> float:
        """Metres to keep from what is occupied or unknown for the confidence asked for; 0 without one."""
        return 0.0 if self._settings.confidence is None else 3.0 * self._sensor.sigma + 0.02

    def take(self, records: Sequence[Record]) -> Intake:
        """Take in what was sensed, and bring pose and map up to date."""
        readings, refused, moved = 0, list[str](), False
        for record in records:
            if not self.records:
                self.records.append(Pose(record.t, *self._start.tolist()))
            if isinstance(record, Increment | Odometry):
                self._move(record)
                self.records.append(record)
            elif isinstance(record, Scan):
                self._reckoning.add(record)
                moved |= self._add(record)
                readings += 1
            elif isinstance(record, Detection):
                refused.append(f"detection at {record.t:.3f} s: expected scans, got a detection")
        return Intake(readings, tuple(refused), False, moved)

    def relocate(self) -> bool:
        """Look for the robot in the map, after it was lost; return whether it was found."""
        return False

    def finished_map(self, log: Log) -> World:
        """Return the world that ``trailmark map`` makes of the log: obstacles with covariances."""
        return map_log(log, robot=self._robot).world

    def _move(self, record: Increment | Odometry) -> None:
        self._reckoning.add(record)
        if isinstance(record, Odometry) or record.covariance is None:
            self._errors[:] = np.inf
        else:
            covariance = np.asarray(record.covariance)
            self._errors += max(covariance[0, 0], covariance[1, 1]), covariance[2, 2]
            self._driven += float(np.hypot(record.dx, record.dy) + abs(record.dtheta))
        limit = np.square(TRUSTED) * max(self._driven, 1.0) / 10.0
        if self._slam is None and (self._errors > limit).any():
            reach = min(GraphSettings.max_range, self._sensor.max_range)
            self._slam = ScanSlam(replace(GraphSettings(), max_range=reach))
            for scan, pose in self._scans:
                self._slam.add(scan, pose)

    def _add(self, scan: Scan) -> bool:
        """Take in a scan, and return whether poses of the past were moved."""
        self._at, before = self._reckoning.pose, 0
        self._scans.append((scan, self._at))
        if self._slam is None:
            self._pose = self._at
            scan = scan._replace(pose=tuple(self._at.tolist()))
        else:
            before = self._slam.corrections
            self._slam.add(scan, self._at)
            self._pose = self._slam.pose
        self.records.append(scan)
        if self._slam is not None and self._slam.corrections > before:
            self._draw()
            return True
        self._enter(scan, self._pose)
        return False

    def _enter(self, scan: Scan, pose: FloatArray) -> None:
        self.known.add_scan(scan, pose, self._sensor.max_range)

    def _draw(self) -> None:
        """Draw the map anew."""
        self.known.clear()
        for (scan, _), (_, *pose) in zip(self._scans, self.trajectory, strict=True):
            self._enter(scan, np.array(pose))
