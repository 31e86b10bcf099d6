"""One path through places in a given order: each leg is a query, and configurations left free are chosen together.

The configurations in which the places are passed are first those of the cheapest chain without obstacles, by dynamic
programming. Once there is a path, each place tries its other configurations with both of its legs, and then each leg is
improved for its share of the time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from trailmark.arguments import brief
from trailmark.errors import ConfigurationError
from trailmark.motion import Motion
from trailmark.planning.escape import without_paths
from trailmark.planning.incumbent import Budget, Incumbent, OnProgress, vertices_of
from trailmark.planning.model import WorldModel, zones_at
from trailmark.planning.pipeline import plan_single
from trailmark.planning.result import PlanProgress, PlanResult, Status
from trailmark.proofs import LowerBound
from trailmark.proofs.background import in_time
from trailmark.proofs.claims import contradicted
from trailmark.se2 import FloatArray
from trailmark.trajectories import CurvePath, Path, path_of
from trailmark.world import Robot
from trailmark.world.goals import Goal, ReachedGoal, goals_of

__all__ = ["Stops", "plan_through", "stops_of"]

HEADINGS, DRAWN, MORE_DRAWN, CHOICES = 16, 24, 2_000, 32
"""Headings of a place where any is allowed; configurations drawn in a region, and while none is free; and those of one
place that are chosen among, at most."""

LEG_SHARE, TRY_SHARE, PROOF_SHARE = 0.5, 0.05, 0.1
"""Of a leg's part of the time, for the configuration chosen, before all of the place is its goal; of the time left, for
trying one other configuration, and for lower bounds."""


@dataclass(frozen=True)
class Stops:
    """Places to pass in this order, each one goal or several of which any one is passed; the last is the goal."""

    places: tuple[tuple[Goal, ...], ...]

    def name(self, i: int) -> str:
        """Return what a place is called; -1 is the start."""
        return "start" if i < 0 else "goal" if i == len(self.places) - 1 else f"via point {i + 1}"

    def configuration(self, i: int) -> tuple[float, float, float] | None:
        """Return the one configuration in which a place is passed; None if there are more."""
        place = self.places[i]
        return place[0].configuration if len(place) == 1 else None


def stops_of(goals: Sequence[Any]) -> Stops:
    """Return places given as configurations, positions x, y, goals, or sequences of goals.

    Raises:
        ConfigurationError: there is none, or one is nothing of these.
    """
    if isinstance(goals, Goal | str | bytes) or not isinstance(goals, Sequence | np.ndarray) or len(goals) == 0:
        raise ConfigurationError(f"goals: expected the places to pass in turn, got {brief(goals)}")
    try:
        return Stops(tuple(goals_of(each) or (Goal(each),) for each in goals))
    except ConfigurationError as error:
        raise ConfigurationError(f"goals: {error}") from None


def plan_through(
    model: WorldModel,
    start: FloatArray,
    stops: Stops,
    budget: Budget,
    plan: Callable[..., PlanResult],
    on_progress: OnProgress | None = None,
) -> PlanResult:
    """Return one path from a start through all places; whoever calls holds the lock of the model's roadmap.

    Args:
        model: of the world.
        start: configuration, shape (3,).
        stops: what the path leads through.
        budget: for all legs together.
        plan: answers any query: a model, start, goal, budget and ``on_progress``.
        on_progress: called after every step, with a path once there is a whole one.

    Raises:
        ConfigurationError: the start, or a place that is one configuration, is not valid.
    """
    through = _Through(model, start, stops, budget, plan, on_progress)
    if not through.find():
        return through.failure()
    for i in range(len(through.legs) - 1):
        through.choose(i)
    through.improve()
    return through.result()


@dataclass(frozen=True)
class _Leg:
    """A leg for which there is a path: where it starts, its path, and the answer to its query."""

    start: FloatArray
    path: Path
    result: PlanResult


class _Through:
    """One query through places.

    Attributes:
        choices: free configurations of each place, shape (n, 3).
        legs: of the path so far.
        failed: the answer to the last query of :meth:`find`.
        cost: of the whole path, metres; infinite before there is one.
    """

    def __init__(
        self,
        model: WorldModel,
        start: FloatArray,
        stops: Stops,
        budget: Budget,
        plan: Callable[..., PlanResult],
        on_progress: OnProgress | None,
    ) -> None:
        self.model, self.motion, self.start, self.stops, self.budget = model, model.motion, start, stops, budget
        # Keep-out zones that the start is in: the first leg leads out of them, and the others keep out of all.
        zones = zones_at(model.checker, start)
        self._leaves, self._verification = len(zones) > 0, (model.without(zones) if zones else model).verification
        self._plan, self._on_progress = plan, on_progress
        self._told = None if on_progress is None else without_paths(on_progress)
        self.choices = [self._configurations(i) for i in range(len(stops.places))]
        self._chain = self._cheapest_chain()
        self.legs: list[_Leg] = []
        self.cost, self._history = np.inf, list[tuple[float, float]]()

    def _configurations(self, i: int) -> FloatArray:
        """Return free configurations of a place, shape (n, 3); empty if none is found."""
        checker, place, rng = self.model.checker, self.stops.places[i], self.model.rng
        headings = np.linspace(-np.pi, np.pi, HEADINGS, endpoint=False) if self.motion.turns else self.start[2:]
        for count in (DRAWN, MORE_DRAWN):
            rows = []
            for goal in place:
                if (pose := goal.configuration) is not None:
                    rows.append(np.array([pose]))
                    continue
                around = np.column_stack([np.tile(goal.disc[0], (len(headings), 1)), headings])
                if goal.disc[1] > 0.0 or goal.headings:
                    around = np.vstack([goal.nearest(around), goal.draw(rng, count)])
                rows.append(around)
            states = np.vstack(rows)
            free = checker.states_free(states)
            if free.any():
                break
        if not free.any() and all(goal.configuration is not None for goal in place):
            checker.require_valid(states[0], self.stops.name(i))
        states = states[free]
        return states if len(states) <= CHOICES else rng.choice(states, CHOICES, replace=False)

    def _cheapest_chain(self) -> list[FloatArray | None]:
        """Return the configurations of the cheapest way through all places without obstacles."""
        known = [i for i, rows in enumerate(self.choices) if len(rows)]
        costs, rows, back = np.zeros(1), self.start[None], []
        for i in known:
            each = costs[:, None] + self._straight(rows, self.choices[i]) + self._charges(i, self.choices[i])
            back.append(each.argmin(axis=0))
            costs, rows = each.min(axis=0), self.choices[i]
        ends: list[FloatArray | None] = [None] * len(self.choices)
        k = int(costs.argmin())
        for i, before in zip(reversed(known), reversed(back), strict=True):
            ends[i], k = self.choices[i][k], int(before[k])
        return ends

    def _charges(self, i: int, rows: FloatArray) -> FloatArray:
        """Return what configurations (n, 3) of a place are charged by the cheapest goal that holds each, (n,)."""
        place = self.stops.places[i]
        if len(place) == 1:
            return np.full(len(rows), place[0].cost)
        return np.asarray(np.min([np.where(goal.contains(rows), goal.cost, np.inf) for goal in place], axis=0))

    def _straight(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return what motions from each of n configurations to each of m cost, metres, shape (n, m)."""
        first, second = np.repeat(a, len(b), axis=0), np.tile(b, (len(a), 1))
        if self.motion.turns:
            return self.motion.costs(first, second).reshape(len(a), len(b))
        pairs = np.array([self.motion.ends(p, q) for p, q in zip(first, second, strict=True)])
        costs = self.motion.costs(np.array(pairs[:, 0]), np.array(pairs[:, 1]))
        whole = [self.motion.whole_cost(c, p, q) for c, p, q in zip(costs, first, second, strict=True)]
        return np.reshape(whole, (len(a), len(b)))

    def find(self) -> bool:
        """Find a first path for each leg in turn; return whether there is one for all of them."""
        here = self.start
        for i, end in enumerate(self._chain):
            place, one = self.stops.places[i], self.stops.configuration(i) is not None
            goals = [*([] if end is None else [(end, 1.0 if one else LEG_SHARE)]), *([] if one else [(place, 1.0)])]
            for goal, share in goals:
                seconds = share * self.budget.seconds_left() / (len(self._chain) - i)
                # What leads out of zones is not improved later.
                budget = self.budget.part(seconds, self.budget.gap if self._leaves and i == 0 else np.inf)
                self.failed = self._plan(self.model, here, goal, budget, on_progress=self._told)
                if self.failed.path is not None:
                    break
            if self.failed.path is None:
                return False
            self.legs.append(_Leg(here, self.failed.path, self._reaching(i, self.failed, self.failed.path)))
            here = self.failed.path.states[-1]
        return self._submit(self.legs)

    def _reaching(self, i: int, result: PlanResult, path: Path) -> PlanResult:
        """Return the answer to a leg's query with which of the place's goals it ends at, and that one's cost."""
        place, end = self.stops.places[i], path.states[-1]
        held = [k for k, goal in enumerate(place) if goal.contains(end)]
        if not held or (len(place) == 1 and place[0].cost == 0.0 and place[0].configuration is not None):
            return result
        k = min(held, key=lambda k: place[k].cost)
        return replace(result, goal=ReachedGoal(k, (float(end[0]), float(end[1]), float(end[2])), place[k].cost))

    def choose(self, i: int) -> None:
        """Pass a place in the configuration with which both of its legs cost least, of those there is time to try."""
        if (
            self.stops.configuration(i) is not None
            or self.good_enough
            or self.budget.is_up()
            or (i == 0 and self._leaves)
        ):
            return
        before, after = (vertices_of(self.motion, leg.path) for leg in self.legs[i : i + 2])
        beside = np.vstack([before[-2:], after[:2]])
        rows = np.vstack([self.choices[i], *(goal.nearest(beside) for goal in self.stops.places[i])])
        rows = rows[self.model.checker.states_free(rows)]
        # What is gained as seen from the vertices beside it, and from the places beside it.
        gains, all_ = np.full(len(rows), -np.inf), np.vstack([before[-1:], rows])
        for a, b in ((before[-2:][:1], after[:2][-1:]), (before[:1], after[-1:])):
            costs = self._straight(a, all_)[0] + self._straight(all_, b)[:, 0] + self._charges(i, all_)
            gains = np.maximum(gains, costs[0] - costs[1:])
        for k in np.argsort(-gains, kind="stable"):
            if gains[k] <= 0.0 or self.good_enough or self.budget.is_up():
                return
            self._try(i, rows[k])

    def _try(self, i: int, q: FloatArray) -> None:
        """Pass a place in another configuration if that costs less."""
        seconds, legs = TRY_SHARE * self.budget.seconds_left(), list(self.legs)
        for j, moved in ((i, -1), (i + 1, 0)):
            states = vertices_of(self.motion, legs[j].path)
            states[moved] = q if self.motion.turns else [*q[:2], 0.0]
            last = states[-2:] if moved else states[:2]
            known = len(last) == 2 and self.motion.motions_between_valid(last[:1], last[1:])[0]
            start, end = (legs[j].start, q) if moved else (q, legs[j].path.states[-1])
            leg = self._planned(j, start, end, seconds, np.inf, states if known else None)
            if leg is None:
                return
            legs[j] = leg
        self._submit(legs)

    def improve(self) -> None:
        """Improve the legs, each for its share of the time, until the whole is proven to be good enough."""
        for i in range(int(self._leaves), len(self.legs)):
            if self.good_enough or self.budget.is_up():
                return
            old, seconds = self.legs[i], self.budget.seconds_left() / (len(self.legs) - i)
            known = vertices_of(self.motion, old.path)
            new = self._planned(i, old.start, old.path.states[-1], seconds, self.budget.gap, known)
            if new is not None:
                best = new if (new.result.cost or np.inf) < (old.result.cost or np.inf) else old
                bound = max(old.result.lower_bound or 0.0, new.result.lower_bound or 0.0)
                result = replace(best.result, lower_bound=bound)
                self._submit([*self.legs[:i], replace(best, result=result), *self.legs[i + 1 :]])

    def _planned(
        self, i: int, start: FloatArray, goal: FloatArray, seconds: float, gap: float, known: FloatArray | None
    ) -> _Leg | None:
        """Return a leg to a place, between two configurations, or None."""
        budget = self.budget.part(seconds, gap)
        result = plan_single(self.model, start, goal, budget, on_progress=self._told, known=known)
        return None if result.path is None else _Leg(start, result.path, self._reaching(i, result, result.path))

    # --- the whole

    def _submit(self, legs: list[_Leg]) -> bool:
        """Keep legs if all together cost no more than those kept so far; return whether they do."""
        path = _joined([leg.path for leg in legs], self.motion)
        cost = self._cost_of(path, legs)
        if cost > self.cost:
            return False
        better = cost < self.cost
        self.legs, self.cost, self.path = legs, cost, path
        if better:
            seconds = perf_counter() - self.budget.begin
            self._history.append((seconds, cost))
            if self._on_progress is not None:
                nodes = len(self.model.shared.roadmap)
                self._on_progress(PlanProgress(seconds, "improving the legs", nodes, cost, path))
        return True

    def _cost_of(self, path: Path, legs: list[_Leg]) -> float:
        """Return what a whole path costs, metres: with changes of gear at the places, and with the goals' own costs."""
        goals = sum(leg.result.goal.cost for leg in legs if leg.result.goal is not None)
        if self.motion.objective is None:
            return path.cost + goals
        if self.motion.turns:
            return self.motion.cost_within(vertices_of(self.motion, path))[0] + goals
        return sum(leg.result.cost or 0.0 for leg in legs)

    @property
    def good_enough(self) -> bool:
        """Whether the whole path is proven to be within the gap of the best."""
        return self.budget.gap == np.inf or self.cost <= (1.0 + self.budget.gap) * self.bound() + 1e-9

    def bound(self) -> float:
        """Return a proven lower bound on what any path through the places costs, metres; infinite: there is none.

        The bound of a leg's query holds for its two ends. Where either may be another configuration, it counts what a
        way between the positions costs.
        """
        total = 0.0
        for i, place in enumerate(self.stops.places):
            fixed = self.stops.configuration(i) is not None and (i == 0 or self.stops.configuration(i - 1) is not None)
            proven = self.legs[i].result.lower_bound if fixed and i < len(self.legs) else None
            total += proven if proven is not None else self._positions[i] + min(goal.cost for goal in place)
        return total

    @cached_property
    def _positions(self) -> list[float]:
        """Lower bounds on what each leg costs, whatever the configurations at its ends, metres.

        They are what the way of the largest disc about the reference point costs, which is inside the robot whatever
        its heading.
        """
        found, checker, bound = [], self.model.checker, self.model.bound
        radius = checker.robot.reference_radius
        disc = None
        if radius > 0.0 and self.budget.gap < np.inf:
            disc = LowerBound(checker.world, Robot.disc(radius + checker.robot.clearance), checker.grid)
        begins: tuple[Goal, ...] = (Goal(self.start),)  # type: ignore[arg-type]  # arrays, too
        for i, place in enumerate(self.stops.places):
            pairs = [(a.disc, b.disc) for a in begins for b in place]
            least = [bound.between(p, q, near + far) for (p, near), (q, far) in pairs]
            seconds = PROOF_SHARE * self.budget.seconds_left() / len(self.stops.places)
            exact = len(pairs) == 1 and pairs[0][0][1] + pairs[0][1][1] == 0.0 and not (self._leaves and i == 0)
            if disc is not None and exact and seconds > 0.0 and not disc.takes_long:
                ends = [np.array([*position, 0.0]) for position, _ in pairs[0]]
                around = in_time(seconds, lambda stop, ends=ends: disc.of(*ends, stop=stop).cost)  # type: ignore[misc]
                least = [max(least[0], bound.least * (around or 0.0))]
            found.append(min(least))
            begins = place
        return found

    def result(self) -> PlanResult:
        """Return the whole path, checked once more in the form in which it is returned."""
        ends, bound = np.array([self.start, self.path.states[-1]]), self.bound()
        if not self._verification.certified(self.path, ends):
            return self._made("timeout", None, "the joined path did not pass the final check")
        path = self.model.verification.followed_by_lines(self.path, leaves=self._leaves)
        made, last = self._made("solved", path, ""), self.legs[-1].result
        return replace(
            made,
            lower_bound=0.0 if contradicted(bound, self.cost) else min(bound, self.cost),
            charged=None if self.motion.objective is None and self.cost == path.cost else self.cost,
            goal=None if last.goal is None else replace(last.goal, cost=0.0),
        )

    def failure(self) -> PlanResult:
        """Return that there is no path, and for which leg; proven where that leg could not begin anywhere else."""
        i, names = len(self.legs), self.stops.name
        begin = i == 0 or self.stops.configuration(i - 1) is not None
        proven = (begin and self.failed.status == "infeasible") or not np.isfinite(self.bound())
        made = self._made(
            "infeasible" if proven else "timeout",
            None,
            f"leg {i + 1} of {len(self.choices)}, from {names(i - 1)} to {names(i)}",
        )
        return replace(made, legs=(*made.legs, self.failed))

    def _made(self, status: Status, path: Path | None, reason: str) -> PlanResult:
        end = self.start if path is None else path.states[-1]
        incumbent = Incumbent(self.motion, self.start, end, self.budget.begin)
        incumbent.history, incumbent.first_cost = self._history, self._history[0][1] if self._history else None
        legs = tuple(leg.result for leg in self.legs)
        build = sum(leg.time["build"] or 0.0 for leg in legs)
        made = self._verification.result(incumbent, status, path, self.model.shared.roadmap, build)
        if path is not None and self._leaves:
            made = replace(made, path=path, min_clearance=0.0, escape=legs[0].escape)
        return replace(made, legs=legs, target=self.stops, reason=reason, world=self.model.checker.world)


def _joined(paths: list[Path], motion: Motion) -> Path:
    """Return paths, of which each begins where the one before ends, as one."""
    if isinstance(paths[0], CurvePath):
        rows = [vertices_of(motion, path) for path in paths]
        return path_of(motion, np.vstack([rows[0], *(states[1:] for states in rows[1:])]))
    return Path(np.vstack([paths[0].states, *(path.states[1:] for path in paths[1:])]))
