"""Scan matching against scans cast from known poses: bad first guesses, people, glass, short ranges, corridors."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.ray_casting import cast, room
from tests.helpers.trials import few

from trailmark.estimation.scan_matching import (
    LocalMap,
    PointCloud,
    Window,
    in_view,
    joined,
    local_map,
    match_covariance,
    point_cloud,
    refine,
    search,
)
from trailmark.se2 import FloatArray, wrap

OFFICE = (
    room(0.0, 0.0, 9.0, 6.0),
    shapely.union(shapely.box(5.0, 0.0, 5.15, 2.5), shapely.box(5.0, 3.5, 5.15, 6.0)),
    shapely.box(1.0, 4.4, 2.2, 5.2),
    shapely.box(7.0, 0.0, 7.6, 0.8),
)
CORRIDOR = (shapely.box(-60.0, 1.0, 60.0, 1.2), shapely.box(-60.0, -1.2, 60.0, -1.0))
WINDOW = Window(0.5, math.radians(20.0))


def scan_of(regions: tuple[shapely.Geometry, ...], pose: list[float], seed: int, **options: float) -> PointCloud:
    rng = np.random.default_rng(seed)
    return point_cloud(cast(regions, pose, sigma_range=0.015, sigma_bearing=0.002, rng=rng, **options), 20.0)  # type: ignore[arg-type]  # numbers


def area_of(regions: tuple[shapely.Geometry, ...], poses: list[list[float]]) -> LocalMap:
    return local_map(joined([scan_of(regions, pose, 10 + i) for i, pose in enumerate(poses)], np.array(poses)))


AREA = area_of(OFFICE, [[1.5, 2.0, 0.3], [2.5, 3.0, 0.0], [3.0, 2.0, 2.5]])


def match(area: LocalMap, cloud: PointCloud, guess: FloatArray) -> FloatArray:
    found = search(area, cloud.points, guess, WINDOW)
    return refine(area, cloud, found.pose).pose


@settings(max_examples=few(25), deadline=None)
@given(
    x=st.floats(-0.5, 0.5),
    y=st.floats(-0.5, 0.5),
    turn=st.floats(-20.0, 20.0),
    heading=st.floats(-0.5, 0.5),
    seed=st.integers(0, 99),
)
def test_a_first_guess_may_be_half_a_metre_and_twenty_degrees_off(
    x: float, y: float, turn: float, heading: float, seed: int
) -> None:
    true = np.array([2.0, 2.4, heading])
    found = match(AREA, scan_of(OFFICE, true.tolist(), seed), np.add(true, [x, y, math.radians(turn)]))
    assert np.hypot(*(found - true)[:2]) < 0.03
    assert abs(wrap(found[2] - true[2])) < math.radians(0.5)


@pytest.mark.parametrize("range_max", [4.0, 20.0])
def test_people_glass_and_short_ranges_are_no_obstacle(range_max: float) -> None:
    true = [2.0, 2.4, 0.2]
    people = [shapely.buffer(shapely.Point(x, y), 0.25) for x, y in ((3.2, 2.9), (2.6, 1.2), (1.2, 3.2))]
    cloud = scan_of((*OFFICE, *people), true, 3, range_max=range_max)
    # Glass: a tenth of the beams came back from far behind the wall.
    through = np.random.default_rng(0).random(len(cloud.points)) < 0.1
    points = np.where(through[:, None], 1.7 * cloud.points, cloud.points)
    found = match(AREA, PointCloud(points, cloud.normals, cloud.spacing), np.add(true, [0.4, -0.4, 0.3]))
    assert np.hypot(*(found - true)[:2]) < 0.05
    assert abs(found[2] - true[2]) < math.radians(1.0)


def test_the_direction_of_a_corridor_is_left_open() -> None:
    heading = 0.4
    turned = tuple(shapely.affinity.rotate(wall, heading, origin=(0, 0), use_radians=True) for wall in CORRIDOR)
    along = np.array([math.cos(heading), math.sin(heading)])
    area = area_of(turned, [[*(s * along), heading] for s in (-2.0, 0.0)])
    pose = np.array([*along, heading])
    covariance, is_open = match_covariance(area, scan_of(turned, pose.tolist(), 1).points, pose)
    assert is_open
    across = np.array([-along[1], along[0]])
    assert along @ covariance[:2, :2] @ along > 1.0
    assert across @ covariance[:2, :2] @ across < 0.05**2
    closed, is_open = match_covariance(AREA, scan_of(OFFICE, [2.0, 2.4, 0.2], 1).points, np.array([2.0, 2.4, 0.2]))
    assert not is_open
    assert np.sqrt(np.diag(closed)).max() < 0.05
    # What odometry knows holds the scan along the corridor, and the walls hold it across.
    guess = np.add(pose, [*(0.3 * along + 0.2 * across), 0.1])
    cloud = scan_of(turned, pose.tolist(), 2)
    information = np.diag([1.0 / 0.1**2, 1.0 / 0.1**2, 1.0 / 0.1**2])
    first = search(area, cloud.points, guess, WINDOW, information=information)
    found = refine(area, cloud, first.pose, information=information, guess=guess).pose
    assert abs(across @ (found - pose)[:2]) < 0.03
    assert abs(along @ (found - guess)[:2]) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(("gap", "is_open"), [(0.1, True), (math.inf, False)])
def test_beams_that_lie_metres_apart_do_not_hold_a_scan_along_a_corridor(gap: float, is_open: bool) -> None:
    """Where each end point counts for itself, the next scan seems to lie where its own come to lie on some."""
    walls, true = (shapely.box(-300, 25, 300, 27), shapely.box(-300, -27, 300, -25)), np.array([0.8, 0.0, 0.0])
    sigma, nees = np.array([0.03, 0.03, 0.01]), list[float]()
    for seed in range(8):
        rng = np.random.default_rng(seed)
        before, now = (
            point_cloud(cast(walls, [x, 0, 0], beams=200, field=math.tau, sigma_range=0.01, range_max=80, rng=rng), 80)
            for x in (0.0, true[0])
        )
        area, guess = local_map(before, gap=gap), true + sigma * rng.normal(size=3)
        first = search(area, now.points, guess, WINDOW, information=np.diag(1.0 / sigma**2))
        found = refine(area, now, first.pose, information=0.01 * np.diag(1.0 / sigma**2), guess=guess).pose
        covariance, opens = match_covariance(area, now.points, found, scatter=0.01)
        assert opens == is_open
        information = np.linalg.inv(covariance) + np.diag(1.0 / sigma**2)
        nees.append(float((found - true) @ information @ (found - true)) / 3.0)
    # What lines make of it is consistent, and what points alone would make of it far from that.
    assert (np.mean(nees) < 1.5) == is_open
    assert (max(nees) < 5.0) == is_open


@pytest.mark.slow
def test_the_search_finds_the_best_of_all_poses() -> None:
    """Branch and bound against trying each pose of the lattice."""
    true = np.array([2.0, 2.4, 0.2])
    points = scan_of(OFFICE, true.tolist(), 5).points[::6]
    guess, window = np.add(true, [0.21, -0.17, 0.06]), Window(0.4, 0.1)
    found = search(AREA, points, guess, window)
    step = AREA.cell / min(max(np.quantile(np.hypot(*points.T), 0.9), 1.0), 20.0)
    best = 0.0
    for turn in np.arange(-math.ceil(0.1 / step), math.ceil(0.1 / step) + 1) * step:
        c, s = math.cos(guess[2] + turn), math.sin(guess[2] + turn)
        at = np.floor((points @ [[c, s], [-s, c]] + guess[:2] - [AREA.x0, AREA.y0]) / AREA.cell).astype(int)
        for dx in range(-8, 9):
            for dy in range(-8, 9):
                row, column = np.add(at, [dx, dy]).T[::-1]
                inside = (row >= 0) & (row < AREA.nearest.shape[0]) & (column >= 0) & (column < AREA.nearest.shape[1])
                score = float(AREA.likelihood[0][row[inside], column[inside]].sum()) / 255.0 / len(at)
                best = max(best, score)
    assert found.score == pytest.approx(best, abs=1e-9)
    assert search(AREA, points, guess, window, min_score=best + 1e-6) is None
    other = search(AREA, points, guess, window, apart_from=found.pose)
    assert other is None or np.hypot(*(other.pose - found.pose)[:2]) >= 0.5


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=few(30), deadline=None)
def test_what_beams_reach_is_in_view_and_nothing_half_a_metre_behind_walls(seed: int) -> None:
    """By shapely: where rays along the bearing, and a hundredth of a radian beside it, first meet a wall."""
    walls = [room(-5.0, -4.0, 6.0, 5.0), shapely.box(2.0, 1.0, 3.0, 2.5), shapely.box(-3.0, -2.0, -2.5, 0.0)]
    points = np.random.default_rng(seed).uniform([-4.5, -3.5], [5.5, 4.5], (200, 2))
    bearing, distance = np.arctan2(points[:, 1], points[:, 0]), np.hypot(*points.T)
    points, bearing, distance = (a[np.abs(bearing) < 3.1] for a in (points, bearing, distance))  # beams begin behind
    cloud = point_cloud(cast(walls, (0.0, 0.0, 0.0), beams=720, field=2.0 * math.pi), 20.0)
    rays = bearing[:, None] + [-0.01, 0.0, 0.01]
    ends = 20.0 * np.stack([np.cos(rays), np.sin(rays)], axis=-1)
    lines = shapely.linestrings(np.stack([np.zeros_like(ends), ends], axis=-2))
    first = shapely.distance(shapely.intersection(lines, shapely.union_all(walls)), shapely.Point(0.0, 0.0))
    seen = in_view(cloud, points)
    reached, hidden = distance < first.min(axis=1) - 0.01, distance > first.max(axis=1) + 0.51
    assert reached.sum() > 100
    assert hidden.sum() > 2
    assert seen[reached].all()
    assert not seen[hidden].any()
