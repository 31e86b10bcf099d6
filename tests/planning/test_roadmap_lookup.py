"""A kept roadmap helps: the same query again costs no more, and what nobody can answer does not fill it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from tests.helpers.random_pairs import random_pairs
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.quick import QUICK

from trailmark import LandmarkPlanner
from trailmark.planning.settings import PlannerSettings
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

LONG = 30.0

WORLD = random_world(3, 120, size=50.0, radii=(0.5, 3.0), discs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rectangle", "disc"])
def test_it_hardly_grows_by_queries_that_it_knows(name: str, judge: Callable[..., float]) -> None:
    kept = LandmarkPlanner(WORLD, ROBOTS[name], seed=4, settings=QUICK)
    start, goal = random_pairs(kept, 1, 3)[0]
    sizes, costs = [], []
    for _ in range(14):
        result = kept.plan(start, goal, LONG, max_iterations=1)
        assert result.path is not None
        sizes.append((len(kept.roadmap), len(kept.roadmap.edges)))
        costs.append(judge(WORLD, kept.robot, start, goal, result.path.states))
    assert sizes[-1][0] <= sizes[0][0] + 50
    assert sizes[-1] == sizes[9]
    assert costs[-1] <= 1.03 * costs[0]
    for start, goal in random_pairs(kept, 8, 5):
        assert kept.plan(start, goal, LONG, max_iterations=1).status == "solved"
        sizes.append((len(kept.roadmap), 0))
    assert sizes[-1][0] <= PlannerSettings().max_kept_nodes
    # What it grows by becomes less.
    assert sizes[-1][0] - sizes[-4][0] <= sizes[-4][0]


@pytest.mark.slow
def test_a_query_that_nobody_can_answer_does_not_fill_it() -> None:
    # The way is barred to the robot, not to its disc, and no proof is sought.
    walls = (Rectangle((5.0, 1.4), 0.4, 2.8), Rectangle((5.0, 6.2), 0.4, 5.6), Rectangle((4.3, 3.1), 0.2, 1.0))
    world = World("barred", (0, 0, 10, 9), walls, Robot.rectangle(2.0, 0.4))
    settings = PlannerSettings(max_kept_nodes=150, without=("background-proof",))
    planner = LandmarkPlanner(world, seed=0, settings=settings)
    sizes = []
    for _ in range(3):
        result = planner.plan((2.0, 4.0, 1.5), (8.0, 4.0, 1.5), LONG, max_iterations=2)
        assert result.path is None
        sizes.append(len(planner.roadmap))
    assert sizes[-1] == sizes[-2] == sizes[-3]
    # One query may need more than there is room for; no other one goes on from there.
    assert sizes[-1] < 5_000
