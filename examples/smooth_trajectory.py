"""From a path to what a controller follows: corners rounded within the free space, and the fastest time law along it.

python examples/smooth_trajectory.py [WORLD] [ANIMATION.html|.gif]
"""

import sys

import numpy as np

from trailmark import LandmarkPlanner, StateChecker, World
from trailmark.plotting import save_trajectory_animation

world = World.load(sys.argv[1] if len(sys.argv) > 1 else "worlds/office.yaml")
checker = StateChecker(world)
query = world.query()
path = LandmarkPlanner(world, checker.robot, seed=0).plan(query.start, query.pose(), time_limit=0.5).path
if path is None:
    sys.exit("no path found")

smooth = path.smooth(checker)
for name, driven in (("as planned", path), ("smooth", smooth)):
    trajectory = driven.timed(max_speed=1.0, max_acceleration=0.5, max_turn_rate=1.0, zones=world.zones)
    stops = np.count_nonzero(~trajectory.dq[1:-1].any(axis=1))
    print(f"{name}: {driven.length:.2f} m in {trajectory.duration:.1f} s, {stops} stops on the way")

# What a controller asks for: where to be at a time, and how fast.
now = 0.5 * trajectory.duration
print(f"after {now:.1f} s: at {trajectory.at(now).round(3)}, velocity {trajectory.velocity(now).round(3)}")
print(f"arrays: t {trajectory.t.shape}, q {trajectory.q.shape}, dq {trajectory.dq.shape}")
if len(sys.argv) > 2:
    save_trajectory_animation(sys.argv[2], trajectory, world, checker.robot)
    print(f"{sys.argv[2]}: written")
