"""The map of a robot with a laser."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.affinity
from tests.helpers.exploration_faults import Fault, Faulty, Impossible, frozen_odometry, miscounted, silence
from tests.helpers.trials import trials

from trailmark import Disc, Rectangle, Robot, World
from trailmark.estimation import load_log, map_log
from trailmark.estimation.readers.jsonl import write_jsonl
from trailmark.estimation.records import Log, Pose, Scan
from trailmark.exploration.known_map import FREE, KnownMap
from trailmark.exploration.mapper import Belief
from trailmark.exploration.result import ExplorationSettings
from trailmark.exploration.scan_mapper import ScanMapper
from trailmark.exploration.simulated_robot import SimulatedRobot, laser_scanner
from trailmark.se2 import FloatArray, between, compose, difference

WALL = Rectangle((6.0, 2.0), 1.0, 4.0)
WORLD = World("room", (0.0, 0.0, 10.0, 8.0), (WALL, Disc((3.0, 6.0), 0.5), Disc((8.0, 2.0), 0.2)))
ROBOT = Robot.rectangle(0.6, 0.4)
START = np.array([1.0, 2.0, 0.0])
LASER = laser_scanner(6.0, 0.05)


def begun(noise: float = 1.0) -> tuple[SimulatedRobot, ScanMapper]:
    robot = SimulatedRobot(WORLD, ROBOT, START, LASER, noise=noise)
    mapper = ScanMapper(START, KnownMap(WORLD.bounds, 0.05), LASER, ROBOT, ExplorationSettings())
    mapper.take(robot.sense())
    return robot, mapper


def drive(robot: SimulatedRobot, mapper: ScanMapper, times: int, step: tuple[float, float, float]) -> list[Belief]:
    intakes = []
    for _ in range(times):
        robot.drive(np.array([[0.0, 0.0, 0.0], step]), 1.0)
        intakes.append(mapper.take(robot.sense()))
    return intakes


@pytest.mark.parametrize(("noise", "off"), [(0.0, 1e-9), (1.0, 0.02)], ids=["taken as exact", "set right by scans"])
def test_the_pose_is_as_exact_as_odometry_and_scans_make_it(noise: float, off: float) -> None:
    robot, mapper = begun(noise)
    intakes = drive(robot, mapper, 30, (0.1, 0.0, 0.04))
    assert all((intake.readings, intake.refused, intake.lost) == (1, (), False) for intake in intakes)
    assert np.hypot(*(mapper.pose - robot.pose)[:2]) < off
    assert mapper.covariance.any() == (noise > 0.0)
    assert len(mapper.trajectory) == len(mapper.covariances) == 31
    assert (mapper.known.state == FREE).sum() * mapper.known.cell**2 > 30.0
    assert (mapper.known.state[mapper.known.cells_of(np.array([[6.0, 2.0], [3.0, 6.0]]))] != FREE).all()


def test_streets_that_look_alike_are_not_joined_and_covariances_are_those_of_the_errors() -> None:
    blocks = tuple(Rectangle((3.0 + 4.4 * i, 3.0 + 4.4 * j), 3.0, 3.0) for i in range(3) for j in range(3))
    streets = World("streets", (0.0, 0.0, 14.8, 14.8), blocks)
    errors, stated = list[FloatArray](), list[FloatArray]()
    for seed in trials(2):
        start, reach = np.array([0.75, 0.75, 0.0]), laser_scanner(5.0, 0.05)
        robot = SimulatedRobot(streets, ROBOT, start, reach, seed=seed)
        mapper = ScanMapper(start, KnownMap(streets.bounds, 0.05), reach, ROBOT, ExplorationSettings())
        mapper.take(robot.sense())
        corners = [(5.2, 0.75), (5.2, 14.0), (9.6, 14.0), (9.6, 5.2), (0.75, 5.2), (0.75, 0.75), (5.2, 0.75)]
        for corner in corners:
            while (away := math.hypot(*(np.array(corner) - robot.pose[:2]))) > 0.3:
                ahead = between(robot.pose, np.array([*corner, robot.pose[2]])) * min(1.0, 0.3 / away)
                robot.drive(np.array([np.zeros(3), ahead]), 1.0)
                mapper.take(robot.sense())
        at = np.searchsorted(robot.truth[:, 0], mapper.trajectory[:, 0] - 1e-9)
        errors.append(difference(robot.truth[at, 1:], mapper.trajectory[:, 1:])[1:])
        stated.append(mapper.covariances[1:])
    error, covariance = np.concatenate(errors), np.concatenate(stated)
    assert np.hypot(*error[:, :2].T).max() < 0.05
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error).mean()
    assert 0.1 < nees < 6.0  # errors along a drive are alike: a drive is but a few samples


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_a_robot_that_is_carried_away_is_lost_and_found_again(noise: float) -> None:
    robot, mapper = begun(noise)
    drive(robot, mapper, 20, (0.15, 0.0, 0.06))
    robot.drive(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.01]]), 1.0)
    mapper.take(robot.sense())
    before = mapper.known.state.copy()
    robot.carry((4.5, 7.2, -2.0))
    intakes = drive(robot, mapper, 5, (0.0, 0.0, 0.05))
    assert [intake.lost for intake in intakes] == [False, False, True, True, True]
    assert not any(intake.readings for intake in intakes)
    assert (mapper.known.state == before).all()
    assert mapper.relocate()
    assert np.abs(mapper.pose - robot.pose).max() < 0.03
    intakes = drive(robot, mapper, 8, (0.1, 0.0, 0.04))
    assert all(intake.readings and not intake.lost for intake in intakes)
    assert np.hypot(*(mapper.pose - robot.pose)[:2]) < 0.03
    # Whoever goes on from the log is there, too.
    again = ScanMapper(START, KnownMap(WORLD.bounds, 0.05), LASER, ROBOT, ExplorationSettings())
    assert not again.take(mapper.records).refused
    assert np.abs(again.pose - robot.pose).max() < 0.03
    mapped = map_log(Log("room", tuple(mapper.records), np.empty((0, 3))))
    assert np.hypot(*(mapped.trajectory[-1, 1:] - robot.pose)[:2]) < 0.05


def test_a_robot_whose_readings_fit_the_map_nowhere_is_not_found() -> None:
    robot, mapper = begun()
    drive(robot, mapper, 20, (0.1, 0.0, 0.0))
    scan = next(record for record in reversed(mapper.records) if isinstance(record, Scan))
    angles = scan.angle_min + scan.angle_increment * np.arange(len(scan.ranges))
    for i in range(1, 5):
        elsewhere = scan._replace(t=scan.t + i, ranges=1.0 + 0.3 * np.sin(7.0 * angles))
        intake = mapper.take([elsewhere])
    assert intake.lost
    assert not mapper.relocate()


@pytest.mark.parametrize(
    "fault",
    [Impossible(math.inf), Impossible(math.nan), Impossible(-1.0), miscounted, silence],
    ids=["infinite", "nan", "negative", "miscounted", "silence"],
)
def test_impossible_readings_change_nothing(fault: Fault) -> None:
    robot, mapper = begun()
    drive(robot, mapper, 10, (0.1, 0.0, 0.04))
    before, spoilt = mapper.known.state.copy(), Faulty(robot, fault)
    for _ in range(4):
        robot.drive(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.01]]), 1.0)
        records = spoilt.sense()
        intake = mapper.take(records)
        assert intake.readings == 0
        assert len(intake.refused) == sum(isinstance(record, Scan) for record in records)
    assert (mapper.known.state == before).all()
    after = drive(robot, mapper, 3, (0.05, 0.0, 0.0))
    assert [intake.readings for intake in after] == [1, 1, 1]


def test_repeated_and_late_readings_are_left_out() -> None:
    robot, mapper = begun()
    robot.drive(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]), 1.0)
    records = list(robot.sense())
    intake = mapper.take(records + [record for record in records if isinstance(record, Scan)])
    assert intake.readings == 1
    assert "its time again" in intake.refused[0]
    robot.drive(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]), 1.0)
    mapper.take(robot.sense())
    late = mapper.take(records)
    assert late.readings == 0
    assert all("in the order of time" in problem for problem in late.refused)


def test_odometry_that_stands_still_is_not_trusted_for_long() -> None:
    robot, mapper = begun(0.0)
    drive(robot, mapper, 20, (0.05, 0.0, 0.0))
    frozen, intakes = Faulty(robot, frozen_odometry), []
    for _ in range(20):
        robot.drive(np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]]), 1.0)
        intakes.append(mapper.take(frozen.sense()))
    assert [intake.redrawn for intake in intakes].count(True) == 1
    assert mapper.pose == pytest.approx(robot.pose, abs=0.03)
    assert mapper.trajectory[-1, 1:] == pytest.approx(robot.pose, abs=0.03)


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_the_log_that_is_kept_leads_to_the_same_map(noise: float, tmp_path: Path) -> None:
    robot, mapper = begun(noise)
    drive(robot, mapper, 15, (0.2, 0.0, 0.08))
    log = mapper.finished_log(Log("room", tuple(mapper.records), np.empty((0, 3))))
    made = mapper.finished_map(log)
    write_jsonl(tmp_path / "log.jsonl", log)
    again = map_log(load_log(tmp_path / "log.jsonl"), robot=ROBOT).world
    assert len(made.obstacles) == len(again.obstacles) > 3
    assert made.bounds == again.bounds
    walls = shapely.union_all([shape.polygon(1e-3).shapely() for shape in made.obstacles])
    others = shapely.union_all([shape.polygon(1e-3).shapely() for shape in again.obstacles])
    assert walls.symmetric_difference(others).area < 1e-6
    first = mapper.records[0]
    assert isinstance(first, Pose)
    assert (first.x, first.y, first.theta) == tuple(START)


@pytest.mark.parametrize("seed", trials(2))
def test_with_the_margin_nothing_true_lies_where_the_map_is_free(seed: int) -> None:
    sure = ExplorationSettings(confidence=0.99)
    robot = SimulatedRobot(WORLD, ROBOT, START, LASER, seed=seed)
    mapper = ScanMapper(START, KnownMap(WORLD.bounds, 0.05), LASER, ROBOT, sure)
    assert 0.03 < mapper.margin < 0.08
    true = shapely.union_all([shape.polygon(1e-3).shapely() for shape in WORLD.obstacles])
    true = true.union(shapely.box(-1.0, -1.0, 11.0, 9.0).difference(shapely.box(*WORLD.bounds)))
    world = World("known", WORLD.bounds)
    mapper.take(robot.sense())
    for _ in range(5):
        drive(robot, mapper, 10, (0.05, 0.0, 0.02))
        world = mapper.known.follow(world)
        drawn = shapely.union_all([shape.polygon(1e-3).shapely() for shape in world.obstacles])
        # The truth as the robot has it around itself, where it may drive in the next second.
        (x, y, theta), near = compose(mapper.pose, between(robot.pose, np.zeros(3))), shapely.Point(*mapper.pose[:2])
        c, s = math.cos(theta), math.sin(theta)
        around = shapely.affinity.affine_transform(true, [c, -s, s, c, x, y])
        free = near.buffer(1.5).difference(drawn).buffer(-mapper.margin)
        assert free.area > 1.0
        assert free.intersection(around).area == 0.0


def test_the_margin_is_that_of_the_noise_and_none_without_a_confidence() -> None:
    def margin(sigma: float, confidence: float | None) -> float:
        sensor, settings = replace(LASER, sigma=sigma), ExplorationSettings(confidence=confidence)
        return ScanMapper(START, KnownMap(WORLD.bounds, 0.05), sensor, ROBOT, settings).margin

    assert margin(0.01, None) == 0.0
    assert 0.02 < margin(0.01, 0.9) < margin(0.01, 0.99) < margin(0.01, 0.999)
    assert margin(0.5, 0.99) > 4.0 * margin(0.1, 0.99) > 16.0 * margin(0.01, 0.99)
