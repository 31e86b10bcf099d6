"""The map of a robot with a laser."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.known_map import FREE, KnownMap
from trailmark.exploration.scan_mapper import ScanMapper
from trailmark.exploration.simulated_robot import SimulatedRobot, laser_scanner
from trailmark.shapes import Disc, Rectangle
from trailmark.world import Robot, World

WALL = Rectangle((6.0, 2.0), 1.0, 4.0)
WORLD = World("room", (0.0, 0.0, 10.0, 8.0), (WALL, Disc((3.0, 6.0), 0.5), Disc((8.0, 2.0), 0.2)))
ROBOT = Robot.rectangle(0.6, 0.4)
START = np.array([1.0, 2.0, 0.0])
LASER = laser_scanner(6.0, 0.05)


def explored(noise: float) -> tuple[SimulatedRobot, ScanMapper]:
    robot = SimulatedRobot(WORLD, ROBOT, START, LASER, noise=noise)
    mapper = ScanMapper(START, KnownMap(WORLD.bounds, 0.05), LASER, ROBOT, ExplorationSettings())
    mapper.take(robot.sense())
    for _ in range(60):
        robot.drive(np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.02]]), 1.0)
        intake = mapper.take(robot.sense())
        assert (intake.readings, intake.refused, intake.lost) == (1, (), False)
    return robot, mapper


def test_exact_odometry_is_taken_as_exact() -> None:
    robot, mapper = explored(0.0)
    assert mapper.pose == pytest.approx(robot.pose, abs=1e-9)
    assert not mapper.covariance.any()
    assert mapper.known.free_area > 30.0


def test_noisy_odometry_is_set_right_by_scans() -> None:
    robot, mapper = explored(1.0)
    assert np.hypot(*(mapper.pose - robot.pose)[:2]) < 0.02
    assert len(mapper.trajectory) == 61
    inside = mapper.known.state[mapper.known.cells_of(np.array([[6.0, 2.0], [3.0, 6.0]]))]
    assert (inside != FREE).all()
