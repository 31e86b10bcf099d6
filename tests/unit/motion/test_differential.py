"""A differential drive's motions: their costs, what they certify, and the paths that are made of them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from trailmark import Disc, Robot, StateChecker, World
from trailmark.motion import DifferentialMotion, motion_of
from trailmark.se2 import FloatArray, difference
from trailmark.trajectories import path_of
from trailmark.verify import RIM, Verifier

OPEN = World("open", (-50.0, -50.0, 50.0, 50.0), ())
CART = Robot.rectangle(0.6, 0.4).differential()


def motion_in(world: World, robot: Robot) -> DifferentialMotion:
    found = motion_of(StateChecker(world, robot))
    assert isinstance(found, DifferentialMotion)
    return found


def assert_driven(states: FloatArray, reverse: bool = False) -> None:
    """Assert that each piece of a path is a turn in place or a drive along the heading."""
    for a, b in pairwise(states):
        dx, dy, turned = difference(a, b)
        length = math.hypot(dx, dy)
        if length == 0.0:
            continue
        assert turned == 0.0
        ahead = dx * math.cos(a[2]) + dy * math.sin(a[2])
        assert (abs(ahead) if reverse else ahead) == pytest.approx(length, abs=1e-12 + 1e-9 * length)


def test_costs_are_length_and_half_of_all_turns() -> None:
    a = np.array([[0.0, 0.0, 0.0]] * 5)
    b = np.array([[3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [1.0, 1.0, math.pi / 4]])
    half = 0.5 * math.pi
    assert motion_in(OPEN, CART).costs(a, b) == pytest.approx(
        [3.0, 2.0 + half, 0.5, 1.0 + 2.0 * half, math.sqrt(2.0) + half / 4]
    )
    assert motion_in(OPEN, CART.differential(reverse=True)).costs(a, b)[3] == pytest.approx(1.0)


@pytest.mark.parametrize("reverse", [False, True])
def test_costs_obey_the_triangle_inequality_and_agree_with_the_path(reverse: bool) -> None:
    rng, motion = np.random.default_rng(1), motion_in(OPEN, CART.differential(reverse))
    q = np.column_stack([rng.uniform(-2, 2, (600, 2)), rng.uniform(-math.pi, math.pi, 600)])
    a, b, c = q[:200], q[200:400], q[400:]
    if not reverse:
        assert (motion.costs(a, c) <= motion.costs(a, b) + motion.costs(b, c) + 1e-9).all()
    path = path_of(motion, q)
    assert_driven(path.states, reverse)
    assert path.cost == pytest.approx(motion.cost_of(q))
    for start, end, cost in zip(a[:20], b[:20], motion.costs(a, b), strict=False):
        assert cost >= math.dist(start[:2], end[:2]) + 0.5 * abs(difference(start, end)[2]) - 1e-12
        assert path_of(motion, np.array([start, end])).cost == pytest.approx(cost)


def test_reversible_motions_are_their_opposites() -> None:
    rng, motion = np.random.default_rng(2), motion_in(OPEN, CART.differential(reverse=True))
    q = np.column_stack([rng.uniform(-2, 2, (400, 2)), rng.uniform(-math.pi, math.pi, 400)])
    a, b = q[:200], q[200:]
    assert motion.reversible(a, b).all()
    for start, end in zip(a[:50], b[:50], strict=True):
        there, back = (path_of(motion, np.array(pair)).states for pair in ((start, end), (end, start)))
        assert there[::-1] == pytest.approx(back, abs=1e-9)
    level = np.array([[0.0, 0.0, math.pi / 2]]), np.array([[1.0, 0.0, math.pi / 2]])
    assert not motion.reversible(*level).any()
    assert motion_in(OPEN, CART).directed


def test_the_final_check_refuses_what_cannot_be_driven() -> None:
    motion, check = motion_in(OPEN, CART), Verifier(OPEN, CART, RIM)
    ends = np.array([[0.0, 0.0, 0.0], [3.0, 1.0, 1.0]])
    path = path_of(motion, ends)
    assert check.fault(path, *ends) is None
    for other, robot in ((path_of(motion_of(StateChecker(OPEN, Robot.rectangle(0.6, 0.4))), ends), CART), (path, CART)):
        states = other.states.copy()
        if len(states) > 2:
            states = states[::-1].copy()
        fault = Verifier(OPEN, robot, RIM).fault(type(other)(states), states[0], states[-1])
        assert fault is not None
        assert "neither a turn in place nor a drive ahead" in fault


def test_the_least_cost_and_turns_to_even_headings() -> None:
    wall = World("wall", (-5.0, -5.0, 5.0, 5.0), (Disc((0.0, 0.34), 0.1),))
    start, goal = np.array([0.0, 0.0, 0.2]), np.array([1.0, 1.0, 1.0])
    for reverse in (False, True):
        motion = motion_in(wall, CART.differential(reverse))
        assert 0.0 < motion.least_cost(start, goal) <= motion.costs(start[None], goal[None])[0]
        # Of four headings ahead is the nearest one; in a wall there is none.
        assert motion.turned(start, 4).tolist() == [0.0, 0.0, 0.0]
        assert motion.turned(np.array([0.0, 0.34, 0.2]), 4).tolist() == [0.0, 0.34, 0.2]
