"""Measured runs of OMPL's planners: when the first solution came, how the cost fell, what was checked, what was built.

The bindings have no progress properties, so the best cost is read where Python is called anyway: now and then in a
validity or motion check, in the planner's own thread. PRM and PRM* do not report their best
cost; they are run in slices, between which their roadmap stays (:func:`_in_slices`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from time import perf_counter
from typing import Any

from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from trailmark.motion.pointwise import PointwiseChecker
from trailmark.ompl_bridge.guard import planning
from trailmark.ompl_bridge.ompl_curves import OmplCurves
from trailmark.ompl_bridge.planners import set_parameters
from trailmark.ompl_bridge.problem import SE2Problem
from trailmark.ompl_bridge.states import path_to_ompl
from trailmark.trajectories import CurvePath, Path

__all__ = ["Measurement", "graph_size", "measure", "seed_ompl", "silence_ompl", "simplify"]

READING_PERIOD = 0.0005
"""Seconds between two readings of the best cost."""

ROUNDING = 1e-9
"""Part of a cost by which OMPL's sum of a path's length and ours may differ; costs this close are one cost."""

GROWING, EXPANDING = 0.4, 0.2
"""Seconds after which one ``PRM.solve`` turns from growing its roadmap to expanding it, and back."""

SLICED = ("PRM", "PRMstar")

EXACT = 6
FINAL = (1, 2, 3, 9)
"""OMPL's numbers for an exact solution, and for what more time does not change: invalid ends, infeasible."""


@dataclass
class Measurement:
    """One run of one of OMPL's planners. Times are seconds from the call, costs metres of SE2 distance.

    Attributes:
        status: OMPL's number.
        time: until the planner was done.
        path: the path returned, exact or not; None without one.
        exact: whether it reaches the goal, by the planner's word.
        curve: (time, cost) of each better exact solution.
        states_checked: calls of the validity checker; for OMPL's discrete validator also those along motions.
        motions_checked: motions checked.
    """

    status: int
    time: float
    path: Path | None
    exact: bool
    curve: list[tuple[float, float]]
    states_checked: int
    motions_checked: int


def seed_ompl(seed: int) -> None:
    """Seed OMPL's random numbers; only a process that has not drawn any yet can be seeded."""
    # OMPL ignores 0.
    ou.RNG.setSeed(seed + 1)


def silence_ompl() -> None:
    """Keep OMPL from printing messages."""
    ou.noOutputHandler()


def measure(
    problem: SE2Problem,
    name: str,
    limit: float,
    *,
    parameters: Mapping[str, str] | None = None,
) -> Measurement:
    """Run a planner on a problem, whose objective becomes the length of the path.

    Args:
        problem: as set up; its checkers count anew.
        name: of one of OMPL's planners.
        limit: seconds.
        parameters: of the planner, by OMPL's names; the others keep their defaults.

    Raises:
        PlannerNameError: the installed OMPL has no planner of that name, or it has no such parameter.
    """
    monitor = _Monitor()
    parts: list[Any] = [problem.validity, *([] if problem.motions is None else [problem.motions])]
    for part in parts:
        part.checked, part.watch = 0, monitor.read
    problem.setup.setOptimizationObjective(ob.PathLengthOptimizationObjective(problem.information))
    monitor.begin = begin = perf_counter()
    planner = problem.set_planner(name)
    if parameters:
        set_parameters(type(planner).__name__, parameters)(planner)
    problem.setup.setup()
    monitor.cost = getattr(planner, "bestCost", None)
    if name in SLICED:
        status = _in_slices(problem, planner, monitor, limit)
    else:
        status = _solve(planner, limit - (perf_counter() - begin))
    time = perf_counter() - begin
    for part in parts:
        part.watch = None  # else planner, checker and monitor would keep one another alive
    return _measurement(problem, monitor, status, time)


def graph_size(problem: SE2Problem) -> tuple[int, int]:
    """Return the number of nodes and edges of the roadmap or tree of the planner that was run last."""
    planner = problem.setup.getPlanner()
    if hasattr(planner, "milestoneCount"):
        # Reading a roadmap's edges one by one takes a tenth of a second.
        return int(planner.milestoneCount()), int(planner.edgeCount())
    data = ob.PlannerData(problem.information)
    problem.setup.getPlannerData(data)
    return int(data.numVertices()), int(data.numEdges())


def simplify(problem: SE2Problem, path: Path, limit: float) -> tuple[Path, float]:
    """Return what OMPL's ``PathSimplifier`` makes of a path, and the seconds that it took.

    Args:
        problem: whose checker and motion validator decide.
        path: in the problem's space.
        limit: seconds.
    """
    states = path.states
    if isinstance(path, CurvePath):
        certified = OmplCurves(problem.information, PointwiseChecker(problem.checker, path.steering))
        found = certified.certified_states(problem.information, path)
        states = path.knots if found is None else found
    made = path_to_ompl(problem.information, states)
    simplifier, begin = og.PathSimplifier(problem.information), perf_counter()
    with planning():
        simplifier.simplify(made, limit)
    seconds = perf_counter() - begin
    return problem.path_of(made), seconds


@dataclass
class _Monitor:
    """Reads the planner's best cost while it plans."""

    begin: float = 0.0
    cost: Callable[[], Any] | None = None
    curve: list[tuple[float, float]] = field(default_factory=list)
    _next: float = 0.0

    def read(self) -> None:
        """Read the best cost, if the last reading is a period ago."""
        now = perf_counter()
        if now < self._next:
            return
        self._next = now + READING_PERIOD
        if self.cost is not None:
            self.add(now - self.begin, float(self.cost().value()))

    def add(self, time: float, cost: float) -> None:
        """Add a cost to the curve if it is better than the last one."""
        # OMPL's planners start from an infinite cost or none.
        if isfinite(cost) and cost > 0.0 and (not self.curve or cost < (1.0 - ROUNDING) * self.curve[-1][1]):
            self.curve.append((time, cost))


def _in_slices(problem: SE2Problem, planner: Any, monitor: _Monitor, limit: float) -> Any:
    """Solve slice by slice on one roadmap, and read the best path's cost after each slice.

    One ``PRM.solve`` grows the roadmap for 0.4 s, expands it for 0.2 s, and so on. A slice is shorter and would only
    ever grow it, so the turns are taken here.
    """
    status, definition = None, problem.setup.getProblemDefinition()
    while True:
        elapsed = perf_counter() - monitor.begin
        left = limit - elapsed
        if left <= 0.0 and status is not None:
            return status
        turn = elapsed % (GROWING + EXPANDING)
        to_turn = (GROWING if turn < GROWING else GROWING + EXPANDING) - turn
        # A tenth of the time so far: the first solution's time is as exact as that.
        step = max(1e-4, min(max(0.005, 0.1 * elapsed), 0.05, left, to_turn))
        if turn >= GROWING:
            condition = ob.timedPlannerTerminationCondition(step)
            with planning(condition):
                planner.expandRoadmapPtc(condition)
            # As long as it takes to report the path that expanding found.
            step = 1e-3
        status = _solve(planner, step)
        if definition.hasExactSolution():
            cost = float(definition.getSolutionPath().length())
            monitor.add(perf_counter() - monitor.begin, cost)
        if int(status.getStatus().value) in FINAL:
            return status


def _solve(planner: Any, limit: float) -> Any:
    condition = ob.timedPlannerTerminationCondition(max(limit, 1e-4))
    with planning(condition):
        return planner.solve(condition)


def _measurement(problem: SE2Problem, monitor: _Monitor, status: Any, time: float) -> Measurement:
    definition = problem.setup.getProblemDefinition()
    exact = bool(definition.hasExactSolution())
    path = problem.path_of(definition.getSolutionPath()) if definition.hasSolution() else None
    if path is None or not exact:
        monitor.curve.clear()
    else:
        monitor.add(time, path.cost)
    # The validator that looks at states one by one counts motions itself.
    motions = problem.motions.checked if problem.motions is not None else problem.information.getCheckedMotionCount()
    return Measurement(
        # A later slice may end without finding the path anew.
        status=EXACT if exact else int(status.getStatus().value),
        time=time,
        path=path,
        exact=exact,
        curve=monitor.curve,
        states_checked=problem.validity.checked,
        motions_checked=int(motions),
    )
