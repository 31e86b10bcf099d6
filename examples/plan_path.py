"""Plan a path
===========

A world, a robot that has a shape and a heading, and a path between two configurations, certified free of collision.
"""

import matplotlib.pyplot as plt

from trailmark import LandmarkPlanner, World

# %%
# A world has bounds and obstacles and, where its file says so, a robot and queries. This one is shipped; a file's path
# does as well: trailmark's own YAML, a ROS/nav2 map, a MovingAI map, an OMPL.app problem.
office = World.load("office")
query = office.query("door")
print(office.robot.describe() if office.robot else None, query.start, query.goal)

# %%
# The first path is there within milliseconds, once the kernels are compiled; it gets better until the time limit, or
# until it is proven that none is better. ``status`` is ``solved``, ``timeout`` or, only if proven, ``infeasible``.
planner = LandmarkPlanner(office, seed=0)
result = planner.plan(query.start, query.pose(), time_limit=1.0)
assert result.path is not None
print(result.status, f"{result.path.cost:.2f} m, at least {result.lower_bound:.2f} m")
print(f"first path after {result.time['first_solution']:.3f} s, cost {result.first_cost:.2f} m")
print(result.path.states[:3])  # rows x, y, theta: metres and radians

# %%
# Results, worlds, robots and roadmaps draw themselves, on axes of your own with ``ax=``.
result.plot(roadmap=planner.roadmap)
plt.show()
