"""Motion and its kinds: how a robot moves from one configuration to another, as Python asks of it."""

from __future__ import annotations

from math import fabs, hypot, inf
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.kernels import FREE, UNDECIDED
from trailmark.curves import Steering
from trailmark.errors import ConfigurationError
from trailmark.heading import turn
from trailmark.motion import base
from trailmark.motion.base import MotionModel
from trailmark.motion.density import Density, build_density, least_factor
from trailmark.motion.one_way import one_ways
from trailmark.se2 import ROTATION_WEIGHT, FloatArray
from trailmark.world.objective import Objective

__all__ = ["CurveMotion", "DifferentialMotion", "Motion", "StraightMotion", "TranslationMotion"]

DRAWN = 12
"""Number of straight lines that represent a curve in drawings."""

TOLERANCE = 5e-4
"""Share of a cost that its error should stay within where it is reported."""

UNWEIGHTED = build_density(Objective(), (), 0.0), one_ways(())
"""Density and one-way zones of motions that cost their length."""


class Motion:
    """One kind of motion of a robot in a world.

    Args:
        checker: decides which configurations are valid.

    Attributes:
        checker: as given.
        kind: the tuple that compiled code takes.
        directed: whether a motion may be possible in one direction only.
        candidates: nodes near in the embedding that are considered for each neighbour that is wanted.
        moves_anywhere: whether the robot may move in every direction.
        has_lattice: whether its motions lead from one configuration of a lattice to the next.
        turns: whether the heading makes a difference to which configurations and motions are valid.
        objective: what a path costs; None if that is its length.
        direct_is_best: whether nothing is cheaper than a motion that leads from start to goal.
    """

    objective: Objective | None = None
    directed = False
    candidates: ClassVar[int] = 1
    moves_anywhere: ClassVar[bool] = True
    has_lattice: ClassVar[bool] = True
    turns: ClassVar[bool] = True
    drive: ClassVar[int]
    direct_is_best = True

    def __init__(self, checker: StateChecker) -> None:
        self.checker = checker
        radius = checker.footprint.sweep_radius
        self.kind = MotionModel(
            checker.grid, checker.field, checker.footprint, self.drive, radius, (), 1.0, True, 0.0, 0.0, (), *UNWEIGHTED
        )

    def weigh(self, objective: Objective) -> None:
        """Let motions cost what an objective and the world's zones say, and travel as its one-way zones allow."""
        field, world = self.checker.field, self.checker.world
        farthest = float(field.distance.max(initial=0.0)) + field.slack
        density, one_way = build_density(objective, world.zones, farthest), one_ways(world.zones)
        self.kind = self.kind._replace(weighted=(True,), density=density, one_way=one_way)
        self.objective, self.direct_is_best = objective, False
        self.directed = self.directed or len(one_way.zones) > 0

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.checker.robot.describe()} in world {self.checker.world.name!r})"

    @property
    def weighted(self) -> bool:
        """Whether a metre's cost differs from its length or from place to place, or its direction matters."""
        return len(self.kind.weighted) > 0

    @property
    def density(self) -> Density:
        """What a metre costs, if the motion is weighted."""
        return self.kind.density

    @property
    def radius(self) -> float:
        """R of the embedding (x, y, R·cos θ, R·sin θ), metres."""
        return self.kind.embedding

    def costs(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return the costs (metres, shape (n,)) of the motions from a to b, each of shape (n, 3) or (3,)."""
        starts, ends = np.broadcast_arrays(np.atleast_2d(a), np.atleast_2d(b))
        return np.asarray(base.costs(self.kind, np.array(starts, order="C"), np.array(ends, order="C")))

    def least_cost(self, start: FloatArray, goal: FloatArray) -> float:
        """Return a lower bound (metres) on the cost of a path from start to goal, each of shape (3,), in open space."""
        if not self.weighted:
            return self._least_length(start, goal)
        rotation = self.density.rotation * abs(turn(start[2], goal[2])) if self.moves_anywhere else 0.0
        return self.density.least * hypot(goal[0] - start[0], goal[1] - start[1]) + rotation

    def _least_length(self, start: FloatArray, goal: FloatArray) -> float:
        return hypot(goal[0] - start[0], goal[1] - start[1]) + ROTATION_WEIGHT * fabs(turn(start[2], goal[2]))

    def cost_of(self, states: FloatArray) -> float:
        """Return the cost (metres) of a path's states, shape (n, 3)."""
        motions, more, _ = self._path_cost(states, inf)
        return motions + more

    def cost_within(self, states: FloatArray) -> tuple[float, float]:
        """Return the cost of a path's states, shape (n, 3), as it is reported, and a proven bound on its error."""
        motions, more, error = self._path_cost(states, TOLERANCE)
        return motions + more, error

    def _path_cost(self, states: FloatArray, tolerance: float) -> tuple[float, float, float]:
        found: tuple[float, float, float] = base.path_cost(self.kind, np.array(states, order="C"), tolerance)
        return found

    def longest(self, costs: Any) -> Any:
        """Return the length (metres) up to which motions of some costs may lead the reference point."""
        if not self.weighted:
            return costs
        # Costs may be of a world before, in which obstacles were nearer or farther: their part is left out.
        density = self.density
        return costs / (density.length * least_factor(density.zones) + density.time / density.speed)

    @property
    def charged(self) -> bool:
        """Whether motions may cost more than one by one: see :func:`trailmark.motion.base.extra`."""
        return self.kind.direction_change > 0.0 or self.kind.reverse_metre > 0.0

    def motions_valid(self, a: ArrayLike, b: ArrayLike) -> NDArray[np.bool_]:
        """Return which motions are certified free of collision, ends included.

        Args:
            a: starts, shape (n, 3).
            b: ends, shape (n, 3).

        Returns:
            Shape (n,), True only if no configuration along the motion collides.

        Raises:
            ConfigurationError: other shapes, different lengths, or values that are not finite.
        """
        starts, ends = se2.ends_of_motions(a, b)
        free = np.asarray(self.checker.valid(starts) & self.checker.valid(ends))
        free[free] = self.motions_between_valid(starts[free], ends[free])
        return free

    def motion_valid(self, a: ArrayLike, b: ArrayLike) -> bool:
        """Return whether the motion from a to b, each of shape (3,), is certified free of collision."""
        ends = se2.configurations(a, name="motion: start"), se2.configurations(b, name="motion: end")
        if ends[0].ndim != 1 or ends[1].ndim != 1:
            raise ConfigurationError(f"motion: expected shapes (3,), got {ends[0].shape} and {ends[1].shape}")
        return bool(self.motions_valid(*ends)[0])

    def motions_between_valid(self, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
        """Return which motions between configurations known to be valid are certified; shapes (n, 3), unchecked."""
        # Copies: read-only arrays would be another type to the kernels, and compiled for anew.
        return np.asarray(base.motions_free(self.kind, np.array(a), np.array(b)))

    def motions_by_field(self, a: FloatArray, b: FloatArray) -> NDArray[np.uint8]:
        """Return what the clearance field alone proves about motions: FREE, BLOCKED or UNDECIDED, shape (n,)."""
        return np.full(len(a), UNDECIDED, np.uint8)

    def reversible(self, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
        """Return which motions are in the opposite direction the motion from b to a, shape (n,)."""
        return np.full(len(a), not (self.weighted and self.directed))

    def ends(self, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Return the configurations, shape (2, 3), that a path of these motions joins for a start and a goal."""
        return np.array([start, goal])

    def whole_cost(self, cost: float, start: FloatArray, goal: FloatArray) -> float:
        """Return the cost (metres) from start to goal of a path with this cost between :meth:`ends`."""
        return cost

    def whole_states(self, states: FloatArray, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Return a path between :meth:`ends`, shape (n, 3), as one from start to goal."""
        return states

    def lines(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return straight lines, shape (l, 2, 2), metres, that show the motions from a to b, each of shape (n, 3)."""
        return np.stack([a[:, :2], b[:, :2]], axis=1)

    def driven(self, states: FloatArray) -> FloatArray:
        """Return the states (m, 3) of the path over these states, shape (n, 3); for curves, they are its knots."""
        return states


class StraightMotion(Motion):
    """Straight motions in SE(2): x, y and heading are linear, the heading the shorter way round."""

    drive = base.STRAIGHT

    def motions_by_field(self, a: FloatArray, b: FloatArray) -> NDArray[np.uint8]:
        """Return what the clearance field alone proves about motions: FREE, BLOCKED or UNDECIDED, shape (n,)."""
        known = self.checker.motions_by_field(a, b)
        return np.where(known == FREE, np.uint8(UNDECIDED), known) if self.weighted and self.directed else known

    def reversible(self, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
        """Return which motions are in the opposite direction the motion from b to a, shape (n,).

        Exactly half a turn is counter-clockwise in either direction: back, it is another motion.
        """
        known = super().reversible(a, b)
        return known & (np.abs(a[:, 2] - b[:, 2]) != np.pi) if self.turns else known


class TranslationMotion(StraightMotion):
    """Translations of a disc, whose heading does not matter for collisions.

    It turns evenly along the whole path, which has the lowest cost; between :meth:`ends` it is 0.
    """

    turns: ClassVar[bool] = False
    drive = base.TRANSLATION

    def ends(self, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Return start and goal, shape (2, 3), at heading 0."""
        ends = np.array([start, goal])
        ends[:, 2] = 0.0
        return ends

    def whole_cost(self, cost: float, start: FloatArray, goal: FloatArray) -> float:
        """Return the whole cost of a path: what is given, and the turn from the start's heading to the goal's."""
        rotation = self.density.rotation if self.weighted else ROTATION_WEIGHT
        return cost + rotation * abs(turn(start[2], goal[2]))

    def whole_states(self, states: FloatArray, start: FloatArray, goal: FloatArray) -> FloatArray:
        """Return a path with the ends' headings, shape (n, 3), n >= 2, that turns evenly along its length."""
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(states[:, :2], axis=0).T))])
        share = along / along[-1] if along[-1] > 0.0 else np.linspace(0.0, 1.0, len(states))
        turned = np.array(states)
        turned[:, 2] = se2.interpolate(start, goal, share)[:, 2]
        turned[0], turned[-1] = start, goal
        return turned


class DifferentialMotion(Motion):
    """Motions of a robot with a differential drive: a turn in place, a drive along the heading, another turn.

    Each of the three is certified, and what is between them is valid. Costs are ‖Δxy‖ and half of each turn. A robot
    that may reverse drives backwards where that takes less turning.

    Args:
        checker: decides which configurations are valid; ``reverse`` of its robot says whether it drives backwards.
    """

    moves_anywhere: ClassVar[bool] = False
    candidates: ClassVar[int] = 2
    drive = base.DIFFERENTIAL

    def __init__(self, checker: StateChecker) -> None:
        super().__init__(checker)
        self.directed = not checker.robot.reverse
        # Who may reverse gets aside by driving to and fro, with less turning than straight there.
        self.direct_is_best = not checker.robot.reverse
        # A turn costs something, a disc's too.
        self.kind = self.kind._replace(embedding=max(self.radius, ROTATION_WEIGHT), reverse=checker.robot.reverse)

    def _least_length(self, start: FloatArray, goal: FloatArray) -> float:
        if self.direct_is_best:
            return float(self.costs(start, goal)[0])
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
        apart = np.abs(turns[:2].sum(axis=0) - turns[2:].sum(axis=0)) > base.ALIGNED
        return np.asarray(super().reversible(a, b) & apart & (turns < np.pi - base.ALIGNED).all(axis=0))

    def turned(self, q: FloatArray, headings: int) -> FloatArray:
        """Return a configuration, shape (3,), turned in place by the least to one of so many even headings, from 0 on.

        It is q itself if none of these turns is certified.
        """
        turned = np.repeat(q[None], headings, axis=0)
        turned[:, 2] = se2.wrap(2.0 * np.pi / headings * np.arange(headings))
        by = np.abs(se2.wrap(turned[:, 2] - q[2]))
        by[~self.motions_valid(np.repeat(q[None], headings, axis=0), turned)] = np.inf
        return turned[np.argmin(by)] if np.isfinite(by).any() else q

    def driven(self, states: FloatArray) -> FloatArray:
        """Return the states (m, 3) of the path over these states, each of its pieces a turn in place or a drive."""
        return np.asarray(base.driven(self.kind, np.array(states)))


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
    drive = base.CURVE

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
        radius, reverse = chosen.radius, chosen.reverse
        self.kind = self.kind._replace(embedding=radius, car=(True,), radius=radius, reverse=reverse)
        if objective is not None and chosen.reverse:
            change, more = objective.maneuver_costs
            self.kind = self.kind._replace(direction_change=change, reverse_metre=more)
        if self.charged:
            # A curve with fewer changes of direction may be longer and cost less.
            self.objective, self.direct_is_best = objective, False

    def _least_length(self, start: FloatArray, goal: FloatArray) -> float:
        """Return a lower bound (metres) on the cost of a path from start to goal, each of shape (3,), in open space.

        Without a change of direction a path is a curve of Dubins, or one from goal to start driven backwards; with one,
        it is no shorter than a curve of Reeds and Shepp.
        """
        shortest = self.steering.lengths(start, goal)
        if not self.charged:
            return float(shortest)
        forwards = Steering(self.steering.radius, reverse=False)
        backwards = (1.0 + self.kind.reverse_metre) * forwards.lengths(goal, start)
        return float(min(shortest + self.kind.direction_change, forwards.lengths(start, goal), backwards))

    def lines(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return straight lines, shape (l, 2, 2), metres, that show the curves from a to b, each of shape (n, 3)."""
        if len(a) == 0:
            return np.empty((0, 2, 2))
        along = self.steering.lengths(a, b)[:, None] * np.linspace(0.0, 1.0, DRAWN + 1)
        xy = self.steering.states(a, b, along)[..., :2]
        return np.stack([xy[:, :-1], xy[:, 1:]], axis=2).reshape(-1, 2, 2)
