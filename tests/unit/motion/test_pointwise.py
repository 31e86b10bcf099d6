"""One configuration or motion a call: the same answers as for arrays, from addresses that stay good."""

from __future__ import annotations

import gc
import math

import numpy as np
import pytest
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import Robot, StateChecker, Steering, World
from trailmark.motion.pointwise import CurveMarks, PointwiseChecker
from trailmark.shapes import Disc, Rectangle, Shape


@pytest.mark.parametrize("robot", [Robot.rectangle(1.0, 0.5), Robot.disc(0.4)], ids=["rectangle", "disc"])
def test_what_is_no_configuration_is_neither_valid_nor_reached(robot: Robot) -> None:
    # A thin wall between the two ends, both in wide open space.
    world = World("wall", (0.0, 0.0, 20.0, 10.0), (Rectangle((10.0, 5.0), 0.2, 10.0),))
    single = PointwiseChecker(StateChecker(world, robot))
    good, beyond = (5.0, 5.0, 0.0), (15.0, 5.0, 0.0)
    for wrong in (np.nan, np.inf, -np.inf, 1e300, -1e300):
        for axis in range(3):
            values = [wrong if i == axis else value for i, value in enumerate(beyond)]
            q = (values[0], values[1], values[2])
            assert not single.valid(*q), q
            assert single.clearance(*q) == 0.0, q
            assert not single.step_valid(*q, *q), q
            for a, b in ((good, q), (q, good)):
                assert not single.motion_valid(a, b), (a, b)
                assert not single.step_valid(*a, *b), (a, b)
    assert not single.valid(np.inf, -np.inf, 0.0)
    # OMPL turns by more than once around between headings that it has not brought into [-pi, pi].
    for heading in (np.nextafter(np.pi, 4.0), -np.nextafter(np.pi, 4.0), 4.0, -7.0, 1e6):
        assert not single.valid(5.0, 5.0, heading)
        assert not single.motion_valid(good, (6.0, 5.0, heading))
    assert single.valid(5.0, 5.0, np.pi)
    assert single.valid(5.0, 5.0, -np.pi)
    assert single.step_valid(*good, 6.0, 5.0, -np.pi)


@pytest.mark.slow
def test_the_arrays_outlive_their_checker() -> None:
    single = PointwiseChecker(StateChecker(random_world(1, 40, size=30.0), ROBOTS["disc"]))
    q = np.random.default_rng(1).uniform(0.0, 30.0, (200, 3))
    before = [single.valid(*row) for row in q.tolist()]
    gc.collect()
    for seed in range(5):
        StateChecker(random_world(seed + 2, 40, size=30.0), ROBOTS["disc"])
    assert [single.valid(*row) for row in q.tolist()] == before


def test_of_several_shortest_curves_all_that_are_free_are_found() -> None:
    # To turn round on the spot, four curves are as short; an obstacle on one of them lies off the others.
    steering = Steering(2.0)
    a, b = (10.0, 10.0, 0.0), (10.0, 10.0, math.pi)

    def free_ones(obstacles: tuple[Shape, ...]) -> tuple[bool, int]:
        marks_of = CurveMarks(
            PointwiseChecker(StateChecker(World("w", (0, 0, 20, 20), obstacles), Robot.disc(0.2)), steering)
        )
        own = marks_of.shortest(a, b)
        length = steering.lengths(a, b)
        # The same one may come as two words, with its pieces shared out in another way: told apart by their marks.
        return own is not None, len({str(np.round(marks, 6)) for marks in marks_of.others(a, b, length)})

    mine = steering.states(a, b, np.linspace(0.0, steering.lengths(a, b), 200))
    turned = np.column_stack([20.0 - mine[:, 0], 20.0 - mine[:, 1]])
    far = turned[np.argmax(np.hypot(*(turned[:, None] - mine[None, :, :2]).transpose(2, 0, 1)).min(axis=1))]
    own, others = free_ones(())
    assert own
    assert others >= 3
    blocked_own, blocked_others = free_ones((Disc((far[0], far[1]), 0.05),))
    assert blocked_own
    assert 1 <= blocked_others < others


def test_contact_is_left_to_fcl_and_allowed() -> None:
    world = World("wall", (0.0, 0.0, 10.0, 10.0), (Rectangle((5.0, 5.0), 2.0, 2.0),))
    single = PointwiseChecker(StateChecker(world, Robot.rectangle(1.0, 1.0)))
    assert single.step_valid(3.0, 5.0, 0.0, 3.5, 5.0, 0.0)
    assert not single.step_valid(3.0, 5.0, 0.0, 3.5 + 1e-6, 5.0, 0.0)
