"""GoalIncumbent: the best path to any of a query's goals, what is known of each, and what is proven."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from trailmark.goals import Goal, ReachedGoal
from trailmark.path import Path
from trailmark.planning.error_report import report_error
from trailmark.planning.followed import FollowedPath
from trailmark.planning.free_end import with_free_end
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.proofs.claims import contradicted
from trailmark.planning.query import Clock, OnProgress
from trailmark.planning.result import PlanProgress, PlanResult, Status
from trailmark.planning.world_model import WorldModel
from trailmark.se2 import FloatArray

__all__ = ["GoalIncumbent", "reached_at"]


class GoalIncumbent:
    """The best path of one query with goals.

    Args:
        model: of the world.
        start: valid, shape (3,).
        goals: of which one is to be reached.
        bounds: proven lower bound for each goal, its cost included, metres, shape (g,).
        clock: of the query.
        gap: how far above the proven lower bound a path may be to end the search, as a share of it.
        on_progress: called after every step and with every better path.

    Attributes:
        bounds: as given, to be raised by whoever proves more; infinite: there is no path to that goal.
        charges: the goals' own costs, metres, shape (g,).
        cost: of the best path, its goal's cost included, metres; infinite before there is one.
        path: the best, which passed the final check; None before there is one.
        found: for each goal that a path is known to: the cheapest one's cost without the goal's, and its vertices.
        nearest: without a path, the certified one that comes nearest to a goal, if one is known.
        build: seconds that were spent on what other queries use as well.
    """

    def __init__(
        self,
        model: WorldModel,
        start: FloatArray,
        goals: tuple[Goal, ...],
        bounds: FloatArray,
        clock: Clock,
        gap: float,
        on_progress: OnProgress | None,
    ) -> None:
        self.model, self.motion, self.start, self.goals, self.clock = model, model.motion, start, goals, clock
        self.bounds, self.gap, self._on_progress = bounds, gap, on_progress
        self.charges = np.array([goal.cost for goal in goals])
        self.cost, self._index, self.build = np.inf, -1, 0.0
        self.path: Path | None = None
        self.nearest: Path | None = None
        self.found: dict[int, tuple[float, FloatArray]] = {}
        self._history: list[tuple[float, float]] = []

    @property
    def lower_bound(self) -> float:
        """Proven lower bound on the cost of any path with its goal's, metres."""
        return float(self.bounds.min())

    @property
    def close_enough(self) -> bool:
        """Whether the best path is proven to be within the gap, or that there is none."""
        if self.path is None:
            return not np.isfinite(self.lower_bound)
        return self.cost <= (1.0 + self.gap) * self.lower_bound + 1e-9

    def better(self) -> NDArray[np.bool_]:
        """Return for each goal whether a path there may be better than the best by more than the gap, shape (g,)."""
        if self.path is None:
            return np.isfinite(self.bounds)
        return np.asarray(self.cost > (1.0 + self.gap) * self.bounds + 1e-9)

    def settle(self, states: FloatArray, i: int, end: FloatArray) -> None:
        """Offer a path to a goal, with the end that costs least."""
        if self.offer(states, i, end) and self.goals[i].configuration is None:
            states = with_free_end(self.motion, states, self.goals[i], self.model.rng, self.clock.seconds_left)
            end = np.array([*states[-1, :2], states[-1, 2] if self.motion.turns else end[2]])
            self.offer(states, i, end)

    def offer(self, states: FloatArray, i: int, end: FloatArray) -> bool:
        """Keep a path to a goal if it is the best so far and passes the final check; return whether it may be used."""
        whole = self.motion.whole_states(states, self.start, end)
        cost = self.motion.whole_cost(self.motion.cost_of(states), self.start, end)
        total = cost + self.charges[i]
        if i not in self.found or cost < self.found[i][0]:
            self.found[i] = cost, states
        if total >= self.cost:
            return True
        path = self.motion.path(whole)
        if not self.goals[i].contains(path.states[-1]) or not self.model.verification.certified(
            path, np.array([self.start, end])
        ):
            del self.found[i]
            return False
        self.cost, self.path, self._index = total, path, i
        seconds = perf_counter() - self.clock.begin
        self.note(seconds, total)
        if self._on_progress is not None:
            nodes = len(self.model.shared.roadmap)
            self._on_progress(PlanProgress(seconds, "looking for better goals", nodes, total, path))
        return True

    def note(self, seconds: float, total: float) -> None:
        """Note a path that is better than those before."""
        if not self._history or total < self._history[-1][1]:
            self._history.append((seconds, total))

    def report(self, state: PlanProgress, i: int, offset: float) -> None:
        """Hand on progress, with the best path to any goal."""
        assert self._on_progress is not None  # noqa: S101  # that is why it is called
        path, cost = self.path, None if self.path is None else self.cost
        if state.path is not None and state.cost is not None and state.cost + self.charges[i] < self.cost:
            path, cost = state.path, state.cost + self.charges[i]
        self._on_progress(replace(state, elapsed=offset + state.elapsed, path=path, cost=cost))

    def end_of(self, i: int, states: FloatArray) -> FloatArray:
        """Return the configuration that a path to a goal ends at, shape (3,)."""
        if self.motion.turns:
            return np.array(states[-1])
        return np.array(self.goals[i].nearest([*states[-1, :2], self.start[2]])[0])

    def result(self) -> PlanResult:
        """Return the answer."""
        bound, path = self.lower_bound, self.path
        status: Status = "solved" if path is not None else "timeout" if np.isfinite(bound) else "infeasible"
        if contradicted(bound, self.cost):
            problem = (
                f"a lower bound of {bound:g} m is above the cost of a path to one of several goals, {self.cost:g} m"
            )
            end = self.start if path is None else path.states[-1]
            report_error(
                problem, self.model.checker.world, self.model.checker.robot, self.start, end, seed=self.model.seed
            )
            bound = 0.0
        incumbent = Incumbent(
            self.motion, self.start, self.start if path is None else path.states[-1], self.clock.begin
        )
        incumbent.history = self._history
        incumbent.first_cost = self._history[0][1] if self._history else None
        if path is not None and len(path.states) > 1:
            self.model.followed = FollowedPath.of(self.motion, path)
        found = self.model.verification.result(incumbent, status, path, self.model.shared.roadmap, self.build)
        goal = None if path is None else reached_at(path, self._index, self.goals[self._index])
        # Where the two meet, the cost may be below the bound by its error.
        lower_bound = min(bound, self.cost) if np.isfinite(bound) else None
        nearest = self.nearest if path is None else None
        return replace(found, lower_bound=lower_bound, goal=goal, nearest=nearest, target=tuple(self.goals))


def reached_at(path: Path, index: int, goal: Goal) -> ReachedGoal:
    """Return which of its goals, and where, a path ends at."""
    x, y, theta = path.states[-1].tolist()
    return ReachedGoal(index, (x, y, theta), goal.cost)
