"""Many queries on one roadmap: paths judged by shapely alone, the same whoever asks, and nothing left behind."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.helpers.oracles import judge
from tests.helpers.trials import QUICK
from tests.helpers.worlds import ROBOTS, joined_pairs, random_pairs, random_world

from trailmark import ConfigurationError, LandmarkPlanner, PlannerSettings, Robot, World

FloatArray = NDArray[np.float64]

WORLD = random_world(3, 60, size=40.0, radii=(0.3, 3.0), discs=0.3)


LIGHT = PlannerSettings(probes=50, max_spread_landmarks=700)
"""Of a planner whose roadmap need not be as dense as would help."""


def planner_for(name: str, settings: PlannerSettings | None = None) -> LandmarkPlanner:
    return LandmarkPlanner(WORLD, ROBOTS[name], seed=4, settings=settings)


def queries(planner: LandmarkPlanner, n: int) -> tuple[FloatArray, FloatArray]:
    """Return starts and goals in one part of the world, at any heading for a disc too."""
    ends = joined_pairs(planner, n)
    if planner.checker.footprint.is_disc:
        ends[..., 2] = np.random.default_rng(8).uniform(-3.0, 3.0, (n, 2))
    return ends[:, 0], ends[:, 1]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "L"])
def test_paths_are_valid_bounded_and_leave_nothing_behind(name: str) -> None:
    planner = planner_for(name, LIGHT)
    planner.build(700)
    starts, goals = queries(planner, 12)
    # Here what is new to the roadmap is learnt.
    assert {r.status for r in planner.plan_many(starts, goals, time_limit=20.0, max_iterations=4)} == {"solved"}
    nodes, edges = len(planner.roadmap), len(planner.roadmap.edges)
    seen: list[tuple[int, int]] = []
    results = planner.plan_many(starts, goals, on_progress=lambda done, of: seen.append((done, of)))
    assert seen == [(i + 1, 12) for i in range(12)]
    assert [r.status for r in results] == ["solved"] * 12
    assert (len(planner.roadmap), len(planner.roadmap.edges)) == (nodes, edges)
    for start, goal, result in zip(starts, goals, results, strict=True):
        cost = judge(WORLD, planner.robot, start, goal, result.path.states)
        assert result.path.cost == pytest.approx(cost, abs=1e-9)
        assert result.first_cost is not None
        straight = math.dist(start[:2], goal[:2])
        assert straight - 1e-9 <= result.lower_bound <= cost + 1e-9
        costs = [c for _, c in result.history]
        assert costs[0] == result.first_cost
        assert costs == sorted(costs, reverse=True)
        assert costs[-1] == pytest.approx(cost)
        times = [t for t, _ in result.history]
        assert times == sorted(times)
        assert result.time["first_solution"] == times[0]


@pytest.mark.slow
def test_answers_do_not_depend_on_the_number_of_threads() -> None:
    answers = []
    for workers in (1, 5):
        planner = LandmarkPlanner(WORLD, ROBOTS["rectangle"], seed=4, settings=replace(LIGHT, patience=2))
        planner.build(500)
        starts, goals = queries(planner, 16)
        # One query is planned until it settles.
        answers.append(planner.plan_many(starts, goals, time_limit=600.0, workers=workers))
    for other in answers[1:]:
        for a, b in zip(answers[0], other, strict=True):
            assert (a.status, a.lower_bound, a.first_cost) == (b.status, b.lower_bound, b.first_cost)
            assert a.path == b.path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time_limit": 0.0}, r"time limit: expected more than 0, got 0\.0 s"),
        ({"max_iterations": 0}, "max iterations: expected a whole number, 1 or more, got 0"),
        ({"starts": [(5, 5, 0)] * 3}, "goals: expected 3, as many as starts, got 2"),
        ({"goals": [(9, 9, 0), (-1, 5, 0)]}, r"goal 1 \(-1, 5, 0\) is not valid"),
    ],
)
def test_bad_arguments(change: dict[str, object], message: str) -> None:
    open_world = World("open", (0, 0, 10, 10))
    planner = LandmarkPlanner(open_world, Robot.disc(0.3), seed=0)
    arguments: dict[str, object] = {"starts": [(1, 1, 0), (2, 2, 0)], "goals": [(9, 9, 0), (5, 5, 0)], **change}
    with pytest.raises(ConfigurationError, match=message):
        planner.plan_many(**arguments)  # type: ignore[arg-type]  # wrong on purpose


@pytest.mark.slow
def test_many_queries_can_be_stopped() -> None:
    planner = planner_for("rectangle", LIGHT)
    starts, goals = queries(planner, 8)
    results = planner.plan_many(starts, goals, 60.0, stop=lambda: True)
    assert [r.status for r in results] == ["timeout"] * 8
    assert all(
        r.path is None and r.lower_bound == pytest.approx(math.dist(a[:2], b[:2]), abs=2.0)
        for r, a, b in zip(results, starts, goals, strict=True)
    )
    # Hardly anything was built; the next call goes on with it.
    assert len(planner.roadmap) <= 16
    asked = [0]

    def later() -> bool:
        asked[0] += 1
        return asked[0] > 40

    some = planner.plan_many(starts, goals, 60.0, stop=later)
    assert len(some) == 8
    assert {r.status for r in planner.plan_many(starts, goals, 60.0)} == {"solved"}


LIMIT = 30.0


LOOKUP_WORLD = random_world(3, 120, size=50.0, radii=(0.5, 3.0), discs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rectangle", "disc"])
def test_it_hardly_grows_by_queries_that_it_knows(name: str) -> None:
    kept = LandmarkPlanner(LOOKUP_WORLD, ROBOTS[name], seed=4, settings=QUICK)
    start, goal = random_pairs(kept, 1, 3)[0]
    sizes, costs = [], []
    for _ in range(14):
        result = kept.plan(start, goal, LIMIT, max_iterations=1)
        sizes.append((len(kept.roadmap), len(kept.roadmap.edges)))
        costs.append(judge(LOOKUP_WORLD, kept.robot, start, goal, result.path.states))
    assert sizes[-1][0] <= sizes[0][0] + 50
    assert sizes[-1] == sizes[9]
    assert costs[-1] <= 1.03 * costs[0]
    for start, goal in random_pairs(kept, 8, 5):
        assert kept.plan(start, goal, LIMIT, max_iterations=1).status == "solved"
        sizes.append((len(kept.roadmap), 0))
    assert sizes[-1][0] <= PlannerSettings().max_kept_nodes
    # What it grows by becomes less.
    assert sizes[-1][0] - sizes[-4][0] <= sizes[-4][0]
