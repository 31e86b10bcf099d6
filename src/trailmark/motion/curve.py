"""A car's motions: the shortest curves of Dubins, or of Reeds and Shepp for a car that reverses."""

from __future__ import annotations

from math import hypot
from typing import ClassVar, NamedTuple

import numpy as np

from trailmark.collision import StateChecker
from trailmark.collision.certify import curve_motion, new_queue
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import FREE, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.curves import CurvePath, Steering
from trailmark.curves.shortest import MAX_WORDS, curve_length, shortest_word
from trailmark.curves.words import PIECES, walk
from trailmark.errors import ConfigurationError
from trailmark.jit import array_callee, callee, njit
from trailmark.motion import base
from trailmark.motion.base import Motion, Scratch, charged, extra_along, new_scratch
from trailmark.objective import Objective
from trailmark.se2 import FloatArray
from trailmark.variants import variant_of

__all__ = ["Curve", "CurveMotion", "word_extra"]

DRAWN = 12
"""Number of straight lines that represent a curve in drawings."""


class Curve(NamedTuple):
    """Shortest curves, as compiled code takes them.

    Attributes:
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint.
        radius: turning radius, metres.
        reverse: whether the car drives backwards too.
        direction_change: what a change of direction costs, metres.
        reverse_metre: what a metre in reverse costs beyond its length, metres.
    """

    grid: ObstacleGrid
    field: ClearanceField
    robot: Footprint
    radius: float
    reverse: bool
    direction_change: float
    reverse_metre: float


class CurveMotion(Motion):
    """Shortest curves of a car.

    A curve is certified if no configuration along it collides; as with straight motions, one that comes within 1e-6 m
    of an obstacle more than 1 mm from its ends is not, nor is one that needs more than 20,000 distances. Configurations
    are near in the embedding (x, y, ρ·cos θ, ρ·sin θ): a turn by an angle takes an arc of about that length.

    Args:
        checker: decides which configurations are valid.
        steering: turning radius, and whether the car reverses; that of the checker's robot if None.
        objective: what changes of direction and metres in reverse cost; nothing beyond their length by default.

    Raises:
        ConfigurationError: neither ``steering`` nor a turning radius of the robot is given.
    """

    candidates: ClassVar[int] = 3
    moves_anywhere: ClassVar[bool] = False
    has_lattice: ClassVar[bool] = False

    def __init__(
        self, checker: StateChecker, steering: Steering | None = None, objective: Objective | None = None
    ) -> None:
        super().__init__(checker)
        chosen = steering or Steering.of(checker.robot)
        if chosen is None:
            raise ConfigurationError(
                f"curves: expected steering, or a robot with a turning radius, got neither ({checker.robot.describe()})"
            )
        self.steering: Steering = chosen
        self.directed = not chosen.reverse
        change, more = (0.0, 0.0) if objective is None or not chosen.reverse else objective.maneuver_costs
        self.kind = Curve(checker.grid, checker.field, checker.footprint, chosen.radius, chosen.reverse, change, more)
        if self.charged:
            # A curve with fewer changes of direction may be longer and cost less.
            self.objective, self.direct_is_best = objective, False

    def least_cost(self, start: FloatArray, goal: FloatArray) -> float:
        """Return a lower bound (metres) on the cost of a path from start to goal, each of shape (3,), in open space.

        Without a change of direction a path is a curve of Dubins, or one from goal to start driven backwards; with one,
        it is no shorter than a curve of Reeds and Shepp.
        """
        shortest = self.steering.lengths(start, goal)
        if not charged(self.kind):
            return float(shortest)
        forwards = Steering(self.steering.radius, reverse=False)
        backwards = (1.0 + self.kind.reverse_metre) * forwards.lengths(goal, start)
        return float(min(shortest + self.kind.direction_change, forwards.lengths(start, goal), backwards))

    def extra_of(self, states: FloatArray) -> float:
        """Return what changes of direction and metres in reverse cost along a path, shape (n, 3), in metres."""
        return float(_extra_of(self.kind, np.array(states, order="C"))) if charged(self.kind) else 0.0

    def lines(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return straight lines, shape (l, 2, 2), metres, that show the curves from a to b, each of shape (n, 3)."""
        if len(a) == 0:
            return np.empty((0, 2, 2))
        along = self.costs(a, b)[:, None] * np.linspace(0.0, 1.0, DRAWN + 1)
        xy = self.steering.states(a, b, along)[..., :2]
        return np.stack([xy[:, :-1], xy[:, 1:]], axis=2).reshape(-1, 2, 2)

    def path(self, states: FloatArray) -> CurvePath:
        """Return the path over these knots, shape (n, 3)."""
        return CurvePath(states, self.steering)


@variant_of(base.new_scratch, Curve)
@array_callee
def _new_scratch(kind: Curve) -> Scratch:
    return Scratch(workspace(kind.robot), new_queue(), np.empty((MAX_WORDS, 2, PIECES)))


@variant_of(base.cost, Curve)
@callee
def _cost(kind: Curve, scratch: Scratch, a: FloatArray, b: FloatArray) -> float:
    return float(curve_length(a, b, kind.radius, kind.reverse, scratch.words))


@variant_of(base.certified, Curve)
@array_callee
def _certified(kind: Curve, scratch: Scratch, a: FloatArray, b: FloatArray, budget: int) -> bool:
    word = shortest_word(a, b, kind.radius, kind.reverse, scratch.words)
    answer = curve_motion(
        kind.grid, kind.field, kind.robot, scratch.placed, scratch.queue, a, word, kind.radius, budget
    )
    return bool(answer == FREE)


@variant_of(base.interpolate, Curve)
@array_callee
def _interpolate(kind: Curve, scratch: Scratch, a: FloatArray, b: FloatArray, along: float, q: FloatArray) -> None:
    walk(a, shortest_word(a, b, kind.radius, kind.reverse, scratch.words), kind.radius, along, q)


@variant_of(base.embedding_radius, Curve)
@njit
def _radius(kind: Curve) -> float:
    return kind.radius


@variant_of(base.least_cost, Curve)
@callee
def _least_cost(kind: Curve, a: FloatArray, b: FloatArray) -> float:
    return hypot(b[0] - a[0], b[1] - a[1])


@variant_of(base.charged, Curve)
@njit(numbers=True)
def _charged(kind: Curve) -> bool:
    return bool(kind.direction_change > 0.0 or kind.reverse_metre > 0.0)


@variant_of(base.extra, Curve)
@array_callee
def _extra(kind: Curve, scratch: Scratch, a: FloatArray, b: FloatArray, gear: float) -> tuple[float, float]:
    if not _charged(kind):
        return 0.0, 0.0
    word = shortest_word(a, b, kind.radius, kind.reverse, scratch.words)
    return word_extra(word, kind.radius, kind.direction_change, kind.reverse_metre, gear)


@callee
def word_extra(
    word: FloatArray, radius: float, direction_change: float, reverse_metre: float, gear: float
) -> tuple[float, float]:
    """Return what a word, shape (2, 5), costs beyond its length (metres), and the gear at its end: see ``extra``."""
    total = 0.0
    for k in range(PIECES):
        if word[0, k] == 0.0:
            continue
        now = 1.0 if word[0, k] > 0.0 else -1.0
        if gear * now < 0.0:
            total += direction_change
        if now < 0.0:
            total -= reverse_metre * radius * word[0, k]
        gear = now
    return total, gear


@njit(nogil=True)
def _extra_of(kind: Curve, states: FloatArray) -> float:
    return extra_along(kind, new_scratch(kind), states, 0, len(states) - 1)


@variant_of(base.obeys_triangle, Curve)
@callee
def _obeys_triangle(kind: Curve) -> bool:
    return True
