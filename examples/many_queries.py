"""Answer many queries on one roadmap
==================================

One roadmap over all free space, kept from query to query: a path in a fraction of a millisecond, by several threads.
"""

import matplotlib.pyplot as plt
import numpy as np

from trailmark import LandmarkPlanner, World
from trailmark.landmarks import free_samples

# %%
# Two hundred pairs of configurations that are free of collision.
warehouse = World.load("warehouse")
planner = LandmarkPlanner(warehouse, seed=0)
q = free_samples(planner.checker, 400, random_state=0)
starts, goals = q[::2], q[1::2]

# %%
# The roadmap is built with the first batch, and as dense as the world asks for.
results = list(planner.plan_many(starts, goals, workers=2))
milliseconds = [1e3 * (result.time["first_solution"] or 0.0) for result in results]
print(sum(result.status == "solved" for result in results), "of", len(results), "solved")
print(f"first path after {np.median(milliseconds):.2f} ms in the median")
print(planner.roadmap)

# %%
axes = results[0].plot(roadmap=planner.roadmap)
for result in results[1:20]:
    if result.path is not None:
        axes.plot(*result.path.states[:, :2].T, lw=0.8, alpha=0.6)
plt.show()
