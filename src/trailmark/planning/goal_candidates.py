"""Candidates: configurations of a query's goals that may be planned to, and about what paths there cost."""

from __future__ import annotations

from math import atan2

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import kernels
from trailmark.collision.footprint import build_footprint
from trailmark.goals import Goal
from trailmark.planning.lattice.cost_to_go import CostToGo
from trailmark.planning.query import Clock
from trailmark.planning.world_model import WorldModel
from trailmark.robot import Robot
from trailmark.se2 import FloatArray, transform

__all__ = ["Candidates"]

DRAWN, MANY_DRAWN = 48, 4_000
"""Configurations drawn in a goal that holds more than one, and how many more while none of them is free."""

MAX_DRAWS = 20
"""Times that more configurations are drawn where none is free, or none was reached."""

PER_GOAL = 6
"""Configurations of one goal that are planned to, for each time that they are drawn."""

HEADINGS = 8
"""Headings that are tried at the nearest position, where the heading is free."""

APART = 0.38
"""Sine of half the angle by which headings differ at least between configurations at the same place: 45 degrees."""

INNER, FEW_CELLS, MOST_CELLS = 8, 1, 20_000
"""Discs inside the robot, and cells of a goal, that are looked at to prove that it is nowhere free: at first, while
there may be a path to another goal, and once nothing else is left to try."""

MARGIN = 1e-6
"""Metres of overlap, more than rounding and than what counts as touching, that prove a place blocked."""


class Candidates:
    """Configurations of goals.

    Args:
        model: of the world.
        start: valid, shape (3,).
        goals: of the query.
        clock: of the query.

    Attributes:
        ends: configurations that may be planned to, valid, shape (m, 3).
        of: the goal of each, shape (m,).
        estimates: about what a path to each costs with its goal's cost, metres, shape (m,).
        attempts: at each, shape (m,); infinite once there is nothing more to try.
        charges: the goals' own costs, metres, shape (g,).
        bounds: proven lower bound for each goal, its cost included, metres, shape (g,); infinite: no way.

    Raises:
        ConfigurationError: each goal is one configuration, and none is valid.
    """

    def __init__(self, model: WorldModel, start: FloatArray, goals: tuple[Goal, ...], clock: Clock) -> None:
        self.model, self.start, self.goals, self.clock = model, start, goals, clock
        self.charges = np.array([goal.cost for goal in goals])
        self.bounds = np.array([self._least_cost(goal) for goal in goals]) + self.charges
        self.ends, self.of = np.empty((0, 3)), np.empty(0, np.int64)
        self.estimates, self.attempts = np.empty(0), np.empty(0)
        self._to_come: CostToGo | None = None
        self._draws = 0
        self._take_configurations()
        for i, goal in enumerate(goals):
            if goal.configuration is None:
                self._draw(i, DRAWN)

    def rank(self, to_come: CostToGo) -> None:
        """Let the estimates mind the obstacles, by costs from the start."""
        self._to_come = to_come
        self._raise_estimates()

    @property
    def ranked(self) -> bool:
        """Whether the estimates mind the obstacles."""
        return self._to_come is not None

    def promising(self, better: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return the candidates not tried to the end, of goals (g,) that may be better, the most promising first."""
        order = np.lexsort((self.estimates, self.attempts))
        return order[(better[self.of] & np.isfinite(self.attempts))[order]]

    def draw_more(self) -> bool:
        """Draw further configurations of goals that hold more; return whether there are any, and it is worth while."""
        several = [i for i, goal in enumerate(self.goals) if goal.configuration is None and np.isfinite(self.bounds[i])]
        self._draws += 1
        for i in several:
            if self._draws == 1 and i not in self.of and self._is_blocked(self.goals[i], MOST_CELLS):
                self.bounds[i] = np.inf
            else:
                self._draw(i, MANY_DRAWN)
        return bool(several) and self._draws < MAX_DRAWS

    def _least_cost(self, goal: Goal) -> float:
        """Return what a path to a goal would cost at least without obstacles, metres."""
        motion = self.model.motion
        if goal.configuration is not None:
            return motion.least_cost(self.start, np.array(goal.configuration))
        ends = np.array([self.start, goal.nearest(self.start)[0]])
        if not motion.moves_anywhere:
            # As if the car were headed there.
            ends[:, 2] = atan2(ends[1, 1] - ends[0, 1], ends[1, 0] - ends[0, 0])
        return motion.least_cost(*ends)

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
                radius = disc[2] - np.sqrt(2.0) * half - 2.0 * far * np.sin(0.5 * turn) - MARGIN
                if self.clock.is_up():
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

    def _take_configurations(self) -> None:
        """Take the goals that are one configuration each, as far as they are valid."""
        which = np.array([i for i, goal in enumerate(self.goals) if goal.configuration is not None], np.int64)
        if len(which) == 0:
            return
        states = np.array([self.goals[i].configuration for i in which])
        free = self.model.checker.states_free(states)
        if len(which) == len(self.goals) and not free.any():
            self.model.checker.require_valid(states[0], "goal" if len(which) == 1 else "goal[0]")
        self.bounds[which[~free]] = np.inf
        self._add(states[free], which[free])

    def _draw(self, i: int, count: int) -> None:
        """Add free configurations of a goal that holds more than one."""
        goal, theta = self.goals[i], self.start[2]
        turned = np.repeat(goal.nearest(self.start), HEADINGS, axis=0)
        turned[:, 2] += 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS
        states = np.vstack([goal.nearest(turned), goal.draw(self.model.rng, count)])
        # The same again without turning.
        unturned = goal.nearest(np.column_stack([states[:, :2], np.full(len(states), theta)]))
        states = np.vstack([states, unturned])
        states = states[self.model.checker.states_free(states)]
        if len(states):
            chosen = _spread(states, self._straight(states), 0.5 * goal.disc[1])
            self._add(states[chosen], np.full(len(chosen), i))
        elif self._draws == 0 and self._is_blocked(goal, FEW_CELLS):
            self.bounds[i] = np.inf

    def _add(self, states: FloatArray, of: NDArray[np.int64]) -> None:
        """Add valid configurations (n, 3) of goals (n,)."""
        if len(states):
            self.ends, self.of = np.vstack([self.ends, states]), np.append(self.of, of)
            self.estimates = np.append(self.estimates, self._straight(states) + self.charges[of])
            self.attempts = np.append(self.attempts, np.zeros(len(states)))
            self._raise_estimates()

    def _straight(self, states: FloatArray) -> FloatArray:
        """Return what paths to configurations (n, 3) would cost without obstacles, metres, shape (n,)."""
        motion, start = self.model.motion, self.start
        ends = np.array([motion.ends(start, q) for q in states])
        costs = motion.costs(np.array(ends[:, 0]), np.array(ends[:, 1]))
        return np.array([motion.whole_cost(c, start, q) for c, q in zip(costs, states, strict=True)])

    def _raise_estimates(self) -> None:
        if self._to_come is not None:
            costs = np.array([self._to_come.at(*self.model.checker.disc_center(q)) for q in self.ends])
            self.estimates = np.maximum(self.estimates, costs + self.charges[self.of])


def _spread(states: FloatArray, costs: FloatArray, apart: float) -> list[int]:
    """Return the cheapest of configurations (n, 3), ``apart`` metres or an eighth of a turn from one another."""
    chosen: list[int] = []
    for k in np.argsort(costs, kind="stable").tolist():
        off = states[chosen] - states[k]
        if not ((np.hypot(*off[:, :2].T) < apart) & (np.abs(np.sin(0.5 * off[:, 2])) < APART)).any():
            chosen.append(k)
            if len(chosen) == PER_GOAL:
                break
    return chosen
