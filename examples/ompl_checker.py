"""trailmark's collision checks in an OMPL program
===============================================

A program of your own gets certified motions by two lines, marked below.

``python examples/ompl_checker.py [WORLD] [PLANNER]``
"""

import sys

import matplotlib.pyplot as plt
from ompl import base as ob
from ompl import geometric as og

from trailmark import StateChecker, World
from trailmark.ompl_bridge import MotionValidator, StateValidityChecker, planner_named, solve, state, states_of
from trailmark.plotting import draw_world

# %%
# The program as it is without trailmark: a space with bounds, and a setup.
world = World.load(sys.argv[1] if len(sys.argv) > 1 else "office")
query = world.query()

space = ob.SE2StateSpace()
bounds = ob.RealVectorBounds(2)
for axis in (0, 1):
    bounds.setLow(axis, world.bounds[axis])
    bounds.setHigh(axis, world.bounds[axis + 2])
space.setBounds(bounds)
setup = og.SimpleSetup(space)
information = setup.getSpaceInformation()

# %%
# A motion is accepted only if no configuration along it collides: there is no resolution to set.
checker = StateChecker(world)
setup.setStateValidityChecker(StateValidityChecker(information, checker))  # trailmark: states
information.setMotionValidator(MotionValidator(information, checker))  # trailmark: motions, certified

setup.setStartAndGoalStates(state(information, query.start), state(information, query.pose()))
setup.setPlanner(planner_named(sys.argv[2] if len(sys.argv) > 2 else "RRTConnect", information))

# %%
# As ``setup.solve(2.0)``, but Ctrl-C and errors in callbacks end the planning and are raised here.
status = solve(setup, 2.0)
print(status.asString())
if setup.haveExactSolutionPath():
    path = setup.getSolutionPath()
    print(f"{path.length():.2f} m in {path.getStateCount()} states")
    figure, axes = plt.subplots(figsize=(8, 5))
    draw_world(axes, world, checker.robot)
    axes.plot(*states_of(path)[:, :2].T, "o-")
    plt.show()
