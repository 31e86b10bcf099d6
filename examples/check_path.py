"""Anybody's path, audited: where it collides, with what and how deep; and the nearest path that does not.

python examples/check_path.py [WORLD] [PATH]
"""

import sys
from pathlib import Path

from trailmark import LandmarkPlanner, PathAuditor, StateChecker, World
from trailmark.audit.repair import repaired
from trailmark.formats.any_path import read_any_path

world = World.load(sys.argv[1] if len(sys.argv) > 1 else "worlds/office.yaml")
# JSON, CSV, rows, or a nav_msgs/Path as YAML or JSON. Here: straight from one end of a query to the other.
path = read_any_path(Path(sys.argv[2])).path if len(sys.argv) > 2 else [world.query().start, world.query().goal]

checker = StateChecker(world)
auditor = PathAuditor(checker)
audit = auditor.audit(path)
for hit in audit.collisions:
    print(f"{hit.begin:.3f} to {hit.end:.3f} m: obstacle {hit.obstacle}, {hit.depth:.3f} m deep")
print(f"free: {audit.free}, least clearance {audit.min_clearance:.6f} m, {audit.length:.2f} m long")

planner = LandmarkPlanner(world, checker.robot, seed=0)
better = repaired(auditor, audit, lambda start, goal: planner.plan(start, goal, time_limit=0.5).path)
if better is not None:
    audit = auditor.audit(better)
    print(f"repaired: free: {audit.free}, least clearance {audit.min_clearance:.6f} m, {audit.length:.2f} m long")
