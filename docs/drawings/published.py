"""The published method, before and after K-means."""

import matplotlib.pyplot as plt
import numpy as np

from trailmark import StateChecker, World
from trailmark.landmarks.executions import execute_paper
from trailmark.plotting import draw_world
from trailmark.plotting.landmarks import draw_execution, draw_initial_execution

checker = StateChecker(World.load("environment1"))
run = execute_paper(checker, 1000, 12, "forgy", np.random.default_rng([0, 0]))
figure, (before, after) = plt.subplots(1, 2, figsize=(8, 8.5), layout="constrained")
for axes, draw, more, title in (
    (before, draw_initial_execution, (), "points drawn, and those dropped"),
    (after, draw_execution, (checker.world.bounds,), "clusters and centres"),
):
    draw_world(axes, checker.world)
    draw(axes, run, *more)
    axes.set_title(title)
