"""Worlds from scans: of rooms that are known, and of the Intel lab."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from tests.helpers.ray_casting import cast, end_points, room

from trailmark import Disc, Polygon, Rectangle, Robot, World
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.grid import EvidenceGrid
from trailmark.estimation.map_settings import MappingSettings
from trailmark.estimation.obstacles import ScanMap, find_obstacles, map_scans, wall_estimate
from trailmark.estimation.records import Scan
from trailmark.estimation.scan_features import DiscTracks, LineTracks, Observation, ScanSettings

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


@pytest.mark.slow
def test_walls_stand_where_they_are_within_what_they_are_known_by() -> None:
    found = mapped()
    assert found.walls >= 8
    # Faces that the robot saw, and where they are: (axis, place).
    faces = [(0, 0.0), (0, 10.0), (1, 0.0), (1, 5.0), (0, 4.9), (0, 5.1)]
    met = set()
    for estimate, readings in zip(found.world.estimates[: found.walls], found.readings, strict=False):
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
    (post,) = found.world.estimates[found.walls : found.walls + found.discs]
    assert isinstance(post.mean, Disc)
    assert (*post.mean.center, post.mean.radius) == pytest.approx((7.5, 3.5, 0.25), abs=0.03)
    assert post.covariance.shape == (3, 3)


@pytest.mark.slow
def test_the_door_is_open_and_passable_when_grown(tmp_path: Path) -> None:
    world = map_scans(scans(), settings=SETTINGS, robot=Robot.disc(0.2), confidence=0.99).world
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


def test_scans_that_show_nothing_make_a_world_nevertheless() -> None:
    empty = Scan(0.0, np.full(10, math.inf), 0.0, 0.1, 30.0, pose=(0.0, 0.0, 0.0))
    found = map_scans([empty])
    assert found.walls == found.discs == 0
    assert found.world.estimates == ()


@pytest.mark.slow
def test_a_robot_that_stands_is_no_surer_by_seeing_the_same_again() -> None:
    """And it holds no more end points, however long it stands."""
    once = scans()[:12]
    long = tuple(scan._replace(t=scan.t + 0.01 * k) for scan in once for k in range(6))
    short, standing = (map_scans(log, settings=SETTINGS) for log in (once, long))
    assert sum(map(len, standing.readings)) <= SETTINGS.confirm * sum(map(len, short.readings)) * 1.2
    assert standing.grid.hits.sum() == 6 * short.grid.hits.sum()
    assert standing.walls >= short.walls


CELL = 0.1
HERE = np.array([[1.05, 1.05, 0.0]])
SETTINGS_OBSTACLES = MappingSettings(cell=CELL, pose_sigma=(0.02, 0.01))
POSE = np.diag([4e-4, 4e-4, 1e-4])


def nothing() -> tuple[LineTracks, DiscTracks]:
    return LineTracks(0.99, POSE, 0.3), DiscTracks(0.99, POSE)


def open_grid() -> EvidenceGrid:
    """Six by four metres, all of which beams went through once."""
    grid = EvidenceGrid((0.0, 0.0, 6.0, 4.0), CELL)
    grid.passes[:] = 1
    return grid


def hit(grid: EvidenceGrid, rows: slice, columns: slice, times: int = 5, length: float = 2.0) -> None:
    grid.hits[rows, columns], grid.passes[rows, columns] = times, 0
    grid.variance[rows, columns] = times * (0.02**2 + (0.01 * length) ** 2)


def test_cells_that_nothing_explains_are_heaps() -> None:
    grid = open_grid()
    hit(grid, np.s_[20:23], np.s_[30:35], length=3.0)
    # Beside it, within three cells, what was seen from far away: no part of it.
    hit(grid, np.s_[20:23], np.s_[37:38], length=40.0)
    found = find_obstacles(*nothing(), grid, HERE, SETTINGS_OBSTACLES)
    assert (found.walls, found.discs, found.unknown) == ([], [], [])
    near, far = sorted(found.heaps, key=lambda heap: float(heap.mean.polygon().vertices[:, 0].min()))
    assert isinstance(near.mean, Polygon)
    assert shapely.hausdorff_distance(near.mean.shapely(), shapely.box(3.0, 2.0, 3.5, 2.3)) < 1e-9
    for heap, away in ((near, 3.0), (far, 40.0)):
        assert heap.covariance == pytest.approx((4e-4 + 4e-4 + (0.01 * away) ** 2) * np.eye(2))


def test_what_is_cut_off_or_unseen_is_blocked() -> None:
    grid = open_grid()
    grid.passes[:, 40:] = 0
    grid.passes[5, 20] = 0
    hit(grid, np.s_[:], np.s_[30:32])
    found = find_obstacles(*nothing(), grid, HERE, SETTINGS_OBSTACLES)
    blocked = shapely.union_all([shape.polygon().shapely() for shape in found.unknown])
    assert shapely.covers(blocked, shapely.box(4.0, 0.0, 6.0, 4.0))
    # Behind the wall beams went, but no robot came there; one unseen cell among free ones is none.
    assert shapely.covers(blocked, shapely.box(3.4, 0.1, 4.0, 3.9))
    assert shapely.distance(blocked, shapely.box(0.0, 0.0, 2.9, 4.0)) > 0.0
    free = find_obstacles(*nothing(), grid, HERE, MappingSettings(cell=CELL, unknown="free"))
    assert free.unknown == []


def test_a_wall_that_is_gone_is_no_wall() -> None:
    grid = open_grid()
    lines, discs = nothing()
    points = np.column_stack([np.linspace(1.0, 3.0, 60), np.full(60, 2.05)])
    lines.update([Observation(np.array([2.05, 0.5 * math.pi]), 1e-4 * np.eye(2), np.zeros((2, 2)), points)])
    assert find_obstacles(lines, discs, grid, HERE, SETTINGS_OBSTACLES).walls == []
    post = np.array([3.0, 1.0, 0.2])
    discs.update([Observation(post, 1e-4 * np.eye(3), np.zeros((3, 3)), post[:2] - [[0.2, 0.0], [0.1, 0.17]])])
    assert find_obstacles(lines, discs, grid, HERE, SETTINGS_OBSTACLES).discs == []
    hit(grid, np.s_[8:13], np.s_[27:31])
    grid.passes[8:13, 28:33] = 0  # beams end at it, and none goes through
    ((disc, _),) = find_obstacles(lines, discs, grid, HERE, SETTINGS_OBSTACLES).discs
    assert disc.covariance.shape == (3, 3)


def test_a_disc_that_beams_went_through_is_none() -> None:
    """Two faces at the end of a wall fit a circle that reaches into free space: cells stand for it."""
    for free in (0, 1):
        grid = open_grid()
        _, discs = nothing()
        points = np.array([[2.75, 0.85], [2.75, 0.95], [2.75, 1.05], [2.85, 0.85], [2.95, 0.85]])
        hit(grid, np.s_[8:11], np.s_[27:28])
        hit(grid, np.s_[8:9], np.s_[28:30])
        # Behind the faces, where the circle bulges: in sight, or not.
        grid.passes[9:13, 28:33] = free
        discs.update([Observation(np.array([3.0, 1.05, 0.3]), 1e-4 * np.eye(3), np.zeros((3, 3)), points)])
        found = find_obstacles(*(nothing()[0], discs), grid, HERE, SETTINGS_OBSTACLES)
        assert (len(found.discs), len(found.heaps)) == ((0, 1) if free else (1, 0))


angles = st.floats(-math.pi, math.pi)


def corners(rho: float, alpha: float, low: float, high: float, thickness: float) -> np.ndarray:
    """The wall's corners, front first: points of the line at two places along it, and those behind."""
    n, t = np.array([math.cos(alpha), math.sin(alpha)]), np.array([-math.sin(alpha), math.cos(alpha)])
    front = np.array([rho * n + low * t, rho * n + high * t])
    return np.concatenate([front, front[::-1] + thickness * n])


@given(st.floats(-9, 9), angles, st.floats(-9, 9), st.floats(0.1, 9), st.floats(0.05, 0.5))
def test_a_wall_stands_behind_its_line(rho: float, alpha: float, low: float, length: float, thickness: float) -> None:
    estimate = wall_estimate((rho, alpha), np.zeros((2, 2)), (low, low + length), thickness=thickness)
    assert isinstance(estimate.mean, Rectangle)
    expected = shapely.Polygon(corners(rho, alpha, low, low + length, thickness))
    assert shapely.hausdorff_distance(estimate.mean.polygon().shapely(), expected) < 1e-9


@given(st.floats(-5, 5), angles, st.floats(-9, 9), st.floats(0.5, 9), st.integers(0, 2**32 - 1))
def test_a_walls_covariance_is_that_of_its_line(rho: float, alpha: float, low: float, length: float, seed: int) -> None:
    """Moving the line a little moves the wall's front, across itself, as the rectangle's covariance says."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(2, 2)) * 1e-3
    covariance, thickness = a @ a.T, 0.1
    estimate = wall_estimate((rho, alpha), covariance, (low, low + length), thickness=thickness, end_sigma=2e-3)
    # The line's displacement across itself at a place s along it: δρ − s·δα.
    for s in (low, low + 0.5 * length, low + length):
        g = np.array([1.0, -s])
        across = float(g @ covariance @ g)
        x, y = (low + 0.5 * length), s
        # The front's point at s, seen from the rectangle's centre: along by s − m, across by half the thickness.
        u = np.array([math.cos(alpha), math.sin(alpha)])
        arm = (y - x) * np.array([-u[1], u[0]]) - 0.5 * thickness * u
        row = np.array([*u, u @ np.array([-arm[1], arm[0]]), 0.0])
        assert float(row @ estimate.covariance @ row) == pytest.approx(across, rel=1e-6, abs=1e-15)
    # Each end moves along the line by itself.
    t = np.array([-math.sin(alpha), math.cos(alpha)])
    arm = 0.5 * thickness * np.array([math.cos(alpha), math.sin(alpha)])
    for end in (-0.5, 0.5):
        row = np.array([*t, t @ np.array([arm[1], -arm[0]]), end])
        assert float(row @ estimate.covariance @ row) == pytest.approx(4e-6, rel=1e-3)


coordinate = st.floats(-0.7, 4.7)


@pytest.mark.slow
@given(st.tuples(coordinate, coordinate), st.tuples(coordinate, coordinate), st.booleans(), st.floats(0.0, 3.0))
def test_a_beam_counts_in_the_cells_that_it_crosses(
    start: tuple[float, float], end: tuple[float, float], met: bool, margin: float
) -> None:
    grid = EvidenceGrid((0.0, 0.0, 4.0, 3.0), 0.25)
    a, b = np.array(start), np.array(end)
    length = float(np.hypot(*(b - a)))
    grid.add(a, b[None], np.array([met]), margin, (0.1, 0.1))
    assert grid.passes.max() <= 1
    t = np.linspace(0.0, 1.0, 2001)
    steps = np.floor((a + t[:, None] * (b - a)) / 0.25).astype(int)
    last = np.floor(b / 0.25).astype(int)
    # Padded by a cell: what lies next to the steps may be crossed by rounding.
    near = np.zeros((14, 18), dtype=bool)
    kept = (steps >= -1).all(axis=1) & (steps[:, 0] <= 16) & (steps[:, 1] <= 12)
    for i, j in np.unique(steps[kept], axis=0):
        near[max(0, j) : j + 3, max(0, i) : i + 3] = True
    assert (grid.passes[~near[1:-1, 1:-1]] == 0).all()
    # Cells that are crossed over a length that no rounding makes up.
    before_hit = ~((steps == last).all(axis=1) | (t * length > length - margin * 0.25)) | (not met)
    own = kept & before_hit & (steps >= 0).all(axis=1) & (steps[:, 0] < 16) & (steps[:, 1] < 12)
    counts = np.zeros((12, 16), dtype=int)
    np.add.at(counts, (steps[own, 1], steps[own, 0]), 1)
    assert length < 1e-300 or (grid.passes[counts > 5] == 1).all()
    hit = met and length > 0.0 and 0.0 <= b[0] < 4.0 and 0.0 <= b[1] < 3.0
    assert grid.hits.sum() == int(hit)
    if hit:
        assert grid.hits[last[1], last[0]] == 1
        assert grid.passes[last[1], last[0]] == 0
        assert grid.variance.sum() == pytest.approx(0.01 + (0.1 * length) ** 2, rel=1e-5)


def test_what_was_there_and_is_gone_is_free() -> None:
    grid = EvidenceGrid((0.0, 0.0, 4.0, 1.0), 0.1)
    start, near, far = np.array([0.05, 0.55]), np.array([[2.05, 0.55]]), np.array([[3.05, 0.55]])
    for _ in range(3):
        grid.add(start, near, np.array([True]))
    assert grid.occupied()[5, 20]
    for _ in range(20):
        grid.add(start, far, np.array([True]))
    assert not grid.occupied()[5, 20]
    assert grid.occupied()[5, 30]
    assert grid.centres(grid.occupied()) == pytest.approx(np.array([[3.05, 0.55]]))
    rows, columns = grid.cells(np.array([[2.05, 0.55], [-9.0, 99.0]]))
    assert rows.tolist() == [5, 9]
    assert columns.tolist() == [20, 0]
