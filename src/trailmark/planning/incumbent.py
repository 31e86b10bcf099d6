"""Incumbent: the best path of a query so far, what it took to get there, and what is proven about better ones."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from trailmark.motion import Motion
from trailmark.path import Path
from trailmark.planning.error_report import report_error
from trailmark.planning.proofs.claims import contradicted
from trailmark.se2 import FloatArray

__all__ = ["Incumbent"]


class Incumbent:
    """The best path of one query.

    Args:
        motion: what paths are made of.
        start: valid configuration, shape (3,).
        goal: valid configuration, shape (3,).
        begin: reading of ``time.perf_counter`` that times are counted from, seconds.

    Attributes:
        states: of the best path, shape (n, 3), between the motion's :meth:`~trailmark.motion.Motion.ends`; None before
            there is one.
        cost: theirs, metres; infinite before there is one.
        first_cost: the first path's cost, metres; None before there is one.
        history: (seconds, cost in metres) of each better path.
        lower_bound: proven lower bound on any path's cost, metres; infinite if it proves that there is none.
        bounded: whether ``lower_bound`` was proven with the obstacles taken into account.
        nearest: without a path, the states (n, 3) of one from the start to where it comes nearest to the goal.
    """

    def __init__(self, motion: Motion, start: FloatArray, goal: FloatArray, begin: float) -> None:
        self.motion, self.start, self.goal, self.begin = motion, start, goal, begin
        self.states: FloatArray | None = None
        self.cost = np.inf
        self.first_cost: float | None = None
        self.history: list[tuple[float, float]] = []
        self.lower_bound = motion.least_cost(start, goal)
        self.bounded = self._refuted = False
        self.nearest: FloatArray | None = None

    @property
    def whole_cost(self) -> float:
        """The best path's cost, a disc's turning included, metres; infinite before there is one."""
        return self.motion.whole_cost(self.cost, self.start, self.goal)

    @property
    def infeasible(self) -> bool:
        """Whether it is proven that there is no path."""
        return not np.isfinite(self.lower_bound)

    @property
    def optimal(self) -> bool:
        """Whether the best path costs no more than the lower bound."""
        return self.whole_cost <= self.lower_bound + 1e-9

    def path(self) -> Path | None:
        """Return the best path from start to goal; None before there is one."""
        if self.states is None:
            return None
        return self.motion.path(self.motion.whole_states(self.states, self.start, self.goal))

    def offer(self, states: FloatArray) -> bool:
        """Keep a path if it costs less than the best so far; return whether it does."""
        seconds, cost = perf_counter() - self.begin, self.motion.cost_of(states)
        if cost >= self.cost:
            return False
        self.states, self.cost = states, cost
        self.claim(self.lower_bound)
        if self.first_cost is None:
            self.first_cost = self.whole_cost
        self.history.append((seconds, self.whole_cost))
        return True

    def claim(self, bound: float) -> None:
        """Take a lower bound over (metres), unless a known path costs less: then nothing is claimed any more."""
        if self._refuted:
            return
        self.lower_bound = max(self.lower_bound, bound)
        if self.states is not None and contradicted(self.lower_bound, self.whole_cost):
            # What planning goes by may be a little less than the cost that is reported.
            self.cost = max(self.cost, sum(self.motion.cost_within(self.states)))
        if self.states is not None and contradicted(self.lower_bound, self.whole_cost):
            problem = f"a lower bound of {self.lower_bound:g} m is above the cost of a path, {self.whole_cost:g} m"
            checker = self.motion.checker
            report_error(problem, checker.world, checker.robot, self.start, self.goal)
            self.lower_bound, self._refuted = self.motion.least_cost(self.start, self.goal), True

    def within(self, gap: float) -> bool:
        """Return whether the best path is proven to cost no more than (1 + ``gap``) times the optimum."""
        return self.bounded and self.whole_cost <= (1.0 + gap) * self.lower_bound + 1e-9
