"""Pallets are dropped in front of a driving robot; its path follows within milliseconds.

python examples/changing_warehouse.py [--pallets 8] [--seed 0] [--plot DRIVE.gif]
"""

import argparse
from time import perf_counter

import numpy as np

from trailmark import LandmarkPlanner, Rectangle, World
from trailmark.plotting import Frame, save_animation

STEP, SPEED = 0.5, 2.0
"""Seconds between two looks at the world, and metres a second."""

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--pallets", type=int, default=8, help="that are dropped on the way (default: 8)")
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--plot", metavar="FILE.gif", help="write an animation of the drive")
options = parser.parse_args()

world = World.load("worlds/warehouse.yaml")
query, rng = world.query("dock"), np.random.default_rng(options.seed)
planner = LandmarkPlanner(world, seed=options.seed)
here, goal = np.array(query.start), np.array(query.goal)
path = planner.plan(here, goal, time_limit=1.0).path
if path is None:
    raise SystemExit("no path to begin with")
print(f"the path costs {path.cost:.1f} m")

moments: list[Frame] = [Frame(world, here, path)]
dropped = moment = 0
while path is not None and path.cost > STEP * SPEED:
    here, moment, note, changed = path.at(STEP * SPEED / path.cost), moment + 1, "", world
    if moment % 4 == 0 and dropped < options.pallets:
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

if options.plot:
    save_animation(options.plot, moments, planner.robot, goal, seconds=0.15)
    print(f"{options.plot} written")
