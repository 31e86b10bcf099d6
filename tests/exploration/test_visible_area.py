from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.simulated_robot import SimulatedRobot, laser_scanner
from trailmark.exploration.visible_area import VisibleArea, evaluate, reachable_places, visible_area
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Rectangle
from trailmark.world import Robot, World

BOUNDS = (0.0, 0.0, 8.0, 4.0)
DISC = Robot.disc(0.25)


def two_rooms(door: float) -> World:
    """Rooms left and right of a wall at x = 4..4.2 with a door at its lower end, and a pillar in the right one."""
    wall = Rectangle((4.1, 0.5 * (door + 4.0)), 0.2, 4.0 - door)
    return World("two rooms", BOUNDS, (wall, Disc((6.0, 1.0), 0.4)))


def seen_by_shapely(world: World, points: FloatArray, views: FloatArray, max_range: float) -> NDArray[np.bool_]:
    solids = shapely.union_all([shape.polygon(1e-6).shapely() for shape in world.obstacles])
    shapely.prepare(solids)
    seen = np.zeros(len(points), np.bool_)
    for view in views:
        ends = np.stack([np.broadcast_to(view, points.shape), points], axis=1)
        near = np.hypot(*(points - view).T) <= max_range
        seen |= near & ~shapely.intersects(solids, shapely.linestrings(ends))
    return seen


@pytest.mark.slow
def test_what_is_seen_is_what_shapely_sees() -> None:
    world, rng = two_rooms(1.0), np.random.default_rng(0)
    places = np.column_stack([rng.uniform(0.5, 3.5, 6), rng.uniform(0.5, 3.5, 6), np.zeros(6)])
    area = visible_area(world, places, 5.0)
    xs, ys = (np.arange(0.5 * area.side, high, area.side) for high in BOUNDS[2:])
    grid = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    expected = seen_by_shapely(world, grid, places[:, :2], 5.0)
    got = {tuple(point) for point in np.round(area.points / area.side).astype(int).tolist()}
    cells = [tuple(point) for point in np.round(grid / area.side).astype(int).tolist()]
    differ = sum((cell in got) != bool(seen) for cell, seen in zip(cells, expected, strict=True))
    assert 0.4 * len(grid) < expected.sum() < 0.9 * len(grid)
    assert differ <= 2  # on the very edge of a shadow


@pytest.mark.slow
def test_a_robot_that_does_not_fit_through_a_door_sees_through_it() -> None:
    driven = np.array([[1.0, 2.0, 0.0]])
    wide, narrow = two_rooms(0.7), two_rooms(0.4)
    through = reachable_places(wide, DISC, driven)
    here = reachable_places(narrow, DISC, driven)
    assert through[:, 0].max() > 7.5
    assert here[:, 0].max() < 3.8 + 0.25
    parts = [visible_area(world, places, 20.0).points for world, places in ((wide, through), (narrow, here))]
    free = 32.0 - np.pi * 0.4**2
    areas = [len(part) * visible_area(wide, through, 20.0).side ** 2 for part in parts]
    assert areas[0] == pytest.approx(free - 0.2 * 3.3, rel=0.01)
    behind = parts[1][parts[1][:, 0] > 4.2]
    assert len(behind) > 100
    # The lowest ray through the door's upper corner from where the robot can be: all that is above is in the dark.
    assert behind[:, 1].max() <= 0.4 + (8.0 - 4.0) * (0.4 - 0.25) / (4.0 - 3.75) + 0.1


@pytest.mark.slow
def test_a_long_robot_turns_to_fit() -> None:
    driven, body = np.array([[1.0, 2.0, 1.5]]), Robot.rectangle(1.6, 0.5)
    assert reachable_places(two_rooms(0.9), body, driven)[:, 0].max() > 6.0
    assert reachable_places(two_rooms(0.45), body, driven)[:, 0].max() < 4.0


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "door"), [(DISC, 0.51), (Robot.rectangle(0.7, 0.5), 0.53)])
def test_a_passage_too_narrow_for_the_grid(robot: Robot, door: float) -> None:
    """A centimetre of room is less than the grid's 4 cm; half a centimetre too little is none."""
    driven = np.array([[1.0, 2.0, 0.0]])
    assert reachable_places(two_rooms(door), robot, driven)[:, 0].max() > 7.0
    assert reachable_places(two_rooms(0.495), robot, driven)[:, 0].max() < 4.2


def test_where_it_has_been_is_reachable_whatever_the_grid_says() -> None:
    places = reachable_places(two_rooms(0.4), DISC, np.array([[1.0, 2.0, 0.0], [5.0, 3.0, 0.0]]))
    assert places[:, 0].min() < 0.5
    assert places[:, 0].max() > 7.5


def test_the_share_that_is_known() -> None:
    known = KnownMap(BOUNDS, 0.5)
    points = np.array([[1.0, 1.0], [3.0, 1.0], [5.0, 1.0], [7.0, 1.0]])
    area = VisibleArea(points, 0.1)
    assert area.share_known(known) == 0.0
    state = np.full(known.state.shape, UNKNOWN, np.uint8)
    state[:, :4], state[:, 4:8] = FREE, OCCUPIED
    known.set_state(state)
    assert area.share_known(known) == 0.5
    assert VisibleArea(points[:0], 0.1).share_known(known) == 1.0


@pytest.mark.slow
def test_evaluation() -> None:
    robot = SimulatedRobot(two_rooms(0.7), DISC, (1.0, 2.0, 0.0), laser_scanner(20.0, 0.1), noise=0.0)
    robot.drive(np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), 9.0)
    known = KnownMap(BOUNDS, 0.1)
    state = known.state.copy()
    state[:, :40] = FREE
    known.set_state(state)
    times = np.array([0.05, 0.55, 1.05])
    trajectory = np.column_stack([times, 1.0 + times + 0.1, np.full(3, 2.0), np.full(3, 0.2)])
    covariances = np.array([np.diag([0.01, 1.0, 0.01]), np.diag([0.01, 1.0, 0.01]), np.zeros((3, 3))])
    evaluation = evaluate(robot, known, trajectory, covariances)
    assert evaluation.seen == pytest.approx(16.0 / (32.0 - 0.2 * 3.3 - np.pi * 0.4**2), rel=0.01)
    assert evaluation.collisions == 0
    assert evaluation.nees == pytest.approx(0.1**2 / 0.01 + 0.2**2 / 0.01)
    robot.drive(np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]), 9.0)
    assert evaluate(robot, known, trajectory, covariances).collisions == 1
