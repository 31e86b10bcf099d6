"""PRM with its own sampler and with landmarks, in turn, over the same time: one line more, marked below.

python examples/ompl_landmark_sampler.py [WORLD] [QUERY]
"""

import sys

from trailmark import World
from trailmark.ompl_bridge import SE2Problem, plug_landmark_sampler

world = World.load(sys.argv[1] if len(sys.argv) > 1 else "worlds/narrow.yaml")
query = sys.argv[2] if len(sys.argv) > 2 else None

for landmarks in (False, True):
    problem = SE2Problem(world, query=query)
    if landmarks:
        print(plug_landmark_sampler(problem.setup, seed=0))  # trailmark: the landmarks, and what draws from them
    problem.set_planner("PRM")
    status = problem.solve(1.0)
    words = "with landmarks" if landmarks else "its own sampler"
    cost = "no path" if problem.path is None else f"{problem.path.cost:.2f} m"
    print(f"PRM, {words}: {status.asString()}, {cost}, {problem.graph()}")
