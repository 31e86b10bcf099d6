"""Landmarks for OMPL's PRM
========================

PRM with its own sampler and with one that draws around landmarks, in turn, over the same time: one line more.

``python examples/ompl_landmark_sampler.py [WORLD] [QUERY]``
"""

import sys

import matplotlib.pyplot as plt

from trailmark import World
from trailmark.ompl_bridge import SE2Problem, plug_landmark_sampler
from trailmark.plotting import draw_world

world = World.load(sys.argv[1] if len(sys.argv) > 1 else "narrow")
query = sys.argv[2] if len(sys.argv) > 2 else None

# %%
# A narrow passage is where uniform samples are few and landmarks are not.
figure, all_axes = plt.subplots(1, 2, figsize=(10, 5), layout="constrained")
for landmarks, axes in zip((False, True), all_axes, strict=True):
    problem = SE2Problem(world, query=query)
    if landmarks:
        print(plug_landmark_sampler(problem.setup, seed=0))  # trailmark: the landmarks, and what draws from them
    problem.set_planner("PRM")
    status = problem.solve(1.0)
    words = "with landmarks" if landmarks else "its own sampler"
    cost = "no path" if problem.path is None else f"{problem.path.cost:.2f} m"
    print(f"PRM, {words}: {status.asString()}, {cost}, {problem.graph()}")
    draw_world(axes, world)
    if problem.path is not None:
        axes.plot(*problem.path.states[:, :2].T)
    axes.set_title(f"PRM, {words}: {cost}")
plt.show()
