"""PathAuditor: verdict, intervals, obstacles and least clearance, against geometry that is known and shapely."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from trailmark import ConfigurationError, CurvePath, KeepOutZone, PathAudit, Robot, Steering, World, check_path, se2
from trailmark.shapes import Disc, Polygon, Rectangle, Shape

BOUNDS = (0.0, 0.0, 20.0, 20.0)
BOX = Rectangle((10.0, 10.0), 2.0, 2.0)
SQUARE = Robot.rectangle(1.0, 1.0)
L_ROBOT = Robot.polygon([[0.0, 0.0], [2.0, 0.0], [2.0, 0.5], [0.5, 0.5], [0.5, 2.0], [0.0, 2.0]])


def audit(obstacles: tuple[Shape, ...], robot: Robot, states: Any, **more: Any) -> PathAudit:
    return check_path(World("w", BOUNDS, obstacles, **more), robot, states)


@pytest.mark.slow
def test_a_robot_that_drives_through_a_box() -> None:
    found = audit((BOX,), SQUARE, [[5, 10.2, 0], [15, 10.2, 0]])
    (hit,) = found.collisions
    assert not found.free
    assert (hit.begin, hit.end) == pytest.approx((3.5, 6.5), abs=1e-6)
    assert hit.obstacle == 0
    assert hit.depth == pytest.approx(1.3, rel=1e-3)  # out by the upper side: half of both less 0.2
    assert hit.motions == pytest.approx((0.35, 0.65), abs=1e-6)
    assert (found.min_clearance, found.min_clearance_at) == (0.0, hit.begin)
    assert (found.length, found.rotation, found.cost) == (10.0, 0.0, 10.0)


def test_every_obstacle_met_has_its_own_intervals() -> None:
    discs = tuple(Disc((x, 10.0), 0.5) for x in (6.0, 8.0, 10.0))
    world = World("w", BOUNDS, (*discs, Disc((3.0, 3.0), 1.0)), ids=("first", None, "third", None))
    found = check_path(world, Robot.disc(0.5), np.array([[4, 10, 0], [12, 10, 0], [4, 10, math.pi]]))
    assert [c.obstacle for c in found.collisions] == ["first", 1, "third", "third", 1, "first"]
    assert [c.begin for c in found.collisions] == pytest.approx([1, 3, 5, 9, 11, 13], abs=1e-6)
    assert [c.depth for c in found.collisions] == pytest.approx([1.0] * 6, rel=1e-3)


def test_bounds_and_boundary() -> None:
    inside = Polygon(np.array([[2, 2], [18, 2], [18, 18], [2, 18.0]]))
    out = audit((), SQUARE, [[10, 10, 0], [19.7, 10, 0]])
    rows: list[Any] = [(c.obstacle, c.depth) for c in out.collisions]
    assert rows == [("bounds", pytest.approx(0.2, rel=1e-3))]
    over = audit((), SQUARE, [[10, 10, 0], [17.6, 10, 0], [10, 10, 0]], boundary=inside)
    rows = [(c.obstacle, c.depth) for c in over.collisions]
    assert rows == [("boundary", pytest.approx(0.1, rel=1e-3))]
    assert (over.collisions[0].begin, over.collisions[0].end) == pytest.approx((7.5, 7.7), abs=1e-6)
    both = audit((), Robot.disc(0.5), [[10, 10, 0], [25, 10, 0]], boundary=inside)
    assert {c.obstacle for c in both.collisions} == {"bounds", "boundary"}


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, 1e5, -3e6])
@pytest.mark.parametrize("robot", [SQUARE, L_ROBOT, Robot.disc(0.5)], ids=["square", "L", "disc"])
def test_touching_is_free_and_a_micrometre_deeper_is_not(robot: Robot, offset: float) -> None:
    # The lower edge of the robot slides along the upper edge of a wall, 8 m long.
    low = robot.footprint.bounding_box()[1]
    bounds = (offset, offset, offset + 20.0, offset + 20.0)
    wall = Rectangle((offset + 10.0, offset + 5.0), 12.0, 1.0)
    digits = 1e-9 * max(1.0, abs(offset) / 1e5)
    for gap, free in ((0.0, True), (5e-8, True), (-5e-8, True), (-1e-6, False), (1e-6, True)):
        y = offset + 5.5 - low + gap
        found = check_path(World("w", bounds, (wall,)), robot, [[offset + 6, y, 0], [offset + 14, y, 0]])
        assert found.free == free, gap
        if free:
            assert found.min_clearance == pytest.approx(max(0.0, gap), abs=2e-7 + digits)


@pytest.mark.slow
def test_touching_while_turning() -> None:
    # A regular 64-gon turns in place, its corners passing a wall at a distance of 1e-8 m, then a micrometre deep.
    angles = 2 * math.pi * np.arange(64) / 64
    robot = Robot.polygon(np.column_stack([np.cos(angles), np.sin(angles)]).tolist())
    for gap, free in ((1e-8, True), (-1e-6, False)):
        wall = Rectangle((10.0, 8.5 - gap), 20.0, 1.0)
        found = audit((wall,), robot, [[10, 10, 0.02], [10, 10, 3.0], [10, 10, -0.5]])
        assert found.free == free
        assert found.length == 0.0
        if not free:
            assert all(c.begin == c.end == 0.0 for c in found.collisions)
            assert 28 <= len(found.collisions) <= 62  # each corner that passes
            assert found.max_curvature == math.inf
            assert found.to_dict("w")["max_curvature"] is None


@pytest.mark.parametrize("robot", [SQUARE, Robot.disc(0.5)], ids=["square", "disc"])
def test_a_motion_that_is_longer_than_places_along_it_can_be_told_apart(robot: Robot) -> None:
    far = 1e7
    world = World("wide", (-far, -far, far, far), (Disc((0.0, 0.0), 1.0), Rectangle((4.0, 5.0), 2.0, 2.0)))
    found = check_path(world, robot, [(1.0 - far, -0.25, 0.0), (far, -0.25, 0.0)])
    assert [hit.obstacle for hit in found.collisions] == [0, "bounds"]
    found = check_path(world, robot, [(1.0 - far, 1.5, 0.0), (far - 1.0, 1.5, 0.0)])
    assert found.free
    assert found.min_clearance <= 0.5 + 5e-7


@pytest.mark.parametrize("robot", [SQUARE, Robot.disc(0.5)], ids=["square", "disc"])
def test_a_turn_in_place_has_places_of_its_own_for_a_disc_too(robot: Robot) -> None:
    found = audit((BOX,), robot, [[10, 10, 0], [10, 10, 2], [15, 10, 2], [15, 10, 3]])
    (hit,) = found.collisions
    assert hit.motions[0] == 0.0
    assert 1.0 < hit.motions[1] < 2.0
    assert hit.begin == 0.0
    turned = audit((BOX,), robot, [[5, 10, 0], [10, 10, 0], [10, 10, 2]]).collisions[0]
    assert turned.motions[1] == 2.0
    assert turned.end == 5.0
    assert audit((BOX,), robot, [[10, 10, 0], [10, 10, 2]]).collisions[0].motions == (0.0, 1.0)


@pytest.mark.parametrize("robot", [SQUARE, Robot.disc(0.5)], ids=["square", "disc"])
def test_a_keep_out_zone_may_be_left_after_a_turn_in_place(robot: Robot) -> None:
    zones = (KeepOutZone(Polygon(np.array([[1.0, 1.0], [5.0, 1.0], [5.0, 5.0], [1.0, 5.0]]))),)
    assert audit((), robot, [[3, 3, 0], [3, 3, 1.5], [3, 12, 1.5]], zones=zones).free
    assert not audit((), robot, [[3, 3, 0], [3, 3, 1.5], [3, 12, 1.5], [3, 3, 1.5]], zones=zones).free
    assert not audit((), robot, [[3, 3, 0], [3, 3, 1.5]], zones=zones).free


def test_wholly_inside_an_obstacle_and_inside_a_hole() -> None:
    ring = Polygon(
        np.array([[2, 2], [18, 2], [18, 18], [2, 18.0]]), (np.array([[6, 6], [14, 6], [14, 14], [6, 14.0]]),)
    )
    small = Robot.rectangle(0.4, 0.2)
    inside = audit((ring,), small, [[3, 4, 0], [4, 4, 2.0]])
    (hit,) = inside.collisions
    assert hit.motions == pytest.approx((0.0, 1.0))
    hole = audit((ring,), small, [[8, 8, 0], [12, 12, 3.0]])
    assert hole.free
    through = audit((ring,), small, [[10, 10, 0], [1, 10, 0]])
    rows: list[Any] = [(c.begin, c.end) for c in through.collisions]
    assert rows == [(pytest.approx(3.8, abs=1e-6), pytest.approx(8.2, abs=1e-6))]
    whole = audit((Disc((10, 10), 3.0),), small, [[10, 10, 0], [10, 10, 0]])
    rows = [(c.begin, c.end, c.obstacle) for c in whole.collisions]
    assert rows == [(0.0, 0.0, 0)]
    assert whole.collisions[0].depth == pytest.approx(3.1, rel=2e-3)


def test_a_car_s_curve_is_audited_not_the_chords_of_its_states() -> None:
    steering = Steering(4.0)
    path = CurvePath(np.array([[5.0, 5.0, 0.0], [9.0, 9.0, math.pi / 2]]), steering)
    car = Robot.rectangle(1.0, 0.5).steered(4.0)
    # A wall that the arc's outer corner passes at 2 µm.
    places = path.resample(1e-3).states
    corner = se2.transform(places, car.outline.vertices).reshape(-1, 2)
    away = corner @ np.array([math.sqrt(0.5), -math.sqrt(0.5)])
    centre = np.array([7.0, 7.0]) + (away.max() + 0.5 + 2e-6 - 0.0) * np.array([math.sqrt(0.5), -math.sqrt(0.5)])
    wall = Rectangle((float(centre[0]), float(centre[1])), 4.0, 1.0, math.pi / 4)
    found = audit((wall,), car, path)
    assert found.free
    assert 0.0 < found.min_clearance < 3e-6
    assert found.max_curvature == pytest.approx(0.25, rel=1e-6)
    assert found.cost == found.length == pytest.approx(2 * math.pi)


def test_at_a_single_state_the_robot_stands() -> None:
    world = World("w", BOUNDS, (BOX,), SQUARE)
    assert check_path(world, None, [[5, 10, 0]]) == check_path(world, SQUARE, [[5, 10, 0]])
    # As in the path of a plan whose start is as near to its goal as is asked for.
    for place, free in ((5.0, True), (10.0, False)):
        found = audit((BOX,), SQUARE, [[place, 10, 0]])
        assert found == audit((BOX,), SQUARE, [[place, 10, 0]] * 2)
        assert (found.free, found.length) == (free, 0.0)
        assert check_path(World("w", BOUNDS, (BOX,)), SQUARE.steered(1.0), [[place, 10, 0]]).free == free


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ([], "path"),
        ([[1, 1, 0], [math.nan, 1, 0]], "not a finite number"),
        ([[1, 1], [2, 2]], "expected shape"),
        ([[1, 1, 0], [1e308, -1e308, 0]], r"path: expected x and y of at most 1e\+07 m, got 1e\+308"),
        ("path", "path"),
        (None, "path"),
    ],
)
def test_what_is_no_path_is_refused_in_one_line(path: Any, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        audit((), SQUARE, path)


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.0, 1e-3])
def test_slivers(turn: float) -> None:
    # A needle whose tip, 1/3 of a milliradian wide, slides along a wall; and a needle that stands in a robot's way.
    needle = Robot.polygon([[0.0, 0.0], [3.0, 0.0], [3.0, 0.001]])
    wall = Rectangle((4.0, 10.0), 2.0, 16.0)
    for gap, free in ((0.0, True), (-5e-8, True), (-1e-5, False)):
        assert audit((wall,), needle, [[5.0 + gap, 5, -turn], [5.0 + gap, 15, turn]]).free == free, gap
    spike = Polygon(np.array([[2.0, 10.0], [10.0, 10.0005], [2.0, 10.001]]))
    for gap, free in ((0.0, True), (-1e-5, False)):
        found = audit((spike,), SQUARE, [[10.5 + gap, 5, 0], [10.5 + gap, 15, 0]])
        assert found.free == free, gap
        assert all(c.begin + 5.5 > 9.9995 for c in found.collisions)
