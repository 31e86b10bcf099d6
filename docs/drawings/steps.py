"""From a world to a path, in four pictures."""

import matplotlib.pyplot as plt
import numpy as np

from trailmark import LandmarkPlanner, StateChecker, World
from trailmark.landmarks import free_samples, k_means_landmarks
from trailmark.plotting import draw_plan, draw_world

world = World.load("office")
query, checker = world.query("door"), StateChecker(world)
planner = LandmarkPlanner(world, seed=0)
result = planner.plan(query.start, query.pose(), time_limit=1.0)
samples = free_samples(checker, 1500, random_state=0)
centres = k_means_landmarks(samples, 120, radius=checker.robot.sweep_radius, random_state=0)
figure, all_axes = plt.subplots(2, 2, figsize=(10, 6.6), layout="constrained")
titles = (
    "the world, and where the middle of the robot cannot be",
    "free configurations, drawn at random",
    "centres by K-means: landmarks, with their headings",
    "the roadmap of a query, and its path",
)
for axes, title in zip(all_axes.flat, titles, strict=True):
    draw_world(axes, world, checker.robot)
    axes.set_title(title, fontsize=10)
    axes.set(xlabel="", ylabel="")
all_axes[0, 1].plot(*samples[:, :2].T, ".", ms=2, color="#0072b2")
all_axes[1, 0].quiver(*centres[:, :2].T, np.cos(centres[:, 2]), np.sin(centres[:, 2]), color="#d55e00", scale=40)
draw_plan(all_axes[1, 1], checker.robot, result.path, planner.roadmap, query.start, query.pose())
