"""From a sensor log to a path
===========================

A robot drives among trees and sees them at noisy ranges and bearings; its log becomes a world, in which obstacles are
grown as much as a stated risk asks for, and in that world a path is planned.
"""

import matplotlib.pyplot as plt

from trailmark import LandmarkPlanner, World
from trailmark.estimation import Detector, MapSettings, RangeBearing, Unicycle, map_log, simulate
from trailmark.plotting.mapped import draw_map

# %%
# The drive, simulated: odometry with noise, and discs seen up to 12 m away.
field = World.load("discs")
query = field.query("corner")
path = LandmarkPlanner(field, seed=0).plan(query.start, query.pose(), time_limit=0.5).path
assert path is not None
motion, detector = Unicycle(0.02, 0.01, period=1.0), Detector(RangeBearing(0.05, 0.02), max_range=12.0)
log, truth = simulate(field, path.states, motion, detector=detector, random_state=0)

# %%
# EKF-SLAM makes a map of it. NIS tells whether the filter knows how wrong it is: about the number of measured values.
settings = MapSettings(radius=0.8, radius_sigma=0.1, velocity=motion, start=query.start)
mapped = map_log(log, settings, robot=field.robot, confidence=0.99)
assert mapped.slam is not None
print(len(mapped.world.obstacles), "obstacles, NIS", mapped.slam.nis())
print("at the end:", mapped.trajectory[-1, 1:].round(3), "in truth:", truth[-1, 1:].round(3))
figure, axes = plt.subplots(figsize=(7, 7))
draw_map(axes, mapped)
plt.show()

# %%
# A valid path in the mapped world meets a true obstacle with a probability of 1 percent at most.
farthest = mapped.world.query("farthest")
result = LandmarkPlanner(mapped.world, seed=0).plan(farthest.start, farthest.pose(), time_limit=0.5)
print(result)
