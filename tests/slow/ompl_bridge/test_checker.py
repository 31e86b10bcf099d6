"""States, paths and answers as OMPL has them: the same as directly."""

from __future__ import annotations

import math
from typing import Any

import pytest


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


def test_states_and_paths_there_and_back(run_ompl: Any) -> None:
    found = run_ompl("""
si = SE2Problem(shipped("office")).information
rng = np.random.default_rng(0)
q = rng.uniform((0, 0, -3.14), (20, 12, 3.14), (100, 3))
back = np.array([configuration(state(si, row)) for row in q])
path = states_of(path_to_ompl(si, q))
half = states_of(path_to_ompl(si, [[1.0, 1.0, np.pi / 2], [1.0, 1.0, -np.pi / 2], [2.0, 1.0, -np.pi / 2]]))
tell(half=half[:, 2].tolist())
one = state(si, q[0])
write_state(one, (1.0, 2.0, 3.0 * np.pi))
tell(states=bool((back == q).all()), path=bool((path == q).all()), wrapped=configuration(one).tolist(),
     length=path_to_ompl(si, q).length(), ours=float(sum(
        np.hypot(*(b - a)[:2]) + 0.5 * abs((b[2] - a[2] + np.pi) % (2 * np.pi) - np.pi) for a, b in zip(q, q[1:]))))
try:
    state(si, (1.0, float("nan"), 0.0))
except Exception as error:
    tell(error=type(error).__name__)
""")
    assert found["states"]
    assert found["path"]
    assert found["wrapped"][:2] == [1.0, 2.0]
    assert abs(abs(found["wrapped"][2]) - 3.141592653589793) < 1e-12
    assert abs(found["length"] - found["ours"]) < 1e-9
    assert found["error"] == "ConfigurationError"
    # Half a turn back is turned as it was certified: counter-clockwise, by way of pi.
    assert len(found["half"]) == 4
    assert abs(found["half"][1]) == pytest.approx(math.pi)


def test_planner_data_becomes_a_graph(run_ompl: Any) -> None:
    found = run_ompl(
        """
problem = SE2Problem(shipped("office"))
problem.set_planner("PRM")
for _ in range(50):  # a busy machine needs longer
    if problem.solve(0.2).asString() == "Exact solution":
        break
graph = problem.graph()
import networkx as nx
start = next(n for n, d in graph.nodes(data=True) if d["start"])
goal = next(n for n, d in graph.nodes(data=True) if d["goal"])
ends = [list(graph.nodes[n]["configuration"]) for n in (start, goal)]
lengths = [d["length"] for _, _, d in graph.edges(data=True)]
from trailmark import se2
true = [float(se2.distance(np.array(graph.nodes[a]["configuration"]), np.array(graph.nodes[b]["configuration"])))
        for a, b in graph.edges]
tell(ends=ends, wanted=[problem.start.tolist(), problem.goal.tolist()], joined=nx.has_path(graph, start, goal),
     edges=len(lengths), worst=max(abs(a - b) for a, b in zip(lengths, true)))
"""
    )
    assert found["ends"] == found["wanted"]
    assert found["joined"]
    assert found["edges"] > 10
    assert found["worst"] < 1e-9
