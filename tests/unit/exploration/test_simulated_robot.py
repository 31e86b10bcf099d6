from __future__ import annotations

import json
import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from tests.helpers.trials import few, trials

from trailmark import ConfigurationError, Disc, Rectangle, Robot, World
from trailmark.estimation.records import Detection, Increment, Record, Scan
from trailmark.exploration.simulated_robot import SimulatedRobot, disc_detector, laser_scanner
from trailmark.se2 import FloatArray, compose, wrap

WALL = Rectangle((6.0, 2.0), 1.0, 4.0)
WORLD = World("room", (0.0, 0.0, 10.0, 8.0), (WALL, Disc((3.0, 6.0), 0.5), Disc((8.0, 2.0), 0.2)))
ROBOT = Robot.rectangle(0.6, 0.4)
START = (1.0, 2.0, 0.0)
SENSOR = laser_scanner(5.0, 0.1)
TURN = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 1.5], [2.0, 1.0, 2.0]])


def laser(noise: float = 1.0, seed: int = 0, slip: float = 0.01, world: World = WORLD) -> SimulatedRobot:
    return SimulatedRobot(world, ROBOT, START, SENSOR, noise=noise, seed=seed, slip=slip)


def dead_reckoning(records: list[Record], start: tuple[float, float, float] = START) -> FloatArray:
    """Compose the increments with complex numbers."""
    place, heading = complex(*start[:2]), start[2]
    for record in records:
        if isinstance(record, Increment):
            place += complex(record.dx, record.dy) * np.exp(1j * heading)
            heading += record.dtheta
    return np.array([place.real, place.imag, heading])


def ahead(metres: float) -> FloatArray:
    return np.array([[0.0, 0.0, 0.0], [metres, 0.0, 0.0]])


def test_without_noise_odometry_and_ranges_are_exact() -> None:
    robot = laser(noise=0.0)
    report = robot.drive(TURN, 60.0)
    records = list(robot.sense())
    assert report.arrived
    assert not report.blocked
    assert report.distance == pytest.approx(1.0 + math.sqrt(2.0))
    assert robot.pose == pytest.approx([3.0, 3.0, 2.0])
    assert dead_reckoning(records) == pytest.approx(robot.pose)
    assert robot.time == pytest.approx(1.0 + 1.5 + math.sqrt(2.0))
    scan = records[-1]
    assert isinstance(scan, Scan)
    assert scan.t == robot.time
    solids = shapely.union_all([shape.polygon(1e-6).shapely() for shape in WORLD.obstacles])
    walls = shapely.union_all([solids, shapely.box(*WORLD.bounds).exterior])
    for i in range(0, len(scan.ranges), 7):
        angle = robot.pose[2] + scan.angle_min + i * scan.angle_increment
        beam = shapely.LineString([robot.pose[:2], robot.pose[:2] + 5.0 * np.array([math.cos(angle), math.sin(angle)])])
        met = shapely.distance(shapely.Point(robot.pose[:2]), beam.intersection(walls))
        assert scan.ranges[i] == (np.inf if math.isnan(met) else pytest.approx(met, abs=1e-4))


def test_a_reading_at_the_start_and_one_for_each_moment() -> None:
    robot = laser()
    (first,) = robot.sense()
    assert isinstance(first, Scan)
    assert first.t == 0.0
    assert robot.sense() == []
    robot.drive(np.zeros((1, 3)), 0.5)
    increment, scan = robot.sense()
    assert isinstance(increment, Increment)
    assert increment[:4] == (0.5, 0.0, 0.0, 0.0)
    assert scan.t == 0.5
    assert np.array_equal(robot.truth, [[0.0, *START], [0.5, *START]])


@pytest.mark.slow
def test_records_state_the_noise_that_there_is() -> None:
    """Errors of drives, normalised by the covariance of their composed records, have the mean 3 of a chi-square."""
    rng, squares, robot = np.random.default_rng(1), [], laser(slip=0.0)
    for _ in range(few(150, of=2)):
        robot.carry(START)
        robot.drive(TURN, 60.0)
        records = [record for record in robot.sense() if isinstance(record, Increment)]
        pose, covariance = np.array(START), np.zeros((3, 3))
        for record in records:
            cos, sin = math.cos(pose[2]), math.sin(pose[2])
            turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
            dx, dy = turn[:2, :2] @ [record.dx, record.dy]
            carry = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
            assert np.linalg.eigvalsh(record.covariance).min() > 0.0
            covariance = carry @ covariance @ carry.T + turn @ record.covariance @ turn.T
            pose = compose(pose, [record.dx, record.dy, record.dtheta])
        error = robot.pose - pose
        error[2] = wrap(error[2])
        squares.append(error @ np.linalg.solve(covariance, error))
    means = [rng.choice(squares, len(squares)).mean() for _ in range(500)]
    assert np.quantile(means, 0.001) < 3.0 < np.quantile(means, 0.999)


def test_it_goes_on_where_it_was() -> None:
    """What is restored from JSON does to the last bit what the robot itself goes on to do."""
    robot = laser(seed=5)
    robot.drive(ahead(8.0), 9.0)
    robot.sense()
    robot.drive(TURN - [1.0, 0.0, 0.0] * (np.arange(4) > 0)[:, None], 0.3)
    again = laser(seed=6)
    again.restore(json.loads(json.dumps(robot.state())))
    for each in (robot, again):
        each.drive(ahead(0.5), 0.7)
    records, others = list(robot.sense()), list(again.sense())
    assert [record.t for record in records] == [record.t for record in others]
    assert np.array_equal(dead_reckoning(records), dead_reckoning(others))
    assert isinstance(records[-1], Scan)
    assert isinstance(others[-1], Scan)
    assert np.array_equal(records[-1].ranges, others[-1].ranges)
    assert np.array_equal(robot.truth, again.truth)
    assert (robot.collisions, robot.time) == (again.collisions, again.time)
    with pytest.raises(ConfigurationError, match="robot's place"):
        SimulatedRobot(World("full", WORLD.bounds, (Rectangle((5.0, 2.0), 3.0, 3.0),)), ROBOT, START, SENSOR).restore(
            robot.state()
        )


@pytest.mark.slow
def test_slip_loses_a_part_of_the_way_and_nothing_without_noise() -> None:
    robot, driven = laser(slip=0.5), []
    for _ in range(40):
        robot.carry(START)
        robot.drive(ahead(4.0), 60.0)
        driven.append(robot.pose[0] - 1.0)
    assert np.mean(driven) == pytest.approx(4.0 * (1.0 - 0.5 * 0.5), abs=0.1)
    robot = laser(noise=0.0, slip=0.5)
    robot.drive(ahead(4.0), 60.0)
    assert robot.pose[0] == pytest.approx(5.0)


def test_it_stops_before_what_it_meets_and_counts_that_once() -> None:
    robot = laser(noise=0.0)
    report = robot.drive(ahead(6.0), 8.0)
    front = WALL.polygon().shapely().bounds[0] - 0.3
    assert report[0] == pytest.approx(front - 1.0, abs=2e-3)
    assert report[1:] == (False, True)
    assert front - 2e-3 < robot.pose[0] <= front
    assert robot.time == 8.0
    assert robot.collisions == 1
    for _ in range(3):  # it goes on pushing, and slides along
        robot.drive(np.array([[0.0, 0.0, 0.0], [0.5, 0.1, 0.0]]), 1.0)
    assert robot.collisions == 1
    assert robot.drive(np.array([[0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]), 2.0).arrived
    assert robot.drive(ahead(3.0), 3.0).blocked
    assert robot.collisions == 2
    assert dead_reckoning(list(robot.sense())) == pytest.approx(robot.pose)


@pytest.mark.slow
@pytest.mark.parametrize("seed", trials(8))
def test_the_footprint_never_overlaps_anything(seed: int) -> None:
    """Drive at random, with noise, among and against obstacles; shapely looks at every pose on the way."""
    robot, rng = laser(seed=seed), np.random.default_rng(seed)
    for _ in range(40):
        target = [rng.uniform(-1.0, 3.0), rng.uniform(-1.0, 1.0), rng.uniform(-3.0, 3.0)]
        robot.drive(np.array([[0.0, 0.0, 0.0], target]), 2.0)
    solids = shapely.union_all([shape.polygon(1e-6).shapely() for shape in WORLD.obstacles])
    truth = robot.truth
    between = truth[:-1] + 0.5 * np.column_stack([np.diff(truth[:, :3], axis=0), wrap(np.diff(truth[:, 3]))])
    room = shapely.box(*WORLD.bounds)
    for _, x, y, theta in np.concatenate([truth, between]):
        body = shapely.affinity.rotate(shapely.box(-0.3, -0.2, 0.3, 0.2), theta, (0.0, 0.0), use_radians=True)
        body = shapely.affinity.translate(body, x, y)
        assert body.intersection(solids).area < 1e-6
        assert body.difference(room).area < 1e-6
    assert robot.collisions > 0


@pytest.mark.slow
def test_discs_are_detected_with_their_noise() -> None:
    robot = SimulatedRobot(WORLD, ROBOT, START, disc_detector(9.0), noise=0.0)
    (seen,) = robot.sense()
    assert isinstance(seen, Detection)
    assert seen.identity == 1
    assert seen.z == pytest.approx([math.hypot(2.0, 4.0), math.atan2(4.0, 2.0)], abs=1e-9)
    assert seen.covariance == pytest.approx(np.diag([2e-4, 1e-4]) ** 2)
    errors, robot = [], SimulatedRobot(WORLD, ROBOT, START, disc_detector(9.0), noise=2.0)
    for _ in range(200):
        noisy = robot.sense()[-1]
        robot.drive(np.zeros((1, 3)), 0.1)
        assert isinstance(noisy, Detection)
        errors.append(noisy.z - seen.z)
        assert noisy.covariance == pytest.approx(np.diag([0.04, 0.02]) ** 2)
    assert np.std(errors, axis=0) == pytest.approx([0.04, 0.02], rel=0.2)


def test_a_door_closes_and_the_robot_is_carried_away() -> None:
    robot = laser(noise=0.0)
    closed = WORLD.edited(add=[Rectangle((6.0, 6.0), 1.0, 4.0)])
    robot.change_world(closed)
    robot.drive(np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [6.0, 2.0, 0.0]]), 20.0)
    assert robot.collisions == 1
    assert robot.pose[0] <= 5.2
    assert robot.world is closed
    before = list(robot.sense())
    robot.carry((8.0, 5.0, 1.0))
    assert robot.pose == pytest.approx([8.0, 5.0, 1.0])
    assert robot.sense() == []
    robot.drive(ahead(0.5), 1.0)
    increments = [record for record in robot.sense() if isinstance(record, Increment)]
    assert sum(step.dx for step in increments) == pytest.approx(0.5)
    assert isinstance(before[-1], Scan)
    with pytest.raises(ConfigurationError, match="robot's place"):
        robot.change_world(World("full", WORLD.bounds, (Rectangle((8.0, 5.0), 3.0, 3.0),)))
    with pytest.raises(ConfigurationError, match="pose"):
        robot.carry((6.0, 2.0, 0.0))
    assert robot.world is closed
