"""Worlds from scans: of rooms that are known, and of the Intel lab."""

from __future__ import annotations

import gzip
import itertools
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely
from tests.estimation.ray_casting import cast, end_points, room

from trailmark.estimation.errors import EstimationError
from trailmark.estimation.map_settings import MappingSettings
from trailmark.estimation.obstacles import ScanMap, map_scans
from trailmark.estimation.records import Log, Pose, Scan
from trailmark.estimation.scan_features import ScanSettings
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import Robot, World

OUTER = room(0.0, 0.0, 10.0, 5.0)
PARTITION = shapely.union(shapely.box(4.9, 0.0, 5.1, 2.0), shapely.box(4.9, 3.0, 5.1, 5.0))
POST = shapely.buffer(shapely.Point(7.5, 3.5), 0.25, quad_segs=64)
PERSON = shapely.buffer(shapely.Point(3.0, 2.5), 0.2)
BUILDING = (OUTER, PARTITION, POST)
SETTINGS = MappingSettings(scan=ScanSettings(sigma_range=0.015), pose_sigma=(0.005, 0.001))


def drive() -> np.ndarray:
    """Poses through both rooms and the door between them, turning all round in each."""
    way = np.concatenate([np.linspace([1.5, 2.5], [8.5, 2.5], 36), np.linspace([8.5, 2.5], [8.5, 1.5], 6)])
    turns = np.linspace(0.0, 6.0 * math.pi, len(way))
    return np.column_stack([way, turns])


@cache
def scans() -> tuple[Scan, ...]:
    rng = np.random.default_rng(0)
    found = []
    for i, pose in enumerate(drive()):
        things = (*BUILDING, PERSON) if i < 3 else BUILDING
        found.append(cast(things, pose.tolist(), sigma_range=0.015, sigma_bearing=0.002, rng=rng, t=0.5 * i))
    return tuple(found)


@cache
def mapped() -> ScanMap:
    return map_scans(scans(), settings=SETTINGS, robot=Robot.disc(0.2))


def regions(world: World) -> np.ndarray:
    return np.array([shape.polygon(1e-4).shapely() for shape in world.obstacles])


def open_at(world: World, point: shapely.Point) -> bool:
    free = shapely.distance(regions(world), point).min() > 0.0
    return bool(free and shapely.covers(shapely.box(*world.bounds), point))


@pytest.mark.slow
def test_scans_end_at_outlines_and_the_way_is_free() -> None:
    world, solid = mapped().world, regions(mapped().world)
    outlines = shapely.union_all([shapely.boundary(region) for region in solid])
    ends = np.concatenate([end_points(scan) for scan in scans()[3:]])
    assert (shapely.distance(outlines, shapely.points(ends)) <= 0.15).mean() > 0.98
    assert (shapely.distance(outlines, shapely.points(ends)) <= 0.05).mean() > 0.9
    way = shapely.LineString(drive()[:, :2])
    assert shapely.distance(solid, way).min() > 0.25
    assert world.robot == Robot.disc(0.2)
    assert shapely.covers(shapely.box(*world.bounds), shapely.points(ends)).all()


@pytest.mark.slow
def test_what_nobody_saw_is_blocked_or_free_as_asked() -> None:
    outside = shapely.points([[-0.2, 2.5], [5.0, 5.2], [10.2, 1.0], [7.5, 3.5]])
    blocked = regions(mapped().world)
    assert all(shapely.distance(blocked, point).min() == 0.0 for point in outside)
    world = map_scans(scans(), settings=MappingSettings(scan=SETTINGS.scan, unknown="free")).world
    free = regions(world)
    assert all(shapely.distance(free, point).min() > 0.0 for point in outside[:3])
    assert None not in world.estimates
    # What was seen is the same.
    assert shapely.distance(free, shapely.LineString(drive()[:, :2])).min() > 0.25


def test_walls_stand_where_they_are_within_what_they_are_known_by() -> None:
    found = mapped()
    assert found.walls >= 8
    # Faces that the robot saw, and where they are: (axis, place).
    faces = [(0, 0.0), (0, 10.0), (1, 0.0), (1, 5.0), (0, 4.9), (0, 5.1)]
    met = set()
    for estimate, readings in zip(found.world.estimates[: found.walls], found.readings, strict=False):
        assert estimate is not None
        wall = estimate.mean
        assert isinstance(wall, Rectangle)
        assert len(estimate.covariance) == 3
        front = shapely.union_all([shapely.boundary(region) for region in BUILDING])
        if wall.length < 0.5:
            continue
        axis, place = min(faces, key=lambda face: float(np.abs(readings[:, face[0]] - face[1]).mean()))
        met.add((axis, place))
        # The front lies half the thickness from the centre; where it truly is, is known to 4 standard deviations.
        off = abs(abs(wall.center[axis] - place) - 0.5 * wall.width)
        assert off < 4.0 * math.sqrt(estimate.covariance[axis, axis]) + 1e-3
        assert shapely.distance(front, shapely.points(readings)).max() < 0.1
    assert met == set(faces)


def test_posts_are_discs() -> None:
    found = mapped()
    assert found.discs == 1
    estimate = found.world.estimates[found.walls]
    assert estimate is not None
    assert isinstance(estimate.mean, Disc)
    assert estimate.mean.center == pytest.approx((7.5, 3.5), abs=0.03)
    assert estimate.mean.radius == pytest.approx(0.25, abs=0.03)
    assert estimate.covariance.shape == (3, 3)


def test_people_who_walk_on_leave_no_obstacle() -> None:
    assert shapely.distance(regions(mapped().world), shapely.Point(3.0, 2.5)).min() > 0.3


@pytest.mark.slow
def test_the_door_is_open_and_passable_when_grown(tmp_path: Path) -> None:
    world = map_scans(scans(), settings=SETTINGS, robot=Robot.disc(0.2), confidence=0.99).world
    assert world.risk is not None
    assert world.risk.confidence == 0.99
    assert math.fsum(e.share or 0.0 for e in world.estimates if e is not None) == pytest.approx(1.0)
    door = shapely.LineString([(4.5, 2.5), (5.5, 2.5)])
    assert 0.2 < shapely.distance(regions(world), door).min() < 0.5
    # Grown walls cover the true fronts along their stretches.
    for shape, readings in zip(world.obstacles[: mapped().walls], mapped().readings, strict=False):
        assert isinstance(shape, Polygon)
        front = shapely.union_all([shapely.boundary(region) for region in BUILDING])
        nearest = shapely.shortest_line(front, shapely.points(readings))
        true = shapely.get_coordinates(nearest).reshape(-1, 2, 2)[:, 0]
        assert (shapely.distance(shape.shapely(), shapely.points(true)) == 0.0).mean() > 0.97
    world.save(tmp_path / "w.yaml")
    assert World.load(tmp_path / "w.yaml") == world


def test_beams_that_meet_nothing_clear_the_way(monkeypatch: pytest.MonkeyPatch) -> None:
    wall = shapely.box(2.0, -0.5, 2.1, 0.5)
    views = [cast([wall], (0.0, 0.0, 0.01 * i), range_max=6.0) for i in range(5)]
    inside = shapely.Point(1.0, 3.0)
    for clear_range, cleared in ((4.0, True), (0.0, False)):
        monkeypatch.setattr("trailmark.estimation.obstacles.CLEAR_RANGE", clear_range)
        world = map_scans(views).world
        assert open_at(world, inside) == cleared
        assert not open_at(world, shapely.Point(1.0, 4.5))
    # Lost readings say nothing.
    lost = [view._replace(ranges=np.where(view.ranges < 6.0, view.ranges, math.nan)) for view in views]
    monkeypatch.setattr("trailmark.estimation.obstacles.CLEAR_RANGE", 4.0)
    world = map_scans(lost).world
    assert not open_at(world, inside)


@pytest.mark.slow
def test_cells_that_make_too_many_corners_are_doubled_unless_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    some = scans()[::6]
    assert map_scans(some, drive()[::6], settings=SETTINGS).grid.cell == 0.05
    monkeypatch.setattr("trailmark.formats.grid.MAX_CORNERS", 500)
    assert map_scans(some, drive()[::6], settings=SETTINGS).grid.cell == 0.1
    with pytest.raises(EstimationError, match="at most 500 corners"):
        map_scans(some, drive()[::6], settings=replace(SETTINGS, cell=0.05))


# --- Poses


@pytest.mark.slow
def test_poses_from_elsewhere() -> None:
    given = map_scans(scans()[:4], drive()[:4], settings=SETTINGS)
    own = map_scans(scans()[:4], settings=SETTINGS)
    assert np.allclose(given.poses[:, :2], own.poses[:, :2])
    assert given.walls == own.walls


# --- Bad input


def test_no_scans_and_poses_that_do_not_fit() -> None:
    with pytest.raises(EstimationError, match="log: expected one scan or more, got none"):
        map_scans(Log("log", (Pose(0.0, 0, 0, 0),), np.empty((0, 3))))
    with pytest.raises(EstimationError, match=r"expected shape \(3, 3\), one for each scan, got \(2, 3\)"):
        map_scans(scans()[:3], np.zeros((2, 3)))
    with pytest.raises(EstimationError, match="got 'odomtry'"):
        map_scans(scans()[:3], "odomtry")


def test_scans_that_show_nothing_make_a_world_nevertheless() -> None:
    empty = Scan(0.0, np.full(10, math.inf), 0.0, 0.1, 30.0, pose=(0.0, 0.0, 0.0))
    found = map_scans([empty])
    assert found.walls == found.discs == 0
    assert found.world.estimates == ()


# --- Real data


@pytest.mark.slow
def test_a_part_of_the_intel_lab(shared_data: Path, tmp_path: Path) -> None:
    from trailmark.estimation.readers import load_log

    file = shared_data / "carmen" / "intel-corrected.log.gz"
    if not file.is_file():
        pytest.skip("the Intel lab log is not among the data")
    with gzip.open(file, "rt") as whole:
        (tmp_path / "intel.log").write_text("".join(itertools.islice(whole, 1700)))
    seen = [record for record in load_log(tmp_path / "intel.log").records if isinstance(record, Scan)]
    found = map_scans(seen, robot=Robot.disc(0.2))
    solid = regions(found.world)
    tree, outlines = shapely.STRtree(solid), shapely.STRtree(shapely.boundary(solid))
    ends = np.concatenate([end_points(scan) for scan in seen])[::5]
    _, off = outlines.query_nearest(shapely.points(ends), return_distance=True, all_matches=False)
    assert (off <= 0.15).mean() >= 0.95
    _, room_left = tree.query_nearest(shapely.points(found.poses[:, :2]), return_distance=True, all_matches=False)
    assert (room_left >= 0.2).mean() >= 0.99
    assert len(seen) > 70
    assert found.walls > 40


@pytest.mark.slow
def test_a_robot_that_stands_is_no_surer_by_seeing_the_same_again() -> None:
    """And it holds no more end points, however long it stands."""
    once = scans()[:12]
    long = tuple(scan._replace(t=scan.t + 0.01 * k) for scan in once for k in range(6))
    short, standing = (map_scans(log, settings=SETTINGS) for log in (once, long))
    assert sum(map(len, standing.readings)) <= SETTINGS.confirm * sum(map(len, short.readings)) * 1.2
    assert standing.grid.hits.sum() == 6 * short.grid.hits.sum()
    assert standing.walls >= short.walls
