"""The poses of scans by matching: a loop of corridors driven with odometry that drifts, with its attacks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest
import shapely
from tests.helpers.ray_casting import cast, room
from tests.helpers.trials import few

from trailmark.estimation import MapSettings, map_log
from trailmark.estimation.laser_slam import ScanPoses, match_scans
from trailmark.estimation.pose_graph import GraphSettings, KeyScans, LoopFinder, Relation, judge_revisits
from trailmark.estimation.records import Increment, Log, Pose, Record, Scan
from trailmark.estimation.scan_matching import PointCloud, surface_cloud
from trailmark.estimation.virtual_sensors import Scanner
from trailmark.exploration.scan_mapper import graph_settings
from trailmark.se2 import FloatArray, between, compose

BLOCK = (
    room(0.0, 0.0, 24.0, 14.0),
    shapely.difference(shapely.box(2.5, 2.5, 21.5, 11.5), shapely.box(2.7, 2.7, 21.3, 11.3)),
    # Niches and pillars, all different.
    shapely.box(5.0, 0.0, 6.0, 0.5),
    shapely.box(14.0, 0.0, 14.4, 0.7),
    shapely.box(23.5, 4.0, 24.0, 5.5),
    shapely.box(9.0, 13.3, 11.0, 14.0),
    shapely.box(17.0, 13.6, 17.4, 14.0),
    shapely.box(0.0, 8.0, 0.6, 8.4),
    shapely.box(2.2, 4.0, 2.5, 6.0),
    shapely.box(12.0, 2.2, 13.0, 2.5),
)


@cache
def truth() -> FloatArray:
    corners = np.array([[1.2, 1.2], [22.8, 1.2], [22.8, 12.8], [1.2, 12.8], [1.2, 1.2], [9.0, 1.2]])
    poses = []
    for a, b in itertools.pairwise(corners):
        heading = math.atan2(*(b - a)[::-1])
        steps = np.arange(0.0, float(np.hypot(*(b - a))), 0.5)
        poses += [[*(a + s * np.array([math.cos(heading), math.sin(heading)])), heading] for s in steps]
    return np.array(poses)


@cache
def scans() -> tuple[Scan, ...]:
    rng = np.random.default_rng(0)
    return tuple(
        cast(BLOCK, pose.tolist(), sigma_range=0.015, sigma_bearing=0.002, rng=rng, t=float(i))
        for i, pose in enumerate(truth())
    )


@cache
def odometry() -> FloatArray:
    """It turns a degree too far each metre."""
    rng, poses = np.random.default_rng(1), [truth()[0]]
    for step in between(truth()[:-1], truth()[1:]):
        wrong = step * [1.03, 1.0, 1.0] + [0.0, 0.0, math.radians(0.5)] + rng.normal(size=3) * [0.01, 0.01, 0.01]
        poses.append(compose(poses[-1], wrong))
    return np.array(poses)


def drifting(true: FloatArray, sigmas: list[float], rng: np.random.Generator, scale: float = 1.0) -> FloatArray:
    """Return odometry along true poses, shape (n, 3): each step errs by standard deviations of x, y, theta."""
    poses = [true[0]]
    for step in between(true[:-1], true[1:]):
        poses.append(compose(poses[-1], step * [scale, 1.0, 1.0] + rng.normal(size=3) * sigmas))
    return np.array(poses)


@cache
def matched() -> ScanPoses:
    return match_scans(scans(), odometry())


def test_a_loop_is_closed_and_the_poses_are_right() -> None:
    found, true = matched(), truth()
    assert np.hypot(*(odometry() - true)[-1, :2]) > 4.0
    assert found.closures >= 1
    error = found.poses - true
    assert np.hypot(*error[:, :2].T).max() < 0.3
    # Where the robot came again, the two visits agree.
    again = np.flatnonzero(np.hypot(*(true[:, :2] - true[-1, :2]).T) < 0.6)
    seen = between(found.poses[again[:1]], found.poses[again[-1:]]) - between(true[again[:1]], true[again[-1:]])
    assert np.hypot(*seen[0, :2]) < 0.05


def test_covariances_are_those_of_the_errors_after_the_best_alignment() -> None:
    settings = GraphSettings(odometry=(0.05, 0.05), odometry_floor=(0.02, 0.02))
    found, true = match_scans(scans(), odometry(), settings), truth()
    a, b = true[:, :2] - true[:, :2].mean(axis=0), found.poses[:, :2] - found.poses[:, :2].mean(axis=0)
    turn = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    c, s = math.cos(turn), math.sin(turn)
    off = b @ [[c, -s], [s, c]] - a
    assert np.allclose(found.covariances, found.covariances.transpose(0, 2, 1))
    sigma = np.sqrt(found.covariances[:, 0, 0] + found.covariances[:, 1, 1])
    assert (np.hypot(*off.T) <= 3.0 * sigma).mean() > 0.99
    # And of the errors' size, though the scans scatter less than the settings have it.
    assert 0.3 < np.sqrt((sigma**2).mean() / (off**2).sum(axis=1).mean()) < 3.0


def test_scans_that_show_nothing_leave_odometry() -> None:
    blind = [scan._replace(ranges=np.full_like(scan.ranges, scan.range_max)) for scan in scans()[:10]]
    found = match_scans(blind, odometry()[:10])
    assert np.allclose(found.poses, odometry()[:10], atol=1e-6)


def test_no_more_nodes_than_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twice around: the later round stands on the first one's nodes."""
    once = slice(0, len(truth()) - 16, 2)
    true, seen = np.vstack([truth()[once]] * 2), [scan._replace(t=float(i)) for i, scan in enumerate(scans()[once] * 2)]
    one_round = len(true) // 2
    steps = between(true[:-1], true[1:])
    guess = [true[0]]
    for step in steps:
        guess.append(compose(guess[-1], step * [1.02, 1.0, 1.0] + [0.0, 0.0, math.radians(0.3)]))
    monkeypatch.setattr("trailmark.estimation.laser_slam.MAX_NODES", one_round)
    found = match_scans(seen, np.array(guess))
    assert len(found.keys) < 1.5 * one_round
    assert np.hypot(*(found.poses - true)[:, :2].T).max() < 0.3


def as_log(odometry: FloatArray) -> Log:
    records: list[Record] = [Pose(0.0, *odometry[0].tolist())]
    for before, here, scan in zip(odometry[[0, *range(len(odometry) - 1)]], odometry, scans(), strict=True):
        records += [Increment.between(scan.t, tuple(before), tuple(here)), scan._replace(pose=None)]
    return Log("block", tuple(records), np.empty((0, 3)))


def test_revisits_tell_a_right_map_from_a_bent_one_and_from_a_wrong_closure(monkeypatch: pytest.MonkeyPatch) -> None:
    right, bent = matched().revisits, truth().copy()
    assert right.scans >= 5
    assert right.off < 0.1
    bent[40:] = compose(compose(bent[40], np.array([0.0, 0.0, 0.05])), between(bent[40], bent[40:]))
    keys = KeyScans(0.8)
    for scan, pose in zip(scans(), bent, strict=True):
        keys.add(surface_cloud(scan, 20.0), pose, np.zeros((3, 3)))
    off = judge_revisits(keys, [Relation(0, 1, between(bent[0], bent[1]), np.eye(3))], GraphSettings()).off
    assert off > 0.4

    def wrong(_: LoopFinder, k: int) -> list[Relation]:
        """The last scan lies two metres beside the first."""
        place = np.array([2.0, 2.0, 0.0])
        return [Relation(0, k, place, 1e-6 * np.eye(3))] if k == 150 else []

    monkeypatch.setattr(LoopFinder, "find", wrong)
    mapped = map_log(as_log(odometry()), MapSettings(poses="match"))
    assert mapped.figures()["matching"]["revisits"]["off"] > 0.4
    assert any("seen again do not look as before" in warning for warning in mapped.warnings)


def test_places_that_look_alike_close_no_loop() -> None:
    """A comb of equal rooms along a corridor, there and back: each looks like the next, and odometry drifts as far."""
    walls = (room(0.0, 0.0, 24.0, 5.0), *(shapely.box(4.0 * k - 0.1, 1.5, 4.0 * k + 0.1, 5.0) for k in range(7)))
    doors = [shapely.box(4.0 * k + 1.5, 1.4, 4.0 * k + 2.5, 1.6) for k in range(6)]
    front = shapely.difference(shapely.box(0.0, 1.4, 24.0, 1.6), shapely.union_all(doors))
    poses, up = [], 0.5 * math.pi
    for x in 4.0 * np.arange(6):
        poses += [[x + s, 0.7, 0.0] for s in (0.5, 1.0, 1.5)] + [[x + 2.0, 0.7, turn] for turn in (0.0, 0.5 * up, up)]
        poses += [[x + 2.0, y, up] for y in (1.2, 1.7, 2.2, 2.7)] + [[x + 2.0, y, -up] for y in (2.2, 1.7, 1.2, 0.7)]
        poses += [[x + 2.0, 0.7, -0.5 * up]] + [[x + s, 0.7, 0.0] for s in (2.5, 3.0, 3.5)]
    poses += [[23.5, 0.7, turn] for turn in (0.8, 1.6, 2.4, 3.14)]
    true = np.array([*poses, *([x, 0.7, math.pi] for x in np.arange(23.0, 0.5, -0.5))])
    rng = np.random.default_rng(1)
    seen = [
        cast((*walls, front), pose.tolist(), range_max=6.0, sigma_range=0.015, rng=rng, t=float(i))
        for i, pose in enumerate(true)
    ]
    found = match_scans(seen, drifting(true, [0.05, 0.03, 0.05], rng, scale=1.08))
    assert np.hypot(*(found.poses - true)[:, :2].T).max() < 1.0  # 4 m where the next room is taken for it


@pytest.mark.parametrize("seed", [8, 1, 10][: few(3)])
def test_a_place_seen_from_the_other_side_closes_no_loop_along_the_corridor(seed: int) -> None:
    """No map has what a laser that looked ahead had behind it, the end wall; shifted along, most of the rest fits."""
    corners = np.array([[1.2, 1.2], [22.8, 1.2], [22.8, 12.8], [1.2, 12.8], [1.2, 1.2]])
    poses = []
    for a, b in itertools.pairwise([*corners, *corners[-2::-1]]):
        steps = np.arange(0.0, float(np.hypot(*(b - a))), 1.0)
        poses += [[*(a + s * (b - a) / np.hypot(*(b - a))), math.atan2(*(b - a)[::-1])] for s in steps]
    true, rng = np.array(poses), np.random.default_rng(seed)
    seen = [
        cast(BLOCK, p, range_max=6.0, sigma_range=0.015, sigma_bearing=0.002, rng=rng, t=float(i))
        for i, p in enumerate(true.tolist())
    ]
    found = match_scans(seen, drifting(true, [0.03, 0.02, 0.02], rng, scale=1.02))
    assert found.closures >= 2
    assert np.hypot(*(found.poses - true)[:, :2].T).max() < 0.5  # 2.2 m where such a loop is closed


CORRIDOR = (shapely.box(-60.0, -1.3, 60.0, -1.2), shapely.box(-60.0, 1.2, 60.0, 1.3))


@pytest.mark.parametrize("turn", [81.0, -120.0])
@pytest.mark.parametrize(
    ("world", "place", "decides"), [(BLOCK, (1.2, 1.2, 0.3), True), (CORRIDOR, (0.0, 0.0, 0.0), False)]
)
def test_a_turn_that_odometry_lacks_is_found_by_the_scan_or_said(
    turn: float, world: Sequence[shapely.Geometry], place: tuple[float, float, float], decides: bool
) -> None:
    """The robot turns where it stands, and its odometry is lost meanwhile."""
    ahead = [compose(np.array([*place]), np.array([0.1 * k, 0.0, 0.0])) for k in range(8)]
    turned = compose(ahead[-1], np.array([0.0, 0.0, math.radians(turn)]))
    true = np.array([*ahead, *(compose(turned, np.array([0.1 * k, 0.0, 0.0])) for k in range(8))])
    odometry = true.copy()
    odometry[8:] = compose(true[7], between(true[8], true[8:]))
    rng = np.random.default_rng(0)
    seen = [
        cast(world, pose, beams=360, field=2.0 * math.pi, rng=rng, sigma_range=0.015, t=float(i))
        for i, pose in enumerate(true.tolist())
    ]
    found = match_scans(seen, odometry, missing=np.arange(16) == 8)
    assert found.unplaced == (() if decides else (8,))
    if decides:
        assert found.relocated == (8,)
        assert np.abs(found.poses - true).max() < 0.05


def test_odometry_that_jumps_or_slips_is_not_believed() -> None:
    true = truth()[:40]
    steps = between(true[:-1], true[1:])
    steps[12] = [25.0, -3.0, 2.0]
    steps[25] = [0.5, 0.0, 1.2]
    guess = [true[0]]
    for step in steps:
        guess.append(compose(guess[-1], step))
    found = match_scans(scans()[:40], np.array(guess))
    assert np.hypot(*(found.poses - true)[:, :2].T).max() < 0.3


@pytest.mark.parametrize(
    ("apart", "settings"),
    [(3.0, GraphSettings()), (0.8, GraphSettings(scale=8.0))],
    ids=["scans far apart", "nodes far apart"],
)
def test_a_robot_that_drives_back_was_not_carried_there(apart: float, settings: GraphSettings) -> None:
    """Steps longer than any window lead along a corridor, which holds no scan, to nodes of the way there."""
    hall = (room(0.0, 0.0, 60.0, 4.0), shapely.box(3.0, 0.0, 4.0, 1.0), shapely.box(56.0, 3.0, 57.0, 4.0))
    there = np.arange(8.0, 52.0, apart)
    x = np.concatenate([there, there[::-1]])
    true = np.column_stack([x, np.full_like(x, 2.0), np.zeros_like(x)])
    rng = np.random.default_rng(0)
    seen = [
        cast(hall, p, field=2.0 * math.pi, sigma_range=0.01, rng=rng, t=float(i)) for i, p in enumerate(true.tolist())
    ]
    found = match_scans(seen, drifting(true, [0.02, 0.01, 0.001], rng), settings)
    steps = between(found.poses[:-1], found.poses[1:]) - between(true[:-1], true[1:])
    assert np.hypot(*steps[:, :2].T).max() < 0.25
    assert np.hypot(*(found.poses - true)[:, :2].T).max() < 1.5


@pytest.mark.parametrize("apart", [2.0, 3.0])
def test_a_scan_that_shows_new_things_does_not_say_that_the_robot_stands(apart: float) -> None:
    """Seen from where the last scan was taken, all would be as it was; half of the field ahead is new."""
    corners = np.array([[22.8, 6.0], [22.8, 12.8], [1.2, 12.8], [1.2, 1.2], [1.2, 12.8], [22.8, 12.8]])
    poses = []
    for a, b in itertools.pairwise(corners):
        ways = np.arange(0.0, float(np.hypot(*(b - a))), apart)
        poses += [[*(a + s * (b - a) / np.hypot(*(b - a))), math.atan2(*(b - a)[::-1])] for s in ways]
    true, rng = np.array(poses), np.random.default_rng(0)
    seen = [
        cast(BLOCK, p, sigma_range=0.015, sigma_bearing=0.002, rng=rng, t=float(i)) for i, p in enumerate(true.tolist())
    ]
    found = match_scans(seen, drifting(true, [0.05, 0.03, 0.03], rng, scale=1.02))
    steps = between(found.poses[:-1], found.poses[1:]) - between(true[:-1], true[1:])
    assert np.hypot(*steps[:, :2].T).max() < 1.0  # what the window is worth


def test_backwards_out_of_a_corridor_a_robot_that_looks_ahead_is_where_odometry_says() -> None:
    """Most of what it sees at its sides is new, and would fit the best if it had not moved; a laser of 80 m."""
    hall = (room(0.0, 0.0, 70.0, 4.0), shapely.box(3.0, 0.0, 4.0, 1.0), shapely.box(66.0, 3.0, 67.0, 4.0))
    x = np.arange(62.0, 8.0, -0.8)
    true = np.column_stack([x, np.full_like(x, 2.0), np.zeros_like(x)])
    rng = np.random.default_rng(0)
    seen = [cast(hall, p, range_max=80.0, sigma_range=0.01, rng=rng, t=float(i)) for i, p in enumerate(true.tolist())]
    guess = drifting(true, [0.01, 0.003, 0.0003], rng)
    settings = graph_settings(
        Scanner(180, math.pi, 80.0, sigma=0.01), np.array([0.01**2, 0.0003**2]) * len(x), 0.8 * len(x), False
    )
    found = match_scans(seen, guess, settings)
    assert np.abs(found.poses - true)[:, 0].max() < 0.5


def test_the_other_face_of_a_thin_wall_is_not_taken_for_the_known_one() -> None:
    """Behind a door hardly anything but the wall's other face holds the scan along the way."""
    wall = shapely.difference(shapely.box(0.0, 5.0, 8.0, 5.18), shapely.box(3.6, 4.0, 4.4, 6.0))
    rooms = (room(0.0, 0.0, 8.0, 14.0), wall)
    true = np.column_stack([np.full(26, 4.0), 2.5 + 0.2 * np.arange(26), np.full(26, math.pi / 2)])
    seen = [
        cast(rooms, pose.tolist(), beams=360, field=2.0 * math.pi, range_max=4.5, t=float(i))
        for i, pose in enumerate(true)
    ]
    rng = np.random.default_rng(0)
    odometry = true + np.cumsum(rng.normal(0.0, [0.004, 0.004, 0.001], true.shape), axis=0)
    settings = GraphSettings(max_range=4.5, scatter=0.01, odometry=(0.03, 0.03), odometry_floor=(0.03, 0.01))
    found = match_scans(seen, odometry, settings).poses
    assert np.hypot(*(found - found[0] - true + true[0])[:, :2].T).max() < 0.05


@pytest.mark.parametrize("seed", [2, 4, 13, 28][: few(4, of=2)])
def test_a_door_in_a_thin_wall_that_is_passed_aslant_shifts_no_pose(seed: int) -> None:
    """The wall's known face is near to where the other one should be, and much of what is seen lies on it."""
    rng = np.random.default_rng(seed)
    walls = shapely.union_all([shapely.box(0.0, y, 19.0, y + 0.2) for y in (5.58, 7.56)])
    doors = [shapely.box(2.64, 5.0, 4.0, 6.0), shapely.box(3.64, 7.0, 4.96, 8.0)]
    rooms = (
        room(0.0, 0.0, 19.0, 13.0),
        shapely.difference(walls, shapely.union_all(doors)),
        shapely.box(5.84, 0.0, 6.04, 5.68),
    )
    before, door = np.array([rng.uniform(3.6, 4.2), 6.4]), np.array([rng.uniform(3.3, 3.7), 5.7])
    behind = [rng.uniform(2.4, 4.2), rng.uniform(3.8, 4.6)]
    parts = (([4.6, 9.0], [before[0] + 0.6, 6.8], 26), (before, door, 8), (door, behind, 17))
    places = np.vstack([np.linspace(*part) for part in parts])
    true = np.column_stack([places, np.full(len(places), rng.uniform(-math.pi, math.pi))])
    seen = [
        cast(rooms, pose.tolist(), beams=785, field=2.0 * math.pi, range_max=5.0, sigma_range=0.01, rng=rng, t=float(i))
        for i, pose in enumerate(true)
    ]
    odometry = true + np.cumsum(rng.normal(0.0, [0.012, 0.012, 0.002], true.shape), axis=0)
    settings = GraphSettings(max_range=5.0, scatter=0.01, odometry=(0.09, 0.03), odometry_floor=(0.036, 0.011))
    found = match_scans(seen, odometry, settings).poses
    assert np.hypot(*(found - found[0] - true + true[0])[:, :2].T).max() < 0.05


def test_the_map_of_a_chain_is_as_unsure_as_its_scans_beside_one_of_them() -> None:
    """Against poses drawn step by step."""
    rng, keys = np.random.default_rng(0), KeyScans(math.inf)
    shapes = rng.normal(size=(9, 3, 3)) * 0.01
    steps = shapes @ shapes.transpose(0, 2, 1)
    for i, step in enumerate(steps):
        keys.add(PointCloud(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)), np.array([i, 0.0, 0.0]), step)
    drawn = np.cumsum(np.einsum("nij,knj->kni", shapes, rng.normal(size=(20_000, 9, 3))), axis=1)
    for middle in (2, 4, 7):
        chain = np.arange(2, 8)
        beside = drawn[:, chain] - drawn[:, middle, None]
        expected = np.einsum("kni,knj->ij", beside, beside) / (len(drawn) * len(chain))
        np.testing.assert_allclose(keys.spread(chain, middle), expected, atol=0.05 * np.abs(expected).max())
    assert not keys.spread(np.array([3]), 3).any()
