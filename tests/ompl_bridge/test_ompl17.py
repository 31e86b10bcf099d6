"""The bridge on OMPL 1.7, whose bindings are others: in an interpreter of its own, named by TRAILMARK_OMPL17_PYTHON.

Its programs leave by ``os._exit``: OMPL 1.7 may crash while the interpreter exits.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.helpers.oracle import Oracle, motion_states

from trailmark.library import find_world
from trailmark.world import World

PYTHON = os.environ.get("TRAILMARK_OMPL17_PYTHON")

pytestmark = pytest.mark.skipif(not PYTHON, reason="OMPL 1.7 not found: set TRAILMARK_OMPL17_PYTHON to its interpreter")

Run17 = Callable[[str], Any]

ROADMAPS = ("BKPIECE1", "EST", "PRM", "PRMstar", "SBL")
TREES = ("FMT", "KPIECE1", "LazyPRM", "RRT", "RRTConnect", "RRTstar", "TRRT")
NEITHER = ("BITstar", "InformedRRTstar", "SORRTstar")
THROUGH = ("RRTstar", "RRTConnect", "PRM")
"""Those that have to get through the slit."""


@pytest.fixture(scope="module")
def run(run_ompl: Any) -> Run17:
    return lambda program: run_ompl(program + "\nos._exit(0)\n", python=PYTHON)


@pytest.fixture(scope="module")
def oracle() -> Oracle:
    world = World.load(find_world("narrow"))
    assert world.robot is not None
    return Oracle(world, world.robot)


@pytest.fixture(scope="module")
def drawn(run_ompl: Any) -> Any:
    """What each planner draws in 0.3 s from the landmarks, and the path that it found, if any.

    Those that have to find one get more time where a busy machine needs it.
    """
    program = f"""
problem = SE2Problem(shipped("narrow"), query="second")
for name in {ROADMAPS + TREES + NEITHER}:
    plugged = plug_landmark_sampler(problem.setup, seed=1)
    problem.set_planner(name)
    problem.solve(0.3)
    while problem.path is None and name in {THROUGH} and plugged.handed["landmark"] < 20_000:
        problem.solve(0.3)
    path = problem.path
    tell(**{{name: dict(handed=plugged.handed, states=None if path is None else path.states.tolist())}})
    problem.setup.clear()
tell(valid=plugged.valid_states, states=plugged.states, cannot=dict(plugged.cannot), text=str(plugged))
os._exit(0)
"""
    return run_ompl(program, python=PYTHON)


def test_it_is_ompl_17(run: Run17) -> None:
    assert run("""
from importlib.metadata import version
tell(version=version("ompl"), scoped=not hasattr(ob, "SE2StateType"))
""") == {"version": "1.7.0", "scoped": True}


@pytest.mark.parametrize("planner", ROADMAPS + TREES)
def test_planners_draw_from_the_landmarks(drawn: Any, planner: str, oracle: Oracle) -> None:
    handed = drawn[planner]["handed"]
    assert handed["landmark"] + handed["landmark near"] > 0
    assert planner in (drawn["valid"] if planner in ROADMAPS else drawn["states"])
    if drawn[planner]["states"] is not None:
        assert_solves(drawn[planner]["states"], oracle)


@pytest.mark.parametrize("planner", THROUGH)
def test_planners_get_through_the_slit_by_landmarks(drawn: Any, planner: str, oracle: Oracle) -> None:
    handed = drawn[planner]["handed"]
    assert handed["landmark"] / sum(handed.values()) > 0.05
    assert_solves(drawn[planner]["states"], oracle)


@pytest.mark.parametrize("planner", NEITHER)
def test_planners_with_samplers_of_their_own_are_named(drawn: Any, planner: str) -> None:
    assert sum(drawn[planner]["handed"].values()) == 0
    assert "informed sampler of OMPL's own" in drawn["cannot"][planner]
    assert any(line.startswith("not ") and planner in line for line in drawn["text"].splitlines())


def test_sampled_states_are_valid_and_near(run: Run17, oracle: Oracle) -> None:
    found = run("""
problem = SE2Problem(shipped("narrow"), query="second")
plugged = plug_landmark_sampler(problem.setup, seed=1)
valid, plain = problem.information.allocValidStateSampler(), problem.space.allocStateSampler()
s, near = state(problem.information, [0, 0, 0]), state(problem.information, [11.75, 5.1, 0.5])
def rows(draw, n=1500):
    return [configuration(s).tolist() for _ in range(n) if draw() is not False]
tell(valid=rows(lambda: valid.sample(s())), valid_near=rows(lambda: valid.sampleNear(s(), near(), 1.5)),
     plain=rows(lambda: plain.sampleUniform(s())), near=rows(lambda: plain.sampleUniformNear(s(), near(), 1.5)),
     normal=rows(lambda: plain.sampleGaussian(s(), near(), 0.3)))
""")
    q = {name: np.array(rows) for name, rows in found.items()}
    assert len(q["valid"]) == len(q["plain"]) == 1500
    assert not oracle.collides(np.vstack([q["valid"], q["valid_near"]])).any()
    assert np.abs(np.vstack([q["valid_near"], q["near"]])[:, :2] - (11.75, 5.1)).max() <= 1.5
    # Landmarks first, all valid; then uniform ones too, which need not be.
    assert 0.0 < oracle.collides(q["plain"]).mean() < 0.4
    assert q["normal"].mean(axis=0) == pytest.approx([11.75, 5.1, 0.5], abs=0.03)
    assert q["normal"].std(axis=0) == pytest.approx([0.2, 0.2, 0.1], rel=0.15)


def test_answers_through_ompl_are_those_given_directly(run: Run17) -> None:
    found = run("""
problem = SE2Problem(shipped("clutter"))
si, checker = problem.information, problem.checker
rng = np.random.default_rng(1)
q = rng.uniform((0, 0, -np.pi), (100, 100, np.pi), (3000, 3))
made = [state(si, row) for row in q]
valid = checker.valid(q)
pairs = rng.choice(np.flatnonzero(valid), (1000, 2))
direct = checker.motions_valid(q[pairs[:, 0]], q[pairs[:, 1]])
through = [si.checkMotion(made[a](), made[b]()) for a, b in pairs]
tell(states=[si.isValid(s()) for s in made] == valid.tolist(), motions=through == direct.tolist(),
     share=float(valid.mean()), certified=float(direct.mean()),
     round_trip=float(np.abs(np.array([configuration(s) for s in made]) - q).max()))
""")
    assert found["states"]
    assert found["motions"]
    assert 0.1 < found["share"] < 0.95
    assert 0.005 < found["certified"] < 0.95
    assert found["round_trip"] == 0.0


def test_paths_and_graphs_come_back(run: Run17, oracle: Oracle) -> None:
    found = run("""
problem = SE2Problem(shipped("narrow"), query="first")
problem.set_planner("rrtconnect")
status = problem.solve(5.0)
graph = problem.graph()
tell(status=status.asString(), states=problem.path.states.tolist(), cost=problem.path.cost,
     length=problem.setup.getSolutionPath().length(), nodes=len(graph), edges=graph.number_of_edges(),
     again=states_of(path_to_ompl(problem.information, problem.path)).tolist())
""")
    states = np.array(found["states"])
    assert found["status"] == "Exact solution"
    assert not oracle.collides(motion_states(states[:-1], states[1:], 200).reshape(-1, 3)).any()
    assert found["cost"] == pytest.approx(found["length"])
    assert found["again"] == found["states"]
    assert found["nodes"] > 2
    assert found["edges"] >= found["nodes"] - 2


def test_a_refused_motion_tells_how_far_it_is_certified(run: Run17) -> None:
    found = run("""
from types import SimpleNamespace
from trailmark.shapes import Rectangle
# A wall from x = 6 on: the disc's centre gets to x = 5.5, the rectangle turning on the spot to where its end touches.
wall = Rectangle((8.0, 5.0), 4.0, 10.0)
def last(robot, a, b, keep=True):
    problem = SE2Problem(World("wall", (0, 0, 10, 10), (wall,), robot=robot), query=([2, 5, 0], [3, 5, 0]))
    si = problem.information
    place = state(si, [0, 0, 0])
    # Python cannot make OMPL's own pair; the next test looks at those.
    pair = SimpleNamespace(first=place() if keep else None, second=-1.0)
    first, second = state(si, a), state(si, b)
    free = problem.motions.checkMotion(first(), second(), pair)
    return dict(free=free, fraction=pair.second, place=configuration(place).tolist())
disc, rectangle = Robot.disc(0.5), Robot.rectangle(2.0, 0.2)
tell(towards=last(disc, [1.5, 5, 0], [9.5, 5, 0]), without=last(disc, [1.5, 5, 0], [9.5, 5, 0], keep=False),
     along=last(disc, [1.5, 2, 0], [1.5, 8, 0]), turning=last(rectangle, [5.5, 5, 1.5], [5.5, 5, -1.5]),
     at_once=last(disc, [5.5, 5, 0], [9.5, 5, 0]))
""")
    towards = found["towards"]
    assert towards["free"] is False
    assert 0.5 - 0.001 / 8.0 <= towards["fraction"] <= 0.5 + 1e-7
    assert towards["place"] == pytest.approx([1.5 + 8.0 * towards["fraction"], 5.0, 0.0])
    assert found["without"]["fraction"] == towards["fraction"]
    assert found["along"]["free"] is True
    # The rectangle's corner (1, -0.1) touches x = 0.5 ahead of it at the heading where cos(t) + 0.1 sin(t) = 0.5.
    reach = np.hypot(1.0, 0.1)
    touch = np.arccos(0.5 / reach) + np.arctan2(0.1, 1.0)
    turning = found["turning"]
    assert turning["free"] is False
    assert turning["place"][2] == pytest.approx(touch, abs=0.002)
    assert turning["place"][2] == pytest.approx(1.5 - 3.0 * turning["fraction"])
    assert found["at_once"]["free"] is False
    assert found["at_once"]["fraction"] <= 1e-6


@pytest.mark.parametrize("planner", ["PDST", "KPIECE1"])
def test_planners_go_on_from_the_last_certified_place(run: Run17, planner: str) -> None:
    found = run(f"""
world = shipped("office")
problem = SE2Problem(world)
told = []
class Telling(MotionValidator):
    def checkMotion(self, a, b, last=None):
        ends = configuration(a).tolist(), configuration(b).tolist()
        free = super().checkMotion(a, b, last)
        if last is not None and not free and len(told) < 80:
            told.append([*ends, last.second, configuration(last.first).tolist()])
        return free
motions = Telling(problem.information, problem.checker)
problem.information.setMotionValidator(motions)
problem.set_planner({planner!r})
status = problem.solve(10.0)
tell(status=status.asString(), states=problem.path.states.tolist(), told=told)
""")
    world = World.load(find_world("office"))
    assert world.robot is not None
    oracle = Oracle(world, world.robot)
    states = np.array(found["states"])
    assert found["status"] == "Exact solution"
    assert not oracle.collides(motion_states(states[:-1], states[1:], 200).reshape(-1, 3)).any()
    told = found["told"]
    assert len(told) > 10
    a, b, fraction, place = (np.array([row[i] for row in told]) for i in range(4))
    assert ((fraction >= 0.0) & (fraction < 1.0)).all()
    assert (fraction > 0.01).any()
    assert place[:, :2] == pytest.approx(a[:, :2] + fraction[:, None] * (b - a)[:, :2], abs=1e-9)
    assert not oracle.collides(motion_states(a, place, 50).reshape(-1, 3)).any()
    # And no farther: three millimetres on, and what lies between two places looked at, something is hit.
    n = 401
    blocked = oracle.collides(motion_states(a, b, n).reshape(-1, 3)).reshape(len(a), n)
    first = np.where(blocked.any(axis=1), blocked.argmax(axis=1) / (n - 1), 1.0)
    turn = np.abs(np.angle(np.exp(1j * (b - a)[:, 2])))
    spare = 0.003 / (np.hypot(*(b - a)[:, :2].T) + oracle.reach * turn) + 1.0 / (n - 1)
    assert (fraction + spare >= first).mean() > 0.9


def test_sbl_solves(run: Run17) -> None:
    found = run("""
problem = SE2Problem(shipped("office"))
problem.set_planner("SBL")
status = problem.solve(10.0)
tell(status=status.asString(), certified=bool(problem.checker.motions_valid(
    problem.path.states[:-1], problem.path.states[1:]).all()))
""")
    assert found == {"status": "Exact solution", "certified": True}


@pytest.mark.parametrize("planner", ["PRM", "RRTConnect"])
def test_an_error_in_a_callback_is_raised_after_the_planning(run: Run17, planner: str) -> None:
    found = run(f"""
problem = SE2Problem(shipped("narrow"), query="second")
plugged = plug_landmark_sampler(problem.setup, seed=1)
class Odd(Exception):
    pass
def broken(i):
    raise Odd("no round")
plugged.source.round = broken
problem.set_planner({planner!r})
try:
    problem.solve(20.0)
except Odd as error:
    tell(raised=str(error))
""")
    assert found == {"raised": "no round"}


def assert_solves(states: Any, oracle: Oracle) -> None:
    """Check that a path leads from start to goal of the query and that nothing is hit along it."""
    rows = np.array(states)
    assert rows[0] == pytest.approx([8.2, 8.6, 0.0])
    assert rows[-1] == pytest.approx([15.6, 4.6, 0.0])
    assert not oracle.collides(motion_states(rows[:-1], rows[1:], 200).reshape(-1, 3)).any()
