"""Query: what all steps of planning share: the ends, the clock, the best path so far, and whom to tell."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np

from trailmark.landmarks import Relaxation
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.result import PlanProgress
from trailmark.planning.settings import PlannerSettings
from trailmark.planning.shortening import shorten
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray

__all__ = ["Clock", "OnProgress", "Query"]

OnProgress = Callable[[PlanProgress], None]


class Clock:
    """How much time is left.

    Args:
        begin: reading of ``time.perf_counter``, seconds.
        limit: seconds.
        stop: asked whether to end early; never by default.
    """

    def __init__(self, begin: float, limit: float, stop: Callable[[], bool] | None = None) -> None:
        self.begin, self.limit = begin, limit
        self.stop = stop

    def seconds_left(self) -> float:
        """Return the seconds left, 0 or less once the time is up or planning was told to stop."""
        if self.stop is not None and self.stop():
            return 0.0
        return self.begin + self.limit - perf_counter()

    def is_up(self) -> bool:
        """Return whether no time is left."""
        return self.seconds_left() <= 0.0


class Query:
    """One query under way.

    Args:
        roadmap: the planner's own, of the queries before; its motion is what paths are made of.
        relaxation: the relaxed problem's grid.
        rng: source of randomness.
        incumbent: takes the paths that are found.
        clock: tells the time left.
        settings: numbers that a person may change.
        gap: how far above the proven lower bound a path may be to end the search, as a share of it.
        max_rounds: rounds of landmarks at most; as many as there is time for by default.
        on_progress: called after every step and with every better path.

    Attributes:
        ends: start and goal as the motion leads from one to the other, shape (2, 3).
        expanded: tells how many nodes and edges searches have taken so far.
        effort: nodes and edges that were taken until the first path.
        known_cost: cost of the best path that the planner's own roadmap knows, metres.
    """

    def __init__(
        self,
        roadmap: Roadmap,
        relaxation: Relaxation,
        rng: np.random.Generator,
        incumbent: Incumbent,
        clock: Clock,
        settings: PlannerSettings,
        *,
        gap: float = 0.0,
        max_rounds: int | None = None,
        on_progress: OnProgress | None = None,
    ) -> None:
        self.roadmap, self.relaxation, self.rng = roadmap, relaxation, rng
        self.motion, self.checker = roadmap.motion, roadmap.checker
        self.incumbent, self.clock, self.settings, self.gap = incumbent, clock, settings, gap
        self.ends = self.motion.ends(incumbent.start, incumbent.goal)
        self.known_cost = np.inf
        self.expanded: Callable[[], int] = int
        self.effort = 0
        self._rounds_left = np.inf if max_rounds is None else max_rounds
        self._on_progress = on_progress

    @property
    def solved(self) -> bool:
        """Whether there is a path."""
        return self.incumbent.states is not None

    @property
    def close_enough(self) -> bool:
        """Whether the best path is proven to be within the gap."""
        return self.incumbent.within(self.gap)

    def seconds_left(self) -> float:
        """Return the seconds left."""
        return self.clock.seconds_left()

    def offer(self, states: FloatArray) -> None:
        """Keep a path if it is the best so far."""
        if not self.solved:
            self.effort = self.expanded()
        if self.incumbent.offer(states):
            self.report("shortening")

    def begin_round(self, phase: str) -> bool:
        """Report, and return whether another round of landmarks may begin."""
        self.report(phase)
        self._rounds_left -= 1
        return self._rounds_left >= 0 and not self.clock.is_up()

    def take(self, states: FloatArray) -> float:
        """Offer a path, if there is one, and what shortening makes of it; return that one's cost, metres."""
        if len(states) == 0:
            return np.inf
        if not self.solved:
            self.offer(states)
        states = self.shortened(states, self.settings.first_sweeps)
        if self.motion.weighted:
            # The rest takes longer than to look for other ways around.
            self.offer(states)
            return self.motion.cost_of(states)
        if self.motion.cost_of(states) < self.settings.promising * self.incumbent.cost:
            states = self.shortened(states)
            self.offer(states)
        return self.motion.cost_of(states)

    def take_known(self, states: FloatArray) -> None:
        """Offer a path that the planner's own roadmap knows."""
        self.known_cost = min(self.known_cost, self.take(states))

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
        near = None if incumbent.nearest is None or path is not None else self.motion.path(incumbent.nearest)
        cost = None if path is None else incumbent.whole_cost
        seconds = perf_counter() - self.clock.begin
        self._on_progress(PlanProgress(seconds, phase, len(self.roadmap), cost, path, near))
