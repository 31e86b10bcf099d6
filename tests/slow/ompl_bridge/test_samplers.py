"""Landmark samplers in OMPL 2.0: who draws from them, what they return, bad input, errors, nothing kept alive."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.helpers.oracles import Oracle, motion_states

from trailmark.world import World
from trailmark.world.library import find_world

DRAWING = ("BKPIECE1", "PRM", "PRMstar")


@pytest.fixture(scope="module")
def oracle() -> Oracle:
    world = World.load(find_world("narrow"))
    assert world.robot is not None
    return Oracle(world, world.robot)


def test_sampled_states_are_valid_and_near_where_they_should_be(run_ompl: Any, oracle: Oracle) -> None:
    found = run_ompl("""
problem = SE2Problem(shipped("narrow"), query="second")
plugged = plug_landmark_sampler(problem.setup, seed=1)
sampler = problem.information.allocValidStateSampler()
s, near = state(problem.information, [0, 0, 0]), state(problem.information, [11.75, 5.1, 0.5])
drawn = [configuration(s).tolist() for _ in range(500) if sampler.sample(s)]
close = [configuration(s).tolist() for _ in range(500) if sampler.sampleNear(s, near, 1.5)]
tell(name=sampler.getName(), drawn=drawn, close=close, counted=sum(stream.drawn for stream in plugged.streams))
""")
    drawn, close = np.array(found["drawn"]), np.array(found["close"])
    assert found["name"] == "landmark"
    assert len(drawn) > 496
    assert not oracle.collides(drawn).any()
    assert found["counted"] >= len(drawn) + len(close)
    # In a slit hardly wider than the robot most tries fail, but not all.
    assert 25 < len(close) <= 500
    assert not oracle.collides(close).any()
    assert np.abs(close[:, :2] - (11.75, 5.1)).max() <= 1.5
    assert np.abs(close[:, 2] - 0.5).max() <= 3.0


def test_exactly_the_planners_named_draw_from_the_landmarks(run_ompl: Any) -> None:
    found = run_ompl("""
problem = SE2Problem(shipped("narrow"), query="second")
drawn = {}
for name in planner_names():
    plugged = plug_landmark_sampler(problem.setup, seed=1)
    problem.set_planner(name)
    problem.solve(0.05)
    problem.setup.clear()
    drawn[name] = sum(stream.drawn for stream in plugged.streams)
tell(drawn=drawn, valid=plugged.valid_states, cannot=dict(plugged.cannot), text=str(plugged))
""")
    drawing = tuple(name for name, count in found["drawn"].items() if count > 0)
    assert drawing == tuple(found["valid"]) == DRAWING
    assert sorted([*found["cannot"], *drawing]) == sorted(found["drawn"])
    assert "RRTConnect" in found["cannot"]
    assert "no StateSpace.setStateSamplerAllocator" in found["cannot"]["RRTConnect"]
    assert "informed sampler of OMPL's own" in found["cannot"]["InformedRRTstar"]
    first, *others = found["text"].splitlines()
    assert first == "valid states from landmarks: BKPIECE1, PRM, PRMstar"
    assert len(others) == 2
    assert all(line.startswith("not ") for line in others)


@pytest.mark.parametrize("planner", ["PRM", "PRMstar"])
def test_prm_finds_through_the_slit_what_it_misses_alone(run_ompl: Any, planner: str, oracle: Oracle) -> None:
    found = run_ompl(f"""
query = shipped("narrow").query("second")
problem = SE2Problem(shipped("narrow"), query="second")
plugged = plug_landmark_sampler(problem.setup, seed=1)
problem.set_planner({planner!r})
problem.solve(0.5)
tell(states=problem.path.states.tolist())
""")
    states = np.array(found["states"])
    assert states[0] == pytest.approx([8.2, 8.6, 0.0])
    assert states[-1] == pytest.approx([15.6, 4.6, 0.0])
    assert not oracle.collides(motion_states(states[:-1], states[1:], 200).reshape(-1, 3)).any()


def test_the_same_seed_draws_the_same_states_and_nothing_is_kept_alive(run_ompl: Any) -> None:
    found = run_ompl("""
import weakref
world = shipped("narrow")
checker = SE2Problem(world, query="second").checker
kept = []
def drawn(seed):
    problem = SE2Problem(world, query="second", checker=checker)
    plugged = plug_landmark_sampler(problem.setup, seed=seed)
    sampler = problem.information.allocValidStateSampler()
    s = state(problem.information, [0, 0, 0])
    states = [configuration(s).tolist() for _ in range(1500) if sampler.sample(s)]
    problem.set_planner("PRM")
    problem.solve(0.02)
    kept.extend([weakref.ref(plugged), weakref.ref(plugged.source), weakref.ref(problem.validity)])
    return states
tell(same=drawn(1) == drawn(1), other=drawn(1) == drawn(2))
gc.collect()
tell(alive=sum(ref() is not None for ref in kept), of=len(kept))
""")
    assert found == {"same": True, "other": False, "alive": 0, "of": 12}


@pytest.mark.parametrize("planner", ["PRM", "BKPIECE1"])
def test_an_error_in_the_sampler_ends_the_planning_and_is_raised(run_ompl: Any, planner: str) -> None:
    found = run_ompl(f"""
problem = SE2Problem(shipped("narrow"), query="second")
plugged = plug_landmark_sampler(problem.setup, seed=1)
class Odd(Exception):
    pass
def broken(i):
    raise Odd("no round")
plugged.source.round = broken
problem.set_planner({planner!r})
try:
    problem.solve(3600.0)
except Odd as error:
    tell(raised=str(error))
""")
    assert found["raised"] == "no round"
