"""The checker and the motion validator as OMPL calls them: the same answers as directly."""

from __future__ import annotations

from typing import Any

import pytest


@pytest.mark.slow
def test_answers_through_ompl_are_those_given_directly(run_ompl: Any) -> None:
    found = run_ompl("""
world = shipped("clutter")
problem = SE2Problem(world)
si, checker = problem.information, problem.checker
rng = np.random.default_rng(1)
xmin, ymin, xmax, ymax = world.bounds
q = rng.uniform((xmin, ymin, -np.pi), (xmax, ymax, np.pi), (4000, 3))
made = [state(si, row) for row in q]
valid = checker.valid(q)
free = np.flatnonzero(valid)
pairs = rng.choice(free, (1500, 2))
q[pairs[:, 1], :2] = q[pairs[:, 1], :2]
direct = checker.motions_valid(q[pairs[:, 0]], q[pairs[:, 1]])
through = [si.checkMotion(made[a], made[b]) for a, b in pairs]
part = si.getStateValidityChecker()
tell(states=[si.isValid(s) for s in made] == valid.tolist(), share=float(valid.mean()),
     motions=through == direct.tolist(), certified=float(direct.mean()),
     clearances=max(abs(part.clearance(made[i]) - checker.clearance(q[i])) for i in range(300)),
     counted=[problem.validity.checked, problem.motions.checked])
""")
    assert found["states"]
    assert found["motions"]
    assert 0.1 < found["share"] < 0.95
    assert 0.005 < found["certified"] < 0.95
    assert found["clearances"] < 1e-12
    assert found["counted"][0] == 4000
    assert found["counted"][1] == 1500


@pytest.mark.slow
def test_half_a_turn_back_is_checked_the_way_that_ompl_turns(run_ompl: Any) -> None:
    # A bar in a corner: counter-clockwise there is room, clockwise there is a wall.
    found = run_ompl("""
from trailmark.shapes import Rectangle
robot = Robot.polygon([(0.0, -0.1), (2.0, -0.1), (2.0, 0.1), (0.0, 0.1)])
world = World("post", (0.0, 0.0, 10.0, 10.0), (Rectangle((6.2, 5.0), 0.3, 0.3),), robot)
problem = SE2Problem(world, query=((5.0, 5.0, np.pi / 2), (5.0, 5.0, -np.pi / 2)))
si, space = problem.information, problem.space
a, b, middle = (state(si, (5.0, 5.0, t)) for t in (np.pi / 2, -np.pi / 2, 0.0))
half = si.allocState()
space.interpolate(a, b, 0.5, half)
tell(yaw=half.getYaw(), there=si.checkMotion(a, b), back=si.checkMotion(b, a), through=si.isValid(half))
space.interpolate(b, a, 0.5, half)
tell(other=half.getYaw(), across=si.isValid(half))
""")
    # Whichever way OMPL turns, a motion through the post is refused.
    assert found["there"] == found["through"]
    assert found["back"] == found["across"]


@pytest.mark.slow
def test_half_a_turn_back_is_certified_both_ways_round(run_ompl: Any) -> None:
    # OMPL turns clockwise through the free side; the path that trailmark returns goes counter-clockwise, into the post.
    found = run_ompl("""
from trailmark.shapes import Disc
robot = Robot.polygon([(0.0, -0.1), (2.0, -0.1), (2.0, 0.1), (0.0, 0.1)])
ends = ((5.0, 5.0, np.pi / 2), (5.0, 5.0, -np.pi / 2))
for name, x in (("left", 4.0), ("right", 6.0), ("far", 9.0)):
    problem = SE2Problem(World("post", (0.0, 0.0, 10.0, 10.0), (Disc((x, 5.0), 0.2),), robot), query=ends)
    a, b = (state(problem.information, q) for q in ends)
    tell(**{name: [problem.information.checkMotion(a, b), problem.information.checkMotion(b, a)]})
""")
    assert found == {"left": [False, True], "right": [False, False], "far": [True, True]}


@pytest.mark.slow
def test_states_that_are_none_are_refused(run_ompl: Any) -> None:
    found = run_ompl("""
from trailmark.shapes import Rectangle
world = World("wall", (0.0, 0.0, 20.0, 10.0), (Rectangle((10.0, 5.0), 0.2, 10.0),), Robot.rectangle(1.0, 0.5))
for name, robot in (("straight", world.robot), ("curves", world.robot.steered(1.0)),
                    ("forwards", world.robot.steered(1.0, False))):
    problem = SE2Problem(world, robot, ((5.0, 5.0, 0.0), (15.0, 5.0, 0.0)))
    si, good = problem.information, state(problem.information, (5.0, 5.0, 0.0))
    answers = []
    for wrong in (np.nan, np.inf, -np.inf, 40.0):
        for set_it in ("setX", "setY", "setYaw"):
            odd = state(si, (15.0, 5.0, 0.0))
            getattr(odd, set_it)(float(wrong))
            answers += [si.isValid(odd), si.checkMotion(good, odd), si.checkMotion(odd, good)]
    beyond = state(si, (15.0, 5.0, 0.0))
    tell(**{name: [any(answers), si.isValid(beyond), si.checkMotion(good, beyond), si.checkMotion(good, good)]})
""")
    assert found == {name: [False, True, False, True] for name in ("straight", "curves", "forwards")}


@pytest.mark.slow
def test_nothing_is_compiled_or_built_within_the_first_check(run_ompl: Any) -> None:
    found = run_ompl("""
import trailmark
from numba.core.dispatcher import Dispatcher
def compiled():
    kernels = {id(f): f for name, module in list(sys.modules.items()) if name.startswith("trailmark")
               for f in vars(module).values() if isinstance(f, Dispatcher)}
    return sum(len(f.overloads) for f in kernels.values())
import trailmark.collision.checker as module
from trailmark.shapes import Rectangle
scene = module.FclScene
world = World("wall", (0.0, 0.0, 10.0, 10.0), (Rectangle((5.0, 5.0), 2.0, 2.0),), Robot.rectangle(1.0, 1.0))
for name, robot in (("straight", world.robot), ("curves", world.robot.steered(0.7))):
    problem = SE2Problem(world, robot, ((2.0, 5.0, 0.0), (2.5, 5.0, 0.0)))
    si, before = problem.information, compiled()
    # Building another scene would fail.
    module.FclScene = None
    a, b, touching = (state(si, q) for q in (problem.start, problem.goal, (3.5, 5.0, 0.0)))
    answers = [si.isValid(touching), si.checkMotion(a, b), si.checkMotion(a, touching), problem.validity.clearance(a)]
    module.FclScene = scene
    tell(**{name: [compiled() - before, before > 0, *answers]})
""")
    for name in ("straight", "curves"):
        assert found[name] == [0, True, True, True, True, pytest.approx(1.5)]


@pytest.mark.slow
def test_the_parts_work_in_a_set_up_of_the_users_own(run_ompl: Any) -> None:
    found = run_ompl(
        """
from trailmark import StateChecker
world = shipped("office")
space = ob.SE2StateSpace()
bounds = ob.RealVectorBounds(2)
bounds.setLow(0, 0.0); bounds.setHigh(0, 20.0); bounds.setLow(1, 0.0); bounds.setHigh(1, 12.0)
space.setBounds(bounds)
setup = og.SimpleSetup(space)
si = setup.getSpaceInformation()
checker = StateChecker(world)
validity, motions = StateValidityChecker(si, checker), MotionValidator(si, checker)
setup.setStateValidityChecker(validity)
si.setMotionValidator(motions)
query = world.query("door")
setup.setStartAndGoalStates(state(si, query.start), state(si, query.goal))
setup.setPlanner(planner_named("rrtconnect", si))
status = setup.solve(5.0)
path = states_of(setup.getSolutionPath())
tell(status=status.asString(), certified=bool(checker.motions_valid(path[:-1], path[1:]).all()), n=len(path))
""",
        whole=True,
    )
    assert found["status"] == "Exact solution"
    assert found["certified"]
    assert found["n"] >= 2
