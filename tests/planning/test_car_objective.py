"""What a car pays for: changes of direction and metres in reverse, in plans, in what they report, and in searches."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.helpers.oracles import Oracle

from trailmark import Objective
from trailmark.planning import LandmarkPlanner, PlanResult
from trailmark.shapes import Rectangle
from trailmark.trajectories import CurvePath
from trailmark.world import Robot, World

# A slot for parking, 1.6 m longer than the car.
WALLS = (Rectangle((4.0, 2.0), 8.0, 2.0), Rectangle((17.6, 2.0), 8.0, 2.0), Rectangle((10.0, 0.4), 20.0, 0.8))
WORLD = World("slot", (0.0, 0.0, 20.0, 8.0), WALLS, Robot.rectangle(4.0, 1.8).steered(4.0))
SLOT, ROAD = np.array([10.8, 1.9, 0.0]), np.array([4.0, 5.0, 0.0])


def planned(objective: Objective | str | None = None, start: Any = ROAD, goal: Any = SLOT) -> PlanResult:
    planner = LandmarkPlanner(WORLD, seed=0, objective=objective)
    result = planner.plan(start, goal, time_limit=60.0, max_iterations=2)
    assert isinstance(result.path, CurvePath)
    assert np.array_equal(result.path.knots[[0, -1]], [start, goal])
    assert not Oracle(WORLD, planner.robot).collides(result.path.resample(0.01).states).any()
    return result


@pytest.fixture(scope="module")
def paid() -> PlanResult:
    return planned()


@pytest.mark.slow
def test_changes_of_direction_are_what_a_driver_avoids_by_default(paid: PlanResult) -> None:
    plain = planned("length")
    assert isinstance(paid.path, CurvePath)
    assert isinstance(plain.path, CurvePath)
    assert paid.path.cusps < plain.path.cusps
    assert plain.cost == plain.path.length
    assert plain.objective is None
    assert paid.cost == pytest.approx(paid.path.length + 3.0 * paid.path.cusps + 0.5 * paid.path.reverse_length)
    assert paid.lower_bound is not None
    assert paid.cost is not None
    assert paid.lower_bound <= paid.cost
    record = paid.to_dict("slot")
    assert record["direction_changes"] == paid.path.cusps
    assert record["reverse_length"] == paid.path.reverse_length
    assert record["objective"]["direction_change"] == 3.0


@pytest.mark.slow
def test_many_queries_and_new_plans_pay_too(paid: PlanResult) -> None:
    planner, before = LandmarkPlanner(WORLD, seed=0, landmarks=50), paid.path
    assert before is not None
    for result in (
        planner.plan_many([ROAD], [SLOT], 20.0, max_iterations=1)[0],
        planner.replan(ROAD, SLOT, before, 20.0),
    ):
        path = result.path
        assert isinstance(path, CurvePath)
        assert result.cost == pytest.approx(path.length + 3.0 * path.cusps + 0.5 * path.reverse_length)
