"""A problem made ready for runs: everything is built that does not count as a planner's own time."""

from __future__ import annotations

from time import perf_counter
from typing import Any

from trailmark import se2
from trailmark.benchmark.problems import read_problem
from trailmark.benchmark.referee import Referee
from trailmark.collision import StateChecker
from trailmark.motion import kind_of
from trailmark.motion.pointwise import CurveMarks, PointwiseChecker
from trailmark.planning.warmup import warm_up

__all__ = ["CountingChecker", "Prepared"]


class Prepared:
    """A problem that is read, with its checker built and its kernels loaded.

    Args:
        text: as in :class:`trailmark.benchmark.problems.Job`.

    Attributes:
        problem: world, robot and query.
        checker: the one that every planner gets.
        setup_time: seconds for reading and for building the checker.
        referee: judges paths; its building is not part of ``setup_time``.
    """

    def __init__(self, text: str) -> None:
        begin = perf_counter()
        self.problem = read_problem(text)
        read = perf_counter() - begin
        # Compiled or loaded from the cache for this kind of motion: no planner's time.
        warm_up(kind_of(self.problem.robot))
        begin = perf_counter()
        self.checker = StateChecker(self.problem.world, self.problem.robot)
        self.setup_time = read + perf_counter() - begin
        if self.problem.steering is not None:
            # They compile what OMPL's simplifier asks of a car's curves: a process whose time is up would never finish.
            CurveMarks(PointwiseChecker(self.checker, self.problem.steering))
        self.referee = Referee(self.problem.world, self.problem.robot)

    @property
    def ends(self) -> tuple[se2.FloatArray, se2.FloatArray]:
        """Start and goal, each of shape (3,)."""
        query = self.problem.query
        start, goal = se2.configurations([query.start, query.pose()])
        return start, goal


class CountingChecker(StateChecker):
    """A checker that counts what it is asked.

    Motions that compiled code checks by itself, while it shortens a path, are not counted.

    Attributes:
        states: configurations asked for, with or without their clearance.
        motions: motions asked for; one that the field leaves open and that is asked for again counts twice.
    """

    def __init__(self, checker: StateChecker) -> None:
        vars(self).update(vars(checker))
        self.states = self.motions = 0

    def clearance(self, q: Any, **options: Any) -> Any:
        """Count, and answer."""
        found = super().clearance(q, **options)
        self.states += 1 if isinstance(found, float) else len(found)
        return found

    def motions_free(self, a: se2.FloatArray, b: se2.FloatArray) -> Any:
        """Count, and answer."""
        self.motions += len(a)
        return super().motions_free(a, b)

    def motions_by_field(self, a: se2.FloatArray, b: se2.FloatArray) -> Any:
        """Count, and answer."""
        self.motions += len(a)
        return super().motions_by_field(a, b)

    def states_free(self, q: se2.FloatArray) -> Any:
        """Count, and answer."""
        self.states += len(q)
        return super().states_free(q)
