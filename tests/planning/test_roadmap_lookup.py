"""A kept roadmap helps: the same query again costs no more, and what nobody can answer does not fill it."""

from __future__ import annotations

import pytest
from tests.helpers.oracles import judge
from tests.helpers.trials import QUICK
from tests.helpers.worlds import ROBOTS, random_pairs, random_world

from trailmark import LandmarkPlanner
from trailmark.planning.settings import PlannerSettings

LONG = 30.0

WORLD = random_world(3, 120, size=50.0, radii=(0.5, 3.0), discs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rectangle", "disc"])
def test_it_hardly_grows_by_queries_that_it_knows(name: str) -> None:
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
