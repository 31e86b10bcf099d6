"""From a log to a world: which records make the obstacles and the poses, the world's parts, the figures, misuse."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import affinity
from tests.helpers.alignment import aligned

from trailmark.estimation import (
    Cartesian,
    Detection,
    Detector,
    EstimationError,
    Increment,
    Log,
    MapSettings,
    Odometry,
    Pose,
    PoseIncrement,
    RangeBearing,
    Scan,
    Scanner,
    SlamSettings,
    Unicycle,
    map_log,
    regrow,
    simulate,
)
from trailmark.estimation.mapped_log import MappedLog
from trailmark.estimation.records import Record
from trailmark.se2 import compose
from trailmark.shapes import Disc, Rectangle
from trailmark.world import Robot, World

CENTRES = np.array([[2.0, 2.2], [5.0, 1.0], [9.5, 1.5], [10.5, 5.0], [7.0, 6.5], [3.0, 6.8], [1.0, 5.0], [6.0, 3.8]])
RADIUS = 0.15
YARD = World("yard", (0.0, 0.0, 12.0, 8.0), tuple(Disc((float(x), float(y)), RADIUS) for x, y in CENTRES))
START = (1.0, 1.0, math.atan2(1.6, 7.0))  # a drive to waypoints begins towards the second
WAY = [[1.0, 1.0], [8.0, 2.6], [9.0, 5.0], [4.5, 5.3], [2.2, 4.0], [1.2, 1.6]]
ROBOT = Robot.disc(0.25)


@cache
def recorded(identities: bool = True, scanner: bool = False, increments: bool = False) -> Log:
    motion = PoseIncrement(0.002, 0.002, 0.001) if increments else Unicycle(0.01, 0.01, period=1.0)
    detector = Detector(RangeBearing(0.03, 0.01), 7.0, period=1.0, identities=identities)
    eyes = Scanner(beams=121, max_range=9.0, period=1.0, bounds=True) if scanner else None
    return simulate(YARD, WAY, motion, detector=detector, scanner=eyes, random_state=3).log


@cache
def grown() -> MappedLog:
    return map_log(recorded(), robot=ROBOT, confidence=0.99)


@cache
def matched() -> tuple[MappedLog, list[tuple[str, int, int]]]:
    """The map of scans by the defaults, and what was told of its progress."""
    told: list[tuple[str, int, int]] = []
    settings = MapSettings(start=START)
    return map_log(recorded(scanner=True), settings, on_progress=lambda *step: told.append(step)), told


def without(log: Log, *kinds: type) -> Log:
    return log._replace(records=tuple(record for record in log.records if not isinstance(record, kinds)))


def discs(world: World) -> list[Disc]:
    return [estimate.mean for estimate in world.estimates if estimate and isinstance(estimate.mean, Disc)]


@pytest.mark.slow
def test_detections_become_discs_with_their_covariances() -> None:
    settings = MapSettings(radius=RADIUS, radius_sigma=0.02, start=START, velocity=Unicycle(0.01, 0.01, period=1.0))
    mapped = map_log(recorded(), settings, robot=ROBOT)
    assert (mapped.poses, mapped.association) == ("slam", "known")
    assert mapped.slam is not None
    truth = {int(i): np.array([x, y]) for i, x, y in recorded().landmarks}
    assert {feature.identity for feature in mapped.slam.features} == set(truth)
    found = np.array([feature.mean for feature in mapped.slam.features])
    expected = np.array([truth[feature.identity] for feature in mapped.slam.features if feature.identity is not None])
    motion = aligned(found, expected)
    for feature, place, estimate in zip(mapped.slam.features, expected, mapped.world.estimates, strict=True):
        assert estimate is not None
        assert isinstance(estimate.mean, Disc)
        assert estimate.mean.radius == RADIUS
        assert np.allclose(estimate.mean.center, feature.mean)
        # Its covariance is relative to the map, whose frame may be turned.
        error = (motion(np.array(estimate.mean.center)) - place) @ motion.R
        assert error @ np.linalg.solve(estimate.covariance[:2, :2], error) < 20.0
        assert np.hypot(*error) < 0.2
        assert estimate.covariance[2, 2] == pytest.approx(0.02**2)
    assert mapped.world.obstacles == tuple(e.mean for e in mapped.world.estimates if e is not None)
    assert mapped.world.risk is None
    np.testing.assert_allclose(mapped.trajectory[0, 1:], START, atol=0.1)
    np.testing.assert_allclose(mapped.trajectory[-1, 1:3], WAY[-1], atol=0.3)


@pytest.mark.slow
def test_confidence_grows_and_the_covariances_are_kept() -> None:
    plain, surer = map_log(recorded(), robot=ROBOT).world, grown().world
    assert surer.risk is not None
    assert surer.risk.confidence == 0.99
    for before, after in zip(plain.obstacles, surer.obstacles, strict=True):
        assert after.polygon(1e-4).shapely().buffer(2e-4).covers(before.polygon(1e-4).shapely())
        assert after.area > before.area
    wider = regrow(surer, 0.999)
    assert all(b.area > a.area for a, b in zip(surer.obstacles, wider.obstacles, strict=True))
    errs = map_log(recorded(), MapSettings(robot_sigma=(0.1, 0.05)), robot=ROBOT, confidence=0.99).world
    assert errs.risk is not None
    np.testing.assert_allclose(np.diag(errs.risk.pose_covariance), [0.01, 0.01, 0.0025])  # type: ignore[arg-type]  # it is there
    assert all(b.area > a.area for a, b in zip(surer.obstacles, errs.obstacles, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("confidence", [None, 0.95])
def test_queries_start_and_end_where_the_robot_was_and_stands_free(confidence: float | None) -> None:
    robot = Robot.rectangle(0.8, 0.5)
    mapped = map_log(recorded(), MapSettings(radius=RADIUS), robot=robot, confidence=confidence)
    driven, farthest = mapped.world.queries
    assert (driven.name, farthest.name) == ("driven", "farthest")
    assert driven.start == farthest.start
    solid = shapely.union_all([shape.polygon(1e-4).shapely() for shape in mapped.world.obstacles])
    for q in (driven.start, driven.goal, farthest.goal):
        assert np.abs(mapped.trajectory[:, 1:] - q).sum(axis=1).min() < 1e-9
        corners = np.array([[0.4, 0.25], [-0.4, 0.25], [-0.4, -0.25], [0.4, -0.25]])
        cos, sin = math.cos(q[2]), math.sin(q[2])
        body = shapely.Polygon(corners @ np.array([[cos, sin], [-sin, cos]]) + q[:2])
        assert not body.intersects(solid)
        assert shapely.box(*mapped.world.bounds).contains(body)
    away = [math.dist(mapped.trajectory[0, 1:3], q[:2]) for q in (driven.goal, farthest.goal)]
    assert away[1] >= away[0]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "nearest"])
def test_features_of_unknown_identity(method: Any) -> None:
    slam = replace(MapSettings().slam, association=method)
    settings = MapSettings(slam=slam, start=START, velocity=Unicycle(0.01, 0.01, period=1.0))
    mapped = map_log(recorded(identities=False), settings)
    assert mapped.association == ("joint" if method == "auto" else method)
    found = np.array([disc.center for disc in discs(mapped.world)])
    assert len(found) == len(CENTRES)
    assert np.hypot(*(found[:, None] - CENTRES).transpose(2, 0, 1)).min(axis=1).max() < 0.2


@pytest.mark.slow
def test_increments_and_cartesian_detections_as_in_victoria_park() -> None:
    log = recorded(increments=True)
    records = tuple(
        record._replace(
            z=record.z[0] * np.array([np.cos(record.z[1]), np.sin(record.z[1])]), kind="cartesian"
        )._replace(covariance=0.05**2 * np.eye(2))
        if isinstance(record, Detection)
        else record
        for record in log.records
    )
    mapped = map_log(log._replace(records=records), MapSettings(start=START))
    assert len(discs(mapped.world)) == len(CENTRES)
    found = np.array([disc.center for disc in discs(mapped.world)])
    assert np.hypot(*(found[:, None] - CENTRES).transpose(2, 0, 1)).min(axis=1).max() < 0.2


@pytest.mark.slow
def test_stated_noise_counts_unless_told_otherwise() -> None:
    def spread(settings: MapSettings) -> float:
        world = map_log(log, settings).world
        return float(np.mean([np.trace(estimate.covariance) for estimate in world.estimates if estimate]))

    log = recorded(increments=True)
    log = log._replace(records=log.records[: len(log.records) // 2])
    loose = MapSettings(range_bearing=RangeBearing(0.5, 0.2), cartesian=Cartesian(0.5, 0.5))
    stated = spread(MapSettings())
    assert spread(loose) == stated
    assert spread(replace(loose, stated_noise=False)) > 2.0 * stated
    drifts = PoseIncrement(0.05, 0.05, 0.05)
    assert spread(MapSettings(increment=drifts)) == stated
    assert spread(MapSettings(increment=drifts, stated_noise=False)) > stated


@pytest.mark.slow
def test_scans_are_mapped_from_the_poses_that_detections_give() -> None:
    mapped = map_log(recorded(scanner=True), MapSettings(start=START, poses="slam"), robot=ROBOT)
    assert (mapped.poses, mapped.association) == ("slam", "known")
    assert mapped.scans is not None
    assert mapped.slam is not None
    walls = [e.mean for e in mapped.world.estimates if e is not None and isinstance(e.mean, Rectangle)]
    assert len(walls) >= 4
    sides = shapely.box(*YARD.bounds).exterior
    for wall in walls:
        if wall.length > 2.0:
            assert sides.distance(shapely.Point(wall.center)) < 0.3
    only = map_log(recorded(scanner=True), MapSettings(start=START, obstacles="detections"))
    assert only.scans is None
    assert len(discs(only.world)) == len(CENTRES)


@pytest.mark.slow
def test_scans_by_odometry_alone_say_that_they_drift() -> None:
    log = without(recorded(scanner=True), Detection)
    mapped = map_log(log, MapSettings(start=START, poses="odometry"))
    assert (mapped.poses, mapped.slam) == ("odometry", None)
    np.testing.assert_allclose(mapped.trajectory[0, 1:], START, atol=1e-6)
    np.testing.assert_allclose(mapped.trajectory[-1, 1:3], WAY[-1], atol=1.0)
    assert any("drift" in note for note in mapped.notes)
    origin = map_log(log, MapSettings(poses="odometry"))
    x, y, theta = START
    turned = affinity.rotate(shapely.LineString(origin.trajectory[:, 1:3]), theta, origin=(0.0, 0.0), use_radians=True)
    moved = np.array([x, y]) + shapely.get_coordinates(turned)
    np.testing.assert_allclose(moved, mapped.trajectory[:, 1:3], atol=1e-9)


@pytest.mark.slow
def test_scans_are_matched_by_default() -> None:
    log = recorded(scanner=True)
    mapped, drifting = matched()[0], map_log(log, MapSettings(start=START, poses="odometry"))
    assert (mapped.poses, mapped.slam) == ("match", None)
    matching = mapped.figures()["matching"]
    assert matching["nodes"] > 10
    assert matching["relations"] >= matching["nodes"] - 1
    true = np.array([record[:3] for record in log.records if isinstance(record, Pose) and record.truth])
    t = mapped.trajectory[:, 0]
    places = np.column_stack([np.interp(t, true[:, 0], true[:, 1]), np.interp(t, true[:, 0], true[:, 2])])
    off = [float(np.hypot(*(m.trajectory[:, 1:3] - places).T).max()) for m in (mapped, drifting)]
    assert off[0] < 0.1 < off[1]


def test_stated_poses_are_taken_between_records() -> None:
    scan = Scan(0.0, np.full(19, 2.0), -0.9, 0.1, 8.0)
    records: tuple[Record, ...] = (
        Pose(0.0, 0.0, 0.0, 3.0),
        *(scan._replace(t=0.25 * i) for i in range(5)),
        Pose(1.0, 1.0, -2.0, -3.0),
        Pose(0.5, 9.0, 9.0, 9.0, truth=True),
    )
    mapped = map_log(Log("hand", records, np.empty((0, 3))))
    assert mapped.poses == "log"
    turn = 2.0 * math.pi - 6.0
    for i, (t, x, y, theta) in enumerate(mapped.trajectory):
        assert (t, x, y) == pytest.approx((0.25 * i, 0.25 * i, -0.5 * i))
        assert math.remainder(theta - 3.0 - turn * t, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.slow
def test_features_from_stated_poses() -> None:
    poses = [
        record._replace(truth=False) if isinstance(record, Pose) else record
        for record in recorded().records
        if not isinstance(record, Odometry)
    ]
    # Of one instant, the pose must come first.
    poses.sort(key=lambda record: (record.t, not isinstance(record, Pose)))
    mapped = map_log(Log("posed", tuple(poses), np.empty((0, 3))))
    assert mapped.poses == "log"
    found = np.array([disc.center for disc in discs(mapped.world)])
    assert (
        np.hypot(*(found - CENTRES[np.hypot(*(found[:, None] - CENTRES).transpose(2, 0, 1)).argmin(axis=1)]).T).max()
        < 0.1
    )


@pytest.mark.slow
def test_misread_identities_are_refused_be_they_few_or_many() -> None:
    log = recorded()

    def spoiled(every: int) -> Log:
        records, seen = [], 0
        for record in log.records:
            seen += isinstance(record, Detection)
            if isinstance(record, Detection) and seen % every == 0:
                record = record._replace(z=np.array([record.z[0], record.z[1] + 1.5]))
            records.append(record)
        return log._replace(records=tuple(records))

    few = map_log(spoiled(100), MapSettings(start=START))
    assert few.slam is not None
    detections = few.slam.counts.detections
    assert 0 < few.slam.counts.outliers <= 0.02 * detections
    found = np.array([disc.center for disc in discs(few.world)])
    assert np.hypot(*(found[:, None] - CENTRES).transpose(2, 0, 1)).min(axis=1).max() < 0.2
    many = map_log(spoiled(5), MapSettings(start=START))
    assert many.slam is not None
    assert 0.15 * detections < many.slam.counts.outliers < 0.3 * detections
    found = np.array([disc.center for disc in discs(many.world)])
    assert np.hypot(*(found[:, None] - CENTRES).transpose(2, 0, 1)).min(axis=1).max() < 0.2


@pytest.mark.slow
@pytest.mark.slow
@pytest.mark.parametrize("velocities", [False, True])
def test_whole_second_stamps_change_nothing(velocities: bool) -> None:
    marks = {0: (-3.0, 0.0), 1: (4.0, 3.0), 2: (6.0, -3.0), 3: (0.0, 5.0), 4: (0.0, -5.0)}
    off = {}
    for tick in (0.1, 1.0):
        rng, pose, records = np.random.default_rng(0), np.zeros(3), list[Record]()
        for k in range(60):
            t = math.floor(k * 0.1 / tick + 1e-9) * tick
            if velocities:
                records.append(Odometry(t, 1.0 + rng.normal(0.0, 0.02), 1.0))
            elif k:
                records.append(Increment(t, 0.1, 0.0, 0.1))  # a coarse encoder: each one the same
            for identity, mark in marks.items():
                x, y = mark - pose[:2]
                z = np.array([math.hypot(x, y), math.remainder(math.atan2(y, x) - pose[2], 2.0 * math.pi)])
                records.append(Detection(t, z + rng.normal(0.0, 0.01, 2), identity=identity))
            if velocities:
                pose = Unicycle(0.0, 0.0).f(pose, np.array([1.0, 1.0, 0.1]))
            else:
                pose = compose(pose, np.array([0.1, 0.0, 0.1]))
        found = map_log(Log("log", tuple(records), np.empty((0, 3))))
        centers = np.array([disc.center for disc in discs(found.world)])
        off[tick] = max(float(np.hypot(*(centers - mark).T).min()) for mark in marks.values())
        assert found.slam is not None
        assert found.slam.counts.repeated == 0
    assert off[1.0] == pytest.approx(off[0.1], abs=1e-6)
    assert off[0.1] < 0.1


def test_scans_without_one_reading_show_no_obstacles() -> None:
    scans = [Scan(float(t), np.full(9, math.nan), 0.0, 0.1, 9.0) for t in range(4)]
    log = Log("blind", (Odometry(0.0, 1.0, 0.0), *scans), np.empty((0, 3)))
    with pytest.raises(EstimationError, match="4 scans without one reading"):
        map_log(log)


def test_nothing_to_go_by() -> None:
    log = recorded()
    for kept, settings, problem in (
        (without(log, Detection), MapSettings(), "got neither scans nor detections"),
        (log, MapSettings(obstacles="scans"), "got no scans"),
        (without(log, Odometry), MapSettings(), "got neither odometry nor poses"),
        (
            log,
            MapSettings(poses="odometry"),
            r"poses: expected what the log holds for detections \(slam\), got 'odometry'",
        ),
        (log, MapSettings(poses="log"), "for detections .*, got 'log'"),
        (
            recorded(identities=False),
            MapSettings(slam=SlamSettings("known")),
            "got no feature confirmed by .* without the identity",
        ),
        (recorded(identities=False), MapSettings(slam=SlamSettings("joint", confirm=10_000)), "no feature confirmed"),
    ):
        with pytest.raises(EstimationError, match=problem):
            map_log(kept, settings)
    with pytest.raises(EstimationError, match="neither scans nor detections"):
        map_log(Log("still", (Increment(0.0, 0.0, 0.0, 0.0),), np.empty((0, 3))))
