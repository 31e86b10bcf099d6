"""From a log to a world: which records make the obstacles and the poses, the world's parts, the figures, misuse."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from tests.helpers.alignment import aligned

from trailmark import Disc, Rectangle, Robot, World
from trailmark.estimation import (
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
from trailmark.estimation.covariance import nees
from trailmark.estimation.ekf_slam import Assignment, Counts, MapFeature, SlamResult
from trailmark.estimation.mapping import association_doubts, gap_warnings, log_warnings
from trailmark.estimation.obstacles import disc_estimates
from trailmark.estimation.records import Record
from trailmark.se2 import compose

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


def without(log: Log, *kinds: type) -> Log:
    return log._replace(records=tuple(record for record in log.records if not isinstance(record, kinds)))


def discs(world: World) -> list[Disc]:
    return [estimate.mean for estimate in world.estimates if estimate and isinstance(estimate.mean, Disc)]


@pytest.mark.slow
def test_detections_become_discs_with_their_covariances() -> None:
    settings = MapSettings(radius=RADIUS, radius_sigma=0.02, start=START, velocity=Unicycle(0.01, 0.01, period=1.0))
    mapped = map_log(recorded(), settings, robot=ROBOT)
    assert (mapped.poses, mapped.association) == ("slam", "known")
    truth = {int(i): np.array([x, y]) for i, x, y in recorded().landmarks}
    assert {feature.identity for feature in mapped.slam.features} == set(truth)
    found = np.array([feature.mean for feature in mapped.slam.features])
    expected = np.array([truth[feature.identity or 0] for feature in mapped.slam.features])
    # Covariances are relative to the map, whose frame may be turned.
    motion = aligned(found, expected)
    errors = (motion(found) - expected) @ motion.R
    stated = np.array([estimate.covariance for estimate in mapped.world.estimates if estimate is not None])
    assert nees(errors, stated[:, :2, :2]).max() < 20.0
    assert np.hypot(*errors.T).max() < 0.2
    assert stated[:, 2, 2] == pytest.approx(0.02**2)
    assert np.array([disc.center for disc in discs(mapped.world)]) == pytest.approx(found)
    assert {disc.radius for disc in discs(mapped.world)} == {RADIUS}
    assert mapped.world.obstacles == tuple(e.mean for e in mapped.world.estimates if e is not None)
    assert mapped.world.risk is None
    np.testing.assert_allclose(mapped.trajectory[0, 1:], START, atol=0.1)
    np.testing.assert_allclose(mapped.trajectory[-1, 1:3], WAY[-1], atol=0.3)


@pytest.mark.slow
def test_confidence_grows_and_the_covariances_are_kept() -> None:
    plain, surer = (map_log(recorded(), robot=ROBOT, confidence=c).world for c in (None, 0.99))
    assert surer.risk.confidence == 0.99
    for before, after in zip(plain.obstacles, surer.obstacles, strict=True):
        assert after.polygon(1e-4).shapely().buffer(2e-4).covers(before.polygon(1e-4).shapely())
        assert after.area > before.area
    wider = regrow(surer, 0.999)
    assert all(b.area > a.area for a, b in zip(surer.obstacles, wider.obstacles, strict=True))
    errs = map_log(recorded(), MapSettings(robot_sigma=(0.1, 0.05)), robot=ROBOT, confidence=0.99).world
    np.testing.assert_allclose(np.diag(errs.risk.pose_covariance), [0.01, 0.01, 0.0025])
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
def test_stated_noise_counts_unless_told_otherwise() -> None:
    def spread(**settings: Any) -> float:
        world = map_log(log, MapSettings(fit_noise=False, **settings)).world
        return float(np.mean([np.trace(estimate.covariance) for estimate in world.estimates if estimate]))

    log = recorded(increments=True)
    log = log._replace(records=log.records[: len(log.records) // 2])
    loose: dict[str, Any] = {"range_bearing": RangeBearing(0.5, 0.2), "increment": PoseIncrement(0.05, 0.05, 0.05)}
    stated = spread()
    assert spread(**loose) == stated
    assert spread(**loose, stated_noise=False) > 2.0 * stated


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
def test_scans_are_matched_by_default_and_by_odometry_alone_they_drift() -> None:
    log = recorded(scanner=True)
    told = list[tuple[str, int, int]]()
    mapped = map_log(log, MapSettings(start=START), on_progress=lambda *step: told.append(step))
    drifting = map_log(log, MapSettings(start=START, poses="odometry"))
    assert told[-1][1] == told[-1][2] > 0
    assert (mapped.poses, mapped.slam, drifting.poses, drifting.slam) == ("match", None, "odometry", None)
    matching = mapped.figures()["matching"]
    assert matching["nodes"] > 10
    assert matching["relations"] >= matching["nodes"] - 1
    true = np.array([record[:3] for record in log.records if isinstance(record, Pose) and record.truth])
    t = mapped.trajectory[:, 0]
    places = np.column_stack([np.interp(t, true[:, 0], true[:, 1]), np.interp(t, true[:, 0], true[:, 2])])
    off = [float(np.hypot(*(m.trajectory[:, 1:3] - places).T).max()) for m in (mapped, drifting)]
    assert off[0] < 0.1 < off[1]
    assert any("drift" in note for note in drifting.notes)
    np.testing.assert_allclose(drifting.trajectory[0, 1:], START, atol=1e-6)


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
@pytest.mark.parametrize(("every", "low", "high"), [(0, 0.0, 0.05), (100, 0.0, 0.02), (5, 0.15, 0.3)])
def test_misread_identities_are_refused_be_they_few_or_many_or_the_first(every: int, low: float, high: float) -> None:
    log, records, seen, count = recorded(), list[Record](), set[int | None](), 0
    for record in log.records:
        if isinstance(record, Detection):
            count += 1
            if count % every == 0 if every else record.identity not in seen:
                record = record._replace(z=np.array([record.z[0], record.z[1] + 1.5]))
            seen.add(record.identity)
        records.append(record)
    mapped = map_log(log._replace(records=tuple(records)), MapSettings(start=START))
    assert low < mapped.slam.counts.outliers / count <= high
    found = np.array([disc.center for disc in discs(mapped.world)])
    assert np.hypot(*(found[:, None] - CENTRES).transpose(2, 0, 1)).min(axis=1).max() < 0.2


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
        assert found.slam.counts.repeated == 0
    assert off[1.0] == pytest.approx(off[0.1], abs=1e-6)
    assert off[0.1] < 0.1


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


def test_gaps_in_odometry_are_told() -> None:
    times = [0.1 * i for i in range(100)]
    steady: list[Record] = [Odometry(t, 0.5, 0.0) for t in times]
    later: list[Record] = [Odometry(130.0 + t, 0.5, 0.0) for t in times]
    assert gap_warnings(steady) == gap_warnings([]) == gap_warnings(steady[:1]) == []
    assert gap_warnings([record._replace(t=100.0 * record.t) for record in steady]) == []
    (gap,) = gap_warnings(steady + later)
    assert "a gap of 120 s from 9.9 s on" in gap
    assert "velocity" in gap
    (end,) = gap_warnings([*steady, Detection(40.0, np.ones(2))])
    assert "a gap of 30 s" in end
    (two,) = gap_warnings([Increment(r.t + d, 0.1, 0.0, 0.0) for d in (0.0, 30.0, 70.0) for r in steady])
    assert "a gap of 30 s from 39.9 s on (2 gaps in all)" in two
    assert "velocity" not in two


def unnamed(places: list[list[float]], read: NDArray[np.bool_]) -> SlamResult:
    """Read from the origin, whichever the rows say; a second an instant."""
    trajectory = np.column_stack([np.arange(float(len(read))), np.zeros((len(read), 3))])
    features = tuple(MapFeature(i, None, np.array(p), np.eye(2), 9) for i, p in enumerate(places))
    assignments = []
    for t, i in np.argwhere(read).tolist():
        x, y = places[i]
        z = np.array([np.hypot(x, y), np.arctan2(y, x)])
        assignments.append(Assignment(float(t), None, i, Detection(float(t), z)))
    counts = Counts(detections=len(assignments), used=len(assignments))
    return SlamResult(trajectory, np.zeros((len(read), 3, 3)), features, (), tuple(assignments), counts)


def test_maps_without_identities_are_certified_only_where_nothing_speaks_against_them() -> None:
    places = [[2.0, -2.0], [3.0, -1.0], [4.0, 0.0], [3.0, 1.0], [2.0, 2.0]]
    read = np.ones((100, 5), dtype=bool)
    result, estimates = unnamed(places, read), disc_estimates(places, [1e-4 * np.eye(2)] * 5, 0.05)
    assert association_doubts(result, estimates, "slam") == []
    # Of two maps of the same things, each is read half of the time.
    half = read.copy()
    half[50:, 1], half[:50, 2] = False, False
    (missed,) = association_doubts(unnamed(places, half), estimates, "slam")
    assert "read 80% of the times" in missed
    (close,) = association_doubts(result, disc_estimates(places, [0.1 * np.eye(2)] * 5, 0.05), "slam")
    assert "5 of 5 features lie less than 5 standard deviations" in close
    # Carried at 50 s: all is new.
    cut = np.zeros((100, 10), dtype=bool)
    cut[:50, :5] = cut[50:, 5:] = True
    far = [[-x, y] for x, y in places]
    both = disc_estimates(places + far, [1e-4 * np.eye(2)] * 10, 0.05)
    carried = association_doubts(unnamed(places + far, cut), both, "slam")
    assert any("before and after 50.000 s" in doubt for doubt in carried)
    assert not any("before and after" in doubt for doubt in association_doubts(unnamed(places + far, cut), both, "log"))
    lost = result._replace(counts=replace(result.counts, used=460))
    assert association_doubts(lost, estimates, "slam") == ["8% of the readings are of no feature"]


def test_a_log_of_two_clocks_and_scans_that_met_nothing() -> None:
    def scan(t: float, reading: float = 1.0) -> Scan:
        return Scan(t, np.array([reading, math.nan]), 0.0, 0.1, 5.0)

    moves: list[Record] = [Pose(0.0, 0.0, 0.0, 0.0), Increment(1.0, 1.0, 0.0, 0.0), Increment(3.0, 1.0, 0.0, 0.0)]
    assert log_warnings([*moves, scan(3.0)], detected=False) == []
    (apart,) = log_warnings([*moves, scan(1.7e9)], detected=False)
    assert "odometry (1.000 to 3.000 s)" in apart
    assert "do not overlap" in apart
    (before,) = log_warnings([scan(0.5), *moves], detected=False)
    assert "do not overlap" in before
    # The last velocity holds on.
    assert log_warnings([Odometry(0.0, 1.0, 0.0), scan(9.0)], detected=False) == []
    for nothing in (math.inf, 5.0, math.nan):
        (blind,) = log_warnings([*moves, scan(1.0, nothing), scan(2.0, nothing), scan(3.0)], detected=False)
        assert "2 of 3 scans met nothing" in blind
