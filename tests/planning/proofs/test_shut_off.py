"""Places that are shut off with whatever heading: as a drawing has them, and never where the planner gets to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.planning.proofs.test_enclosure import SECONDS, wall_with_gap
from tests.support.trials import few, trials

from trailmark import LandmarkPlanner, Rectangle, Robot, World
from trailmark.collision import StateChecker
from trailmark.planning.proofs.shut_off import shut_off

PLACES = np.stack(np.meshgrid(np.arange(0.25, 11.0, 0.5), np.arange(0.25, 5.0, 0.5)), axis=-1).reshape(-1, 2)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "start"), [("rectangle", (2.0, 2.0, 0.3)), ("offset", (9.0, 2.0, 0.3))])
def test_all_of_a_room_is_shut_off_at_once(name: str, start: tuple[float, float, float]) -> None:
    checker = StateChecker(wall_with_gap(0.5), ROBOTS[name])
    around = np.array([11.0 - start[0], 2.0])
    shut = shut_off(checker, np.array(start), around, PLACES, seconds=SECONDS)
    across = (PLACES[:, 0] - 5.5) * np.sign(start[0] - 5.5) < -1.0
    turns = np.column_stack([np.repeat(PLACES, 16, axis=0), np.tile(np.arange(16) * np.pi / 8.0 - 3.0, len(PLACES))])
    fits = np.asarray(checker.valid(turns)).reshape(-1, 16).any(axis=1)
    assert (across & fits).sum() > 20
    assert shut[across & fits].all()
    # Where it is itself it fits, with any heading at some distance from the walls.
    own = (np.abs(PLACES - [start[0], 2.5]) < 1.0).all(axis=1)
    assert own.any()
    assert not shut[own].any()


def test_a_place_with_two_headings_that_are_apart_takes_two_enclosures() -> None:
    # A slot as wide as the robot, shut at both ends: there is no turning round in it.
    walls = (
        Rectangle((3.0, 1.3), 2.4, 0.4),
        Rectangle((3.0, 2.3), 2.4, 0.4),
        *(Rectangle((x, 1.8), 0.2, 1.4) for x in (1.9, 4.1)),
    )
    checker = StateChecker(World("slot", (0.0, 0.0, 6.0, 4.0), walls), Robot.rectangle(0.9, 0.5))
    place = np.array([[3.0, 1.8]])
    assert checker.valid((3.0, 1.8, 0.0))
    assert shut_off(checker, np.array([0.7, 0.7, 0.0]), place[0], place, seconds=SECONDS).all()


@pytest.mark.slow
def test_headings_that_nearly_fit_are_told_from_those_that_do() -> None:
    # Four things cage the robot, upright; across, it collides by a little more than a centimetre.
    things = [(3.84, 6.4, 4.0, 6.72), (4.0, 6.4, 4.4, 6.44), (4.38, 7.18, 4.42, 7.2), (4.76, 6.8, 4.84, 7.04)]
    boxes = tuple(Rectangle(((a + c) / 2.0, (b + d) / 2.0), c - a, d - b) for a, b, c, d in things)
    robot = replace(Robot.rectangle(0.6, 0.4), clearance=0.057)
    checker = StateChecker(World("cage", (0.0, 0.0, 19.2, 17.2), boxes), robot)
    place = np.array([[4.42, 6.82]])
    assert checker.valid((*place[0], np.pi / 2.0))
    assert not checker.valid((*place[0], 0.02))
    assert shut_off(checker, np.array([15.0, 15.0, 0.0]), place[0], place, seconds=SECONDS).all()
    # Without one of them it gets out.
    checker = StateChecker(World("cage", (0.0, 0.0, 19.2, 17.2), boxes[:3]), robot)
    assert not shut_off(checker, np.array([15.0, 15.0, 0.0]), place[0], place, seconds=SECONDS).any()


@pytest.mark.slow
@pytest.mark.parametrize("seed", trials(2, of=2))
def test_no_place_is_shut_off_that_the_planner_gets_to(seed: int) -> None:
    world = random_world(seed, 20, size=8.0, radii=(0.3, 0.9), discs=0.3)
    planner, rng = LandmarkPlanner(world, ROBOTS["rectangle"], seed=seed), np.random.default_rng(seed)
    q = rng.uniform((0, 0, -np.pi), (8, 8, np.pi), (300, 3))
    q = q[planner.checker.valid(q)]
    goals = q[1 : 1 + few(16, of=2)]
    reached = [goal for goal in goals if planner.plan(q[0], goal, 1.0, max_iterations=1).status == "solved"]
    assert len(reached) > few(8, of=2)
    for goal in goals[: few(6, of=2)]:
        shut = shut_off(planner.checker, q[0], goal[:2], q[:, :2], seconds=0.5)
        assert not shut[0]
        assert not any(shut[(q == end).all(axis=1)].any() for end in reached)


def test_nothing_is_told_of_round_robots_or_without_time() -> None:
    closed = wall_with_gap(0.3)
    for robot, seconds in ((Robot.disc(0.4), SECONDS), (ROBOTS["rectangle"], 0.0)):
        checker = StateChecker(closed, robot)
        assert not shut_off(checker, np.array([2.0, 2.0, 0.0]), np.array([9.0, 2.0]), PLACES, seconds=seconds).any()
