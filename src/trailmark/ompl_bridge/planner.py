"""The landmark planner as one of OMPL's: in a SimpleSetup, or beside the C++ planners in OMPL's Benchmark."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
from ompl import base as ob

from trailmark import se2
from trailmark.arguments import one_of, truth, whole
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.motion.pointwise import PointwiseChecker
from trailmark.ompl_bridge.checker import StateValidityChecker
from trailmark.ompl_bridge.errors import BridgeError, ObjectiveError, SpaceError
from trailmark.ompl_bridge.guard import caught
from trailmark.ompl_bridge.spaces import require_within, space_of
from trailmark.ompl_bridge.sparse_path import sparse_path
from trailmark.ompl_bridge.states import configuration, path_to_ompl
from trailmark.path import Path
from trailmark.planning import LandmarkPlanner as Planner
from trailmark.planning import PlanProgress, PlanResult
from trailmark.planning.warmup import warm_up

__all__ = ["LandmarkPlanner"]

POLL = 0.002
"""Seconds between two looks at the termination condition."""

GRACE = 0.05
"""Seconds that the work under way gets to come to its end by itself once planning is to stop."""


class LandmarkPlanner(ob.Planner):  # type: ignore[misc]  # OMPL's bindings carry no types
    """Landmarks, roadmap and shortest path, as an ``ob.Planner``.

    It plans in trailmark's own world, not by asking OMPL's checker state by state; what it returns is certified, with
    fewer vertices than ``result.path`` and up to 0.01 % longer, so that OMPL's path simplifier comes back.
    ``solve`` returns once the termination condition holds (within 20 ms) or the path has settled. Repeated ``solve``,
    and ``clear`` with ``keep_roadmap``, go on with the roadmap of the queries before.

    Args:
        information: the ``SpaceInformation`` of an ``SE2StateSpace`` within the world's bounds.
        checker: trailmark's checker; by default that of the ``StateValidityChecker`` in ``information``.
        seed: the same seed gives the same paths, as long as the termination condition does not cut in.
        keep_roadmap: whether ``clear`` keeps the roadmap. Give False in a benchmark, where each run is to start
            from nothing.

    Attributes:
        result: the last query's :class:`~trailmark.planning.PlanResult`; None if it was cut short.

    Raises:
        SpaceError: a space not made of x, y and heading, or one of curves.
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
    ) -> None:
        space = space_of(information)
        if type(space) is not ob.SE2StateSpace:
            raise SpaceError(f"state space {space.getName()!r} ({type(space).__name__}) given, allowed: SE2StateSpace")
        super().__init__(information, "landmark")
        # Now, so that no query pays for it.
        warm_up()
        self.checker = _checker_in(information) if checker is None else one_of(checker, StateChecker, "checker:")
        require_within(space, self.checker.world)
        self._single = PointwiseChecker(self.checker)
        self._seed = None if seed is None else whole(seed, "seed:", 0)
        self._keep = truth(keep_roadmap, "keep_roadmap:")
        self._planner: Planner | None = None
        self._work: _Work | None = None
        self.result: PlanResult | None = None

    @property
    def roadmap(self) -> Any:
        """The roadmap of the queries so far, a :class:`trailmark.roadmap.Roadmap`; None before the first one."""
        self._wait()
        return None if self._planner is None else self._planner.roadmap

    def solve(self, condition: Any) -> Any:
        """Plan until the path has settled or the condition holds; OMPL calls this."""
        try:
            return self._solve(condition)
        except BaseException as error:  # nothing may pass through OMPL's C++
            caught(error)
            return ob.PlannerStatus(ob.PlannerStatus.ABORT)

    def clear(self) -> None:
        """Forget the last query, and the roadmap too unless ``keep_roadmap``; OMPL calls this."""
        try:
            self._wait()
            self.result = None
            if not self._keep:
                self._planner = None
            # Not the base class's: through the bindings it would come back here.
        except BaseException as error:  # nothing may pass through OMPL's C++
            caught(error)

    def _solve(self, condition: Any) -> Any:
        status = ob.PlannerStatus
        problem = self.getProblemDefinition()
        _require_path_length(problem)
        self._wait()
        start, goal = self._ends(problem)
        if start is None or not self.checker.valid(start):
            return ob.PlannerStatus(status.INVALID_START)
        if goal is None or not self.checker.valid(goal):
            return ob.PlannerStatus(status.INVALID_GOAL)
        if self._planner is None:
            self._planner = Planner(self.checker.world, checker=self.checker, seed=self._seed)
        self._work = work = _Work(self._planner, start, goal)
        try:
            while not work.done.wait(POLL):
                if condition():
                    work.stop.set()
                    work.done.wait(GRACE)
                    break
        finally:
            work.stop.set()
        if work.error is not None:
            raise work.error
        self.result = work.result
        last = work.last
        if last is not None and last.path is not None:
            self._offer(problem, last.path, goal, exact=True)
            return ob.PlannerStatus(status.EXACT_SOLUTION)
        if work.result is not None and work.result.status == "infeasible":
            return ob.PlannerStatus(status.INFEASIBLE)
        if last is not None and last.nearest is not None and len(last.nearest.states) > 1:
            self._offer(problem, last.nearest, goal, exact=False)
            return ob.PlannerStatus(status.APPROXIMATE_SOLUTION)
        return ob.PlannerStatus(status.TIMEOUT)

    def _ends(self, problem: Any) -> tuple[se2.FloatArray | None, se2.FloatArray | None]:
        """Return the first start and the goal state as configurations; None where there is none valid.

        Raises:
            ConfigurationError: a goal that is not one state.
        """
        # Not ProblemDefinition.getStartState: OMPL 2.0.1 gives the state away, and it is freed twice.
        inputs = self.getPlannerInputStates()
        inputs.clear()
        inputs.use(problem)
        first = inputs.nextStart() if inputs.haveMoreStartStates() else None
        goal = problem.getGoal()
        if goal is not None and not isinstance(goal, ob.GoalState):
            raise ConfigurationError(f"goal of kind {type(goal).__name__} given, allowed: GoalState")
        ends = (first, None if goal is None else goal.getState())
        start, last = (None if end is None else configuration(end) for end in ends)
        return start, last

    def _offer(self, problem: Any, path: Path, goal: se2.FloatArray, *, exact: bool) -> None:
        difference = 0.0 if exact else float(se2.distance(path.states[-1], goal))
        made = path_to_ompl(self.getSpaceInformation(), sparse_path(self._single, path.states))
        problem.addSolutionPath(made, not exact, difference, self.getName())

    def _wait(self) -> None:
        """Let work that was cut short come to its end, so that the roadmap is at rest."""
        if self._work is not None:
            self._work.join()
            self._work = None


class _Work(threading.Thread):
    """One query in a thread of its own, so that the termination condition can be looked at meanwhile."""

    def __init__(self, planner: Planner, start: se2.FloatArray, goal: se2.FloatArray) -> None:
        # Not a daemon: Python waits for its end before it ends itself, since a thread cut off in compiled code would
        # take the process down.
        super().__init__(name="trailmark-landmark", daemon=False)
        self.planner, self.ends = planner, (start, goal)
        self.stop, self.done = threading.Event(), threading.Event()
        self.last: PlanProgress | None = None
        self.result: PlanResult | None = None
        self.error: BaseException | None = None
        self.start()

    def run(self) -> None:
        try:
            self.result = self.planner.plan(
                *self.ends, time_limit=np.inf, on_progress=self._follow, stop=self.stop.is_set
            )
        except BaseException as error:  # kept for the thread that waits
            self.error = error
        finally:
            self.done.set()

    def _follow(self, progress: PlanProgress) -> None:
        self.last = progress


def _checker_in(information: Any) -> StateChecker:
    """Return the checker of trailmark's validity checker in a ``SpaceInformation``."""
    try:
        part = information.getStateValidityChecker()
    except TypeError:
        part = None  # OMPL 1.7 does not hand out every checker
    if not isinstance(part, StateValidityChecker):
        raise BridgeError("no checker given, and no trailmark StateValidityChecker is set, allowed: either of them")
    return part.checker


def _require_path_length(problem: Any) -> None:
    """Raise unless the problem is to find a short path.

    Raises:
        ObjectiveError: another objective.
    """
    objective = problem.getOptimizationObjective()
    if objective is not None and not isinstance(objective, ob.PathLengthOptimizationObjective):
        raise ObjectiveError(
            f"objective {objective.getDescription()!r} given, allowed: PathLengthOptimizationObjective, or none"
        )
