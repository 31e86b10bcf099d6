"""RunRecord: what one run of one planner answers, and how it ended."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from enum import IntEnum
from typing import Any

__all__ = ["MEASURED", "RunRecord", "Status"]

States = list[list[float]]


class Status(IntEnum):
    """How a run ended; the numbers are those of ``ompl::base::PlannerStatus``."""

    UNKNOWN = 0
    INVALID_START = 1
    INVALID_GOAL = 2
    UNRECOGNIZED_GOAL_TYPE = 3
    TIMEOUT = 4
    APPROXIMATE_SOLUTION = 5
    EXACT_SOLUTION = 6
    CRASH = 7
    ABORT = 8
    INFEASIBLE = 9

    @property
    def description(self) -> str:
        """OMPL's words for it, as in the ``enums`` table of its benchmark databases."""
        return "Unknown status" if self == Status.UNKNOWN else self.name.replace("_", " ").capitalize()


@dataclass
class RunRecord:
    """One run. Its fields, but the curve, are the columns of a results database's table ``runs``.

    Times are seconds of wall clock, costs are OMPL's SE2 distance along the path (metres). What is not known is None.

    Attributes:
        status: OMPL's number for how it ended.
        solved: whether the planner calls its path an exact solution; the referee decides in ``correct_solution``.
        correct_solution: whether the referee accepts ``path``.
        approximate_solution: whether a path was returned that does not reach the goal.
        solution_difference: distance from the returned path's end to the goal (metres of cost); 0 if exact.
        time: planning, from the call to its end; no set-up of world and checker, no start of a process.
        time_to_first_solution: until the first exact solution.
        first_solution_length: its cost, before anything shortened it.
        solution_length: cost of the path at the end.
        simplified_solution_length: its cost after the simplifier that all planners share.
        simplification_time: what that took; not part of ``time``.
        states_checked: validity checks of single states, by OMPL's planners.
        motions_checked: checks of motions, by OMPL's planners.
        graph_states: nodes of the roadmap or tree at the end.
        graph_motions: its edges.
        memory: MB (2^20 bytes) of main memory held at most above what was held when planning began.
        seed: what the run was seeded with.
        setup_time: reading the problem and building its checker.
        overhead: wall time of the job less ``time``, ``simplification_time`` and what preparing the problem took, if
            it was not ready: forking, counting the graph, judging the path, handing over.
        failure: one line that says why there is no answer, or why it was refused.
        path: states [x, y, theta] of the returned path, also of an approximate one.
        simplified_path: states after the simplifier.
        curve: (seconds, cost) of each better path, in the order of time.
    """

    status: int = Status.UNKNOWN
    solved: bool = False
    correct_solution: bool = False
    approximate_solution: bool = False
    solution_difference: float | None = None
    time: float | None = None
    time_to_first_solution: float | None = None
    first_solution_length: float | None = None
    solution_length: float | None = None
    simplified_solution_length: float | None = None
    simplification_time: float | None = None
    states_checked: int | None = None
    motions_checked: int | None = None
    graph_states: int | None = None
    graph_motions: int | None = None
    memory: float | None = None
    seed: int = 0
    setup_time: float | None = None
    overhead: float | None = None
    failure: str | None = None
    path: States | None = None
    simplified_path: States | None = None
    curve: list[tuple[float, float]] = field(default_factory=list)

    @classmethod
    def from_json(cls, answer: Mapping[str, Any]) -> RunRecord:
        """Return the record of a decoded answer; names that are no fields are left out.

        Raises:
            ValueError: a status that OMPL does not have, or a number that is not finite.
        """
        known = {f.name for f in fields(cls)}
        record = cls(**{name: value for name, value in answer.items() if name in known})
        record.status = int(Status(record.status))
        record.curve = [(float(t), float(cost)) for t, cost in record.curve]
        for name, value in vars(record).items():
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"{name}: expected a finite number, got {value}")
        return record

    def to_json(self) -> dict[str, Any]:
        """Return the fields as plain numbers, strings and lists."""
        return asdict(self)


_KINDS = {"int": "INTEGER", "bool": "BOOLEAN", "float": "REAL", "str": "TEXT", "States": "TEXT"}

MEASURED = {f.name: _KINDS[str(f.type).removesuffix(" | None")] for f in fields(RunRecord) if f.name != "curve"} | {
    "status": "ENUM"
}
"""The columns of ``runs`` after its three keys, with SQLite's types. Paths are JSON."""
