"""What can be seen from where a robot gets to, beside shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from tests.helpers.explore_oracle import truth_of

from trailmark import Disc, Query, Rectangle, Robot, World
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.simulated_robot import SimulatedRobot, laser_scanner
from trailmark.exploration.visible_area import evaluate, reachable_places, visible_area
from trailmark.se2 import FloatArray

BOUNDS = (0.0, 0.0, 8.0, 4.0)
DISC = Robot.disc(0.25)
START = (1.0, 2.0, 0.0)


def two_rooms(door: float) -> World:
    """Rooms left and right of a wall at x = 4..4.2 with a door at its lower end, and a pillar in the right one."""
    wall = Rectangle((4.1, 0.5 * (door + 4.0)), 0.2, 4.0 - door)
    return World("two rooms", BOUNDS, (wall, Disc((6.0, 1.0), 0.4)), DISC, queries=(Query("start", START, START),))


def points(area: KnownMap) -> FloatArray:
    return area.centres(*np.nonzero(area.state == FREE))


@pytest.mark.parametrize("door", [0.7, 0.4])
def test_what_is_seen_is_what_shapely_sees(door: float) -> None:
    """A robot that does not fit through the door sees through it."""
    world = two_rooms(door)
    places = reachable_places(world, DISC, np.array([START]))
    assert (places[:, 0].max() > 7.5) == (door > 0.5)
    area = visible_area(world, places, 20.0)
    truth = truth_of(world, 20.0)
    seen = area.state[area.cells_of(truth.targets)] != UNKNOWN
    assert seen.mean() > 0.99
    assert len(points(area)) * area.cell**2 == pytest.approx(0.04 * len(truth.targets), rel=0.05)
    # None is in an obstacle, but where a corner between two beams is cut.
    assert not shapely.contains_xy(truth.solids.buffer(-area.cell), points(area)).any()
    behind = points(area)[points(area)[:, 0] > 4.2]
    if door < 0.5:
        # The lowest ray through the door's upper corner from where the robot can be: what is above is in the dark.
        assert behind[:, 1].max() <= 0.4 + (8.0 - 4.0) * (0.4 - 0.25) / (4.0 - 3.75) + 0.1
    assert len(behind) > 100


@pytest.mark.parametrize(
    ("robot", "start", "wide", "narrow"),
    [
        (Robot.rectangle(1.6, 0.5), (1.0, 2.0, 1.5), 0.9, 0.45),  # it turns to fit
        # A centimetre of room is less than the grid's 4 cm; half a centimetre too little is none.
        (DISC, START, 0.51, 0.495),
        (Robot.rectangle(0.7, 0.5), START, 0.53, 0.495),
    ],
)
def test_a_passage_is_passed_by_what_fits(
    robot: Robot, start: tuple[float, float, float], wide: float, narrow: float
) -> None:
    driven = np.array([start])
    assert reachable_places(two_rooms(wide), robot, driven)[:, 0].max() > 6.0
    assert reachable_places(two_rooms(narrow), robot, driven)[:, 0].max() < 4.2


def test_where_it_has_been_is_reachable_whatever_the_grid_says() -> None:
    places = reachable_places(two_rooms(0.4), DISC, np.array([START, (5.0, 3.0, 0.0)]))
    assert places[:, 0].min() < 0.5
    assert places[:, 0].max() > 7.5


def test_evaluation() -> None:
    robot = SimulatedRobot(two_rooms(0.7), DISC, START, laser_scanner(20.0, 0.1), noise=0.0)
    robot.drive(np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), 9.0)
    known = KnownMap(BOUNDS, 0.1)
    state = known.state.copy()
    state[:, :20], state[:, 20:40] = FREE, OCCUPIED
    known.set_state(state)
    times = np.array([0.05, 0.55, 1.05])
    trajectory = np.column_stack([times, 1.0 + times + 0.1, np.full(3, 2.0), np.full(3, 0.2)])
    covariances = np.array([np.diag([0.01, 1.0, 0.01]), np.diag([0.01, 1.0, 0.01]), np.zeros((3, 3))])
    evaluation = evaluate(robot, known, trajectory, covariances)
    assert evaluation.seen == pytest.approx(16.0 / (32.0 - 0.2 * 3.3 - np.pi * 0.4**2), rel=0.02)
    assert evaluation.collisions == 0
    assert evaluation.nees == pytest.approx(0.1**2 / 0.01 + 0.2**2 / 0.01)
    robot.drive(np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]]), 9.0)
    assert evaluate(robot, known, trajectory, covariances).collisions == 1
