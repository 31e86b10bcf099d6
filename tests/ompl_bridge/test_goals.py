"""OMPL's goals of more than one state, in a process of its own, which OMPL may abort or hang."""

from __future__ import annotations

import pytest
from tests.support.forks import Forks

SCRIPT = """
import numpy as np
from ompl import base as ob
from trailmark import Robot, World
from trailmark.ompl_bridge import LandmarkPlanner, SE2Problem
from trailmark.ompl_bridge.states import state

world = World("room", (0, 0, 10, 10), (), Robot.rectangle(0.6, 0.4))

def solved(goal, *threshold):
    problem = SE2Problem(world, query=((1, 1, 0), (9, 9, 1)))
    made = goal(problem.information)
    problem.setup.setGoal(made)
    problem.set_planner(LandmarkPlanner(problem.information, seed=0))
    problem.solve(2.0)
    last = problem.path.states[-1]
    assert made.isSatisfied(state(problem.information, last)), last
    return last

def states(information):
    goal = ob.GoalStates(information)
    for q in [(9, 9, 1), (4, 2, 0.5), (8, 1, 0)]:
        goal.addState(state(information, q))
    return goal

def near(information):
    goal = ob.GoalState(information)
    goal.setState(state(information, (9, 9, 1)))
    goal.setThreshold(1.0)
    return goal

class Strip(ob.GoalRegion):
    # right of x = 7

    def __init__(self, information):
        super().__init__(information)
        self.setThreshold(1e-9)

    def distanceGoal(self, found):
        return max(0.0, 7.0 - found.getX())

assert solved(Strip)[0] >= 7.0
assert np.allclose(solved(states), (4, 2, 0.5))
assert np.hypot(*(solved(near)[:2] - 9)) > 0.4
print("passed")
"""


@pytest.mark.slow
def test_the_cheapest_of_several_states_and_a_threshold(forks: Forks) -> None:
    done = forks.run(["-c", SCRIPT], timeout=240.0, whole=True)
    assert done.stdout.endswith("passed\n"), done.stderr[-2000:]
