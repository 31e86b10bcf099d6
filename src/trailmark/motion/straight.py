"""Straight motions in SE(2): x, y and heading are linear, the heading the shorter way round."""

from __future__ import annotations

from math import fabs, hypot
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.collision.certify import EXACT, motion, new_queue
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import FREE, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.heading import turn, wrapped
from trailmark.jit import array_callee, callee, njit
from trailmark.motion import base
from trailmark.motion.base import Motion, Scratch
from trailmark.path import Path
from trailmark.se2 import ROTATION_WEIGHT, FloatArray
from trailmark.variants import variant_of

__all__ = [
    "Straight",
    "StraightMotion",
    "never_charged",
    "no_extra",
    "shortest_anyway",
    "straight_certified",
    "straight_scratch",
    "sweep_radius",
]


class Straight(NamedTuple):
    """Straight motions, as compiled code takes them.

    Attributes:
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint.
    """

    grid: ObstacleGrid
    field: ClearanceField
    robot: Footprint


class StraightMotion(Motion):
    """Straight motions of a robot with a heading; arguments and attributes are those of :class:`Motion`."""

    def __init__(self, checker: StateChecker) -> None:
        super().__init__(checker)
        self.kind = Straight(checker.grid, checker.field, checker.footprint)

    def motions_between_valid(self, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
        """Return which motions between configurations known to be valid are certified; shapes (n, 3), unchecked."""
        return self.checker.motions_free(a, b)

    def motions_by_field(self, a: FloatArray, b: FloatArray) -> NDArray[np.uint8]:
        """Return what the clearance field alone proves about motions: FREE, BLOCKED or UNDECIDED, shape (n,)."""
        return self.checker.motions_by_field(a, b)

    def least_cost(self, start: FloatArray, goal: FloatArray) -> float:
        """Return the cost (metres) of a path from start to goal, each of shape (3,), without obstacles."""
        return hypot(goal[0] - start[0], goal[1] - start[1]) + ROTATION_WEIGHT * fabs(turn(start[2], goal[2]))

    def reversible(self, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
        """Return which motions are in the opposite direction the motion from b to a, shape (n,).

        Exactly half a turn is counter-clockwise in either direction: back, it is another motion.
        """
        return np.asarray(np.abs(a[:, 2] - b[:, 2]) != np.pi)

    def path(self, states: FloatArray) -> Path:
        """Return the path over these states, shape (n, 3)."""
        return Path(states)


@variant_of(base.new_scratch, Straight)
@array_callee
def straight_scratch(kind: Any) -> Scratch:
    """Return memory for straight motions."""
    return Scratch(workspace(kind.robot), new_queue(), np.empty((0, 2, 5)))


@variant_of(base.cost, Straight)
@callee
def _cost(kind: Straight, scratch: Scratch, a: FloatArray, b: FloatArray) -> float:
    return float(hypot(b[0] - a[0], b[1] - a[1]) + ROTATION_WEIGHT * fabs(turn(a[2], b[2])))


@variant_of(base.certified, Straight)
@callee
def straight_certified(kind: Any, scratch: Scratch, a: FloatArray, b: FloatArray, budget: int) -> bool:
    """Return whether the straight motion from a to b, each of shape (3,) and valid, is certified."""
    return bool(motion(kind.grid, kind.field, kind.robot, scratch.placed, scratch.queue, a, b, EXACT, budget) == FREE)


@variant_of(base.interpolate, Straight)
@callee
def _interpolate(kind: Straight, scratch: Scratch, a: FloatArray, b: FloatArray, along: float, q: FloatArray) -> None:
    length = hypot(b[0] - a[0], b[1] - a[1]) + ROTATION_WEIGHT * fabs(turn(a[2], b[2]))
    t = min(1.0, along / length) if length > 0.0 else 0.0
    q[0], q[1] = a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])
    q[2] = wrapped(a[2] + t * turn(a[2], b[2]))


@variant_of(base.embedding_radius, Straight)
@njit
def sweep_radius(kind: Any) -> float:
    """Return the maximum distance (metres) that a point of the robot moves in a turn of one radian."""
    return float(kind.robot.sweep_radius)


@variant_of(base.least_cost, Straight)
@callee
def _least_cost(kind: Straight, a: FloatArray, b: FloatArray) -> float:
    return float(hypot(b[0] - a[0], b[1] - a[1]) + ROTATION_WEIGHT * fabs(turn(a[2], b[2])))


@variant_of(base.extra, Straight)
@callee
def no_extra(kind: Any, scratch: Scratch, a: FloatArray, b: FloatArray, gear: float) -> tuple[float, float]:
    """Return that motions in every direction cost nothing beyond their own cost."""
    return 0.0, 0.0


@variant_of(base.charged, Straight)
@njit
def never_charged(kind: Any) -> bool:
    """Return that motions in every direction cost nothing beyond their own cost."""
    return False


@variant_of(base.obeys_triangle, Straight)
@callee
def shortest_anyway(kind: Any) -> bool:
    """Return True: a straight motion is the shortest."""
    return True
