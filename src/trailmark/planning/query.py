"""One query under way: the problem, and what all stages share."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from trailmark.planning.incumbent import Budget, Incumbent, OnProgress
from trailmark.planning.model import WorldModel
from trailmark.planning.result import PlanProgress
from trailmark.planning.shortening import shorten
from trailmark.se2 import FloatArray
from trailmark.trajectories import path_of

__all__ = ["PROMISING", "Query"]

PROMISING = 1.03
"""Times the best path's cost within which the first sweeps have to bring a path to get all others."""


class Query:
    """One query under way: the problem, what it may take, and what came of it so far.

    Attributes:
        ends: start and goal as the motion leads from one to the other, shape (2, 3).
        incumbent: takes the paths that are found.
        roadmap_cost: cost of the best path that the planner's own roadmap knows, metres.
    """

    def __init__(
        self, model: WorldModel, ends: FloatArray, budget: Budget, on_progress: OnProgress | None = None
    ) -> None:
        self.model, self.roadmap, self.relaxation = model, model.shared.roadmap, model.relaxation
        self.motion, self.checker, self.settings, self.rng = model.motion, model.checker, model.settings, model.rng
        self.budget, self.ends = budget, self.motion.ends(*ends)
        self.incumbent = Incumbent(self.motion, ends[0], ends[1], budget.begin)
        self.roadmap_cost = np.inf
        self._rounds_left = np.inf if budget.rounds is None else budget.rounds
        self._on_progress = on_progress

    @property
    def solved(self) -> bool:
        """Whether there is a path."""
        return self.incumbent.states is not None

    @property
    def close_enough(self) -> bool:
        """Whether the best path is as good as asked for: the first, or proven to be within the gap."""
        return self.solved and (self.budget.gap == np.inf or self.incumbent.within(self.budget.gap))

    def seconds_left(self) -> float:
        """Return the seconds left."""
        return self.budget.seconds_left()

    def begin_round(self, phase: str) -> bool:
        """Report, and return whether another round of landmarks may begin."""
        self.report(phase)
        self._rounds_left -= 1
        return self._rounds_left >= 0 and not self.budget.is_up()

    def offer(self, states: FloatArray) -> None:
        """Keep a path if it is the best so far."""
        if self.incumbent.offer(states):
            self.report("shortening")

    def submit(self, states: FloatArray) -> float:
        """Offer a path, if there is one, and what shortening makes of it; return that one's cost, metres."""
        if len(states) == 0:
            return np.inf
        if not self.solved:
            self.offer(states)
            if self.close_enough:
                return self.incumbent.cost
        states = self.shortened(states, self.settings.first_sweeps)
        # On weighted ground all sweeps take longer than to look for other ways around.
        if self.motion.weighted:
            self.offer(states)
        elif self.motion.cost_of(states) < PROMISING * self.incumbent.cost:
            states = self.shortened(states)
            self.offer(states)
        return self.motion.cost_of(states)

    def submit_known(self, states: FloatArray) -> None:
        """Submit a path that the planner's own roadmap knows."""
        self.roadmap_cost = min(self.roadmap_cost, self.submit(states))

    def shortened(self, states: FloatArray, sweeps: int | None = None, *, splitting: bool = False) -> FloatArray:
        """Return a path made shorter, as far as there is time: with added vertices, but for a car, or without."""
        if not self.settings.uses("shortening"):
            return states
        # A vertex more costs a curve more than it gains.
        splitting = (splitting or (sweeps is None and not self.motion.direct_is_best)) and self.motion.moves_anywhere
        sweeps = self.settings.sweeps if sweeps is None else sweeps
        return shorten(
            self.motion, states, self.rng, sweeps=sweeps, splitting=splitting, seconds_left=self.seconds_left
        )

    def report(self, phase: str) -> None:
        """Tell how far planning has come."""
        if self._on_progress is None:
            return
        incumbent, path = self.incumbent, self.incumbent.path()
        near = None if incumbent.nearest is None or path is not None else path_of(self.motion, incumbent.nearest)
        cost = None if path is None else incumbent.whole_cost
        seconds = perf_counter() - self.budget.begin
        self._on_progress(PlanProgress(seconds, phase, len(self.roadmap), cost, path, near))
