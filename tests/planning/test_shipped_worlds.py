"""Every query of every shipped world: solved, or infeasible where its name says so; shapely judges the paths."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from tests.helpers.trials import thorough

from trailmark.planning import LandmarkPlanner, PlannerSettings, PlanResult
from trailmark.planning.incumbent import GAP
from trailmark.world import Query, World
from trailmark.world.library import shipped_worlds

QUICK = PlannerSettings(sweeps=5, first_sweeps=2, patience=1)
"""Of a planner whose paths need not be the shortest."""

LIMIT = 10.0
"""Seconds, for a busy machine: benchmarks/solve.py measures how long the queries take."""


def solve(planner: LandmarkPlanner, query: Query, gap: float) -> PlanResult:
    """Plan with one round of landmarks, and only where that does not do, with more."""
    result = planner.plan(query.start, query.goal, LIMIT, max_iterations=1, gap=gap)
    if result.status == "timeout":
        result = planner.plan(query.start, query.goal, LIMIT, max_iterations=8, gap=gap)
    return result


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_worlds())
def test_queries_are_answered(name: str, judge: Callable[..., float]) -> None:
    world = World.load(shipped_worlds()[name])
    assert world.robot is not None
    many = len(world.obstacles) > 1000 and not thorough()
    planner = LandmarkPlanner(world, seed=1, settings=QUICK)
    # The first path is improved where that takes little; of those after it the first that is found will do.
    gap = GAP if len(world.obstacles) < 100 or thorough() else np.inf
    # Bounds among thousands of obstacles take long: an ordinary run asks the first query there.
    for query in world.queries[: 1 if many else None]:
        if query.name.startswith("infeasible"):
            result = planner.plan(query.start, query.goal, 0.1)
            assert result.status in ("infeasible", "timeout"), query.name
            assert result.path is None
            continue
        result = solve(planner, query, gap)
        gap = np.inf
        assert result.status == "solved", query.name
        assert result.path is not None
        assert result.lower_bound is not None
        cost = judge(world, world.robot, query.start, query.goal, result.path.states, fine=0.05)
        assert result.cost == pytest.approx(cost, abs=1e-9)
        assert result.lower_bound <= cost + 1e-9
        assert result.min_clearance is not None
        # Measured between the states too, so that it is the least of those at the states or smaller.
        assert result.min_clearance <= np.min(planner.checker.clearance(result.path.states)) + 1e-9


def test_the_enclosed_goal_is_proven_infeasible() -> None:
    world = World.load(shipped_worlds()["enclosed"])
    query = world.query("infeasible")
    assert LandmarkPlanner(world, seed=0).plan(query.start, query.goal).status == "infeasible"
