"""From a path to a trajectory
===========================

What a controller follows: corners rounded within the free space, and the fastest time law along the way.

``python examples/smooth_trajectory.py [WORLD] [ANIMATION.gif]`` animates it as well.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

from trailmark import LandmarkPlanner, StateChecker, World
from trailmark.plotting import draw_world, save_trajectory_animation

world = World.load(sys.argv[1] if len(sys.argv) > 1 else "office")
checker = StateChecker(world)
query = world.query()
path = LandmarkPlanner(world, checker.robot, seed=0).plan(query.start, query.pose(), time_limit=0.5).path
if path is None:
    sys.exit("no path found")

# %%
# A shortest path turns at corners, where a robot has to stop. Rounded, it is certified as the path is.
smooth = path.smooth(checker)
for name, driven in (("as planned", path), ("smooth", smooth)):
    trajectory = driven.timed(max_speed=1.0, max_acceleration=0.5, max_turn_rate=1.0, zones=world.zones)
    stops = np.count_nonzero(~trajectory.dq[1:-1].any(axis=1))
    print(f"{name}: {driven.length:.2f} m in {trajectory.duration:.1f} s, {stops} stops on the way")

# %%
# What a controller asks for: where to be at a time, and how fast.
now = 0.5 * trajectory.duration
print(f"after {now:.1f} s: at {trajectory.at(now).round(3)}, velocity {trajectory.velocity(now).round(3)}")
figure, (plan, speed) = plt.subplots(2, 1, figsize=(8, 8), height_ratios=(2, 1), layout="constrained")
draw_world(plan, world)
plan.plot(*trajectory.q[:, :2].T)
speed.plot(trajectory.t, np.hypot(*trajectory.dq[:, :2].T))
speed.set(xlabel="seconds", ylabel="metres per second")
plt.show()
if len(sys.argv) > 2:
    save_trajectory_animation(sys.argv[2], trajectory, world, checker.robot)
    print(f"{sys.argv[2]}: written")
