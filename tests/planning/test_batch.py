"""Many queries on one roadmap: paths judged by shapely alone, the same whoever asks, and nothing left behind."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import LandmarkPlanner
from trailmark.errors import ConfigurationError
from trailmark.landmarks import free_samples
from trailmark.planning.growth import grow_general
from trailmark.planning.settings import PlannerSettings
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]
Judge = Callable[..., float]

WORLD = random_world(3, 60, size=40.0, radii=(0.3, 3.0), discs=0.3)


LIGHT = PlannerSettings(probes=50, max_spread_landmarks=700)
"""Of a planner whose roadmap need not be as dense as would help."""


def planner_for(name: str, settings: PlannerSettings | None = None) -> LandmarkPlanner:
    return LandmarkPlanner(WORLD, ROBOTS[name], seed=4, settings=settings)


def queries(planner: LandmarkPlanner, n: int, seed: int = 8) -> tuple[FloatArray, FloatArray]:
    """Return starts and goals in one part of the world, some of them at any heading for a disc too."""
    ends = free_samples(planner.checker, 4 * n, random_state=seed)
    reached = planner.relaxation.component(ends[0])
    ends = ends[reached[planner.relaxation.cells(planner.relaxation.disc_centers(ends))]][: 2 * n]
    if planner.checker.footprint.is_disc:
        ends[:, 2] = np.random.default_rng(seed).uniform(-3.0, 3.0, len(ends))
    return ends[::2], ends[1::2]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "L"])
def test_paths_are_valid_bounded_and_leave_nothing_behind(name: str, judge: Judge) -> None:
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
        assert result.path is not None
        cost = judge(WORLD, planner.robot, start, goal, result.path.states)
        assert result.path.cost == pytest.approx(cost, abs=1e-9)
        assert result.lower_bound is not None
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
        ({"workers": 0}, "workers: expected a whole number, 1 or more, got 0"),
        ({"max_iterations": 0}, "max iterations: expected a whole number, 1 or more, got 0"),
        ({"starts": [(1, 1)]}, r"starts: expected shape \(3,\) or \(n, 3\) for x, y, theta, got \(1, 2\)"),
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


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "rectangle"])
def test_a_roadmap_is_built_as_dense_as_the_world_asks_for_and_its_paths_are_short(name: str) -> None:
    planner, seen = planner_for(name), list[tuple[int, int]]()
    starts, goals = queries(planner, 8)
    left = iter([0.0])
    graph, whole = grow_general(
        planner.roadmap, planner.relaxation, np.random.default_rng(0), LIGHT, seconds_left=lambda: next(left)
    )
    # One part, then the time was up.
    assert (whole, len(graph)) == (False, len(planner.roadmap))
    assert 10 <= len(planner.roadmap) <= 16
    results = planner.plan_many(starts, goals, 60.0, on_progress=lambda done, of: seen.append((done, of)))
    # Reports while it is built, then for each query.
    building = [entry for entry in seen if entry == (0, 8)]
    assert len(building) >= 4
    assert seen[len(building) :] == [(i + 1, 8) for i in range(8)]
    assert len(planner.roadmap) > 1_000
    one = LandmarkPlanner(WORLD, ROBOTS[name], seed=5, checker=planner.checker, settings=PlannerSettings(patience=4))
    single = [one.plan(a, b, time_limit=30.0, max_iterations=2).cost for a, b in zip(starts, goals, strict=True)]
    many = np.array([r.cost for r in results], dtype=np.float64)
    ratio = many / np.minimum(many, np.array(single, dtype=np.float64))
    assert np.median(ratio) < 1.03
    assert ratio.max() < 1.5
