"""A kept roadmap helps and never hinders: counted work on it against that of a fresh planner."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.helpers.counted_plans import ask, random_pairs
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.quick import QUICK

from trailmark import LandmarkPlanner
from trailmark.collision import StateChecker
from trailmark.planning.roadmap_lookup import FIRST_BUDGET
from trailmark.planning.settings import PlannerSettings
from trailmark.planning.single_query import GAP
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]
Judge = Callable[..., float]

LONG = 30.0

WORLD = random_world(3, 120, size=50.0, radii=(0.5, 3.0), discs=0.3)

MAX_KEPT = PlannerSettings().max_kept_nodes


def planner_for(name: str = "rectangle", checker: StateChecker | None = None) -> LandmarkPlanner:
    # Counted is the work until the first path; a little improvement brings nodes as well.
    return LandmarkPlanner(WORLD, ROBOTS[name], seed=4, checker=checker, settings=QUICK)


@pytest.mark.slow
def test_the_same_query_again_and_again_costs_no_more(judge: Judge) -> None:
    kept = planner_for()
    start, goal = random_pairs(kept, 1, 3)[0]
    fresh = ask(planner_for(checker=kept.checker), start, goal, LONG, max_iterations=1, gap=np.inf)
    sizes, efforts, costs = [], [], []
    for _ in range(14):
        result, effort = ask(kept, start, goal, LONG, max_iterations=1)
        assert result.path is not None
        sizes.append((len(kept.roadmap), len(kept.roadmap.edges)))
        efforts.append(effort)
        costs.append(result.path.cost)
    # It hardly grows once it knows the query, and answers it at less cost than the first time.
    assert sizes[-1][0] <= sizes[0][0] + 50
    assert sizes[-1] == sizes[9]
    assert max(efforts[1:]) <= max(fresh.effort, FIRST_BUDGET + 24)
    assert np.mean(efforts[1:]) <= fresh.effort
    assert costs[-1] <= 1.03 * costs[0]
    assert result.path is not None
    judge(WORLD, kept.robot, start, goal, result.path.states)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rectangle", "disc"])
def test_random_queries_cost_hardly_more_than_on_a_fresh_planner(name: str) -> None:
    kept = planner_for(name)
    pairs = random_pairs(kept, 8, 5)
    efforts: dict[str, list[int]] = {"kept": [], "fresh": []}
    sizes = []
    # Counted is what was done until the first path; with what comes after it, a planner asked once does nothing.
    enough = {"kept": GAP, "fresh": np.inf}
    for i, (start, goal) in enumerate(pairs):
        fresh = LandmarkPlanner(WORLD, kept.robot, seed=i, checker=kept.checker, settings=QUICK)
        for which, planner in (("kept", kept), ("fresh", fresh)):
            result, effort = ask(planner, start, goal, LONG, max_iterations=1, gap=enough[which])
            assert result.status == "solved"
            efforts[which].append(effort)
        sizes.append(len(kept.roadmap))
    for of_kept, of_fresh in zip(efforts["kept"], efforts["fresh"], strict=True):
        # At worst what the first look took, and a share of what all else took besides.
        assert of_kept <= 1.5 * of_fresh + FIRST_BUDGET + 24
    assert np.mean(efforts["kept"][4:]) <= np.mean(efforts["fresh"][4:]) + 0.5 * FIRST_BUDGET
    assert sizes[-1] <= MAX_KEPT
    # What it grows by becomes less.
    assert sizes[-1] - sizes[4] < sizes[4]


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
