"""Trailmark's objectives in OMPL: RRT* takes them, and the landmark planner plans for them."""

from __future__ import annotations

from typing import Any

import pytest


def test_the_landmark_planner_and_rrt_star_go_round_a_costly_zone(run_ompl: Any) -> None:
    found = run_ompl(
        """
from trailmark import CostZone, PlannerSettings
zone = CostZone([(3, 2), (7, 2), (7, 8), (3, 8)], 4.0)
world = World("costly", (0, 0, 10, 10), (), Robot.rectangle(0.6, 0.4), zones=(zone,))
problem = SE2Problem(world, query=((1, 5, 0), (9, 5, 0)))
objective = PathObjective(problem.information, "length")
problem.setup.setOptimizationObjective(objective)
a, b = (state(problem.information, q) for q in ((1, 5, 0), (9, 5, 0)))
tell(direct=objective.motionCost(a, b).value(), bound=objective.motionCostHeuristic(a, b).value())
for name in ("landmark", "RRTstar"):
    if name == "landmark":
        quick = PlannerSettings(patience=1)
        planner = problem.set_planner(OmplLandmarkPlanner(problem.information, seed=0, settings=quick))
    else:
        planner = problem.set_planner(name)
        objective.setCostThreshold(ob.Cost(17.0))  # it would use all of its time
    problem.solve(20.0)
    rows = problem.path.states
    ends = [[state(problem.information, q) for q in pair] for pair in zip(rows[:-1], rows[1:])]
    tell(**{name: sum(objective.motionCost(*pair).value() for pair in ends)})
    problem.setup.clear()
""",
    )
    assert found["direct"] == pytest.approx(4.0 + 4.0 * 4.0)
    assert 0.0 < found["bound"] <= 8.0 + 1e-9
    # Round the zone's corners it is 4 + 2·√(4 + 9) = 11.2 metres.
    assert found["landmark"] == pytest.approx(11.21, abs=0.2)
    assert found["landmark"] <= found["RRTstar"] + 0.05 < 20.0
