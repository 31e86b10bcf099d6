"""Replanning among moving obstacles for a robot of known speed, which may pass before or behind them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trailmark.clock import Deadline
from trailmark.path import Path
from trailmark.planning.query import Incumbent, vertices_of
from trailmark.planning.replanning import Replanner, Rest, as_replan, rest_of
from trailmark.planning.result import ReplanResult
from trailmark.planning.space_time.obstacles import MovingObstacles, motion_clear, path_clear, state_clear
from trailmark.planning.space_time.search import search
from trailmark.se2 import FloatArray

__all__ = ["SpaceTimeReplanner"]

TRIES = 3
"""Searches at most: how fast a disc moves depends on how much it turns along the whole path, known once it is found."""


class SpaceTimeReplanner:
    """Answers one query for which there was a path, among obstacles that move.

    Args:
        replanner: of the query, in the model of what stands.
        moving: the obstacles, and the robot.
        speed: metres of cost per second.
    """

    def __init__(self, replanner: Replanner, moving: MovingObstacles, speed: float) -> None:
        self.replanner, self.moving, self.speed = replanner, moving, speed
        self.model, self.motion = replanner.model, replanner.motion
        self.turning = self.motion.whole_cost(0.0, replanner.start, replanner.goal)

    def answer(self, path: Path) -> ReplanResult:
        """Return the path to follow from here on instead of ``path``, or the rest of it."""
        replanner = self.replanner
        kept = self._kept(rest_of(self.motion, path, replanner.start, self.model.passed))
        if kept is not None and self._is_near(kept, self.motion.least_cost(replanner.start, replanner.goal)):
            return kept
        if not state_clear(self.moving, replanner.start):
            return self._failed("the robot meets a moving obstacle where it is")
        # Among what stands there may be a better path than one that gave way to what moves.
        among = replanner.answer(path, look=True)
        if among.path is None:
            return among
        # Beside a path that is free, only the way straight back to the route is looked at.
        found = self._searched(
            vertices_of(self.motion, among.path), self.model.settings.space_time_nodes if kept is None else 1
        )
        if kept is None:
            return found
        if found.path is None or self._is_near(kept, found.cost or 0.0):
            return kept
        return replace(found, reason=f"another path costs {found.cost:.4g} m instead of {kept.cost:.4g} m")

    def ends_are_swept(self) -> bool:
        """Return whether an obstacle comes to where the robot is, or to the goal, before its horizon."""
        ends, horizon = np.array([self.replanner.start, self.replanner.goal]), self.moving.until.max()
        return not all(motion_clear(self.moving, q, 0.0, q, horizon) for q in ends)

    def _is_near(self, kept: ReplanResult, cost: float) -> bool:
        """Return whether a path costs too little more than another one (metres) to be replaced by it."""
        return (kept.cost or 0.0) <= (1.0 + self.replanner.options.min_gain) * cost

    def _kept(self, rest: Rest) -> ReplanResult | None:
        """Return the rest of the path, if it is free and stays clear of the moving obstacles."""
        replanner = self.replanner
        if not (np.array_equal(rest.vertices[-1], replanner.ends[1]) and rest.free.all()):
            return None
        return replanner.kept(rest) if self._clear(rest.vertices) else None

    def _clear(self, vertices: FloatArray) -> bool:
        """Return whether the path over vertices (n, 3), as it is returned, stays clear of the moving obstacles."""
        replanner = self.replanner
        # Where a disc does not turn, its headings, left out of the vertices, change nothing.
        states = self.motion.whole_states(vertices, replanner.start, replanner.goal) if self.turning else vertices
        return path_clear(self.moving, states, self.speed) < 0

    def _searched(self, route: FloatArray, max_nodes: int) -> ReplanResult:
        """Return a path that stays clear of the moving obstacles, or as ``nearest`` the steps that do so longest.

        Args:
            route: to the goal among what stands, states that motions join, shape (m, 3).
            max_nodes: of the search.
        """
        replanner, settings = self.replanner, self.model.settings
        to_go = np.append(np.cumsum(self.motion.costs(route[:-1], route[1:])[::-1])[::-1], 0.0)
        length = max(to_go[0], 1e-9)
        step = settings.space_time_step * (self.moving.reach + self.moving.size)
        steps = None
        for _ in range(TRIES):
            found, states = search(
                self.motion.kind,
                self.moving,
                replanner.ends[0],
                route,
                to_go,
                self.speed * length / (length + self.turning),
                step,
                settings.space_time_directions,
                max_nodes,
                Deadline.after(replanner.seconds_left()),
            )
            if not found:
                steps = states
                break
            result = replanner.result(states) if self._clear(states) else None
            if result is not None:
                return as_replan(result, "the path meets a moving obstacle, another one passes it in time")
            length = max(self.motion.cost_of(states), 1e-9)
        return self._failed("no path was found that stays clear of the moving obstacles", steps)

    def _failed(self, reason: str, states: FloatArray | None = None) -> ReplanResult:
        """Return that there is no path, and the steps (n, 3) that stay clear the longest, if there are any."""
        replanner, model = self.replanner, self.model
        incumbent = Incumbent(self.motion, replanner.start, replanner.goal, replanner.begin)
        if states is not None and len(states) > 1:
            incumbent.nearest = states.copy()
            incumbent.nearest[:, 2] = replanner.start[2]
        result = model.verification.result(incumbent, "timeout", None, model.shared.roadmap)
        return replace(as_replan(result, ""), reason=reason)
