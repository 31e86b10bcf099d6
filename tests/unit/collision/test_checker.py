"""StateChecker: verdicts and clearances, edits, misuse, and the reason why a configuration is not valid."""

from __future__ import annotations

import math
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.helpers.worlds import ROBOTS, box, grown_world, random_states, random_world, short_motions

from trailmark import ConfigurationError, Query, StateChecker, WorldError
from trailmark.collision.explain import invalid_reason
from trailmark.collision.fcl_scene import FclScene
from trailmark.estimation import regrow
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import ObstacleEstimate, RiskBound, Robot, World

WORLDS = {
    "polygons": random_world(1, 200),
    "holes, discs, boundary": random_world(2, 120, discs=0.3, holes=0.5, boundary=True),
    "far": random_world(3, 100, discs=0.3, holes=0.3, boundary=True, origin=(1e5, -1e5)),
    "crowded": random_world(4, 60, size=20.0, radii=(0.2, 1.5), discs=0.3, holes=0.4),
    "2,000 obstacles": random_world(5, 2000, radii=(0.1, 1.0), discs=0.2),
    "no obstacles": random_world(6, 0, size=8.0),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_containment_either_way_is_a_collision(name: str) -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    big, speck = Polygon(square * 30.0 + 10.0), Polygon(square * 1e-3 + 70.0)
    ring = Polygon(square * 60.0 + (20.0, 100.0), (square * 40.0 + (30.0, 110.0),))
    sieve = Polygon(square * 30.0 + (100.0, 10.0), (square * 0.02 + (115.0, 25.0),))
    round_big, round_speck = Disc((80.0, 25.0), 14.0), Disc((75.0, 75.0), 1e-3)
    world = World("w", (0, 0, 160, 180), (big, speck, ring, sieve, round_big, round_speck))
    checker = StateChecker(world, ROBOTS[name])
    body = np.array(ROBOTS[name].inscribed_disc.center)
    for theta in (0.0, 1.0, math.pi / 2, -3.0):
        turn = np.array([[math.cos(theta), -math.sin(theta)], [math.sin(theta), math.cos(theta)]])
        for place, valid in (
            ((25.0, 25.0), False),  # the robot in an obstacle
            ((80.0, 25.0), False),  # in a disc
            ((70.0005, 70.0005), False),  # an obstacle in the robot
            ((75.0, 75.0), False),  # a disc in the robot
            ((50.0, 130.0), True),  # in a hole
            ((115.01, 25.01), False),  # around a hole
        ):
            q = np.array([*(np.array(place) - turn @ body), theta])
            assert checker.valid(q) is valid
            assert (checker.clearance(q) > 0.0) is valid


def test_a_robot_larger_than_the_world_fits_nowhere() -> None:
    world = random_world(1, 10, size=20.0)
    for robot in (Robot.disc(50.0), Robot.rectangle(100.0, 0.1), Robot.rectangle(300.0, 200.0)):
        checker = StateChecker(world, robot)
        q = random_states(world, 50, np.random.default_rng(0), 30.0)
        assert not checker.valid(q).any()
        assert not checker.clearance(q).any()


@pytest.mark.parametrize("name", ROBOTS)
def test_configurations_far_outside_are_invalid(name: str) -> None:
    checker = StateChecker(WORLDS["crowded"], ROBOTS[name])
    for far in (50.0, 1e9, 1e18, 1e19, 1e30, 1e300, 1.7e308):
        rows = [(far, 0, 0), (-far, 0, 1), (5, far, 2), (5, -far, 3), (far, far, -1), (-far, far, 1e300)]
        assert not checker.valid(rows).any()
        assert not checker.clearance(rows).any()
        home = np.tile([10.0, 10.0, 0.0], (len(rows), 1))
        assert not checker.motions_valid(home, rows).any()
        assert not checker.motions_valid(rows, home).any()


def test_one_and_many_and_none() -> None:
    checker = StateChecker(WORLDS["crowded"], ROBOTS["L"])
    q = random_states(checker.world, 30, np.random.default_rng(0))
    many = checker.valid(q)
    assert many.dtype == np.bool_
    assert many.tolist() == [checker.valid(row) for row in q]
    assert isinstance(checker.valid(q[0]), bool)
    assert isinstance(checker.clearance(q[0]), float)
    assert checker.clearance(q).tolist() == [checker.clearance(row) for row in q]
    none = np.empty((0, 3))
    assert checker.valid(none).shape == checker.clearance(none).shape == checker.motions_valid(none, none).shape == (0,)
    assert checker.motions_by_field(none, none).shape == (0,)
    assert checker.valid(q.tolist()).tolist() == many.tolist()
    turned = q + (0.0, 0.0, 4.0 * math.pi)  # noqa: RUF005  # a sum of arrays
    assert (checker.valid(turned) == many).all()


Q = np.zeros((2, 3))


@pytest.mark.parametrize(
    ("call", "part"),
    [
        (lambda c: c.valid([1, 2]), "shape (3,) or (n, 3) for x, y, theta, got (2,)"),
        (lambda c: c.valid([[1, 2, math.nan]]), "not a finite number"),
        (lambda c: c.valid("door"), "'door'"),
        (lambda c: c.clearance([1, 2, math.inf]), "not a finite number"),
        (lambda c: c.clearance(Q, cap=math.nan), "expected 0 or more, got nan"),
        (lambda c: c.clearance(Q, cap=-1.0), "expected 0 or more, got -1.0"),
        (lambda c: c.motions_valid(Q, Q[:1]), "expected as many ends as starts, got 2 and 1"),
        (lambda c: c.motions_valid(Q, [[1, 2]]), "shape (3,) or (n, 3) for x, y, theta, got (1, 2)"),
        (lambda c: c.motion_valid((0, 0), (1, 1, 1)), "motion: start: expected shape (3,) or (n, 3) for x, y,"),
        (lambda c: c.motion_valid((0, 0, 0), Q), "motion: expected shapes (3,), got (3,) and (2, 3)"),
        (lambda c: c.motion_valid((0, 0, 0), (0, 0, math.nan)), "motion: end:"),
    ],
)
def test_misuse_is_one_line(call: Any, part: str) -> None:
    checker = StateChecker(WORLDS["no obstacles"], Robot.disc(0.5))
    with pytest.raises(ConfigurationError) as caught:
        call(checker)
    assert part in str(caught.value)


@pytest.mark.parametrize("kind", ["disc", "rectangle", "L", "thin"])
def test_an_edited_checker_answers_as_one_built_anew(kind: str) -> None:
    rng = np.random.default_rng(5)
    world = random_world(3, 25, size=20.0, radii=(0.3, 2.0), discs=0.3, holes=0.4, boundary=True)
    checker = StateChecker(world, ROBOTS[kind], cell=0.3)
    q, (a, b) = random_states(world, 300, rng), short_motions(world, 300, rng, 2.0)

    def answers(checker: StateChecker) -> list[np.ndarray]:
        asked = checker.valid(q), checker.clearance(q), checker.motions_valid(a, b)
        return [*asked, np.array([checker.scene.collides(row) for row in q[:20]])]

    before = answers(checker)
    for changed in (
        world.edited(add=[Disc((10.0, 10.0), 2.0)], remove=[3], move={5: (1.0, 0.5, 0.3)}),
        replace(world, bounds=(-5.0, 0.0, 30.0, 20.0), boundary=None),
    ):
        edited = checker.edited(changed)
        assert edited.world is changed
        assert edited.robot is checker.robot
        for mine, anew in zip(answers(edited), answers(StateChecker(changed, ROBOTS[kind], cell=0.3)), strict=True):
            assert np.array_equal(mine, anew)
        assert not np.array_equal(edited.clearance(q), before[1])
    assert all(map(np.array_equal, answers(checker), before))
    assert checker.edited(world) is checker


def test_a_world_grown_for_a_shorter_robot_is_refused_when_edited() -> None:
    world = random_world(3, 5, size=20.0)
    checker = StateChecker(world, Robot.rectangle(2.0, 1.0))
    risk = RiskBound(0.9, np.eye(3) * 1e-4, reach=0.1)
    with pytest.raises(WorldError, match="grown for a robot that reaches"):
        checker.edited(replace(world, risk=risk))


SMALL, LONG = Robot.rectangle(0.6, 0.4), Robot.rectangle(4.0, 0.5)


POSE = np.diag([1e-4, 1e-4, 0.05**2])


def grown(robot: Robot, pose: np.ndarray | None = POSE) -> World:
    estimate = ObstacleEstimate(Disc((5.0, 5.0), 1.0), np.diag([0.01, 0.01]))
    return grown_world([estimate], (0.0, 0.0, 12.0, 10.0), 0.95, robot=robot, pose_covariance=pose)


@pytest.mark.parametrize("first", [SMALL, Robot.disc(0.3)])
def test_a_robot_that_reaches_farther_is_refused(first: Robot) -> None:
    world = grown(first)
    for given in (world, world.with_robot(LONG)):
        with pytest.raises(WorldError, match=r"grown for a robot that reaches .*, got robot rectangle 4 x 0.5 m"):
            StateChecker(given, LONG)
    again = regrow(world.with_robot(LONG), 0.95)
    assert StateChecker(again).robot == LONG
    assert again.obstacles[0].area > world.obstacles[0].area


def test_without_errors_of_heading_any_robot_is_covered() -> None:
    for pose in (None, np.diag([1e-4, 1e-4, 0.0])):
        StateChecker(grown(SMALL, pose), LONG)
    assert RiskBound(0.9).covers(LONG)
    assert not RiskBound(0.9, POSE, 0.1).covers(LONG)
    StateChecker(World("plain", (0.0, 0.0, 12.0, 10.0), queries=(Query("a", (1, 1, 0), (2, 1, 0)),)), LONG)


@pytest.mark.slow
def test_threads_may_share_a_scene() -> None:
    """The robot is one object that is moved to be looked at: without turns, one thread looks at another's robot."""
    world = World("w", (0, 0, 20, 20), (box(10, 5, 11, 6), box(14, 5, 17, 8)))
    scene = FclScene(world, Robot.rectangle(2.0, 0.5))
    rng = np.random.default_rng(3)
    q = np.column_stack([rng.uniform(7, 18, 4000), rng.uniform(3, 9, 4000), rng.uniform(-3, 3, 4000)])
    collides = [scene.collides(row) for row in q]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as threads:
            orders = [rng.permutation(len(q)) for _ in range(4)]
            looks = [threads.submit(lambda order: [scene.collides(q[i]) for i in order], order) for order in orders]
            for order, look in zip(orders, looks, strict=True):
                assert look.result() == [collides[i] for i in order]
    finally:
        sys.setswitchinterval(interval)


def test_a_checker_needs_a_robot_and_a_cell() -> None:
    world = WORLDS["no obstacles"]
    with pytest.raises(WorldError, match="names no robot"):
        StateChecker(world)
    for cell in (0.0, math.nan):
        with pytest.raises(WorldError, match="cell: "):
            StateChecker(world, Robot.disc(1), cell=cell)


BOUNDS = (0.0, 0.0, 10.0, 10.0)


def world(*obstacles: Shape, boundary: Polygon | None = None) -> World:
    return World("w", BOUNDS, obstacles, boundary=boundary)


QUARTER = math.pi / 2
SQUARE = Robot.rectangle(2, 2)
SPIKE = Polygon(np.array([[1, 1], [4.9, 1], [5, 6], [5.1, 1], [9, 1], [9, 9], [1, 9]], dtype=float))

REASONS = [
    (world(), SQUARE, (0.75, 5, 0), "reaches 0.25 m over the left bound"),
    (world(), SQUARE, (5, 9.5, 0), "reaches 0.5 m over the upper bound"),
    (world(), Robot.disc(1), (5, 0.875, 0), "reaches 0.125 m over the lower bound"),
    (world(), Robot.disc(1), (11, 5, 0), "reaches 2 m over the right bound"),
    (world(), Robot.disc(1), (1e300, 5, 0), "reaches 1e+300 m over the right bound"),
    (world(), SQUARE, (5, -1e300, 1), "reaches 1e+300 m over the lower bound"),
    (world(boundary=box(2, 2, 8, 8)), SQUARE, (5, 2.5, 0), "reaches 0.5 m over the boundary"),
    (world(boundary=box(2, 2, 8, 8)), Robot.disc(1), (5, 7.5, 0), "reaches 0.5 m over the boundary"),
    (world(boundary=box(1, 1, 4, 4)), Robot.disc(1), (5, 2, 0), "reaches 2 m over the boundary"),
    (world(boundary=SPIKE), Robot.rectangle(2, 0.2), (5, 4, 0), "reaches 1.04 m over the boundary"),
    (world(box(5.75, 0, 7, 9)), SQUARE, (5, 5, 0), "overlaps obstacle 0 (polygon) by 0.25 m"),
    (world(Rectangle((6.75, 5), 2, 9)), SQUARE, (5, 5, 0), "overlaps obstacle 0 (rectangle) by 0.25 m"),
    (world(Disc((7.5, 5), 1.75)), SQUARE, (5, 5, 0), "overlaps obstacle 0 (disc) by 0.25 m"),
    (world(Disc((7.5, 5), 1.75)), Robot.disc(1), (5, 5, 0), "overlaps obstacle 0 (disc) by 0.25 m"),
    (world(box(5.75, 0, 7, 9)), Robot.disc(1), (5, 5, 0), "overlaps obstacle 0 (polygon) by 0.25 m"),
    (world(box(2, 2, 8, 8)), Robot.disc(1), (5, 5, 0), "overlaps obstacle 0 (polygon) by 4 m"),
    (world(box(2, 2, 8, 8)), Robot.rectangle(1, 1), (5, 5, 0), "overlaps obstacle 0 (polygon) by 3.5 m"),
    # One crosses the other, or holds it.
    (world(box(4.9, 2, 5.1, 8)), Robot.rectangle(2, 0.1), (5, 5, 0), "overlaps obstacle 0 (polygon) by 1.1 m"),
    (world(box(5, 5, 5.1, 5.1)), SQUARE, (5, 5, 0), "overlaps obstacle 0 (polygon) by 1 m"),
    # The one that is overlapped most, not the first; rounding at a contact elsewhere is not the reason.
    (world(box(0, 0, 4, 10), box(5.75, 0, 6, 10)), SQUARE, (5, 5, QUARTER), "overlaps obstacle 1 (polygon) by 0.25 m"),
    (world(box(1.75, 4, 3, 6)), SQUARE, (1 - 1e-15, 5, QUARTER), "overlaps obstacle 0 (polygon) by 0.25 m"),
    (world(Disc((7, 5), 1), box(3, 4, 4.5, 6)), Robot.disc(1), (5, 5, 0), "overlaps obstacle 1 (polygon) by 0.5 m"),
    (world(box(6, 0, 8, 10)), SQUARE, (5 + 2e-7, 5, 0), "overlaps obstacle 0 (polygon) by 2e-07 m"),
]  # fmt: skip


@pytest.mark.parametrize(("where", "robot", "q", "reason"), REASONS)
def test_the_reason_names_the_obstacle_and_the_depth(
    where: World, robot: Robot, q: tuple[float, float, float], reason: str
) -> None:
    checker = StateChecker(where, robot)
    assert not checker.valid(q)
    said = invalid_reason(where, robot, np.array(q, dtype=float))
    assert said == reason or re.fullmatch(reason, said)
    with pytest.raises(ConfigurationError) as caught:
        checker.require_valid(q, "start")
    message = str(caught.value)
    assert message.startswith("start (")
    assert message.endswith(f"is not valid: the robot ({robot.describe()}) {said}")
