"""Certified curves: what is accepted never collides, and what is clearly free is accepted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.helpers.trials import trials
from tests.helpers.worlds import box

from trailmark import ConfigurationError, CurvePath, Objective, Robot, StateChecker, Steering, World
from trailmark.motion import CurveMotion


def test_forwards_only_and_in_reverse() -> None:
    # A dead end: out of it leads the way back only.
    walls = (box(0, 4, 10, 4.4), box(0, 5.6, 10, 6), box(9.4, 4, 10, 6))
    checker = StateChecker(World("dead end", (0, 0, 20, 10), walls), Robot.rectangle(1, 0.5))
    inside, outside = (8.0, 5.0, 0.0), (3.0, 5.0, 0.0)
    assert CurveMotion(checker, Steering(2.0)).motion_valid(inside, outside)
    assert CurveMotion(checker, Steering(2.0)).motion_valid(outside, inside)
    assert CurveMotion(checker, Steering(2.0, reverse=False)).motion_valid(outside, inside)
    assert not CurveMotion(checker, Steering(2.0, reverse=False)).motion_valid(inside, outside)


def test_a_curve_may_leave_contact_and_arrive_in_it() -> None:
    checker = StateChecker(World("wall", (0, 0, 20, 20), (box(6, 0, 8, 20),)), Robot.rectangle(2, 2))
    motions = CurveMotion(checker, Steering(2.0))
    contact, away = (5.0, 8.0, 0.0), (2.0, 8.0, 0.0)
    assert checker.clearance(contact) == 0.0
    assert motions.motion_valid(contact, away)
    assert motions.motion_valid(away, contact)
    assert motions.motion_valid(contact, contact)
    # Along the wall, touching it all the way, is not certified.
    assert not motions.motion_valid((5.0, 8.0, math.pi / 2), (5.0, 10.0, math.pi / 2))
    assert motions.motion_valid((4.99, 8.0, math.pi / 2), (4.99, 10.0, math.pi / 2))


def test_the_robots_own_steering_and_bad_input() -> None:
    world = World("w", (0, 0, 20, 20))
    car = Robot(Robot.rectangle(2, 1).footprint, turning_radius=3.0, reverse=False)
    assert CurveMotion(StateChecker(world, car)).steering == Steering(3.0, reverse=False)
    with pytest.raises(ConfigurationError, match="expected steering, or a robot with a turning radius, got neither"):
        CurveMotion(StateChecker(world, Robot.disc(1)))
    motions = CurveMotion(StateChecker(world, car))
    with pytest.raises(ConfigurationError, match="expected as many ends as starts, got 2 and 1"):
        motions.motions_valid([(5, 5, 0)] * 2, [(6, 5, 0)])
    with pytest.raises(ConfigurationError, match="shapes"):
        motions.motion_valid([(5, 5, 0)], [(6, 5, 0)])


@pytest.mark.slow
def test_cost_of_a_path_counts_changes_of_direction_and_metres_in_reverse() -> None:
    steering, rng = Steering(1.5), np.random.default_rng(3)
    checker = StateChecker(World("open", (-20.0, -20.0, 20.0, 20.0), ()), Robot.rectangle(1.0, 0.5).steered(1.5))
    plain = CurveMotion(checker, steering)
    motion = CurveMotion(checker, steering, Objective(direction_change=2.0, reverse=1.5))
    for _ in trials(200):
        # States on a grid: some motions lead straight on, some nowhere.
        states = np.column_stack([rng.integers(-3, 4, (6, 2)), rng.choice([0.0, 0.5 * np.pi, np.pi], 6)])
        path = CurvePath(states, steering)
        assert plain.cost_of(states) == pytest.approx(path.length)
        expected = path.length + 2.0 * path.cusps + 0.5 * path.reverse_length
        assert motion.cost_of(states) == pytest.approx(expected)
        bound = motion.least_cost(states[0], states[-1])
        assert plain.least_cost(states[0], states[-1]) - 1e-9 <= bound <= expected + 1e-9


def test_driven_backwards_all_the_way_costs_the_factor() -> None:
    checker = StateChecker(World("open", (-20.0, -20.0, 20.0, 20.0), ()), Robot.rectangle(1.0, 0.5).steered(1.5))
    motion = CurveMotion(checker, objective=Objective(direction_change=2.0, reverse=1.5))
    start, goal = np.zeros(3), np.array([-4.0, 0.0, 0.0])
    assert motion.cost_of(np.array([start, goal])) == pytest.approx(6.0)
    assert motion.least_cost(start, goal) == pytest.approx(6.0)
