"""One query, whatever its goal is and wherever it starts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.goals import Ends, goals_of
from trailmark.planning.goal_search import answer_goals
from trailmark.planning.leaving import leave
from trailmark.planning.result import PlanResult
from trailmark.planning.single_query import answer_query
from trailmark.planning.world_model import WorldModel, zones_at

__all__ = ["answer"]


def answer(model: WorldModel, start: ArrayLike, goal: Ends, time_limit: float, **options: Any) -> PlanResult:
    """Return the answer to one query; whoever calls holds the lock of the model's roadmap.

    Options are those of :func:`trailmark.planning.single_query.answer_query`.

    Raises:
        ConfigurationError: start or goal is not valid; a start in keep-out zones is, if it is without them.
    """
    se2.configurations(start, name="start", by_hand=True)
    goals = goals_of(goal)
    plan: Any = answer_query if goals is None else answer_goals
    zones = zones_at(model.checker, start)
    if not zones:
        return plan(model, start, goal if goals is None else goals, time_limit, **options)  # type: ignore[no-any-return]
    if goals is None:
        end = model.checker.require_valid(goal, "goal")  # type: ignore[arg-type]  # an array then
        return leave(model, zones, start, end, time_limit, plan, **options)[0]
    # Without the zones, those in them would be the nearest.
    poses = [each.configuration for each in goals]
    outside = [i for i, pose in enumerate(poses) if pose is None or model.checker.valid(pose)]
    if not outside:
        model.checker.require_valid(poses[0] or (), "goal 0")
    result, _ = leave(model, zones, start, tuple(goals[i] for i in outside), time_limit, plan, **options)
    return (
        result if result.goal is None else replace(result, goal=replace(result.goal, index=outside[result.goal.index]))
    )
