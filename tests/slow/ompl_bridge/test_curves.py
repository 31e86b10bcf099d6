"""Cars in OMPL: spaces of curves, their certified motions, paths; the same answers as directly."""

from __future__ import annotations

from typing import Any

import pytest

SET_UP = """
from trailmark import StateChecker
from trailmark.trajectories import path_of
from trailmark.motion import CurveMotion
from trailmark.curves import Steering
from trailmark.trajectories import CurvePath
world = shipped("office")
car = world.robot.steered(0.7, REVERSE)
"""


@pytest.mark.parametrize("reverse", [True, False], ids=["reeds-shepp", "dubins"])
def test_ompls_planners_find_certified_paths_of_curves(run_ompl: Any, reverse: bool) -> None:
    found = run_ompl(
        SET_UP.replace("REVERSE", str(reverse))
        + """
from tests.helpers.oracles import Oracle
for name in ("RRTConnect", "RRTstar"):
    problem = SE2Problem(world, car, "coffee")  # to the others it takes them seconds
    # The first path is good enough: RRTstar would use all of its time.
    objective = ob.PathLengthOptimizationObjective(problem.information)
    objective.setCostThreshold(ob.Cost(float("inf")))
    problem.setup.setOptimizationObjective(objective)
    problem.set_planner(name)
    status = problem.solve(20.0)
    path = problem.path
    solution = problem.setup.getSolutionPath()
    hit = Oracle(world, car).collides(path.resample(0.01).states)
    cost = solution.length()
    solution.interpolate(800)
    dense = Oracle(world, car).collides(states_of(solution))
    tell(**{name: [status.asString(), type(path).__name__, bool(hit.any()), bool(dense.any()),
                   abs(cost - path.cost), path.cusps]})
"""
    )
    for name in ("RRTConnect", "RRTstar"):
        status, kind, hit, dense, difference, cusps = found[name]
        assert status == "Exact solution"
        assert kind == "CurvePath"
        assert not hit
        assert not dense
        assert difference < 1e-6
        assert reverse or cusps == 0


def test_what_is_certified_the_other_way_only_is_no_path(run_ompl: Any) -> None:
    # PRM's edges lead both ways, the curves of a car that only drives forwards do not.
    found = run_ompl("""
from trailmark import OneWayZone, Polygon, check_path
world = shipped("office")
free = []
for robot in (Robot.rectangle(0.6, 0.4).steered(0.6, reverse=False), Robot.rectangle(0.6, 0.4)):
    judged = []
    for query in world.queries[:2]:
        problem = SE2Problem(world, robot, (query.start, query.goal))
        problem.set_planner("PRM")
        problem.solve(1.0)
        exact = problem.setup.haveExactSolutionPath()
        given = problem.path
        wrong = exact and not check_path(world, robot, problem.path_of(problem.setup.getSolutionPath())).free
        judged.append([exact, given is not None, bool(wrong)])
    free.append(judged)
zone = OneWayZone(Polygon([(4.0, 0.0), (6.0, 0.0), (6.0, 10.0), (4.0, 10.0)]), 0.0, 0.5)
hall = World("hall", (0.0, 0.0, 10.0, 10.0), robot=Robot.disc(0.3), zones=(zone,))
ways = []
for start, goal in (((1.0, 5.0, 0.0), (9.0, 5.0, 0.0)), ((9.0, 5.0, 0.0), (1.0, 5.0, 0.0))):
    problem = SE2Problem(hall, None, (start, goal))
    problem.set_planner("RRTConnect")
    problem.solve(1.0)
    path = problem.path_of(problem.setup.getSolutionPath())
    ways.append([problem.path is not None, check_path(hall, None, path).free])
tell(free=free, ways=ways)
""")
    for judged in found["free"]:
        assert any(exact for exact, _, _ in judged)
        for exact, given, wrong in judged:
            assert given == (exact and not wrong)
    assert any(wrong for _, _, wrong in found["free"][0])
    assert not any(wrong for _, _, wrong in found["free"][1])
    assert [given for given, _ in found["ways"]] == [free for _, free in found["ways"]]
    assert found["ways"][1] == [False, False]
