"""Certified motions: what is accepted never collides, and what is clearly free is accepted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.helpers.oracles import Oracle, motion_states
from tests.helpers.worlds import box

from trailmark import Robot, StateChecker, World, se2
from trailmark.shapes import Disc, Shape

BOUNDS = (0.0, 0.0, 20.0, 20.0)


def checker_for(robot: Robot, *obstacles: Shape) -> StateChecker:
    return StateChecker(World("w", BOUNDS, obstacles), robot, cell=0.25)


@pytest.mark.parametrize("gap", [0.02, 0.005])
@pytest.mark.parametrize("at", [3.0, 50.0, 93.0, 95.0, 96.5])
def test_a_tooth_in_a_long_tight_corridor_is_not_missed(gap: float, at: float) -> None:
    # So many gaps are open at once along the walls that the kernel's queue runs full: none may be lost.
    walls = (box(0, 0, 100, 4.5 - gap), box(0, 5.5 + gap, 100, 10))
    tooth = box(at, 5.0, at + 0.01, 5.5 + gap)
    robot = Robot.rectangle(1, 1)
    ends = (1.0, 5.0, 0.0), (99.0, 5.0, 0.0)
    checker = StateChecker(World("tooth", (0, 0, 100, 10), (*walls, tooth)), robot)
    assert checker.valid(ends).all()
    assert not checker.motion_valid(*ends)
    assert not checker.motion_valid(*ends[::-1])
    assert StateChecker(World("no tooth", (0, 0, 100, 10), walls), robot).motion_valid(*ends)


def test_turning_in_place() -> None:
    bar = Robot.rectangle(4, 0.5)
    checker = checker_for(bar, box(9, 11, 11, 12))
    assert not checker.motion_valid((10, 10, 0), (10, 10, math.pi / 2 - 0.01))
    assert not checker.motion_valid((10, 10, -1), (10, 10, 2.1))
    assert checker.motion_valid((10, 10, -0.3), (10, 10, 0.3))
    assert checker.motion_valid((10, 9, -1.2), (10, 9, 0.4))
    # The shorter way round: through half a turn, not through the obstacle above.
    assert checker.motion_valid((10, 10, math.pi - 0.3), (10, 10, -math.pi + 0.3))
    disc = checker_for(Robot.disc(1), box(9, 11, 11, 12))
    assert disc.motion_valid((10, 10, 0), (10, 10, math.pi))


@pytest.mark.slow
@pytest.mark.parametrize("robot", [Robot.rectangle(2, 2), Robot.disc(1)], ids=["square", "disc"])
def test_a_motion_may_leave_contact_and_arrive_in_it(robot: Robot) -> None:
    checker = checker_for(robot, box(6, 0, 8, 20), box(0, 0, 20, 3), Disc((3, 16), 1))
    wall, corner, away = (5.0, 8.0, 0.0), (5.0, 4.0, 0.0), (2.0, 8.0, 0.0)
    for contact in (wall, corner):
        assert checker.clearance(contact) == 0.0
        assert checker.motion_valid(contact, away)
        assert checker.motion_valid(away, contact)
    assert checker.motion_valid((3.0, 14.0, 0.0), wall)
    assert not checker.motion_valid(wall, (9.0, 8.0, 0.0))
    assert not checker.motion_valid(wall, (5.0 + 1e-4, 8.0, 0.0))
    # From contact into the wall and out of it again, by turning: the corners swing out.
    if robot.sweep_radius > 0.0:
        assert not checker.motion_valid(wall, (5.0, 8.0, math.pi / 2))
    # Sliding along the wall keeps contact for longer than the ends' zone.
    assert not checker.motion_valid(wall, corner)
    assert not checker.motion_valid(corner, wall)
    # A hair's breadth from the wall, sliding is certified.
    assert checker.motion_valid((5.0 - 1e-3, 8.0, 0.0), (5.0 - 1e-3, 4.0 + 1e-3, 0.0))


@pytest.mark.slow
def test_leaving_contact_in_random_directions() -> None:
    rng = np.random.default_rng(6)
    robot, wall = Robot.rectangle(2, 2), box(6, 0, 8, 20)
    checker, oracle = checker_for(robot, wall), Oracle(World("w", BOUNDS, (wall,)), robot)
    n = 250
    a = np.column_stack([np.full(n, 5.0), rng.uniform(5, 15, n), np.zeros(n)])
    bearing = rng.uniform(0.5 * math.pi, 1.5 * math.pi, n)
    b = a + np.column_stack([3 * np.cos(bearing), 3 * np.sin(bearing), np.zeros(n)])
    accepted = checker.motions_valid(a, b)
    # At less than two thousandths of slope it stays near the wall for longer than the ends' zone.
    steep = np.abs(np.cos(bearing)) > 3e-3
    assert accepted[steep].all()
    # Turning as well, some swing a corner into the wall first: those must not pass.
    b[:, 2] = rng.uniform(-math.pi, math.pi, n)
    accepted = checker.motions_valid(a, b)
    fine = np.concatenate([motion_states(a, b, 200), motion_states(a, a + 0.01 * se2.difference(a, b), 200)], axis=1)
    assert not oracle.collides(fine[accepted].reshape(-1, 3)).any()
    assert 0 < accepted.sum() < n
