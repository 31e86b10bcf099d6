"""Planning for other objectives than length: costs as shapely samples them, bounds below them, paths where expected."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.oracles import sampled_cost

from trailmark import CostZone, LandmarkPlanner, Objective, PlanResult, Polygon, Rectangle, Robot, World

AISLE = World(
    "aisle",
    (0.0, 0.0, 12.0, 4.0),
    (Rectangle((6.0, 0.725), 8.0, 1.45), Rectangle((6.0, 3.275), 8.0, 1.45)),
    Robot.rectangle(0.9, 0.62),
)
"""An aisle of 1.1 m between two blocks, from x = 2 to 10."""

ROBOTS = {"disc": Robot.disc(0.3), "rectangle": Robot.rectangle(0.8, 0.4)}
SQUARE = Polygon(np.array([(3.0, 2.0), (7.0, 2.0), (7.0, 8.0), (3.0, 8.0)], dtype=float))
ENDS = np.array([[1.0, 5.0, 0.0], [9.0, 5.0, 0.0]])


def planned(world: World, robot: Robot, objective: Objective | str, limit: float = 30.0, rounds: int = 3) -> PlanResult:
    planner = LandmarkPlanner(world, robot, seed=0, objective=objective)
    start, goal = ENDS
    return planner.plan(start, goal, time_limit=limit, max_iterations=rounds)


def require_priced(world: World, result: PlanResult, objective: Objective) -> None:
    """Require that cost and bound are what they are said to be."""
    assert result.cost == pytest.approx(
        sampled_cost(world, objective, np.array(result.path.states)), abs=result.cost_error + 0.02
    )
    assert result.lower_bound <= result.cost
    assert result.to_dict("w")["objective"] == objective.to_dict()


@pytest.mark.parametrize("name", ROBOTS)
def test_a_dear_zone_is_gone_round_and_a_cheap_one_gone_through(name: str) -> None:
    dear = World("dear", (0.0, 0.0, 10.0, 10.0), zones=(CostZone(SQUARE, 4.0),))
    result = planned(dear, ROBOTS[name], "length")
    require_priced(dear, result, Objective())
    middle = result.path.states[1:-1, 1]
    assert (np.abs(middle - 5.0) > 2.8).any()
    # Round the zone's corners it is 4 + 2·√(4 + 9) metres.
    assert result.cost == pytest.approx(4.0 + 2.0 * np.hypot(2.0, 3.0), rel=0.02)
    assert result.lower_bound > 0.9 * 4.0 + 1.8 * np.hypot(2.0, 3.0)
    cheap = World(
        "cheap",
        (0.0, 0.0, 10.0, 10.0),
        zones=(CostZone(Polygon(np.array([(1, 7), (9, 7), (9, 8), (1, 8)], dtype=float)), 0.2),),
    )
    result = planned(cheap, ROBOTS[name], "length")
    require_priced(cheap, result, Objective())
    assert (result.path.states[:, 1] >= 6.95).any()


def test_the_objective_clearance_keeps_to_the_middle_of_an_aisle() -> None:
    planner = LandmarkPlanner(AISLE, seed=0, objective="clearance")
    result = planner.plan((1.0, 2.3, 0.0), (11.0, 1.7, 0.0), time_limit=30.0, max_iterations=4)
    require_priced(AISLE, result, Objective.of("clearance"))
    dense = np.array(result.path.resample(0.02).states)
    within = dense[(dense[:, 0] > 2.6) & (dense[:, 0] < 9.4)]
    assert np.abs(within[:, 1] - 2.0).max() <= 0.01


def test_the_bound_of_a_drive_that_turns_faster_than_half_a_second_a_radian() -> None:
    """Turning is charged less than a length has it: the bound on lengths is none on times as it stands."""
    objective = Objective.of("time", max_turn_rate=5.0)
    robot = Robot.disc(0.3).differential()
    planner = LandmarkPlanner(World("open", (0, 0, 10, 10)), robot, objective=objective, seed=0)
    result = planner.plan((1.0, 5.0, 0.0), (9.0, 5.0, np.pi), time_limit=30.0, max_iterations=1)
    assert result.cost == pytest.approx(8.0 + np.pi / 5.0)
    assert result.lower_bound <= result.cost
