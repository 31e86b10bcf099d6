"""Marks lie on the curves that they stand for, and each of several shortest curves has its own."""

from __future__ import annotations

import math

import numpy as np

from trailmark.collision import StateChecker
from trailmark.curves import Steering
from trailmark.motion.pointwise import CurveMarks, PointwiseChecker
from trailmark.shapes import Disc, Shape
from trailmark.world import Robot, World


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
