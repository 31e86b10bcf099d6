"""Referee: against hand-made paths, geometry on paper, and the certified checker that it must not know; measures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.runs import GOAL, START, small_world
from tests.helpers.trials import few

from trailmark import Disc, LandmarkPlanner, OneWayZone, Polygon, Rectangle, Robot, StateChecker, Steering, World, se2
from trailmark.benchmark.referee import Referee
from trailmark.motion import motion_of

ROOM = small_world()
ROBOT = Robot.rectangle(0.8, 0.4)


@pytest.mark.parametrize(
    ("path", "problem"),
    [
        ([START, GOAL], None),
        ([START, (5.0, 2.0, 3.0), GOAL], None),
        ([START, (GOAL[0], GOAL[1], 2.0 * math.pi)], None),  # a whole turn on
        ([START, (5.0, 4.0, 0.0), GOAL], "meets an obstacle"),
        ([START, (5.0, 2.8, math.pi / 2), GOAL], "meets an obstacle"),
        ([START, (5.0, 0.1, 0.0), GOAL], "is out of bounds"),
        ([START, (8.0, 1.0, 0.0)], "path's end (8, 1, 0) is not the goal"),
        ([(1.0, 1.0, 0.001), GOAL], "is not the start"),
        ([START, (math.nan, 1.0, 0.0), GOAL], "not a finite number"),
        ([START[:2], GOAL[:2]], "shape"),
        ([], "shape"),
        ([START, (1e9, 1.0, 0.0), GOAL], "steps"),
    ],
)
def test_faults(path: list[tuple[float, ...]], problem: str | None) -> None:
    found = Referee(ROOM, ROBOT).fault(np.asarray(path, dtype=float), START, GOAL)
    assert (found is None) == (problem is None)
    assert problem is None or problem in str(found)


def test_an_obstacle_thinner_than_a_planners_step_is_seen() -> None:
    wall = Polygon(np.array([[5.0, 0.0], [5.001, 0.0], [5.001, 6.0], [5.0, 6.0]]))
    world = World("wall", (0.0, 0.0, 10.0, 6.0), (wall,))
    assert Referee(world, Robot.disc(0.2)).fault([START, GOAL], START, GOAL) is not None


@pytest.mark.parametrize("robot", [Robot.disc(0.4), Robot.rectangle(0.8, 0.8)])
@pytest.mark.parametrize("kept", [0.0, 0.15])
@pytest.mark.parametrize(("room", "right"), [(0.0, True), (-4e-6, False), (4e-6, True)])
def test_touching_is_allowed(robot: Robot, kept: float, room: float, right: bool) -> None:
    # Between an obstacle above and a bound below: the robot's width, the clearance on both sides, and a little.
    low, wide = (0.0, 0.6 - kept, 10.0, 6.0), (-10.0, -10.0, 20.0, 20.0)
    edge = 1.4 + kept + room
    block = Polygon(np.array([[4.0, edge], [6.0, edge], [6.0, 3.0], [4.0, 3.0]]))
    room_of = Polygon(np.array([[-5.0, 0.6 - kept - room], [15.0, 0.6 - kept - room], [15.0, 9.0], [-5.0, 9.0]]))
    worlds = (
        World("disc", low, (Disc((5.0, 2.4 + kept + room), 1.0),)),
        World("block", low, (block,)),
        World("bound", (0.0, 0.6 - kept - room, 10.0, 6.0)),
        World("boundary", wide, boundary=room_of),
    )
    for world in worlds:
        judge = Referee(world, robot.keeping(kept))
        assert (judge.fault([START, GOAL], START, GOAL) is None) == right, world.name


def test_the_boundary_is_not_left() -> None:
    bent = Polygon(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 6.0], [5.0, 2.0], [0.0, 6.0]]))
    world = World("bent", (0.0, 0.0, 10.0, 6.0), boundary=bent)
    for robot in (Robot.disc(0.3), Robot.rectangle(0.6, 0.6)):
        judge = Referee(world, robot)
        assert judge.fault([START, GOAL], START, GOAL) is None
        over = judge.fault([START, (2.0, 3.5, 0.0), (8.0, 3.5, 0.0), GOAL], START, GOAL)
        assert over is not None
        assert "out of bounds" in over


@pytest.mark.slow
@settings(max_examples=few(40))
@given(st.floats(0.0, 4.0), st.floats(0.05, 1.5), st.floats(0.05, 1.0))
def test_a_disc_passing_a_disc_is_plain_geometry(height: float, radius: float, robot: float) -> None:
    world = World("discs", (-100.0, -100.0, 100.0, 100.0), (Disc((0.0, height), radius),))
    start, goal = (-10.0, 0.0, 0.0), (10.0, 0.0, 0.0)
    apart = height - radius - robot
    if abs(apart) < 1e-3 * robot:
        return  # between two samples the disc may be missed by a hair
    assert (Referee(world, Robot.disc(robot)).fault([start, goal], start, goal) is None) == (apart > 0.0)


CAR = Robot.rectangle(0.8, 0.4).steered(1.0)


@pytest.mark.parametrize("reverse", [True, False])
def test_of_a_car_the_curves_are_judged(reverse: bool) -> None:
    # Two posts: one on the straight line from start to goal, one on the curve that leads round it.
    start, goal = (2.0, 3.0, 0.0), (8.0, 3.0, math.pi)
    car = CAR.steered(1.0, reverse)
    curve = Steering(1.0, reverse).states(start, goal, np.linspace(0.0, 20.0, 400))
    aside = curve[np.argmax(np.abs(curve[:, 1] - 3.0)), :2]
    for post, right in (((5.0, 0.2), True), (tuple(aside), False)):
        world = World("post", (0.0, 0.0, 12.0, 6.0), (Disc(post, 0.1),))
        found = Referee(world, car).fault([start, goal], start, goal)
        assert (found is None) is right
        assert right or (found is not None and "meets an obstacle" in found)


@pytest.mark.parametrize(
    ("path", "right"),
    [
        ([(1, 1, 0), (9, 1, 0)], True),
        ([(9, 1, 0), (1, 1, 0)], False),
        ([(9, 1, 0), (9, 8, 0), (1, 8, 0)], True),  # around it
        ([(9, 2, 0), (1, 2, 0)], True),  # along its edge
        ([(5, 1, 0), (5, 1, 3)], True),  # it turns in place
        ([(4, 1, 0), (5, 1.8, 0), (5, 4, 0)], False),  # out across its edge
    ],
)
def test_one_way_zones_are_travelled_as_they_allow(path: list[tuple[float, ...]], right: bool) -> None:
    zone = OneWayZone(Polygon(np.array([[3.0, -1.0], [7.0, -1.0], [7.0, 2.0], [3.0, 2.0]])), 0.0, 0.8)
    world = World("one-way", (0.0, 0.0, 10.0, 10.0), zones=(zone,))
    found = Referee(world, Robot.disc(0.3)).fault(np.asarray(path, dtype=float), path[0], path[-1])
    assert (found is None) == right
    assert right or "one-way" in str(found)


@pytest.mark.parametrize("reverse", [True, False])
def test_of_a_car_the_direction_of_travel_counts_in_one_way_zones(reverse: bool) -> None:
    zone = OneWayZone(Polygon(np.array([[3.0, 0.0], [7.0, 0.0], [7.0, 4.0], [3.0, 4.0]])), 0.0, 0.5)
    world = World("one-way", (0.0, 0.0, 10.0, 10.0), zones=(zone,))
    referee = Referee(world, Robot.disc(0.3).steered(1.0))
    ahead, back = np.array([[1.0, 2.0, 0.0], [9.0, 2.0, 0.0]]), np.array([[1.0, 2.0, math.pi], [9.0, 2.0, math.pi]])
    path = back if reverse else ahead  # backwards the other way
    assert referee.fault(path, path[0], path[-1]) is None
    assert "one-way" in str(referee.fault(path[::-1], path[-1], path[0]))
    # A turning point within.
    turns = np.array([[2.0, 2.0, 0.0], [5.0, 2.0, 0.0], [2.0, 2.0, 0.0]])
    assert "from (5, 2, 0) to (2, 2, 0)" in str(referee.fault(turns, turns[0], turns[-1]))


@pytest.mark.slow
@pytest.mark.parametrize("robot", [ROBOT, CAR, CAR.steered(1.0, reverse=False)], ids=["straight", "car", "forwards"])
def test_it_agrees_with_the_certified_checker(robot: Robot) -> None:
    rng = np.random.default_rng(5)
    motion, judge = motion_of(StateChecker(ROOM, robot)), Referee(ROOM, robot)
    q = rng.uniform((0.0, 0.0, -np.pi), (10.0, 6.0, np.pi), (800, 3))
    q = q[motion.checker.valid(q)]
    count = few(200, 2)
    a, b = q[:count], q[count : 2 * count]
    certified = motion.motions_valid(a, b)
    judged = np.array([judge.fault([x, y], x, y) is None for x, y in zip(a, b, strict=True)])
    assert 10 < certified.sum() < len(a) - 10
    # A certified motion is right. One that is not certified is wrong, but for grazes between two samples.
    assert judged[certified].all()
    steering, at = Steering.of(robot), np.linspace(0.0, 1.0, 20_000)
    for x, y in zip(a[judged & ~certified], b[judged & ~certified], strict=True):
        along = se2.interpolate(x, y, at) if steering is None else steering.states(x, y, at * steering.lengths(x, y))
        assert motion.checker.clearance(along).min() < 1e-3


def test_what_no_car_drives_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    start, goal = (2.0, 2.0, 0.0), (1.0, 2.1, 0.0)
    judge = Referee(World("wide", (-10.0, -10.0, 10.0, 10.0)), CAR.steered(1.0, reverse=False))
    states = Steering.states
    assert judge.fault([start, goal], start, goal) is None
    # Curves that turn twice as sharply or go backwards would be a mistake of trailmark's own.
    for wrong in (Steering(0.5, reverse=False), Steering(1.0)):
        with monkeypatch.context() as patch:
            patch.setattr(
                Steering,
                "states",
                lambda _, a, b, along, wrong=wrong: states(wrong, a, b, along * wrong.lengths(a, b) / np.max(along)),
            )
            found = judge.fault([start, goal], start, goal)
        assert found is not None
        assert "no curve of the car" in found


@pytest.mark.parametrize("reverse", [False, True])
def test_a_differential_drive_turns_in_place_or_drives_along_its_heading(reverse: bool) -> None:
    robot = Robot.rectangle(0.8, 0.5).differential(reverse)
    referee = Referee(World("room", (0.0, 0.0, 10.0, 6.0)), robot)
    start, half_turn = [1.0, 1.0, 0.0], [1.0, 1.0, math.pi / 2]
    assert referee.fault([start, half_turn, [1.0, 4.0, math.pi / 2]], start, [1.0, 4.0, math.pi / 2]) is None
    for wrong in ([1.0, 4.0, 0.0], [2.0, 1.0, 0.5], [2.0, 1.0 + 3e-6, 0.0]):  # sideways, on an arc, a little sideways
        fault = referee.fault([start, wrong], start, wrong)
        assert fault is not None
        assert "neither turns in place nor drives along its heading" in fault
    backwards = referee.fault([[4.0, 1.0, 0.0], start], [4.0, 1.0, 0.0], start)
    assert (backwards is None) == reverse


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [False, True])
def test_the_planners_paths_of_differential_drives_are_found_correct(reverse: bool) -> None:
    robot = Robot.rectangle(0.8, 0.5).differential(reverse)
    world = World("room", (0.0, 0.0, 10.0, 6.0), (Disc((5.0, 3.0), 1.0), Rectangle((3.0, 1.0), 0.5, 2.0)), robot)
    start, goal = np.array([1.0, 3.0, -3.0]), np.array([9.0, 3.0, math.pi / 2])
    path = LandmarkPlanner(world, seed=0).plan(start, goal, time_limit=0.3).path
    assert Referee(world, robot).fault(path.states, start, goal) is None
