"""An OMPL program of one's own that gets trailmark's collision checks: two lines, marked below.

python examples/ompl_checker.py [WORLD] [PLANNER]
"""

import sys

from ompl import base as ob
from ompl import geometric as og

from trailmark import StateChecker, World
from trailmark.ompl_bridge import MotionValidator, StateValidityChecker, planner_named, solve, state

world = World.load(sys.argv[1] if len(sys.argv) > 1 else "worlds/office.yaml")
query = world.query()

space = ob.SE2StateSpace()
bounds = ob.RealVectorBounds(2)
for axis in (0, 1):
    bounds.setLow(axis, world.bounds[axis])
    bounds.setHigh(axis, world.bounds[axis + 2])
space.setBounds(bounds)
setup = og.SimpleSetup(space)
information = setup.getSpaceInformation()

checker = StateChecker(world)
setup.setStateValidityChecker(StateValidityChecker(information, checker))  # trailmark: states
information.setMotionValidator(MotionValidator(information, checker))  # trailmark: motions, certified

setup.setStartAndGoalStates(state(information, query.start), state(information, query.goal))
setup.setPlanner(planner_named(sys.argv[2] if len(sys.argv) > 2 else "RRTConnect", information))

# As setup.solve(2.0), but Ctrl-C and errors in callbacks end the planning and are raised here.
status = solve(setup, 2.0)
print(status.asString())
if setup.haveExactSolutionPath():
    print(f"{setup.getSolutionPath().length():.2f} m in {setup.getSolutionPath().getStateCount()} states")
