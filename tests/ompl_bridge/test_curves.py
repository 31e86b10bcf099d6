"""Cars in OMPL: spaces of curves, their certified motions, paths; the same answers as directly."""

from __future__ import annotations

from typing import Any

import pytest

SET_UP = """
from trailmark import StateChecker
from trailmark.motion import CurveMotion
from trailmark.curves import CurvePath, Steering
world = shipped("office")
car = world.robot.steered(0.7, REVERSE)
"""


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [True, False], ids=["reeds-shepp", "dubins"])
def test_answers_through_ompl_are_those_given_directly(run_ompl: Any, reverse: bool) -> None:
    found = run_ompl(
        SET_UP.replace("REVERSE", str(reverse))
        + """
problem = SE2Problem(world, car)
si, checker = problem.information, problem.checker
motions = CurveMotion(checker)
rng = np.random.default_rng(1)
xmin, ymin, xmax, ymax = world.bounds
q = rng.uniform((xmin, ymin, -np.pi), (xmax, ymax, np.pi), (2000, 3))
q = q[checker.valid(q)]
a = q[rng.integers(0, len(q), 1000)]
b = a + rng.uniform(-1.0, 1.0, (1000, 3))
b[:, 2] = np.arctan2(np.sin(b[:, 2]), np.cos(b[:, 2]))
made = [(state(si, p), state(si, r)) for p, r in zip(a, b)]
direct = motions.motions_valid(a, b)
through = [si.checkMotion(p, r) for p, r in made]
lengths = [problem.space.distance(p, r) for p, r in made]
steering = problem.motions.steering
through = np.array(through)
tell(more=int(np.sum(through & ~direct)), fewer=float(np.mean(~through & direct)),
     share=float(direct.mean()), kind=type(problem.space).__name__,
     radius=steering.radius, reverse=steering.reverse,
     lengths=float(np.abs(lengths - motions.steering.lengths(a, b)).max()))
"""
    )
    assert found["more"] == 0
    # Where several curves are as short, OMPL may take another than trailmark: all must be free.
    assert found["fewer"] < (0.02 if reverse else 1e-9)
    assert 0.03 < found["share"] < 0.9
    assert found["kind"] == ("ReedsSheppStateSpace" if reverse else "DubinsStateSpace")
    assert found["radius"] == pytest.approx(0.7, abs=1e-12)
    assert found["reverse"] is reverse
    assert found["lengths"] < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [True, False], ids=["reeds-shepp", "dubins"])
def test_ompls_planners_find_certified_paths_of_curves(run_ompl: Any, reverse: bool) -> None:
    found = run_ompl(
        SET_UP.replace("REVERSE", str(reverse))
        + """
from tests.helpers.oracle import Oracle
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_space_of_the_users_own(run_ompl: Any) -> None:
    found = run_ompl(
        """
from trailmark import StateChecker
from trailmark.ompl_bridge.spaces import set_bounds, steering_of
world = shipped("office")
checker = StateChecker(world)
spaces = {"dubins": ob.DubinsStateSpace(1.3), "reeds-shepp": ob.ReedsSheppStateSpace(0.25), "se2": ob.SE2StateSpace()}
for name, space in spaces.items():
    set_bounds(space, world)
    motions = MotionValidator(ob.SpaceInformation(space), checker)
    tell(**{name: None if motions.steering is None else [motions.steering.radius, motions.steering.reverse]})
space = ob.DubinsStateSpace(1.3, True)
set_bounds(space, world)
try:
    MotionValidator(ob.SpaceInformation(space), checker)
except SpaceError as error:
    tell(symmetric=str(error))
""",
        whole=True,
    )
    assert found["dubins"] == [pytest.approx(1.3), False]
    assert found["reeds-shepp"] == [pytest.approx(0.25), True]
    assert found["se2"] is None
    assert "symmetric" in found["symmetric"]
    assert "\n" not in found["symmetric"]
