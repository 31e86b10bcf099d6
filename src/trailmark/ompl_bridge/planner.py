"""The landmark planner as one of OMPL's: in a SimpleSetup, or beside the C++ planners in OMPL's Benchmark."""

from __future__ import annotations

import threading
from concurrent.futures import Future, ThreadPoolExecutor, wait
from copy import copy
from math import isclose
from time import perf_counter
from typing import Any

import numpy as np
from ompl import base as ob

from trailmark import se2
from trailmark.arguments import one_of, truth, whole
from trailmark.collision import StateChecker
from trailmark.curves import Steering
from trailmark.errors import WorldError
from trailmark.motion import kind_of
from trailmark.motion.pointwise import PointwiseChecker
from trailmark.ompl_bridge.checker import checker_in
from trailmark.ompl_bridge.errors import ObjectiveError
from trailmark.ompl_bridge.goals import goals_in
from trailmark.ompl_bridge.guard import caught, returns_on_error
from trailmark.ompl_bridge.objective import PathObjective
from trailmark.ompl_bridge.ompl_curves import OmplCurves
from trailmark.ompl_bridge.spaces import require_within, space_of, steering_of
from trailmark.ompl_bridge.sparse_path import sparse_path
from trailmark.ompl_bridge.states import path_to_ompl, starts_and_goal
from trailmark.planning import LandmarkPlanner, PlannerSettings, PlanProgress, PlanResult
from trailmark.planning.warmup import warm_up
from trailmark.roadmap import Roadmap
from trailmark.trajectories import CurvePath, Path
from trailmark.world import World
from trailmark.world.goals import Ends
from trailmark.world.objective import Objective

__all__ = ["OmplLandmarkPlanner"]

POLL = 0.002
"""Seconds between two calls of the termination condition."""

FIRST_TURN = 0.05
"""Seconds for which each of several starts is planned from first; each round of turns lasts twice as long."""

GRACE = 0.05
"""Seconds that the query gets to end by itself once the termination condition holds."""


class OmplLandmarkPlanner(ob.Planner):  # type: ignore[misc]  # OMPL's bindings carry no types
    """Landmarks, roadmap and shortest path, as an ``ob.Planner``.

    It plans in trailmark's own world and does not ask OMPL's checker state by state. The space decides how the robot
    moves, whatever the turning radius of the checker's robot: straight in an ``SE2StateSpace``, on shortest curves in a
    ``DubinsStateSpace`` or ``ReedsSheppStateSpace``. What OMPL interpolates along the returned path is certified.
    A straight path has fewer vertices than ``result.path`` and is up to 0.01 % longer, so that OMPL's path simplifier
    returns; a car's path has further states on a curve that OMPL would replace by another one. With a
    :class:`~trailmark.ompl_bridge.PathObjective` it plans for that. Of several starts the one with the cheapest path
    is taken.

    ``solve`` returns once the termination condition holds (within 20 ms) or the path has settled. Repeated ``solve``,
    and ``clear`` with ``keep_roadmap``, continue with the roadmap of the queries before.

    Args:
        information: the ``SpaceInformation`` of one of these spaces, within the world's bounds.
        checker: trailmark's checker; by default that of the ``StateValidityChecker`` in ``information``, whose updates
            to other worlds the planner follows.
        seed: the same seed gives the same paths, as long as the termination condition does not end the query.
        keep_roadmap: whether ``clear`` keeps the roadmap. Give False in a benchmark, where each run is to start
            from nothing.
        settings: the planner's numbers. They are given here since OMPL's own parameters (``params()``) cannot be
            declared from Python.

    Attributes:
        result: the last query's :class:`~trailmark.planning.PlanResult`; None if it was cut short.

    Raises:
        SpaceError: a space not made of x, y and heading, or a symmetric Dubins space.
        BoundsError: a space that reaches beyond the world.
        BridgeError: no checker given, and none of trailmark's in ``information``.
    """

    def __init__(
        self,
        information: Any,
        checker: StateChecker | None = None,
        *,
        seed: int | None = None,
        keep_roadmap: bool = True,
        settings: PlannerSettings | None = None,
    ) -> None:
        space = space_of(information)
        super().__init__(information, "landmark")
        own = checker_in(information) if checker is None else one_of(checker, StateChecker, "checker:")
        self._follows, self._space = checker is None, space
        require_within(space, own.world)
        steering = steering_of(information)
        self.checker = _steered(own, steering)
        # Compiled now, so that no query pays for it.
        warm_up(kind_of(self.checker.robot))
        self._single = PointwiseChecker(self.checker, steering)
        self._curves = None if steering is None else OmplCurves(information, self._single)
        self._seed = None if seed is None else whole(seed, "seed:", 0)
        self._keep = truth(keep_roadmap, "keep_roadmap:")
        self._settings = PlannerSettings() if settings is None else one_of(settings, PlannerSettings, "settings:")
        self._planner: LandmarkPlanner | None = None
        self._charges = Objective()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="trailmark-landmark")  # Python waits for it at its end
        self._work: Future[PlanResult] | None = None
        self.result: PlanResult | None = None

    @property
    def roadmap(self) -> Roadmap | None:
        """The roadmap of the queries so far; None before the first one."""
        self._wait()
        return None if self._planner is None else self._planner.roadmap

    def update(self, world: World) -> None:
        """Plan in another world from now on; what the changes do not reach is kept.

        Raises:
            BoundsError: the state space reaches beyond the world. Nothing is changed then.
        """
        self._wait()
        one_of(world, World, "world:", error=WorldError)
        require_within(self._space, world)
        if self._planner is None:
            self.checker = self.checker.edited(world)
        else:
            self._planner.update(world)
            self.checker = self._planner.checker
        self._single.update(self.checker)
        self.result = None

    @returns_on_error(None)
    def clear(self) -> None:
        """Forget the last query, and the roadmap too unless ``keep_roadmap``; OMPL calls this."""
        # The base class's method is not called: through the bindings it would call this one again.
        self._wait()
        self.result = None
        if not self._keep:
            self._planner = None

    def solve(self, condition: Any) -> Any:
        """Plan until the path has settled or the condition holds; OMPL calls this."""
        try:
            return self._solve(condition)
        except BaseException as error:  # nothing may pass through OMPL's C++
            caught(error)
            return ob.PlannerStatus(ob.PlannerStatus.ABORT)

    def _solve(self, condition: Any) -> Any:
        problem, status = self.getProblemDefinition(), ob.PlannerStatus
        charges = _objective_of(problem)
        self._wait()
        if self._follows:
            world = checker_in(self.getSpaceInformation()).world
            if world is not self.checker.world:
                self.update(world)
        goals = goals_in(problem.getGoal(), self.checker, straight=self._curves is None)
        starts, goal = starts_and_goal(problem)
        starts = starts[self.checker.valid(starts)]
        if len(starts) == 0:
            return ob.PlannerStatus(status.INVALID_START)
        if goals and goal is None:
            goal = np.array(goals[0].pose)  # that of a region
        ends = goal if goals is None else np.array([each.pose for each in goals])
        if goal is None or ends is None or not np.any(self.checker.valid(ends)):
            return ob.PlannerStatus(status.INVALID_GOAL)
        if self._planner is None or self._charges != charges:
            self._planner = LandmarkPlanner(
                self.checker.world,
                checker=self.checker,
                seed=self._seed,
                settings=self._settings,
                objective=charges,
            )
            self._charges = charges
        query = _Query(self._planner, starts, goal if goals is None else goals)
        self._work = work = self._thread.submit(query.run)
        try:
            while not wait([work], POLL).done:
                if condition():
                    query.stop.set()
                    wait([work], GRACE)
                    break
        finally:
            query.stop.set()
        self.result, last = work.result() if work.done() else None, query.last
        if last is not None and last.path is not None and self._offer(problem, last.path, goal, exact=True):
            return ob.PlannerStatus(status.EXACT_SOLUTION)
        if self.result is not None and self.result.status == "infeasible":
            return ob.PlannerStatus(status.INFEASIBLE)
        nearest = None if last is None else last.nearest
        if nearest is not None and len(nearest.states) > 1 and self._offer(problem, nearest, goal, exact=False):
            return ob.PlannerStatus(status.APPROXIMATE_SOLUTION)
        return ob.PlannerStatus(status.TIMEOUT)

    def _offer(self, problem: Any, path: Path, goal: se2.FloatArray, *, exact: bool) -> bool:
        """Hand a path to OMPL; return False if OMPL would follow other curves, not certified, between its states."""
        information = self.getSpaceInformation()
        states: se2.FloatArray | None
        if isinstance(path, CurvePath) and self._curves is not None:
            states, distance = self._curves.certified_states(information, path), path.steering.lengths
        elif self._planner is not None and not self._planner.motion.direct_is_best:
            # What has fewer vertices may cost more.
            states, distance = path.states, se2.distance
        else:
            states, distance = sparse_path(self._single, path.states), se2.distance
        if states is None:
            return False
        difference = 0.0 if exact else float(distance(states[-1], goal))
        problem.addSolutionPath(path_to_ompl(information, states), not exact, difference, self.getName())
        return True

    def _wait(self) -> None:
        """Wait for a query that was cut short, so that nothing changes the roadmap any more."""
        if self._work is not None:
            wait([self._work])
            self._work = None


class _Query:
    """One query, in a thread of its own, so that the termination condition can be called meanwhile."""

    def __init__(self, planner: LandmarkPlanner, starts: se2.FloatArray, goal: Ends) -> None:
        self.planner, self.starts, self.goal, self.stop = planner, starts, goal, threading.Event()
        self.last: PlanProgress | None = None

    def run(self) -> PlanResult:
        """Plan from each start in turns that get longer, until each start's answer is final; return the best one."""
        seconds, pending = FIRST_TURN if len(self.starts) > 1 else np.inf, set(range(len(self.starts)))
        answers: dict[int, PlanResult] = {}
        while pending:
            for i in sorted(pending):
                begin = perf_counter()
                answers[i] = found = self.planner.plan(
                    self.starts[i],
                    self.goal,
                    time_limit=seconds,
                    on_progress=self._on_progress,
                    stop=self.stop.is_set,
                )
                # One that ends early has nothing left to try.
                if found.status == "infeasible" or perf_counter() - begin < 0.5 * seconds or self.stop.is_set():
                    pending.discard(i)
            seconds *= 2.0
            best = min((found.cost for found in answers.values() if found.cost is not None), default=np.inf)
            pending = {i for i in pending if (answers[i].lower_bound or 0.0) < best}
        # Without a path, the query is infeasible only if it is from each of the starts.
        return min(
            answers.values(),
            key=lambda found: (np.inf if found.cost is None else found.cost, found.status == "infeasible"),
        )

    def _on_progress(self, progress: PlanProgress) -> None:
        # Of another start's paths the best one stays.
        best = np.inf if self.last is None or self.last.cost is None else self.last.cost
        if (np.inf if progress.cost is None else progress.cost) <= best:
            self.last = progress


def _steered(checker: StateChecker, steering: Steering | None) -> StateChecker:
    """Return a checker whose robot moves as a state space has it: on curves, or straight."""
    robot = checker.robot
    radius, reverse = (None, True) if steering is None else (steering.radius, steering.reverse)
    if radius == robot.turning_radius or (
        radius is not None
        and robot.turning_radius is not None
        # The space's radius is measured, and differs from the one that it was made with by rounding.
        and isclose(radius, robot.turning_radius, rel_tol=1e-9)
        and reverse == robot.reverse
    ):
        return checker
    steered = copy(checker)
    steered.robot = robot.steered(radius, reverse)
    return steered


def _objective_of(problem: Any) -> Objective:
    """Return what paths cost in a problem: their length, unless it has one of trailmark's objectives.

    Raises:
        ObjectiveError: another objective.
    """
    objective = problem.getOptimizationObjective()
    if isinstance(objective, PathObjective):
        return objective.objective
    if objective is not None and not isinstance(objective, ob.PathLengthOptimizationObjective):
        raise ObjectiveError(
            "objective: expected PathLengthOptimizationObjective, trailmark's PathObjective or none, got "
            f"{objective.getDescription()!r}"
        )
    return Objective()
