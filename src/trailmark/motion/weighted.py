"""Weighted motions: those of another kind, at a cost that depends on where they lead."""

from __future__ import annotations

from math import expm1, fabs, hypot, inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import FREE, UNDECIDED
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.curves.shortest import shortest_word
from trailmark.curves.words import unit_length, walk
from trailmark.heading import turn
from trailmark.jit import array_callee, callee, njit
from trailmark.motion import base
from trailmark.motion.base import Motion, Scratch, extra
from trailmark.motion.curve import Curve
from trailmark.motion.density import Density, build_density, least_factor, line_cost, near_border
from trailmark.motion.differential import Differential, facing
from trailmark.motion.one_way import OneWays, curve_allowed, one_ways, straight_allowed
from trailmark.motion.straight import Straight
from trailmark.objective import Objective
from trailmark.path import Path
from trailmark.se2 import FloatArray
from trailmark.variants import by_type, variant_of

__all__ = ["Weighted", "WeightedMotion"]

CHORD = 0.1
"""Metres: a curve is charged as chords of at most this length, and of a tenth of its turning radius."""

TOLERANCE = 5e-4
"""Share of a cost that its error should stay within where it is reported."""


class Weighted(NamedTuple):
    """Weighted motions, as compiled code takes them.

    Attributes:
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint.
        motion: the kind of motion: a named tuple of its own.
        density: what a metre costs.
        one_way: zones with a direction of travel.
    """

    grid: ObstacleGrid
    field: ClearanceField
    robot: Footprint
    motion: Any
    density: Density
    one_way: OneWays


class WeightedMotion(Motion):
    """Motions of another kind under an objective, in a world whose zones say what a metre costs and which way it leads.

    Args:
        motion: of the robot.
        objective: weights.
    """

    direct_is_best = False

    def __init__(self, motion: Motion, objective: Objective) -> None:
        super().__init__(motion.checker)
        self.motion, self.objective = motion, objective
        field = self.checker.field
        farthest = float(field.distance.max(initial=0.0)) + field.slack
        self.density = build_density(objective, self.checker.world, farthest)
        one_way = one_ways(self.checker.world.zones)
        # A disc's heading is 0 all along: a straight motion costs what a translation does, one kind less to compile.
        kind = motion.kind if motion.turns else Straight(*motion.kind)
        self.kind = Weighted(self.checker.grid, field, self.checker.footprint, kind, self.density, one_way)
        self.directed = motion.directed or len(one_way.headings) > 0
        # Instances of their own, where the class says what most kinds have.
        self.candidates, self.moves_anywhere, self.turns = motion.candidates, motion.moves_anywhere, motion.turns  # type: ignore[misc]
        self.has_lattice = motion.has_lattice  # type: ignore[misc]

    def cost_within(self, states: FloatArray) -> tuple[float, float]:
        """Return the cost of a path's states, shape (n, 3), as it is reported, and a proven bound on its error."""
        cost, error = path_cost(self.kind, np.array(states, order="C"), TOLERANCE)
        return float(cost) + self.extra_of(states), float(error)

    def longest(self, costs: Any) -> Any:
        """Return the length (metres) up to which motions of some costs may lead the reference point."""
        # Costs may be of a world before, in which obstacles were nearer or farther: their part is left out.
        density = self.density
        return costs / (density.length * least_factor(density.zones) + density.time / density.speed)

    def extra_of(self, states: FloatArray) -> float:
        """Return what a path's states, shape (n, 3), cost beyond its motions one by one."""
        return self.motion.extra_of(states)

    def least_cost(self, start: FloatArray, goal: FloatArray) -> float:
        """Return a lower bound on the cost of a path from start to goal, each of shape (3,), whatever the obstacles."""
        rotation = self.density.rotation * abs(turn(start[2], goal[2])) if self.moves_anywhere else 0.0
        return self.density.least * hypot(goal[0] - start[0], goal[1] - start[1]) + rotation

    def motions_by_field(self, a: FloatArray, b: FloatArray) -> NDArray[np.uint8]:
        """Return what the clearance field alone proves about motions: FREE, BLOCKED or UNDECIDED, shape (n,)."""
        known = self.motion.motions_by_field(a, b)
        return np.where(known == FREE, np.uint8(UNDECIDED), known) if self.directed else known

    def reversible(self, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
        """Return which motions are in the opposite direction the motion from b to a, shape (n,)."""
        return np.zeros(len(a), np.bool_) if self.directed else self.motion.reversible(a, b)

    def ends(self, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Return the configurations, shape (2, 3), that a path of these motions joins for a start and a goal."""
        return self.motion.ends(start, goal)

    def whole_cost(self, cost: float, start: FloatArray, goal: FloatArray) -> float:
        """Return the cost from start to goal of a path with this cost between :meth:`ends`."""
        return cost if self.turns else cost + self.density.rotation * abs(turn(start[2], goal[2]))

    def whole_states(self, states: FloatArray, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Return a path between :meth:`ends`, shape (n, 3), as one from start to goal."""
        return self.motion.whole_states(states, start, goal)

    def lines(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return straight lines, shape (l, 2, 2), metres, that show the motions from a to b, each of shape (n, 3)."""
        return self.motion.lines(a, b)

    def path(self, states: FloatArray) -> Path:
        """Return the path over these states, shape (n, 3)."""
        return self.motion.path(states)


@by_type
def weighted_cost(
    motion: Any, kind: Any, scratch: Scratch, a: FloatArray, b: FloatArray, tolerance: float
) -> tuple[float, float]:
    """Return the cost of a weighted motion of the kind ``motion`` from a to b, and a bound on its error."""
    raise NotImplementedError


@variant_of(weighted_cost, Straight)
@callee
def _straight_cost(
    motion: Any, kind: Weighted, scratch: Scratch, a: FloatArray, b: FloatArray, tolerance: float
) -> tuple[float, float]:
    cost, error = line_cost(kind.density, kind.grid, kind.field, a[0], a[1], b[0], b[1], tolerance)
    return cost + kind.density.rotation * fabs(turn(a[2], b[2])), error


@variant_of(weighted_cost, Differential)
@callee
def _differential_cost(
    motion: Any, kind: Weighted, scratch: Scratch, a: FloatArray, b: FloatArray, tolerance: float
) -> tuple[float, float]:
    cost, error = line_cost(kind.density, kind.grid, kind.field, a[0], a[1], b[0], b[1], tolerance)
    heading = facing(motion, a, b)
    return cost + kind.density.rotation * (fabs(turn(a[2], heading)) + fabs(turn(heading, b[2]))), error


@variant_of(weighted_cost, Curve)
@array_callee
def _curve_cost(
    motion: Any, kind: Weighted, scratch: Scratch, a: FloatArray, b: FloatArray, tolerance: float
) -> tuple[float, float]:
    """Charge a curve as chords, each longer by what all of them fall short of the curve."""
    word = shortest_word(a, b, motion.radius, motion.reverse, scratch.words)
    length = motion.radius * unit_length(word)
    if len(kind.density.zones) == 0 and kind.density.clearance == 0.0:
        cost = length * (kind.density.length + kind.density.time / kind.density.speed)
        return cost, 1e-12 * cost
    longest = min(CHORD, 0.1 * motion.radius) if tolerance == inf else min(CHORD, 0.01 * motion.radius)
    pieces = max(1, int(np.ceil(length / longest)))
    step = length / pieces
    # By so much an arc may bulge from its chord.
    bulge = step * step / (8.0 * motion.radius) * 1.001
    cost, error, along = 0.0, 0.0, 0.0
    q, before = np.empty(3), a.copy()
    for k in range(1, pieces + 1):
        walk(a, word, motion.radius, length * k / pieces, q)
        piece, off = line_cost(kind.density, kind.grid, kind.field, before[0], before[1], q[0], q[1], tolerance)
        chord = hypot(q[0] - before[0], q[1] - before[1])
        # Where the car changes direction it drives beyond the chord's ends.
        beside = bulge if chord > 0.999 * step else step
        if tolerance < inf and near_border(kind.density, before[0], before[1], q[0], q[1], beside):
            off += (kind.density.most - kind.density.least) * step
        if kind.density.clearance > 0.0:
            # So much nearer to an obstacle, or farther from it, the car may be than on the chord.
            off += kind.density.clearance * step * expm1(beside / kind.density.decay)
        along += chord
        cost, error = cost + piece, error + off
        before[:] = q
    stretch = length / along if along > 0.0 else 1.0
    # What the chords fall short is charged like the rest, but may lie where a metre costs least or most.
    error += max(0.0, length - along) * (kind.density.most + kind.density.clearance - kind.density.least)
    return cost * stretch, error * stretch


@variant_of(base.cost, Weighted)
@callee
def _cost(kind: Weighted, scratch: Scratch, a: FloatArray, b: FloatArray) -> float:
    return float(weighted_cost(kind.motion, kind, scratch, a, b, inf)[0])


@njit(nogil=True)
def path_cost(kind: Weighted, states: FloatArray, tolerance: float) -> tuple[float, float]:
    """Return the cost of a path's states, shape (n, 3), and a bound on its error."""
    scratch, cost, error = new_scratch_of(kind), 0.0, 0.0
    for i in range(len(states) - 1):
        one, off = weighted_cost(kind.motion, kind, scratch, states[i], states[i + 1], tolerance)
        cost, error = cost + one, error + off
    return cost, error


@variant_of(base.new_scratch, Weighted)
@array_callee
def new_scratch_of(kind: Weighted) -> Scratch:
    """Return memory for the motions that are weighted."""
    return base.new_scratch(kind.motion)


@variant_of(base.certified, Weighted)
@callee
def _certified(kind: Weighted, scratch: Scratch, a: FloatArray, b: FloatArray, budget: int) -> bool:
    return allowed(kind.motion, kind.one_way, scratch, a, b) and base.certified(kind.motion, scratch, a, b, budget)


@by_type
def allowed(motion: Any, zones: OneWays, scratch: Scratch, a: FloatArray, b: FloatArray) -> bool:
    """Return whether the motion from a to b travels as all one-way zones allow."""
    raise NotImplementedError


@variant_of(allowed, Straight)
@variant_of(allowed, Differential)
@callee
def _straight_allowed(motion: Any, zones: OneWays, scratch: Scratch, a: FloatArray, b: FloatArray) -> bool:
    return straight_allowed(zones, a, b)


@variant_of(allowed, Curve)
@array_callee
def _curve_allowed(motion: Curve, zones: OneWays, scratch: Scratch, a: FloatArray, b: FloatArray) -> bool:
    word = shortest_word(a, b, motion.radius, motion.reverse, scratch.words)
    return curve_allowed(zones, a, word, motion.radius)


@variant_of(base.charged, Weighted)
@njit(numbers=True)
def _charged(kind: Weighted) -> bool:
    return base.charged(kind.motion)


@variant_of(base.extra, Weighted)
@callee
def _extra(kind: Weighted, scratch: Scratch, a: FloatArray, b: FloatArray, gear: float) -> tuple[float, float]:
    return extra(kind.motion, scratch, a, b, gear)


@variant_of(base.interpolate, Weighted)
@callee
def _interpolate(kind: Weighted, scratch: Scratch, a: FloatArray, b: FloatArray, along: float, q: FloatArray) -> None:
    """Take the cost as evenly spread along the motion: what is made of the place is charged anew."""
    whole = weighted_cost(kind.motion, kind, scratch, a, b, inf)[0]
    share = min(1.0, along / whole) if whole > 0.0 else 0.0
    base.interpolate(kind.motion, scratch, a, b, share * base.cost(kind.motion, scratch, a, b), q)


@variant_of(base.embedding_radius, Weighted)
@njit
def _embedding_radius(kind: Weighted) -> float:
    return base.embedding_radius(kind.motion)


@variant_of(base.least_cost, Weighted)
@callee
def _least_cost(kind: Weighted, a: FloatArray, b: FloatArray) -> float:
    return kind.density.least * hypot(b[0] - a[0], b[1] - a[1])


@variant_of(base.obeys_triangle, Weighted)
@callee
def _obeys_triangle(kind: Weighted) -> bool:
    return False
