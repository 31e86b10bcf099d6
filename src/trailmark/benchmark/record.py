"""RunRecord: what one run of one planner answers, and how it travels as one line of JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from trailmark.benchmark.status import Status

__all__ = ["RunRecord"]

States = list[list[float]]


@dataclass
class RunRecord:
    """One run. A planner's process (or a native program) answers with the fields up to ``failure``.

    Times are seconds of wall clock, costs are OMPL's SE2 distance along the path (metres). What is not known is None.

    Attributes:
        status: OMPL's number for how it ended.
        seed: what the run was seeded with.
        solved: whether the planner calls its path an exact solution; the referee decides in ``correct_solution``.
        approximate_solution: whether a path was returned that does not reach the goal.
        solution_difference: distance from the returned path's end to the goal (metres of cost); 0 if exact.
        time: planning, from the call to its end; no set-up of world and checker, no start of a process.
        time_to_first_solution: until the first exact solution.
        first_solution_length: its cost, before anything shortened it.
        solution_length: cost of the path at the end.
        simplified_solution_length: its cost after the simplifier that all planners share.
        simplification_time: what that took; not part of ``time``.
        states_checked: validity checks of single states.
        motions_checked: checks of motions.
        graph_states: nodes of the roadmap or tree at the end.
        graph_motions: its edges.
        memory: MB (2^20 bytes) of heap in use above what was in use when planning began: the largest value measured,
            after each of the landmark planner's steps, at the end of OMPL's planners.
        setup_time: loading the world and building the checker; shared by all runs on the problem.
        curve: (seconds, cost) of the best solution so far, in the order of time, a row for each better one.
        path: states [x, y, theta] of the returned path, also of an approximate one.
        simplified_path: states after the simplifier.
        smoothness: radians that the direction of travel turns for each metre of ``path``, if that is correct; filled in
            by the worker, as the next two; :class:`~trailmark.benchmark.measures.Measures` defines them.
        max_curvature: its largest turn over the robot's inscribed radius (radians / metre).
        min_clearance: its least distance to obstacles and bounds (metres).
        parameters: of one of OMPL's planners once it is set up, ``name=value`` by commas: some follow from the problem.
        failure: one line that says why there is no answer, or why it was refused.
        correct_solution: whether the referee accepts ``path``; filled in by the worker.
        overhead: wall time of the job less ``time``, ``simplification_time`` and what preparing the problem took, if
            it was not ready: forking, counting the graph, judging the path, handing over; filled in by the worker.
    """

    status: int = Status.UNKNOWN
    seed: int = 0
    solved: bool = False
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
    setup_time: float | None = None
    curve: list[tuple[float, float]] = field(default_factory=list)
    path: States | None = None
    simplified_path: States | None = None
    smoothness: float | None = None
    max_curvature: float | None = None
    min_clearance: float | None = None
    parameters: str | None = None
    failure: str | None = None
    correct_solution: bool = False
    overhead: float | None = None

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
        for f in fields(cls):
            value = getattr(record, f.name)
            if isinstance(value, float) and not math.isfinite(value):
                raise ValueError(f"{f.name}: expected a finite number, got {value}")
        return record

    def to_json(self) -> dict[str, Any]:
        """Return the fields as plain numbers, strings and lists."""
        return asdict(self)
