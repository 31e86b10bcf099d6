"""Translations of a disc: its heading does not matter for collisions and is added when the path is returned."""

from __future__ import annotations

from math import hypot
from typing import ClassVar, NamedTuple

import numpy as np

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.heading import turn
from trailmark.jit import callee
from trailmark.motion import base
from trailmark.motion.base import Scratch
from trailmark.motion.straight import (
    StraightMotion,
    never_charged,
    no_extra,
    shortest_anyway,
    straight_certified,
    straight_scratch,
    sweep_radius,
)
from trailmark.se2 import FloatArray
from trailmark.variants import variant_of

__all__ = ["Translation", "TranslationMotion"]


class Translation(NamedTuple):
    """Translations, as compiled code takes them.

    Attributes:
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint, a disc.
    """

    grid: ObstacleGrid
    field: ClearanceField
    robot: Footprint


class TranslationMotion(StraightMotion):
    """Translations of a disc; arguments and attributes are those of :class:`trailmark.motion.base.Motion`.

    Costs are ‖Δxy‖. The heading turns evenly along the whole path, which has the lowest cost.
    """

    turns: ClassVar[bool] = False

    def __init__(self, checker: StateChecker) -> None:
        super().__init__(checker)
        self.kind = Translation(checker.grid, checker.field, checker.footprint)

    def least_cost(self, start: FloatArray, goal: FloatArray) -> float:
        """Return the cost (metres) of a path from start to goal, each of shape (3,), without obstacles."""
        return self.whole_cost(hypot(goal[0] - start[0], goal[1] - start[1]), start, goal)

    def reversible(self, a: FloatArray, b: FloatArray) -> np.ndarray:
        """Return which motions are in the opposite direction the motion from b to a, shape (n,): all."""
        return np.ones(len(a), np.bool_)

    def ends(self, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Return start and goal, shape (2, 3), at heading 0."""
        ends = np.array([start, goal])
        ends[:, 2] = 0.0
        return ends

    def whole_cost(self, cost: float, start: FloatArray, goal: FloatArray) -> float:
        """Return the whole cost (metres) of a path: its length and the turn from the start's heading to the goal's."""
        return cost + se2.ROTATION_WEIGHT * abs(turn(start[2], goal[2]))

    def whole_states(self, states: FloatArray, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Return a path with the ends' headings, shape (n, 3), that turns evenly along its length."""
        return turned_evenly(states, start, goal)


def turned_evenly(states: FloatArray, start: FloatArray, goal: FloatArray) -> FloatArray:
    """Return a path with the headings of its ends, turning evenly along it, which has the lowest cost; shape (n, 3).

    Args:
        states: shape (n, 3), n >= 2; their headings do not matter.
        start: shape (3,).
        goal: shape (3,).
    """
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(states[:, :2], axis=0).T))])
    share = along / along[-1] if along[-1] > 0.0 else np.linspace(0.0, 1.0, len(states))
    turned = np.array(states)
    turned[:, 2] = se2.interpolate(start, goal, share)[:, 2]
    turned[0], turned[-1] = start, goal
    return turned


# A disc's motions are straight motions with another cost.
variant_of(base.new_scratch, Translation)(straight_scratch)
variant_of(base.certified, Translation)(straight_certified)
variant_of(base.embedding_radius, Translation)(sweep_radius)
variant_of(base.extra, Translation)(no_extra)
variant_of(base.charged, Translation)(never_charged)
variant_of(base.obeys_triangle, Translation)(shortest_anyway)


@variant_of(base.cost, Translation)
@callee
def _cost(kind: Translation, scratch: Scratch, a: FloatArray, b: FloatArray) -> float:
    return hypot(b[0] - a[0], b[1] - a[1])


@variant_of(base.interpolate, Translation)
@callee
def _interpolate(
    kind: Translation, scratch: Scratch, a: FloatArray, b: FloatArray, along: float, q: FloatArray
) -> None:
    length = hypot(b[0] - a[0], b[1] - a[1])
    t = min(1.0, along / length) if length > 0.0 else 0.0
    q[0], q[1], q[2] = a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2]


@variant_of(base.least_cost, Translation)
@callee
def _least_cost(kind: Translation, a: FloatArray, b: FloatArray) -> float:
    return hypot(b[0] - a[0], b[1] - a[1])
