"""A motion that is certified, stretch by stretch."""

import matplotlib.pyplot as plt
import numpy as np

from trailmark import Disc, Robot, StateChecker, World
from trailmark.plotting import draw_world
from trailmark.se2 import interpolate, motion_bound, transform

world = World("pillar", (0, 0, 8, 4), (Disc((4.0, 3.0), 0.9),), Robot.rectangle(0.9, 0.5))
checker = StateChecker(world)
a, b = np.array([0.8, 1.0, 0.0]), np.array([7.2, 1.7, 1.2])
reach = motion_bound(a, b, checker.robot.sweep_radius)
figure, axes = plt.subplots(figsize=(8, 4), layout="constrained")
draw_world(axes, world)
todo, colours = [(0.0, 1.0)], plt.cm.viridis
while todo:
    low, high = todo.pop()
    middle = 0.5 * (low + high)
    q = interpolate(a, b, np.array([middle]))[0]
    share = min(checker.clearance(q) / reach, 0.5 * (high - low))
    ends = interpolate(a, b, np.array([middle - share, middle + share]))
    axes.plot(*ends[:, :2].T, lw=4, color=colours(min(1.0, 3.0 * share)), solid_capstyle="butt")
    outline = transform(q, checker.robot.outline.vertices)
    axes.fill(*outline.T, fill=False, color=colours(min(1.0, 3.0 * share)), lw=1)
    if share < 0.5 * (high - low) and high - low > 1e-3:
        todo += [(low, middle - share), (middle + share, high)]
axes.set_title("the widest clearance first, from the middle; then what is left on both sides", fontsize=10)
