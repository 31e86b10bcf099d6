"""Marks lie on the curves that they stand for, and each of several shortest curves has its own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.curves import Steering
from trailmark.errors import ConfigurationError
from trailmark.motion.curve_marks import CurveMarks
from trailmark.motion.pointwise import PointwiseChecker
from trailmark.shapes import Disc, Shape
from trailmark.world import Robot, World


@pytest.mark.slow
@pytest.mark.parametrize("steering", [Steering(1.5), Steering(1.5, reverse=False)], ids=["reeds-shepp", "dubins"])
def test_marks_lie_on_the_curves(steering: Steering) -> None:
    marks_of = CurveMarks(PointwiseChecker(StateChecker(World("free", (-60, -60, 60, 60)), Robot.disc(0.2)), steering))
    rng = np.random.default_rng(2)
    for _ in range(300):
        p, q = rng.uniform((-9, -9, -math.pi), (9, 9, math.pi), (2, 3))
        a, b = (p[0], p[1], p[2]), (q[0], q[1], q[2])
        found = marks_of.shortest(a, b)
        assert found is not None
        length, marks = found
        assert length == pytest.approx(steering.lengths(a, b), abs=1e-12)
        fraction, places = np.array(marks)[:, 0], np.array(marks)[:, 1:]
        assert (np.diff(fraction) > 0.0).all()
        assert fraction[-1] == pytest.approx(1.0, abs=1e-11)
        assert np.abs(se2.difference(steering.states(a, b, fraction * length), places)).max() < 1e-9
        for others in marks_of.others(a, b, length):
            # Another curve that is as long comes to the same end.
            assert np.abs(se2.difference(np.array(others)[-1, 1:], b)).max() < 1e-6


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


def test_straight_motions_have_no_marks() -> None:
    single = PointwiseChecker(StateChecker(World("free", (0, 0, 9, 9)), Robot.disc(0.2)))
    with pytest.raises(ConfigurationError, match="expected a checker with steering"):
        CurveMarks(single)
