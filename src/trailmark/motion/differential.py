"""Motions of a differential drive: turn in place to face the end, drive there along the heading, turn in place."""

from __future__ import annotations

from math import atan2, fabs, hypot, pi
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.certify import EXACT, motion
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import FREE, state
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.heading import turn, wrapped
from trailmark.jit import array_callee, callee, njit
from trailmark.motion import base
from trailmark.motion.base import Motion, Scratch
from trailmark.motion.straight import never_charged, no_extra, straight_scratch
from trailmark.path import Path
from trailmark.se2 import ROTATION_WEIGHT, FloatArray
from trailmark.variants import variant_of

__all__ = ["ALIGNED", "Differential", "DifferentialMotion", "facing"]

ALIGNED = 1e-9
"""Radians by which a drive may be off the heading: less is not turned by, since it is rounding."""


class Differential(NamedTuple):
    """Turns in place and drives along the heading, as compiled code takes them.

    Attributes:
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint.
        reverse: whether the robot drives backwards too.
    """

    grid: ObstacleGrid
    field: ClearanceField
    robot: Footprint
    reverse: bool


class DifferentialMotion(Motion):
    """Motions of a robot with a differential drive: a turn in place, a drive along the heading, another turn.

    Each of the three is certified, and what is between them is valid. Costs are ‖Δxy‖ and half of each turn. A robot
    that may reverse drives backwards where that takes less turning.

    Args:
        checker: decides which configurations are valid; ``reverse`` of its robot says whether it drives backwards.
    """

    moves_anywhere: ClassVar[bool] = False
    candidates: ClassVar[int] = 2

    def __init__(self, checker: StateChecker) -> None:
        super().__init__(checker)
        self.directed = not checker.robot.reverse
        # Who may reverse gets aside by driving to and fro, with less turning than straight there.
        self.direct_is_best = not checker.robot.reverse
        self.kind = Differential(checker.grid, checker.field, checker.footprint, checker.robot.reverse)

    def least_cost(self, start: FloatArray, goal: FloatArray) -> float:
        """Return a lower bound (metres) on the cost of a path from start to goal, each of shape (3,), in the open."""
        if self.direct_is_best:
            return super().least_cost(start, goal)
        return float(se2.distance(start, goal))

    def reversible(self, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
        """Return which motions are in the opposite direction the motion from b to a, shape (n,).

        Where driving forwards takes as much turning as driving backwards, forwards is chosen in either direction; and
        half a turn is counter-clockwise in either direction.
        """
        ahead = np.arctan2(b[:, 1] - a[:, 1], b[:, 0] - a[:, 0])
        turns = np.abs(
            se2.wrap(np.stack([ahead - a[:, 2], b[:, 2] - ahead, ahead + np.pi - a[:, 2], b[:, 2] - ahead - np.pi]))
        )
        apart = np.abs(turns[:2].sum(axis=0) - turns[2:].sum(axis=0)) > ALIGNED
        return np.asarray(apart & (turns < np.pi - ALIGNED).all(axis=0))

    def driven(self, states: FloatArray) -> FloatArray:
        """Return a path's states, shape (m, 3), with those between the turns and the drives of each motion."""
        return np.asarray(_driven(self.kind, np.array(states)))

    def turned(self, q: FloatArray, headings: int) -> FloatArray:
        """Return a configuration, shape (3,), turned in place by the least to one of so many even headings, from 0 on.

        It is q itself if none of these turns is certified.
        """
        turned = np.repeat(q[None], headings, axis=0)
        turned[:, 2] = se2.wrap(2.0 * np.pi / headings * np.arange(headings))
        by = np.abs(se2.wrap(turned[:, 2] - q[2]))
        by[~self.motions_valid(np.repeat(q[None], headings, axis=0), turned)] = np.inf
        return turned[np.argmin(by)] if np.isfinite(by).any() else q

    def path(self, states: FloatArray) -> Path:
        """Return the path over these states, shape (n, 3), each of its pieces a turn in place or a drive ahead."""
        return Path(self.driven(states))


@callee
def facing(kind: Any, a: FloatArray, b: FloatArray) -> float:
    """Return the heading (radians) in which the robot drives from a to b; a's own where it does not."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    if dx == 0.0 and dy == 0.0:
        return float(a[2])
    ahead = atan2(dy, dx)
    if kind.reverse:
        back = wrapped(ahead + pi)
        if (
            fabs(turn(a[2], back)) + fabs(turn(back, b[2]))
            < fabs(turn(a[2], ahead)) + fabs(turn(ahead, b[2])) - ALIGNED
        ):
            ahead = back
    # What is rounding is not turned by.
    if fabs(turn(a[2], ahead)) <= ALIGNED:
        return float(a[2])
    return float(b[2]) if fabs(turn(ahead, b[2])) <= ALIGNED else ahead


@array_callee
def _stops(kind: Any, a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the four states, shape (4, 3), between which a motion turns, drives and turns."""
    stops = np.empty((4, 3))
    stops[0], stops[1], stops[2], stops[3] = a, a, b, b
    stops[1, 2] = stops[2, 2] = facing(kind, a, b)
    return stops


@njit
def _driven(kind: Any, states: FloatArray) -> FloatArray:
    found = np.empty((3 * len(states), 3))
    found[0] = states[0]
    count = 1
    for i in range(len(states) - 1):
        stops = _stops(kind, states[i], states[i + 1])
        for k in range(1, 4):
            if (stops[k] != found[count - 1]).any() or (i == len(states) - 2 and k == 3 and count == 1):
                found[count] = stops[k]
                count += 1
    return found[:count]


variant_of(base.new_scratch, Differential)(straight_scratch)
variant_of(base.extra, Differential)(no_extra)
variant_of(base.charged, Differential)(never_charged)


@variant_of(base.cost, Differential)
@callee
def _cost(kind: Differential, scratch: Scratch, a: FloatArray, b: FloatArray) -> float:
    heading = facing(kind, a, b)
    turned = fabs(turn(a[2], heading)) + fabs(turn(heading, b[2]))
    return float(hypot(b[0] - a[0], b[1] - a[1]) + ROTATION_WEIGHT * turned)


@variant_of(base.certified, Differential)
@array_callee
def _certified(kind: Differential, scratch: Scratch, a: FloatArray, b: FloatArray, budget: int) -> bool:
    stops = _stops(kind, a, b)
    for k in range(1, 3):
        # Between two motions they are ends, at which a motion may be in contact.
        known = (stops[k] == stops[0]).all() or (stops[k] == stops[3]).all()
        q = stops[k]
        if not known and state(kind.grid, kind.field, kind.robot, scratch.placed, q[0], q[1], q[2]) != FREE:
            return False
    # The drive first: it is the longest.
    for k in (1, 0, 2):
        free = motion(
            kind.grid, kind.field, kind.robot, scratch.placed, scratch.queue, stops[k], stops[k + 1], EXACT, budget
        )
        if free != FREE:
            return False
    return True


@variant_of(base.interpolate, Differential)
@array_callee
def _interpolate(
    kind: Differential, scratch: Scratch, a: FloatArray, b: FloatArray, along: float, q: FloatArray
) -> None:
    stops = _stops(kind, a, b)
    for k in range(3):
        turned = turn(stops[k, 2], stops[k + 1, 2])
        dx, dy = stops[k + 1, 0] - stops[k, 0], stops[k + 1, 1] - stops[k, 1]
        length = hypot(dx, dy) + ROTATION_WEIGHT * fabs(turned)
        if along <= length and length > 0.0:
            t = along / length
            q[0], q[1], q[2] = stops[k, 0] + t * dx, stops[k, 1] + t * dy, wrapped(stops[k, 2] + t * turned)
            return
        along -= length
    q[:] = b


@variant_of(base.embedding_radius, Differential)
@njit
def _radius(kind: Differential) -> float:
    # A disc's turns cost something here, too.
    return float(max(kind.robot.sweep_radius, ROTATION_WEIGHT))


@variant_of(base.obeys_triangle, Differential)
@callee
def _obeys_triangle(kind: Differential) -> bool:
    return not kind.reverse


@variant_of(base.least_cost, Differential)
@callee
def _least_cost(kind: Differential, a: FloatArray, b: FloatArray) -> float:
    return float(hypot(b[0] - a[0], b[1] - a[1]) + ROTATION_WEIGHT * fabs(turn(a[2], b[2])))
