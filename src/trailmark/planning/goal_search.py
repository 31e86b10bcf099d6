"""GoalSearch: the cheapest path to any of several goals, each of which may be more than one configuration.

Configurations are drawn in each goal, and planned to in order of promise as any other: first whatever path is soonest
found, then those that may be cheaper by what is proven of them. A path to a goal that holds more than one configuration
then gets the end that costs it least.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.goals import Goal, ReachedGoal
from trailmark.motion import Motion
from trailmark.path import Path
from trailmark.planning.error_report import report_error
from trailmark.planning.followed import Passed, vertices_of
from trailmark.planning.goal_candidates import Candidates
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.lattice.cost_to_go import CostToGo
from trailmark.planning.lattice.schedule import AT_FIRST, LatticeSchedule
from trailmark.planning.proofs.claims import contradicted
from trailmark.planning.proofs.prover import in_time
from trailmark.planning.query import Clock, OnProgress
from trailmark.planning.result import PlanProgress, PlanResult, Status
from trailmark.planning.roadmap_lookup import RoadmapLookup
from trailmark.planning.shortening import shorten
from trailmark.planning.single_query import GAP, answer_query
from trailmark.planning.world_model import WorldModel
from trailmark.se2 import FloatArray, wrap

__all__ = ["GoalIncumbent", "GoalSearch", "answer_goals", "reached_at", "with_free_end"]

NEARBY = 3
"""Goals looked for over the smallest lattice, the nearest first, before it is known what way leads to which."""

RANKING_CELLS = 1 << 14
"""Of the costs from the start that tell which goals are near."""

MAX_ATTEMPTS = 3
"""Attempts at one configuration once there is a path to another, or where rounds are counted, not seconds."""

MAX_SLICE = 10.0
"""Seconds; of a longer time limit no more is shared out by FIRST_SHARE."""

BATCH = 16
"""Motions that are certified together."""

FIRST_SHARE = 0.05
"""Of the time limit: what one attempt at a path may take, while others wait; twice as much at the next."""

POLISHING_SHARE = 0.4
"""Of the time left: kept for improving the best paths."""

CONTENDER = 1.05
"""Times the best cost up to which a path to another goal is improved as well."""

PROOF_SHARE = 0.1
"""Of the time left that one lower bound may take."""


def answer_goals(
    model: WorldModel,
    start: ArrayLike,
    goals: tuple[Goal, ...],
    time_limit: float,
    *,
    max_rounds: int | None = None,
    on_progress: OnProgress | None = None,
    stop: Callable[[], bool] | None = None,
    gap: float = GAP,
) -> PlanResult:
    """Return the cheapest path to any of the goals; whoever calls holds the lock of the model's roadmap.

    Other arguments are those of :func:`trailmark.planning.single_query.answer_query`.

    Raises:
        ConfigurationError: the start is not valid, or each goal is one configuration and none is valid.
    """
    if len(goals) == 1 and goals[0].cost == 0.0 and (pose := goals[0].configuration) is not None:
        # A query like any other: choosing among ends would only take time.
        one = answer_query(
            model, start, pose, time_limit, max_rounds=max_rounds, on_progress=on_progress, stop=stop, gap=gap
        )
        return replace(one, goal=None if one.path is None else reached_at(one.path, 0, goals[0]), target=goals)
    begin = perf_counter()
    state = model.checker.require_valid(start, "start")
    search = GoalSearch(model, state, goals, Clock(begin, time_limit, stop), gap, max_rounds, on_progress)
    search.find_first()
    search.try_others()
    search.polish()
    return search.best.result()


EIGHTHS = 8
"""Motions that make up a turn all around."""


class GoalSearch:
    """One query with several goals, or one that holds more than one configuration.

    Args:
        model: of the world.
        start: valid, shape (3,).
        goals: of which one is to be reached.
        clock: tells the time left.
        gap: how far above the proven lower bound a path may be to end the search, as a share of it.
        max_rounds: rounds of landmarks at most for each configuration planned to.
        on_progress: called after every step and with every better path.

    Attributes:
        candidates: configurations of the goals.
        best: the best path so far, and what is proven.
    """

    def __init__(
        self,
        model: WorldModel,
        start: FloatArray,
        goals: tuple[Goal, ...],
        clock: Clock,
        gap: float,
        max_rounds: int | None,
        on_progress: OnProgress | None,
    ) -> None:
        self.model, self.start, self.goals, self.clock = model, start, goals, clock
        self.motion, self.checker = model.motion, model.checker
        self._max_rounds, self._on_progress = max_rounds, on_progress
        self.candidates = Candidates(model, start, goals, clock)
        self.best = GoalIncumbent(model, start, goals, self.candidates.bounds, clock, gap, on_progress)
        self._proven = np.zeros(len(goals), np.bool_)
        self._guides: dict[tuple[int, bool, float], CostToGo] = {}

    def find_first(self) -> None:
        """Find a path to any goal that is soon found."""
        self._stand()
        self._go_straight()
        if self.best.path is None and self._has_lattices:
            nearest = np.argsort(self.candidates.estimates, kind="stable")[:NEARBY]
            any(self._try(k, 1) for k in nearest.tolist())

    @property
    def _has_lattices(self) -> bool:
        return self.motion.has_lattice and self.model.settings.uses("lattice")

    def _schedule(self, end: FloatArray) -> LatticeSchedule:
        """Return the lattices that a path to a configuration may be sought on."""
        model, ends = self.model, self.motion.ends(self.start, end)
        lattices = LatticeSchedule(
            self.motion, ends, model.relaxation.size, self.clock.seconds_left, model.settings.without
        )
        # What leads on from the start is the same for all of them.
        lattices.guides = self._guides
        return lattices

    def _try(self, k: int, levels: int = AT_FIRST) -> bool:
        """Look for a path to a configuration where one is soon found; return whether one was."""
        ends = self.motion.ends(self.start, self.candidates.ends[k])
        found = ends[:0]
        if self.motion.motions_between_valid(ends[:1], ends[1:])[0]:
            found = ends
        if len(found) == 0:
            found = RoadmapLookup(self.model.shared.roadmap, *ends).search_free_edges()
        if len(found) == 0 and self._has_lattices:
            self._guides = {key: guide for key, guide in self._guides.items() if not key[1]}
            found = self._schedule(self.candidates.ends[k]).first_path(levels)
        if len(found) == 0:
            return False
        i = int(self.candidates.of[k])
        if self.best.offer(found, i, self.candidates.ends[k]):
            settings, motion = self.model.settings, self.motion
            found = shorten(motion, found, self.model.rng, sweeps=settings.sweeps, seconds_left=self.clock.seconds_left)
            self.best.settle(found, i, self.candidates.ends[k])
        self.candidates.attempts[k] = np.inf
        return True

    def _stand(self) -> None:
        """Take the path of one state, where a goal holds the start."""
        inside = [i for i, goal in enumerate(self.goals) if goal.contains(self.start)]
        if inside:
            i = min(inside, key=lambda i: self.goals[i].cost)
            self.best.offer(self.motion.ends(self.start, self.start)[:1], i, self.start)
            self.candidates.attempts[self.candidates.of == i] = np.inf

    def _go_straight(self) -> None:
        """Take the cheapest of the candidates that lie in sight, unless the path there is better."""
        candidates = self.candidates
        order = np.argsort(candidates.estimates, kind="stable")
        order = order[(candidates.estimates < self.best.cost)[order]]
        for begin in range(0, len(order), BATCH):
            batch = order[begin : begin + BATCH]
            pairs = np.array([self.motion.ends(self.start, q) for q in candidates.ends[batch]])
            seen = self.motion.motions_between_valid(np.array(pairs[:, 0]), np.array(pairs[:, 1]))
            if seen.any():
                k = int(batch[np.argmax(seen)])
                candidates.attempts[k] = np.inf
                self.best.settle(pairs[np.argmax(seen)], int(candidates.of[k]), candidates.ends[k])
                return

    def try_others(self) -> None:
        """Plan to one configuration after the other, the most promising first, as far as they may be better."""
        limit, candidates = min(self.clock.limit, MAX_SLICE), self.candidates
        while not (self.best.close_enough or self.clock.is_up()):
            order = candidates.promising(self.best.better())
            if len(order) == 0:
                for i in range(len(self.goals)):
                    self._prove(i)
                if self.best.path is not None or not candidates.draw_more():
                    return
                continue
            if len(order) > 1 and not candidates.ranked:
                lattices = self._schedule(candidates.ends[0])
                candidates.rank(lattices.to_go(RANKING_CELLS, forward=False))
                continue
            k = int(order[0])
            if self.best.path is not None or candidates.estimates[k] == np.inf:
                self._prove(int(candidates.of[k]))
                if not self.best.better()[candidates.of[k]]:
                    continue
            left = self.clock.seconds_left()
            if self.best.path is not None:
                left *= 1.0 - POLISHING_SHARE
                if left <= 0.01 * limit:
                    return
            if candidates.attempts[k] == 0.0 and self._try(k):
                continue
            share = FIRST_SHARE * limit * 2.0 ** min(candidates.attempts[k], 20.0)
            counted = self._max_rounds is not None
            self._plan(k, left if counted or (len(order) == 1 and self.best.path is None) else min(left, share))
            if candidates.attempts[k] >= MAX_ATTEMPTS and (counted or self.best.path is not None):
                candidates.attempts[k] = np.inf

    def _prove(self, i: int) -> None:
        """Prove a lower bound for a goal, with the obstacles, unless that takes too long or is done."""
        bound, goal = self.model.bound, self.goals[i]
        if self._proven[i] or bound is None or goal.configuration is None:
            return
        pose, most = np.array(goal.configuration), self.best.cost - goal.cost
        self._proven[i] = True
        seconds = PROOF_SHARE * self.clock.seconds_left()
        found = in_time(seconds, lambda stop: bound.of(self.start, pose, most, stop).cost)
        if found is not None:
            self.best.bounds[i] = max(self.best.bounds[i], found + goal.cost)

    def _plan(self, k: int, seconds: float = np.inf, *, known: FloatArray | None = None, gap: float = np.inf) -> None:
        """Plan to a configuration, until there is a path, or by default to the first one that there is."""
        i, end = int(self.candidates.of[k]), self.candidates.ends[k]
        self.candidates.attempts[k] += 1
        result = self._answer(end, i, seconds, known, gap)
        if self.goals[i].configuration is not None:
            bound = np.inf if result.status == "infeasible" else (result.lower_bound or 0.0) + self.best.charges[i]
            self.best.bounds[i] = max(self.best.bounds[i], bound)
        if result.status != "timeout":
            self.candidates.attempts[k] = np.inf
        if result.status == "infeasible" and (self._turns_in_place(i) or self._is_shut_out(i)):
            self.best.bounds[i] = np.inf
        if result.path is not None:
            self.best.settle(vertices_of(self.motion, result.path), i, end)
        elif self.best.nearest is None:
            self.best.nearest = result.nearest

    def _turns_in_place(self, i: int) -> bool:
        """Return whether the robot may turn all around at a goal: no way to one of its headings is none to any."""
        goal = self.goals[i]
        if goal.pose is None or goal.position_tolerance > 0.0 or goal.headings is not None:
            return False
        turned = np.column_stack([np.tile(goal.pose[:2], (EIGHTHS, 1)), np.arange(EIGHTHS) * (2.0 * np.pi / EIGHTHS)])
        turned[:, 2] = wrap(turned[:, 2])
        return self.motion.moves_anywhere and bool(
            self.motion.motions_between_valid(turned, np.roll(turned, -1, axis=0)).all()
        )

    def _is_shut_out(self, i: int) -> bool:
        """Return whether it is proven that a disc inside the robot gets nowhere in a goal."""
        bound, goal = self.model.bound, self.goals[i]
        seconds = PROOF_SHARE * self.clock.seconds_left()
        return in_time(seconds, lambda stop: bound.shuts_out(self.start, goal, stop)) is True

    def _answer(self, end: FloatArray, i: int, seconds: float, known: FloatArray | None, gap: float) -> PlanResult:
        """Return the answer to the query for one configuration, and note how its paths got better."""
        offset = perf_counter() - self.clock.begin
        seconds = max(min(seconds, self.clock.seconds_left()), 1e-3)
        result = answer_query(
            self.model,
            self.start,
            end,
            seconds,
            max_rounds=self._max_rounds,
            on_progress=None if self._on_progress is None else lambda state: self.best.report(state, i, offset),
            stop=self.clock.stop,
            gap=gap,
            known=known,
        )
        self.best.build += result.time["build"] or 0.0
        for at, cost in result.history:
            self.best.note(offset + at, cost + self.best.charges[i])
        return result

    def polish(self) -> None:
        """Improve the best path, and those to other goals that are about as good, until proven or the time is up."""
        contenders = sorted(self.best.found, key=lambda i: self.best.found[i][0] + self.best.charges[i])
        for done, i in enumerate(contenders):
            cost, states = self.best.found[i]
            if len(states) < 2 or cost + self.best.charges[i] > CONTENDER * self.best.cost or not self.best.better()[i]:
                continue
            if self.best.close_enough or self.clock.is_up():
                return
            self._prove(i)
            end = self.best.end_of(i, states)
            seconds = self.clock.seconds_left() / (len(contenders) - done if done else 2 if len(contenders) > 1 else 1)
            if len(states) == 2 and self.goals[i].configuration is None:
                continue
            result = self._answer(end, i, seconds, states, self.best.gap)
            if self.goals[i].configuration is not None and result.lower_bound is not None:
                self.best.bounds[i] = max(self.best.bounds[i], result.lower_bound + self.best.charges[i])
            if result.path is not None:
                self.best.settle(vertices_of(self.motion, result.path), i, end)


# --- GoalIncumbent: the best path to any of a query's goals, what is known of each, and what is proven.


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
            self.model.passed = Passed(vertices_of(self.motion, path), self.model.checker)
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


# --- The end of a path, moved within its goal as long as that makes the path cheaper.

LAST = 6
"""Vertices at a path's end from which a motion to another place in the goal is tried."""

ROUNDS = 12
"""Times that the end is moved, and the path shortened after it, at most."""

SWEEPS = 3
"""Of shortening after each."""

STEPS = 24
"""Random places around the end that are tried for a car, and for others where the nearest place is not free."""

LEAST_GAIN = 1e-4
"""Share of the cost below which a gain is not worth another round."""


def with_free_end(
    motion: Motion, states: FloatArray, goal: Goal, rng: np.random.Generator, seconds_left: Callable[[], float]
) -> FloatArray:
    """Return a path that ends where in its goal it costs least, as far as that is found; shape (m, 3).

    Args:
        motion: what leads from one state to the next, and certifies it.
        states: of a path of certified motions, shape (n, 3), whose last state the goal holds.
        goal: where it may end; for a robot whose heading makes no difference, headings are left as they are.
        rng: source of randomness.
        seconds_left: asked before each round.
    """
    reach = goal.disc[1] + 0.1 * motion.checker.robot.circumradius
    for _ in range(ROUNDS):
        if len(states) < 2 or seconds_left() <= 0.0:
            break
        before = motion.cost_of(states)
        moved = _end_moved(motion, states, goal, rng, reach)
        reach = 0.5 * reach if moved is None else reach
        if moved is not None:
            states = shorten(motion, moved, rng, sweeps=SWEEPS, seconds_left=seconds_left)
        elif reach < LEAST_GAIN * max(before, 1e-9):
            break
        elif motion.moves_anywhere and motion.cost_of(states) > (1.0 - LEAST_GAIN) * before:
            # Where a robot may move in any direction, the nearest place was tried, and is the best there is.
            reach = min(reach, 0.25 * before)
    return states


def _end_moved(
    motion: Motion, states: FloatArray, goal: Goal, rng: np.random.Generator, reach: float
) -> FloatArray | None:
    """Return the path with another, cheaper end, from one of its last vertices; None if none was found."""
    along = np.concatenate([[0.0], np.cumsum(motion.costs(states[:-1], states[1:]))])
    first = max(0, len(states) - 1 - LAST)
    vertices = states[first:-1]
    end, theta = states[-1], None if motion.turns else states[-1, 2]
    around = end + rng.uniform(-1.0, 1.0, (STEPS, 3)) * np.array([reach, reach, min(np.pi, reach)])
    nearest = goal.nearest(vertices)
    # Part of the way there, where all of it is not free.
    between = end + 0.5 * (nearest - end)
    places = np.vstack([nearest, goal.nearest(np.vstack([between, around]))])
    if theta is not None:
        places[:, 2] = theta
    starts = np.repeat(np.arange(first, len(states) - 1), len(places))
    ends = np.tile(places, (len(vertices), 1))
    cost = along[starts] + motion.costs(states[starts], ends)
    limit = along[-1] - 1e-9 * max(1.0, along[-1])
    for k in np.argsort(cost)[: 2 * STEPS]:
        if cost[k] >= limit:
            return None
        free = motion.checker.states_free(ends[k : k + 1])[0]
        if free and motion.motions_between_valid(states[starts[k]][None], ends[k : k + 1])[0]:
            keep = states[: starts[k] + 1]
            same = np.array_equal(keep[-1], ends[k])
            return keep if same and len(keep) > 1 else np.vstack([keep, ends[k]])
    return None
