"""One query, whatever its goal is and wherever it starts."""

# Tested by tests/planning/test_planner.py, test_leaving.py and test_goal_search.py.

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from trailmark.goals import Ends, goals_of
from trailmark.planning.goal_search import answer_goals
from trailmark.planning.leaving import answer_from_anywhere
from trailmark.planning.result import PlanResult
from trailmark.planning.world_model import WorldModel

__all__ = ["answer"]


def answer(model: WorldModel, start: ArrayLike, goal: Ends, time_limit: float, **options: Any) -> PlanResult:
    """Return the answer to one query; whoever calls holds the lock of the model's roadmap.

    Options are those of :func:`trailmark.planning.single_query.answer_query`.
    """
    goals = goals_of(goal)
    if goals is not None:
        return answer_goals(model, start, goals, time_limit, **options)
    return answer_from_anywhere(model, start, goal, time_limit, **options)  # type: ignore[arg-type]  # an array then
