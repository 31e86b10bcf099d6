"""Motion: how a robot moves from one configuration to another, for roadmaps, searches and shortening.

There are four kinds: a disc's translation (:mod:`trailmark.motion.translation`), a straight motion in SE(2)
(:mod:`trailmark.motion.straight`), the shortest curve of a car (:mod:`trailmark.motion.curve`), and what a differential
drive does: turn, drive ahead, turn (:mod:`trailmark.motion.differential`). Compiled code takes a kind as a named tuple
and calls the functions below, which are chosen by its type while it is compiled (:func:`trailmark.variants.by_type`).
Python uses a :class:`Motion`, which holds that tuple.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.certify import BUDGET
from trailmark.collision.kernels import UNDECIDED
from trailmark.errors import ConfigurationError
from trailmark.jit import callee, njit
from trailmark.objective import Objective
from trailmark.path import Path
from trailmark.se2 import FloatArray
from trailmark.variants import by_type

__all__ = [
    "Motion",
    "Scratch",
    "certified",
    "charged",
    "cost",
    "costs",
    "embedding_radius",
    "extra",
    "extra_along",
    "interpolate",
    "least_cost",
    "motions_free",
    "new_scratch",
    "obeys_triangle",
]


class Scratch(NamedTuple):
    """Memory for the compiled code of one thread to work in.

    Attributes:
        placed: (v, 2), the placed outline.
        queue: (128, 2), gaps of a motion.
        words: (w, 2, 5), a car's curves.
    """

    placed: FloatArray
    queue: FloatArray
    words: FloatArray


@by_type
def new_scratch(kind: Any) -> Scratch:
    """Return memory for one thread to work in."""
    raise NotImplementedError


@by_type
def cost(kind: Any, scratch: Scratch, a: FloatArray, b: FloatArray) -> float:
    """Return the cost (metres) of the motion from a to b, each of shape (3,)."""
    raise NotImplementedError


@by_type
def extra(kind: Any, scratch: Scratch, a: FloatArray, b: FloatArray, gear: float) -> tuple[float, float]:
    """Return what the motion from a to b costs beyond :func:`cost`, and the gear at its end.

    A car is charged for its changes of direction and its metres in reverse: one driven to and fro costs more than its
    motions do one by one.

    Args:
        kind: of motion.
        scratch: memory to work in.
        a: shape (3,).
        b: shape (3,).
        gear: of the motion before: 1 forwards, -1 backwards, 0 if there is none or it makes no difference.
    """
    raise NotImplementedError


@by_type
def charged(kind: Any) -> bool:
    """Return whether motions may cost more than :func:`cost`: see :func:`extra`."""
    raise NotImplementedError


@by_type
def certified(kind: Any, scratch: Scratch, a: FloatArray, b: FloatArray, budget: int) -> bool:
    """Return whether the motion from a to b, both valid, is certified free of collision.

    Args:
        kind: of motion.
        scratch: memory to work in.
        a: shape (3,).
        b: shape (3,).
        budget: maximum number of configurations evaluated; a motion that needs more is not certified.
    """
    raise NotImplementedError


@by_type
def interpolate(kind: Any, scratch: Scratch, a: FloatArray, b: FloatArray, along: float, q: FloatArray) -> None:
    """Write the configuration at cost ``along`` (metres) on the motion from a to b to q."""
    raise NotImplementedError


@by_type
def embedding_radius(kind: Any) -> float:
    """Return R of the embedding (x, y, R·cos θ, R·sin θ) in which near configurations are cheap to join, metres."""
    raise NotImplementedError


@by_type
def least_cost(kind: Any, a: FloatArray, b: FloatArray) -> float:
    """Return a lower bound (metres) on :func:`cost` that is cheap to compute and continuous in a and b."""
    raise NotImplementedError


@callee
def extra_along(kind: Any, scratch: Scratch, path: FloatArray, first: int, last: int) -> float:
    """Return the :func:`extra` cost of a path's motions from state ``first`` to ``last``, what is before left aside."""
    total, gear = 0.0, 0.0
    if charged(kind):
        for i in range(max(0, first), min(last, len(path) - 1)):
            more, gear = extra(kind, scratch, path[i], path[i + 1], gear)
            total += more
    return total


@by_type
def obeys_triangle(kind: Any) -> bool:
    """Return whether no motion costs more than two that lead to the same place."""
    raise NotImplementedError


@njit(nogil=True)
def costs(kind: Any, a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the costs (metres, shape (n,)) of the motions from a to b, each of shape (n, 3)."""
    scratch, result = new_scratch(kind), np.empty(len(a))
    for i in range(len(a)):
        result[i] = cost(kind, scratch, a[i], b[i])
    return result


@njit(nogil=True)
def motions_free(kind: Any, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
    """Return which motions between valid configurations, each of shape (n, 3), are certified, shape (n,)."""
    scratch, result = new_scratch(kind), np.empty(len(a), np.bool_)
    for i in range(len(a)):
        result[i] = certified(kind, scratch, a[i], b[i], BUDGET)
    return result


class Motion(ABC):
    """One kind of motion of a robot in a world.

    Args:
        checker: decides which configurations are valid.

    Attributes:
        checker: as given.
        kind: the named tuple that compiled code takes.
        directed: whether a motion may be possible in one direction only.
        candidates: nodes near in the embedding that are considered for each neighbour that is wanted.
        moves_anywhere: whether the robot may move in every direction.
        has_lattice: whether its motions lead from one configuration of a lattice to the next.
        turns: whether the heading makes a difference to which configurations and motions are valid.
        objective: what a path costs; None if that is its length.
        direct_is_best: whether nothing is cheaper than a motion that leads from start to goal.
    """

    kind: Any
    objective: Objective | None = None
    directed = False
    candidates: ClassVar[int] = 1
    moves_anywhere: ClassVar[bool] = True
    has_lattice: ClassVar[bool] = True
    turns: ClassVar[bool] = True
    direct_is_best = True

    def __init__(self, checker: StateChecker) -> None:
        self.checker = checker

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.checker.robot.describe()} in world {self.checker.world.name!r})"

    @property
    def radius(self) -> float:
        """R of the embedding (x, y, R·cos θ, R·sin θ), metres."""
        return float(embedding_radius(self.kind))

    def costs(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return the costs (metres, shape (n,)) of the motions from a to b, each of shape (n, 3) or (3,)."""
        starts, ends = np.broadcast_arrays(np.atleast_2d(a), np.atleast_2d(b))
        return np.asarray(costs(self.kind, np.array(starts, order="C"), np.array(ends, order="C")))

    def least_cost(self, start: FloatArray, goal: FloatArray) -> float:
        """Return the cost (metres) of a path from start to goal, each of shape (3,), without obstacles."""
        ends = self.ends(start, goal)
        return self.whole_cost(float(self.costs(ends[:1], ends[1:])[0]), start, goal)

    def cost_of(self, states: FloatArray) -> float:
        """Return the cost (metres) of a path's states, shape (n, 3)."""
        return float(self.costs(states[:-1], states[1:]).sum()) + self.extra_of(states)

    def longest(self, costs: Any) -> Any:
        """Return the length (metres) up to which motions of some costs may lead the reference point."""
        return costs

    @property
    def charged(self) -> bool:
        """Whether motions may cost more than one by one: see :func:`extra`."""
        return bool(charged(self.kind))

    def extra_of(self, states: FloatArray) -> float:
        """Return what a path's states, shape (n, 3), cost beyond its motions one by one: :func:`extra`."""
        return 0.0

    def cost_within(self, states: FloatArray) -> tuple[float, float]:
        """Return the cost of a path's states, shape (n, 3), as it is reported, and a proven bound on its error."""
        return self.cost_of(states), 0.0

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
        return np.asarray(motions_free(self.kind, a, b))

    def motions_by_field(self, a: FloatArray, b: FloatArray) -> NDArray[np.uint8]:
        """Return what the clearance field alone proves about motions: FREE, BLOCKED or UNDECIDED, shape (n,)."""
        return np.full(len(a), UNDECIDED, np.uint8)

    def reversible(self, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
        """Return which motions are in the opposite direction the motion from b to a, shape (n,)."""
        return np.ones(len(a), np.bool_)

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

    @abstractmethod
    def path(self, states: FloatArray) -> Path:
        """Return the path over these states, shape (n, 3)."""
