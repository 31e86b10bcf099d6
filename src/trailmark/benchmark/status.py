"""Status: how a run ended, with OMPL's numbers."""

from __future__ import annotations

from enum import IntEnum

__all__ = ["Status"]


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
        return _WORDS[self]


_WORDS = {
    Status.UNKNOWN: "Unknown status",
    Status.INVALID_START: "Invalid start",
    Status.INVALID_GOAL: "Invalid goal",
    Status.UNRECOGNIZED_GOAL_TYPE: "Unrecognized goal type",
    Status.TIMEOUT: "Timeout",
    Status.APPROXIMATE_SOLUTION: "Approximate solution",
    Status.EXACT_SOLUTION: "Exact solution",
    Status.CRASH: "Crash",
    Status.ABORT: "Abort",
    Status.INFEASIBLE: "Infeasible",
}
