"""GoalSearch: the cheapest path to any of several goals, each of which may be more than one configuration.

Configurations are drawn in each goal, and planned to as any other, the most promising first: to whatever is soonest
reached, then as far as what is proven of a goal does not rule out that it is cheaper. A path to a goal that holds more
than one configuration then gets the end that costs it least.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import atan2
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import kernels
from trailmark.collision.footprint import build_footprint
from trailmark.goals import Goal, ReachedGoal
from trailmark.motion import Motion
from trailmark.path import Path
from trailmark.planning.lattice.cost_to_go import CostToGo
from trailmark.planning.model import Passed, WorldModel
from trailmark.planning.pipeline import plan_single
from trailmark.planning.proofs.claims import contradicted
from trailmark.planning.proofs.prover import in_time
from trailmark.planning.query import Budget, Incumbent, OnProgress, report_error, vertices_of
from trailmark.planning.result import PlanProgress, PlanResult, Status
from trailmark.planning.shortening import shorten
from trailmark.robot import Robot
from trailmark.se2 import FloatArray, transform, wrap

__all__ = ["GoalSearch", "plan_to_goals"]

DRAWN, MANY_DRAWN, MAX_DRAWS = 48, 4_000, 20
"""Configurations drawn in a goal that holds more than one; how many more, and how often, while none of them is free, or
none was reached."""

PER_GOAL, HEADINGS, APART = 6, 8, 0.38
"""Configurations of one goal that are planned to, for each time that they are drawn; headings tried at the nearest
position; and the sine of half the angle, 45 degrees, by which they differ at least at the same place."""

INNER, FEW_CELLS, MOST_CELLS, OVERLAP = 8, 1, 20_000, 1e-6
"""Discs inside the robot, and cells of a goal, that are looked at to prove that it is nowhere free: at first, and once
nothing else is left to try; and the metres of overlap, more than rounding and touching, that prove a place blocked."""

RANKING_CELLS = 1 << 14
"""Of the costs from the start that tell which goals are near."""

FIRST_SHARE, MAX_SLICE = 0.05, 10.0
"""Of the time limit, of which no more than so many seconds count: what one attempt at a path may take, while others
wait; twice as much at the next."""

MAX_ATTEMPTS = 3
"""At one configuration once there is a path to another, or where rounds are counted, not seconds."""

POLISHING_SHARE = 0.4
"""Of the time left: kept for improving the best path."""

PROOF_SHARE = 0.1
"""Of the time left that one lower bound may take."""

BATCH, EIGHTHS = 16, 8
"""Motions that are certified together, and that make up a turn all around."""


def plan_to_goals(
    model: WorldModel,
    start: FloatArray,
    goals: tuple[Goal, ...],
    budget: Budget,
    *,
    on_progress: OnProgress | None = None,
) -> PlanResult:
    """Return the cheapest path to any of the goals; whoever calls holds the lock of the model's roadmap.

    Raises:
        ConfigurationError: the start is not valid, or each goal is one configuration and none is valid.
    """
    if len(goals) == 1 and goals[0].cost == 0.0 and (pose := goals[0].configuration) is not None:
        # A query like any other: choosing among ends would only take time.
        one = plan_single(model, start, pose, budget, on_progress=on_progress)
        reached = None if one.path is None else _reached(one.path, 0, goals[0])
        return replace(one, goal=reached, target=goals)
    search = GoalSearch(model, model.checker.require_valid(start, "start"), goals, budget, on_progress)
    search.begin()
    search.reach()
    search.polish()
    return search.result()


class GoalSearch:
    """One query with several goals, or one that holds more than one configuration.

    Attributes:
        ends: the candidates: configurations that may be planned to, valid, shape (m, 3).
        of: the goal of each, shape (m,).
        estimates: about what a path to each costs with its goal's cost, metres, shape (m,).
        attempts: at each, shape (m,); infinite once there is nothing more to try.
        charges: the goals' own costs, metres, shape (g,).
        bounds: proven lower bound for each goal, its cost included, metres, shape (g,); infinite: no way.
        cost: of the best path, its goal's cost included, metres; infinite before there is one.
        path: the best, which passed the final check; None before there is one.

    Raises:
        ConfigurationError: each goal is one configuration, and none is valid.
    """

    def __init__(
        self,
        model: WorldModel,
        start: FloatArray,
        goals: tuple[Goal, ...],
        budget: Budget,
        on_progress: OnProgress | None,
    ) -> None:
        self.model, self.motion, self.start, self.goals = model, model.motion, start, goals
        self.budget, self._on_progress = budget, on_progress
        self.charges = np.array([goal.cost for goal in goals])
        self.bounds = np.array([self._least_cost(goal) for goal in goals]) + self.charges
        self._proven = np.zeros(len(goals), np.bool_)
        self.cost, self._index, self._states, self._build = np.inf, -1, np.empty((0, 3)), 0.0
        self.path: Path | None = None
        self.nearest: Path | None = None
        self._history: list[tuple[float, float]] = []
        self.ends, self.of = np.empty((0, 3)), np.empty(0, np.int64)
        self.estimates, self.attempts = np.empty(0), np.empty(0)
        self._from_start: CostToGo | None = None
        self._draws = 0
        self._take_configurations()
        for i, goal in enumerate(goals):
            if goal.configuration is None:
                self._draw(i, DRAWN)

    # --- candidates

    def _take_configurations(self) -> None:
        """Take the goals that are one configuration each, as far as they are valid."""
        which = np.array([i for i, goal in enumerate(self.goals) if goal.configuration is not None], np.int64)
        if len(which):
            states = np.array([self.goals[i].configuration for i in which])
            free = self.model.checker.states_free(states)
            if len(which) == len(self.goals) and not free.any():
                self.model.checker.require_valid(states[0], "goal" if len(which) == 1 else "goal[0]")
            self.bounds[which[~free]] = np.inf
            self._add(states[free], which[free])

    def _draw(self, i: int, count: int) -> None:
        """Add free configurations of a goal that holds more than one: cheap ones, apart from one another."""
        goal, checker = self.goals[i], self.model.checker
        turned = np.repeat(goal.nearest(self.start), HEADINGS, axis=0)
        turned[:, 2] += 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS
        states = np.vstack([goal.nearest(turned), goal.draw(self.model.rng, count)])
        # The same again without turning.
        unturned = np.column_stack([states[:, :2], np.full(len(states), self.start[2])])
        states = np.vstack([states, goal.nearest(unturned)])
        states = states[checker.states_free(states)]
        if len(states) == 0:
            if self._draws == 0 and self._is_blocked(goal, FEW_CELLS):
                self.bounds[i] = np.inf
            return
        chosen: list[int] = []
        for k in np.argsort(self._straight(states), kind="stable").tolist():
            off = states[chosen] - states[k]
            near = np.hypot(*off[:, :2].T) < 0.5 * goal.disc[1]
            if len(chosen) < PER_GOAL and not (near & (np.abs(np.sin(0.5 * off[:, 2])) < APART)).any():
                chosen.append(k)
        self._add(states[chosen], np.full(len(chosen), i))

    def _draw_more(self) -> bool:
        """Draw further configurations of goals that hold more; return whether there are any, and it is worth while."""
        several = [i for i, goal in enumerate(self.goals) if goal.configuration is None and np.isfinite(self.bounds[i])]
        self._draws += 1
        for i in several:
            if self._draws == 1 and i not in self.of and self._is_blocked(self.goals[i], MOST_CELLS):
                self.bounds[i] = np.inf
            else:
                self._draw(i, MANY_DRAWN)
        return bool(several) and self._draws < MAX_DRAWS

    def _add(self, states: FloatArray, of: NDArray[np.int64]) -> None:
        """Add valid configurations (n, 3) of goals (n,)."""
        if len(states):
            self.ends, self.of = np.vstack([self.ends, states]), np.append(self.of, of)
            self.estimates = np.append(self.estimates, self._straight(states) + self.charges[of])
            self.attempts = np.append(self.attempts, np.zeros(len(states)))
            self._raise_estimates()

    def _straight(self, states: FloatArray) -> FloatArray:
        """Return what paths to configurations (n, 3) would cost without obstacles, metres, shape (n,)."""
        ends = np.array([self.motion.ends(self.start, q) for q in states])
        costs = self.motion.costs(np.array(ends[:, 0]), np.array(ends[:, 1]))
        return np.array([self.motion.whole_cost(c, self.start, q) for c, q in zip(costs, states, strict=True)])

    def _raise_estimates(self) -> None:
        """Let the estimates mind the obstacles, once the costs from the start are known."""
        if self._from_start is not None:
            costs = np.array([self._from_start.at(*self.model.checker.disc_center(q)) for q in self.ends])
            self.estimates = np.maximum(self.estimates, costs + self.charges[self.of])

    # --- what is proven

    def _least_cost(self, goal: Goal) -> float:
        """Return what a path to a goal would cost at least without obstacles, metres."""
        if goal.configuration is not None:
            return self.motion.least_cost(self.start, np.array(goal.configuration))
        ends = np.array([self.start, goal.nearest(self.start)[0]])
        if not self.motion.moves_anywhere:
            # As if the car were headed there.
            ends[:, 2] = atan2(ends[1, 1] - ends[0, 1], ends[1, 0] - ends[0, 0])
        return self.motion.least_cost(*ends)

    def _is_blocked(self, goal: Goal, most: int) -> bool:
        """Return whether the robot certainly collides wherever it is in a goal.

        The goal is divided into cells of SE(2); in each, a disc inside the robot, less what it moves there, has to
        collide. What is left is halved, until a configuration is free or there would be more than ``most`` cells.
        """
        checker, robot = self.model.checker, self.model.checker.robot
        about = (0.0, 0.0, robot.reference_radius + robot.clearance if robot.reference_radius > 0.0 else 0.0)
        discs = np.vstack([about, checker.footprint.inner[:INNER]])
        away = np.hypot(*discs[:, :2].T)
        (center, half), (heading, turn) = goal.disc, goal.headings or (0.0, np.pi)
        cells, taken = np.array([[*center, heading]]), 0
        while len(cells) and (taken := taken + len(cells)) <= most:
            open_ = np.ones(len(cells), np.bool_)
            for disc, far in zip(discs, away, strict=True):
                radius = disc[2] - np.sqrt(2.0) * half - 2.0 * far * np.sin(0.5 * turn) - OVERLAP
                if self.budget.is_up():
                    return False
                if radius > 0.0 and open_.any():
                    places = np.column_stack([transform(cells[open_], disc[None, :2])[:, 0], cells[open_, 2]])
                    inside = build_footprint(Robot.disc(radius))
                    open_[open_] = kernels.states_free(checker.grid, checker.field, inside, places) != kernels.BLOCKED
            cells = cells[open_]
            if checker.states_free(cells[goal.contains(cells)]).any():
                return False
            if np.sqrt(2.0) * half >= 2.0 * away.max() * np.sin(0.5 * turn):
                half *= 0.5
                offsets = half * np.array([[-1, -1, 0], [-1, 1, 0], [1, -1, 0], [1, 1, 0]])
            else:
                turn *= 0.5
                offsets = turn * np.array([[0, 0, -1], [0, 0, 1]])
            if not offsets.any():
                return len(cells) == 0
            cells = (cells[:, None] + offsets).reshape(-1, 3)
            cells = cells[goal.near_boxes(cells[:, :2], half)]
        return len(cells) == 0

    def _prove(self, i: int) -> None:
        """Prove a lower bound for a goal, with the obstacles, unless that takes too long or is done."""
        bound, pose = self.model.bound, self.goals[i].configuration
        if self._proven[i] or pose is None:
            return
        self._proven[i] = True
        end, most, seconds = np.array(pose), self.cost - self.charges[i], PROOF_SHARE * self.budget.seconds_left()
        found = in_time(seconds, lambda stop: bound.of(self.start, end, most, stop).cost)
        if found is not None:
            self._raise_bound(i, found)

    def _raise_bound(self, i: int, bound: float) -> None:
        self.bounds[i] = max(self.bounds[i], bound + self.charges[i])

    def _reaches_no_other(self, i: int) -> bool:
        """Return whether a goal has no way to any of its configurations if it has none to one of them.

        So it is where the robot may turn all around at its place, or where not even a disc inside it gets there.
        """
        goal, bound = self.goals[i], self.model.bound
        if goal.pose is not None and not goal.position_tolerance and goal.headings is None:
            turned = np.column_stack([np.tile(goal.pose[:2], (EIGHTHS, 1)), wrap(np.arange(EIGHTHS) * np.pi / 4.0)])
            around = self.motion.motions_between_valid(turned, np.roll(turned, -1, axis=0))
            if self.motion.moves_anywhere and around.all():
                return True
        seconds = PROOF_SHARE * self.budget.seconds_left()
        return in_time(seconds, lambda stop: bound.shuts_out(self.start, goal, stop)) is True

    @property
    def close_enough(self) -> bool:
        """Whether the best path is proven to be within the gap, or that there is none."""
        if self.path is None:
            return not np.isfinite(self.bounds.min())
        return not self._better().any()

    def _better(self) -> NDArray[np.bool_]:
        """Return for each goal whether a path there may be better than the best by more than the gap, shape (g,)."""
        if self.path is None or self.budget.gap == np.inf:
            return np.asarray(np.isfinite(self.bounds) & (self.path is None))
        return np.asarray(self.cost > (1.0 + self.budget.gap) * self.bounds + 1e-9)

    # --- the search

    def begin(self) -> None:
        """Take the path of one state, where a goal holds the start, or the cheapest candidate in sight."""
        inside = [i for i, goal in enumerate(self.goals) if goal.contains(self.start)]
        if inside:
            i = min(inside, key=lambda i: self.goals[i].cost)
            self._offer(self.motion.ends(self.start, self.start)[:1], i, self.start)
            self.attempts[self.of == i] = np.inf
        order = np.argsort(self.estimates, kind="stable")
        order = order[(self.estimates < self.cost)[order]]
        for first in range(0, len(order), BATCH):
            batch = order[first : first + BATCH]
            pairs = np.array([self.motion.ends(self.start, q) for q in self.ends[batch]])
            seen = self.motion.motions_between_valid(np.array(pairs[:, 0]), np.array(pairs[:, 1]))
            if seen.any():
                k = int(batch[np.argmax(seen)])
                self.attempts[k] = np.inf
                self._settle(pairs[np.argmax(seen)], int(self.of[k]), self.ends[k])
                return

    def reach(self) -> None:
        """Plan to one configuration after the other, the most promising first, as far as they may be better."""
        limit, counted = min(self.budget.limit, MAX_SLICE), self.budget.rounds is not None
        while not (self.close_enough or self.budget.is_up()):
            order = np.lexsort((self.estimates, self.attempts))
            order = order[(self._better()[self.of] & np.isfinite(self.attempts))[order]]
            if len(order) == 0:
                for i in range(len(self.goals)):
                    self._prove(i)
                if self.path is not None or not self._draw_more():
                    return
                continue
            if len(order) > 1 and self._from_start is None:
                self._from_start = CostToGo.of(self.model.checker, self.start, RANKING_CELLS)
                self._raise_estimates()
                continue
            k = int(order[0])
            i = int(self.of[k])
            if self.path is not None or self.estimates[k] == np.inf:
                self._prove(i)
                if not self._better()[i]:
                    continue
            left = self.budget.seconds_left()
            if self.path is not None:
                left *= 1.0 - POLISHING_SHARE
                if left <= 0.01 * limit:
                    return
            share = FIRST_SHARE * limit * 2.0 ** min(self.attempts[k], 20.0)
            alone = counted or (len(order) == 1 and self.path is None)
            self._plan(k, left if alone else min(left, share))
            if self.attempts[k] >= MAX_ATTEMPTS and (counted or self.path is not None):
                self.attempts[k] = np.inf

    def _plan(self, k: int, seconds: float) -> None:
        """Plan to a configuration, until there is a path."""
        i, end = int(self.of[k]), self.ends[k]
        one = self.goals[i].configuration is not None
        self.attempts[k] += 1
        result = self._answer(i, end, self.budget.part(seconds, np.inf), None)
        if result.status != "timeout":
            self.attempts[k] = np.inf
        if result.status == "infeasible" and (one or self._reaches_no_other(i)):
            self.bounds[i] = np.inf
        elif one:
            self._raise_bound(i, result.lower_bound or 0.0)
        if result.path is not None:
            self._settle(vertices_of(self.motion, result.path), i, end)
        elif self.nearest is None:
            self.nearest = result.nearest

    def _answer(self, i: int, end: FloatArray, budget: Budget, known: FloatArray | None) -> PlanResult:
        """Return the answer to the query for one configuration, and record how its paths got better."""
        offset = perf_counter() - self.budget.begin

        def hand_on(state: PlanProgress) -> None:
            path, cost = self.path, None if self.path is None else self.cost
            if state.path is not None and state.cost is not None and state.cost + self.charges[i] < self.cost:
                path, cost = state.path, state.cost + self.charges[i]
            if self._on_progress is not None:
                self._on_progress(replace(state, elapsed=offset + state.elapsed, path=path, cost=cost))

        told = None if self._on_progress is None else hand_on
        result = plan_single(self.model, self.start, end, budget, on_progress=told, known=known)
        self._build += result.time["build"] or 0.0
        for at, cost in result.history:
            self._record(offset + at, cost + self.charges[i])
        return result

    def polish(self) -> None:
        """Improve the best path, until it is proven good enough or the time is up."""
        i, states, one = self._index, self._states, self.goals[self._index].configuration is not None
        if self.path is None or len(states) < 2 or (len(states) == 2 and not one):
            return
        self._prove(i)
        if self.close_enough or self.budget.is_up():
            return
        end = np.array(self.path.states[-1])
        result = self._answer(i, end, self.budget.part(self.budget.seconds_left()), states)
        if one:
            self._raise_bound(i, result.lower_bound or 0.0)
        if result.path is not None:
            self._settle(vertices_of(self.motion, result.path), i, end)

    def _settle(self, states: FloatArray, i: int, end: FloatArray) -> None:
        """Offer a path to a goal, then with the end that costs least."""
        if self._offer(states, i, end) and self.goals[i].configuration is None:
            states = _with_free_end(self.motion, states, self.goals[i], self.model.rng, self.budget.seconds_left)
            end = np.array([*states[-1, :2], states[-1, 2] if self.motion.turns else end[2]])
            self._offer(states, i, end)

    def _offer(self, states: FloatArray, i: int, end: FloatArray) -> bool:
        """Keep a path to a goal if it is the best so far and passes the final check; return whether it may be used."""
        cost = self.motion.whole_cost(self.motion.cost_of(states), self.start, end)
        total = cost + self.charges[i]
        if total >= self.cost:
            return True
        path = self.motion.path(self.motion.whole_states(states, self.start, end))
        ends = np.array([self.start, end])
        if not self.goals[i].contains(path.states[-1]) or not self.model.verification.certified(path, ends):
            return False
        self.cost, self.path, self._index, self._states = total, path, i, states
        seconds = perf_counter() - self.budget.begin
        self._record(seconds, total)
        if self._on_progress is not None:
            nodes = len(self.model.shared.roadmap)
            self._on_progress(PlanProgress(seconds, "looking for better goals", nodes, total, path))
        return True

    def _record(self, seconds: float, total: float) -> None:
        if not self._history or total < self._history[-1][1]:
            self._history.append((seconds, total))

    def result(self) -> PlanResult:
        """Return the answer."""
        model, bound, path = self.model, float(self.bounds.min()), self.path
        status: Status = "solved" if path is not None else "timeout" if np.isfinite(bound) else "infeasible"
        end = self.start if path is None else path.states[-1]
        if contradicted(bound, self.cost):
            cost = f"the cost of a path to one of several goals, {self.cost:g} m"
            problem = f"a lower bound of {bound:g} m is above {cost}"
            report_error(problem, model.checker.world, model.checker.robot, self.start, end, seed=model.seed)
            bound = 0.0
        incumbent = Incumbent(self.motion, self.start, end, self.budget.begin)
        incumbent.history = self._history
        incumbent.first_cost = self._history[0][1] if self._history else None
        if path is not None and len(path.states) > 1:
            model.passed = Passed(vertices_of(self.motion, path), model.checker)
        found = model.verification.result(incumbent, status, path, model.shared.roadmap, self._build)
        goal = None if path is None else _reached(path, self._index, self.goals[self._index])
        # Where the two meet, the cost may be below the bound by its error.
        lower_bound = min(bound, self.cost) if np.isfinite(bound) else None
        nearest = self.nearest if path is None else None
        return replace(found, lower_bound=lower_bound, goal=goal, nearest=nearest, target=tuple(self.goals))


def _reached(path: Path, index: int, goal: Goal) -> ReachedGoal:
    """Return which of its goals, and where, a path ends at."""
    x, y, theta = path.states[-1].tolist()
    return ReachedGoal(index, (x, y, theta), goal.cost)


# --- The end of a path, moved within its goal as long as that makes the path cheaper.

LAST, TIMES, SWEEPS = 6, 12, 3
"""Vertices at a path's end from which a motion to another place in the goal is tried; times that the end is moved, at
most; and sweeps of shortening after each."""

STEPS, LEAST_GAIN = 24, 1e-4
"""Random places around the end that are tried; and the share of the cost below which a gain is not worth another."""


def _with_free_end(
    motion: Motion, states: FloatArray, goal: Goal, rng: np.random.Generator, seconds_left: Callable[[], float]
) -> FloatArray:
    """Return a path (n, 3) into a goal with the end in it that costs least, as far as that is found."""
    reach = goal.disc[1] + 0.1 * motion.checker.robot.circumradius
    for _ in range(TIMES):
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
    first, end = max(0, len(states) - 1 - LAST), states[-1]
    vertices = states[first:-1]
    nearest = goal.nearest(vertices)
    # Part of the way there, where all of it is not free; and around.
    around = end + rng.uniform(-1.0, 1.0, (STEPS, 3)) * np.array([reach, reach, min(np.pi, reach)])
    places = np.vstack([nearest, goal.nearest(np.vstack([end + 0.5 * (nearest - end), around]))])
    if not motion.turns:
        places[:, 2] = end[2]
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
