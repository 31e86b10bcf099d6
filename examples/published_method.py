"""The published method
====================

Landmarks by K-means as the method that trailmark grew from has them: readings refined by a Kalman filter, uniform
points, those in the boxes of the readings dropped, and the centres of the rest.
"""

import matplotlib.pyplot as plt
import numpy as np

from trailmark import StateChecker, World
from trailmark.landmarks import spread_of_runs
from trailmark.landmarks.executions import execute_paper
from trailmark.planning.placement import path_over_landmarks
from trailmark.plotting import draw_plan, draw_world
from trailmark.plotting.landmarks import draw_execution, draw_initial_execution

# %%
# Three executions in a world made after the published one, of 1,000 points and 12 landmarks each. Published: 169, 165
# and 171 forbidden points.
checker = StateChecker(World.load("environment1"))
runs = [execute_paper(checker, 1000, 12, "forgy", np.random.default_rng([0, run])) for run in range(3)]
print([int(run.forbidden.sum()) for run in runs], "forbidden points,", [len(run.centres) for run in runs], "landmarks")

# %%
# K-means ends where its first centres lead it: so far are the landmarks of two runs from each other, in metres.
print(f"{spread_of_runs([run.centres for run in runs]).mean:.2f} m between the centres of two runs")

# %%
# What was drawn and dropped, the clusters, and the centres; a centre in which the robot collides is marked.
figure, (before, after) = plt.subplots(1, 2, figsize=(9, 9), layout="constrained")
draw_world(before, checker.world)
draw_initial_execution(before, runs[0])
draw_world(after, checker.world)
draw_execution(after, runs[0], checker.world.bounds)
plt.show()

# %%
# The shortest path over these landmarks and their certified edges. ``trailmark benchmark -p paper`` plans so.
query = checker.world.query()
roadmap, path = path_over_landmarks(checker, runs[0].repaired, query.start, query.pose(), seed=0)
print("the landmarks do not connect the query" if path is None else f"{path.cost:.1f} m over {len(roadmap)} nodes")
figure, axes = plt.subplots(figsize=(5, 9))
draw_world(axes, checker.world)
draw_plan(axes, checker.robot, path, roadmap, query.start, query.pose())
plt.show()
