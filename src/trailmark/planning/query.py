"""One query: its budget, the best path so far with what is proven of better ones, and what all stages share."""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.curves import CurvePath
from trailmark.errors import InternalErrorWarning
from trailmark.formats.world_yaml import world_text
from trailmark.motion import Motion, WeightedMotion
from trailmark.path import Path
from trailmark.planning.proofs.claims import contradicted
from trailmark.planning.result import PlanProgress
from trailmark.planning.shortening import shorten
from trailmark.se2 import FloatArray
from trailmark.world import Query as Named
from trailmark.world import Robot, World

if TYPE_CHECKING:
    from trailmark.planning.model import WorldModel

__all__ = ["GAP", "Budget", "Incumbent", "OnProgress", "Query", "report_error", "vertices_of"]

OnProgress = Callable[[PlanProgress], None]

GAP = 1e-4
"""A path within a ten-thousandth of the optimum is as good as any."""

PROMISING = 1.03
"""Times the best path's cost within which the first sweeps have to bring a path to get all others."""


class Budget:
    """What a query may take.

    Args:
        seconds: from now on.
        stop: asked whether to end early; never by default.
        rounds: of landmarks at most; as many as there is time for by default.
        gap: how far above the proven lower bound a path may be, as a share of it; infinite: the first path will do.
    """

    def __init__(
        self,
        seconds: float,
        *,
        stop: Callable[[], bool] | None = None,
        rounds: int | None = None,
        gap: float = GAP,
    ) -> None:
        self.begin, self.limit, self.stop, self.rounds, self.gap = perf_counter(), seconds, stop, rounds, gap

    def seconds_left(self) -> float:
        """Return the seconds left, 0 or less once the time is up or planning was told to stop."""
        if self.stop is not None and self.stop():
            return 0.0
        return self.begin + self.limit - perf_counter()

    def is_up(self) -> bool:
        """Return whether no time is left."""
        return self.seconds_left() <= 0.0

    def part(self, seconds: float, gap: float | None = None) -> Budget:
        """Return the budget of a part of the work, which ends with the whole at the latest."""
        seconds = max(min(seconds, self.seconds_left()), 1e-3)
        return Budget(seconds, stop=self.stop, rounds=self.rounds, gap=self.gap if gap is None else gap)


class Incumbent:
    """The best path of one query, and what is proven about better ones.

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
        self.raise_bound(self.lower_bound)
        if self.first_cost is None:
            self.first_cost = self.whole_cost
        self.history.append((seconds, self.whole_cost))
        return True

    def raise_bound(self, bound: float) -> None:
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
        if isinstance(self.motion, WeightedMotion):
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
        near = None if incumbent.nearest is None or path is not None else self.motion.path(incumbent.nearest)
        cost = None if path is None else incumbent.whole_cost
        seconds = perf_counter() - self.budget.begin
        self._on_progress(PlanProgress(seconds, phase, len(self.roadmap), cost, path, near))


def vertices_of(motion: Motion, path: Path) -> FloatArray:
    """Return the states, shape (n, 3), that motions of a kind join along a path."""
    states = np.array(path.knots if isinstance(path, CurvePath) else path.states)
    if not motion.turns:
        states[:, 2] = 0.0
    return states


def report_error(problem: str, world: World, robot: Robot, start: FloatArray, goal: FloatArray, **details: Any) -> None:
    """Warn of an error of trailmark's own: what is wrong is not returned, but kept in a file that reproduces it.

    The file, in the temporary folder, is a world with the robot and the query ``failed``: ``trailmark plan FILE --seed
    N`` asks for it again. Details, plain values such as seed and states, are written as comments.

    Warns:
        InternalErrorWarning: the problem, in one line, and where the file is.
    """
    from trailmark import __version__

    failed = Named("failed", tuple(map(float, start)), tuple(map(float, goal)))  # type: ignore[arg-type]  # three each
    notes = {"trailmark": __version__, "problem": problem, **details}
    text = "".join(f"# {key}: {json.dumps(value)}\n" for key, value in notes.items())
    text += world_text(replace(world, robot=robot, queries=(failed,)))
    try:
        handle, where = tempfile.mkstemp(prefix="trailmark-internal-error-", suffix=".yaml")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        where = f"no file ({error.strerror or error})"
    warnings.warn(f"{problem}; not returned. To report it: {where}", InternalErrorWarning, stacklevel=2)
