"""Goals of replanned paths and of many queries at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from trailmark import Disc, Goal, LandmarkPlanner, Rectangle, Robot, World
from trailmark.errors import ConfigurationError

START = np.array([1.0, 1.0, 0.3])
NEAR, FAR = Goal((5.0, 1.0), position_tolerance=0.3), Goal((8.5, 8.5, 1.0))


def planner() -> LandmarkPlanner:
    wall = Rectangle((5.0, 5.0), 4.0, 0.3)
    return LandmarkPlanner(World("room", (0, 0, 10, 10), (wall,), Robot.rectangle(0.6, 0.4)), seed=1)


@pytest.mark.slow
def test_it_leads_to_another_goal_where_its_own_is_blocked() -> None:
    plans = planner()
    path = plans.plan(START, [NEAR, FAR], 0.3).path
    assert path is not None
    plans.update(plans.world.edited(add=[Disc((5.0, 1.0), 0.8)]))
    result = plans.replan(START, [NEAR, FAR], path, improvement=0.1)
    assert result.path is not None
    assert result.goal is not None
    assert result.goal.index == 1
    assert FAR.contains(result.path.states[-1])
    assert "blocked" in result.reason
    # A goal given up is no longer led to.
    other = plans.replan(START, FAR, path)
    assert other.goal is not None
    assert other.reason == "the path leads to another goal"
    with pytest.raises(ConfigurationError, match="is not valid"):
        plans.replan(START, Goal((5.0, 5.0, 0.0)), path)


@pytest.mark.slow
def test_many_queries_may_have_goals() -> None:
    plans = planner()
    goals: list[Any] = [(5.0, 1.0, 0.0), [NEAR, FAR], FAR, (8.5, 1.0, 0.0)]
    results = plans.plan_many(np.tile(START, (4, 1)), goals, 0.3)
    assert [r.status for r in results] == 4 * ["solved"]
    assert [None if r.goal is None else r.goal.index for r in results] == [None, 0, 0, None]
    for result, goal in zip(results, goals, strict=True):
        assert result.path is not None
        if isinstance(goal, tuple):
            assert np.array_equal(result.path.states[-1], goal)
    with pytest.raises(ConfigurationError, match="goals: expected 4, as many as starts, got 2"):
        plans.plan_many(np.tile(START, (4, 1)), [NEAR, FAR], 0.3)
