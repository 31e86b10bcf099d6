"""The map of a robot that detects discs."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from tests.helpers.exploration_faults import Fault, Faulty, Impossible, miscounted, repeated, silence
from tests.helpers.trials import trials

from trailmark import ConfigurationError, Disc, Robot, World
from trailmark.estimation import load_log, map_log
from trailmark.estimation.models import RangeBearing
from trailmark.estimation.readers.jsonl import write_jsonl
from trailmark.estimation.records import Detection, Log
from trailmark.estimation.virtual_sensors import Detector
from trailmark.exploration.detection_mapper import DetectionMapper, aligned
from trailmark.exploration.known_map import FREE, OCCUPIED, KnownMap
from trailmark.exploration.result import ExplorationSettings
from trailmark.exploration.simulated_robot import SimulatedRobot, disc_detector
from trailmark.se2 import FloatArray, between, compose, transform

BOUNDS = (0.0, 0.0, 16.0, 12.0)
PLACES = [(4, 4, 0.3), (7, 2, 0.4), (9, 6, 0.2), (3, 9, 0.3), (12, 3, 0.4), (13, 9, 0.3), (8, 10, 0.25), (5, 6.5, 0.3)]
WORLD = World("trees", BOUNDS, tuple(Disc((float(x), float(y)), r) for x, y, r in PLACES))
RADII = {i: r for i, (_, _, r) in enumerate(PLACES)}
ROBOT = Robot.disc(0.25)
START = np.array([1.5, 1.5, 0.3])
CELL = 0.1


def begun(noise: float, confidence: float | None = None, seed: int = 0) -> tuple[SimulatedRobot, DetectionMapper]:
    sensor = disc_detector(5.0)
    robot = SimulatedRobot(WORLD, ROBOT, START, sensor, noise=noise, seed=seed)
    settings = ExplorationSettings(confidence=confidence)
    mapper = DetectionMapper(START, KnownMap(BOUNDS, CELL), sensor, ROBOT, settings, RADII)
    mapper.take(robot.sense())
    return robot, mapper


def drive(robot: SimulatedRobot, mapper: DetectionMapper, times: int, turn: float = 0.01) -> list[bool]:
    lost = []
    for _ in range(times):
        robot.drive(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, turn]]), 1.0)
        lost.append(mapper.take(robot.sense()).lost)
    return lost


def drawn(mapper: DetectionMapper, world: World | None = None) -> tuple[World, shapely.Geometry]:
    """Return the planner's world, and all of it that is not free."""
    world = mapper.known.follow(world or World("known", BOUNDS))
    return world, shapely.union_all([shape.polygon(1e-4).shapely() for shape in world.obstacles])


def truth() -> shapely.Geometry:
    return shapely.union_all([shape.polygon(1e-4).shapely() for shape in WORLD.obstacles])


@pytest.mark.slow
def test_without_noise_no_disc_is_missed_and_none_is_wider_than_its_cells() -> None:
    robot, mapper = begun(0.0)
    world = None
    for _ in range(8):
        assert not any(drive(robot, mapper, 10))
        world, solid = drawn(mapper, world)
        assert truth().difference(solid).area < 1e-4
    occupied = mapper.known.centres(*np.nonzero(mapper.known.state == OCCUPIED))
    assert shapely.distance(truth(), shapely.points(occupied)).max() < 0.71 * CELL + 2e-3
    assert (mapper.known.state == FREE).sum() * mapper.known.cell**2 > 60.0


@pytest.mark.slow
def test_with_noise_discs_are_grown_so_that_they_cover_the_true_ones() -> None:
    for seed in trials(3):
        robot, mapper = begun(1.0, 0.99, seed)
        assert not any(drive(robot, mapper, 80))
        _, solid = drawn(mapper)
        # As the robot has them around itself: what turns and shifts the whole map does no harm.
        here = between(robot.pose, np.array([(x, y, 0.0) for x, y, _ in PLACES]))
        there = compose(mapper.pose, here)
        for (x, y, _), (*_, radius) in zip(there, PLACES, strict=True):
            assert Disc((x, y), radius).polygon(1e-4).shapely().difference(solid).area < 1e-4
        off = mapper.pose - robot.pose
        assert float(off @ np.linalg.solve(mapper.covariance, off)) < 20.0


@pytest.mark.slow
def test_with_noise_what_may_be_outside_the_bounds_is_closed() -> None:
    for seed in trials(3):
        robot, mapper = begun(1.0, 0.99, seed)
        widths = []
        for _ in range(6):
            assert not any(drive(robot, mapper, 10, turn=0.02))
            # Along the bottom row and the left column, how many cells are closed.
            closed = mapper.known.state == OCCUPIED
            left, below = (CELL * int(lines.all(axis=0).argmin()) for lines in (closed, closed.T))
            # The robot is a disc, which an error of its heading does not move: only that of its place counts.
            assert (np.abs(mapper.pose - robot.pose)[:2] <= (left, below)).all()
            widths += [left, below]
        assert 0.0 < min(widths) <= max(widths) < 1.0
    _, mapper = begun(1.0)
    drive(robot, mapper, 10)
    assert not (mapper.known.state[0] == OCCUPIED).all()


def test_what_was_freed_from_a_pose_that_had_drifted_is_forgotten() -> None:
    robot, mapper = begun(0.0)
    drive(robot, mapper, 5)
    before = mapper.known.state == FREE
    # Looked at from where the pose was less sure by a cell and more than it is now, and from where it was not.
    for rows, sigma in ((slice(80, 90), 1.0), (slice(100, 110), 0.0)):
        mapper._looks[rows, 100:120], mapper._sigma[rows, 100:120], mapper._free[rows, 100:120] = 1, sigma, True
    mapper.take(robot.sense())
    robot.drive(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]), 1.0)
    mapper.take(robot.sense())
    assert not mapper._looks[80:90, 100:120].any()
    assert not (mapper.known.state[80:90, 100:120] == FREE).any()
    assert mapper._looks[100:110, 100:120].all()
    assert (mapper.known.state == FREE)[before].mean() > 0.98


@pytest.mark.slow
def test_a_robot_that_is_carried_away_is_lost_and_found_again() -> None:
    robot, mapper = begun(1.0)
    drive(robot, mapper, 50)
    before = np.array([feature.mean for feature in mapper.features])
    robot.carry((6.0, 8.5, 2.0))
    lost = drive(robot, mapper, 6)
    assert lost.index(True) == 2
    assert np.array([feature.mean for feature in mapper.features]) == pytest.approx(before, abs=0.02)
    assert mapper.relocate()
    assert np.hypot(*(mapper.pose - robot.pose)[:2]) < 0.3
    assert not any(drive(robot, mapper, 20))
    assert np.hypot(*(mapper.pose - robot.pose)[:2]) < 0.2


def test_sizes_must_be_known() -> None:
    with pytest.raises(ConfigurationError, match="finite max_radius"):
        DetectionMapper(START, KnownMap(BOUNDS, CELL), disc_detector(5.0), ROBOT, ExplorationSettings())


def unnamed(noise: float = 1.0) -> tuple[SimulatedRobot, DetectionMapper]:
    sensor = Detector(RangeBearing(0.02, 0.01), 6.0, identities=False)
    world = World(
        "trees", BOUNDS, tuple(Disc(shape.center, 0.3) for shape in WORLD.obstacles if isinstance(shape, Disc))
    )
    robot = SimulatedRobot(world, ROBOT, START, sensor, noise=noise)
    mapper = DetectionMapper(
        START, KnownMap(BOUNDS, CELL), replace(sensor, max_radius=0.3), ROBOT, ExplorationSettings()
    )
    mapper.take(robot.sense())
    return robot, mapper


@pytest.mark.slow
def test_discs_need_no_names() -> None:
    robot, mapper = unnamed()
    assert not any(drive(robot, mapper, 50))
    assert 5 <= len(mapper.features) <= 8
    assert mapper.pose == pytest.approx(robot.pose, abs=0.15)
    robot.carry((7.0, 7.5, 1.0))
    assert drive(robot, mapper, 4)[-1]
    assert mapper.relocate()
    assert np.hypot(*(mapper.pose - robot.pose)[:2]) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [Impossible(math.inf), Impossible(math.nan), Impossible(-1.0), miscounted, silence],
    ids=["infinite", "nan", "negative", "miscounted", "silence"],
)
def test_impossible_readings_change_nothing(fault: Fault) -> None:
    robot, mapper = begun(1.0)
    drive(robot, mapper, 10)
    before, spoilt = mapper.known.state.copy(), Faulty(robot, fault)
    for _ in range(5):
        robot.drive(np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.01]]), 1.0)
        records = spoilt.sense()
        intake = mapper.take(records)
        assert intake.readings == 0
        assert len(intake.refused) == sum(isinstance(record, Detection) for record in records)
    assert (mapper.known.state == before).all()
    assert not drive(robot, mapper, 1)[0]


def test_repeated_readings_count_once() -> None:
    robot, mapper = begun(1.0)
    robot.drive(np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]), 1.0)
    records = repeated(list(robot.sense()))
    intake = mapper.take(records)
    assert intake.readings == 1
    assert len(intake.refused) == sum(isinstance(record, Detection) for record in records) // 2
    assert "got it again" in intake.refused[0]


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_the_log_that_is_kept_leads_to_the_same_map(noise: float, tmp_path: Path) -> None:
    robot, mapper = begun(noise)
    drive(robot, mapper, 30)
    log = Log("trees", tuple(mapper.records), np.empty((0, 3)))
    write_jsonl(tmp_path / "log.jsonl", log)
    made, again = mapper.finished_map(log), map_log(load_log(tmp_path / "log.jsonl")).world
    assert len(made.obstacles) == len(again.obstacles) == len(mapper.features)
    for disc, other in zip(made.obstacles, again.obstacles, strict=True):
        assert isinstance(disc, Disc)
        assert isinstance(other, Disc)
        assert disc.center == pytest.approx(other.center, abs=1e-9)
        nearest = min(WORLD.obstacles, key=lambda true: np.hypot(*np.subtract(true.center, disc.center)))  # type: ignore[union-attr]
        assert disc.radius == nearest.radius  # type: ignore[union-attr]
        assert disc.center == pytest.approx(nearest.center, abs=0.1)  # type: ignore[union-attr]


def detected(pose: FloatArray, places: FloatArray) -> FloatArray:
    """Return places in the robot's frame, by complex numbers."""
    turned = ((places[:, 0] - pose[0]) + 1j * (places[:, 1] - pose[1])) * np.exp(-1j * pose[2])
    return np.column_stack([turned.real, turned.imag])


@pytest.mark.parametrize("identified", [True, False])
@pytest.mark.parametrize("seed", range(5))
def test_the_pose_is_found_among_noise_and_wrong_detections(seed: int, identified: bool) -> None:
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 20.0, (30, 2))
    pose = np.array([*rng.uniform(5.0, 15.0, 2), rng.uniform(-3.0, 3.0)])
    seen = rng.choice(30, 7, replace=False)
    points = detected(pose, places[seen]) + rng.normal(size=(7, 2)) * 0.01
    points[0] += [3.0, -2.0]  # a wrong one
    every = np.arange(30)
    found = aligned(points, places, [np.array([i]) if identified else every for i in seen], 0.05)
    assert found.unique
    assert 6 <= found.matched <= 7
    assert found.pose == pytest.approx(pose, abs=0.03)
    assert transform(found.pose, points[1:]) == pytest.approx(places[seen[1:]], abs=0.08)


def test_two_places_that_look_alike_are_not_told_apart() -> None:
    corner = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]])
    places = np.concatenate([corner, corner + np.array([20.0, 5.0])])
    found = aligned(detected(np.array([1.0, 1.0, 0.5]), corner), places, [np.arange(6)] * 3, 0.05)
    assert found.matched == 3
    assert not found.unique
