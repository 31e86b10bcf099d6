"""Say what a path costs and where it may end
==========================================

Short, quick or far from the shelves; a goal that is a region, one with tolerances, and the cheapest of several.
"""

import matplotlib.pyplot as plt
import numpy as np

from trailmark import Goal, KeepOutZone, LandmarkPlanner, Objective, Polygon, Rectangle, Robot, SpeedZone, World

# %%
# An aisle of 1.1 m between shelves, in which nobody is to be quick, and a corner that is closed to the robot.
shelves = (Rectangle((6, 0.725), 8, 1.45), Rectangle((6, 3.275), 8, 1.45))
slow = SpeedZone(Polygon(np.array([(2, 1.4), (10, 1.4), (10, 2.6), (2, 2.6)])), limit=0.4)
closed = KeepOutZone(Polygon(np.array([(10.2, 2.8), (12, 2.8), (12, 4), (10.2, 4)])))
world = World("aisle", (0, 0, 12, 4), shelves, Robot.rectangle(0.9, 0.62), zones=(slow, closed))

# %%
# The shortest path touches what it rounds; one for clearance runs in the middle of the aisle; ``time`` counts seconds.
# No path costs less than ``lower_bound``, whatever the objective.
figure, all_axes = plt.subplots(3, 1, figsize=(8, 8), layout="constrained")
for name, axes in zip(("length", "clearance", "time"), all_axes, strict=True):
    objective = Objective.of("time", max_speed=0.8, max_turn_rate=0.5) if name == "time" else Objective.of(name)
    result = LandmarkPlanner(world, seed=0, objective=objective).plan((1, 2.4, 0), (11, 1.6, 0), time_limit=1.0)
    print(f"{name}: {result.cost:.2f}, at least {result.lower_bound:.2f}; {result.min_clearance:.3f} m clear")
    result.plot(ax=axes)
    axes.set_title(name)
plt.show()

# %%
# Of several goals the cheapest is reached, its own cost included.
goals = [
    Goal((11.0, 2.4, 1.57), position_tolerance=0.2, heading_tolerance=0.3),
    Goal(region=[(10.4, 0.5), (11.5, 0.5), (11.5, 1.2), (10.4, 1.2)], cost=1.0),
    Goal((11.5, 2.0)),  # with any heading
]
result = LandmarkPlanner(world, seed=0).plan((1, 2.4, 0), goals, time_limit=1.0)
assert result.goal is not None
print(f"goal {result.goal.index} at {result.goal.pose}")
