"""Replan while the world changes
==============================

Pallets are dropped in front of a driving robot; its path follows within milliseconds.

``python examples/changing_warehouse.py [PALLETS] [DRIVE.gif]``
"""

import sys
from time import perf_counter

import matplotlib.pyplot as plt
import numpy as np

from trailmark import LandmarkPlanner, Rectangle, World
from trailmark.plotting import Frame, draw_plan, draw_world, save_animation

STEP, SPEED = 0.5, 2.0  # seconds between two looks at the world, and metres a second
PALLETS = int(sys.argv[1]) if len(sys.argv) > 1 else 8
# %%
# The path to begin with.
world = World.load("warehouse")
query, planner, rng = world.query("dock"), LandmarkPlanner(world, seed=0), np.random.default_rng(0)
here, goal = np.array(query.start), np.array(query.pose())
path = planner.plan(here, goal, time_limit=1.0).path
assert path is not None
print(f"the path costs {path.cost:.1f} m")

# %%
# Twice a second: what changed is told to the planner, and the path is kept, led around or replaced.
moments: list[Frame] = [Frame(world, here, path)]
dropped = moment = 0
while path is not None and path.cost > STEP * SPEED:
    here, moment, note, changed = path.at(STEP * SPEED / path.cost), moment + 1, "", world
    if moment % 4 == 0 and dropped < PALLETS:
        # Four to ten metres ahead, about where the robot is going to be.
        ahead = path.at(min(1.0, rng.uniform(4.0, 10.0) / path.cost))
        x, y = ahead[:2] + rng.normal(0.0, 0.4, 2)
        pallet = {f"pallet-{dropped}": Rectangle((float(x), float(y)), 1.2, 0.8, float(rng.uniform(-3.1, 3.1)))}
        changed, dropped = world.edited(add=pallet), dropped + 1
    begin = perf_counter()
    update = planner.update(changed)
    result = planner.replan(here, goal, path)
    milliseconds = 1e3 * (perf_counter() - begin)
    if result.path is None:
        # It fell onto the goal or into the only way: somebody takes it away again.
        planner.update(world)
        result, changed = planner.replan(here, goal, path), world
    if update.changes:
        verdict = f"path {'kept' if result.kept else 'replaced'}: {result.reason}"
        note = f"{STEP * moment:4.1f} s: pallet {dropped} dropped, {verdict}"
        print(f"{note} ({milliseconds:.1f} ms)")
    # The robot drives on; there is time to look for a better path.
    result = planner.replan(here, goal, result.path, improvement=0.05) if result.path is not None else result
    world, path = changed, result.path
    moments.append(Frame(world, here, path, note))
print(f"arrived after {STEP * moment:.1f} s" if path is not None else "no path any more")

# %%
# The moment in the middle: the robot, its path, and the pallets that are there by then.
world, here, path, note = moments[len(moments) // 2]
figure, axes = plt.subplots(figsize=(9, 5))
draw_world(axes, world)
draw_plan(axes, planner.robot, path, None, here, goal)
axes.set_title(note)
plt.show()

if len(sys.argv) > 2:
    save_animation(sys.argv[2], moments, planner.robot, goal, seconds=0.15)
