"""One configuration or motion a call: the same answers as for arrays, from addresses that stay good."""

from __future__ import annotations

import gc
import math

import numpy as np
import pytest
from tests.helpers.random_worlds import ROBOTS, random_world

from trailmark.collision import StateChecker
from trailmark.curves import Steering
from trailmark.motion.pointwise import CurveMarks, PointwiseChecker
from trailmark.shapes import Disc, Rectangle, Shape
from trailmark.world import Robot, World


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_answers_are_those_of_the_checker(name: str) -> None:
    world = random_world(3, 60, size=40.0, discs=0.3, holes=0.2, boundary=name == "disc")
    checker = StateChecker(world, ROBOTS[name])
    single = PointwiseChecker(checker)
    rng = np.random.default_rng(0)
    q = rng.uniform((-1.0, -1.0, -np.pi), (41.0, 41.0, np.pi), (3000, 3))
    valid = checker.valid(q)
    assert 0.1 < valid.mean() < 0.9
    assert [single.valid(*row) for row in q.tolist()] == valid.tolist()
    assert [single.clearance(*row) for row in q[:500].tolist()] == checker.clearance(q[:500]).tolist()
    free = q[valid]
    a, b = free[:-1], free[:-1] + rng.uniform(0.0, 0.2, (len(free) - 1, 1)) * (free[1:] - free[:-1])
    b[:, 2] = a[:, 2]
    there = checker.valid(b)
    a, b = a[there], b[there]
    certified = checker.motions_between_valid(a, b)
    assert 0.1 < certified.mean() < 1.0
    rows = list(zip(a.tolist(), b.tolist(), strict=True))
    assert [single.motion_valid(tuple(p), tuple(r)) for p, r in rows] == certified.tolist()
    # With the end's own validity, which the motion's does not look at.
    ends = free[:-1] + rng.uniform(-1.0, 1.0, (len(free) - 1, 3))
    ends[:, 2] = (ends[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    whole = checker.motions_valid(free[:-1], ends)
    assert 0.1 < whole.mean() < 0.9
    assert [single.step_valid(*p, *r) for p, r in zip(free[:-1].tolist(), ends.tolist(), strict=True)] == whole.tolist()


def test_contact_is_left_to_fcl_and_allowed() -> None:
    world = World("wall", (0.0, 0.0, 10.0, 10.0), (Rectangle((5.0, 5.0), 2.0, 2.0),))
    single = PointwiseChecker(StateChecker(world, Robot.rectangle(1.0, 1.0)))
    assert single.valid(3.5, 5.0, 0.0)
    assert not single.valid(3.5 + 1e-6, 5.0, 0.0)
    assert single.step_valid(3.0, 5.0, 0.0, 3.5, 5.0, 0.0)
    assert not single.step_valid(3.0, 5.0, 0.0, 3.5 + 1e-6, 5.0, 0.0)
    assert single.clearance(3.5, 5.0, 0.0) == pytest.approx(0.0, abs=1e-9)


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
