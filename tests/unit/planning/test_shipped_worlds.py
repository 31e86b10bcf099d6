"""Every query of every shipped world: solved, or infeasible where its name says so; shapely judges the paths."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.oracles import judge
from tests.helpers.trials import thorough
from tests.helpers.worlds import GRID_KINDS, far_pairs

from trailmark import LandmarkPlanner, PlannerSettings, PlanResult, Query, Robot, StateChecker, World
from trailmark.planning.incumbent import GAP
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
def test_queries_are_answered(name: str) -> None:
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
        cost = judge(world, world.robot, query.start, query.goal, result.path.states, fine=0.05)
        assert result.cost == pytest.approx(cost, abs=1e-9)
        assert result.lower_bound <= cost + 1e-9
        # Measured between the states too, so that it is the least of those at the states or smaller.
        assert result.min_clearance <= np.min(planner.checker.clearance(result.path.states)) + 1e-9


def test_the_enclosed_goal_is_proven_infeasible() -> None:
    world = World.load(shipped_worlds()["enclosed"])
    query = world.query("infeasible")
    assert LandmarkPlanner(world, seed=0).plan(query.start, query.goal).status == "infeasible"


@pytest.mark.slow
@pytest.mark.parametrize("kind", GRID_KINDS)
def test_paths_are_certified_and_within_a_hundredth_of_the_bound(kind: str) -> None:
    rng = np.random.default_rng(5)
    blocked = GRID_KINDS[kind](rng, 100)
    ((x, y, u, v),) = far_pairs(blocked, rng, 1)
    world = World.from_grid(blocked, 1.0)
    planner = LandmarkPlanner(world, Robot.disc(0.4), seed=0)
    result = planner.plan((x + 0.5, y + 0.5, 0.0), (u + 0.5, v + 0.5, 0.0), time_limit=5.0)
    assert result.lower_bound <= result.path.cost <= 1.01 * result.lower_bound
    states = result.path.states
    assert StateChecker(world, Robot.disc(0.4)).motions_valid(states[:-1], states[1:]).all()
