"""Check anybody's path
====================

Where does a path collide, with what and how deep? And what is the nearest path that does not?

``python examples/check_path.py [WORLD] [PATH]`` takes JSON, CSV, rows, or a ``nav_msgs/Path`` as YAML or JSON.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt

from trailmark import LandmarkPlanner, PathAuditor, StateChecker, World
from trailmark.formats.any_path import read_any_path
from trailmark.plotting import draw_audit, draw_world
from trailmark.verify import repaired

# %%
# Here the path leads straight from one end of a query to the other, through whatever is in the way. Nothing is sampled:
# every stretch on which the robot collides is found, with the shortest translation that would take it out.
world = World.load(sys.argv[1] if len(sys.argv) > 1 else "office")
query = world.query()
path = read_any_path(Path(sys.argv[2])).states if len(sys.argv) > 2 else [query.start, query.pose()]

checker = StateChecker(world)
auditor = PathAuditor(checker)
audit = auditor.audit(path)
for hit in audit.collisions:
    print(f"{hit.begin:.3f} to {hit.end:.3f} m: obstacle {hit.obstacle}, {hit.depth:.3f} m deep")
print(f"free: {audit.free}, least clearance {audit.min_clearance:.6f} m, {audit.length:.2f} m long")

# %%
# The parts that collide are planned anew, the others stay.
planner = LandmarkPlanner(world, checker.robot, seed=0)
better = repaired(auditor, audit, lambda start, goal: planner.plan(start, goal, time_limit=0.5).path)
if better is not None:
    after = auditor.audit(better)
    print(f"repaired: free: {after.free}, least clearance {after.min_clearance:.6f} m, {after.length:.2f} m long")

figure, axes = plt.subplots(figsize=(8, 5))
draw_world(axes, world)
draw_audit(axes, checker.robot, audit, better)
plt.show()
