"""Plan on a nav2 map
==================

A map of ROS and nav2 (a YAML file and its image), nav2's footprint, and the path as a message for ``ros2 topic pub``.

``python examples/nav2_map.py [MAP.yaml]`` takes a map of your own.
"""

import sys
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from trailmark import LandmarkPlanner, Robot, World
from trailmark.landmarks import free_samples

# %%
# Without a map of your own, one is drawn here: white is free, black occupied, and grey has not been seen, which is
# not free either. A pixel is 5 cm.
folder = Path(mkdtemp())
pixels = np.full((160, 240), 254, dtype=np.uint8)
pixels[[0, -1], :] = pixels[:, [0, -1]] = 0
pixels[40:, 90:96] = pixels[:120, 160:166] = 0
pixels[100:, 200:] = 205
Image.fromarray(pixels).save(folder / "map.pgm")
(folder / "map.yaml").write_text(
    "image: map.pgm\nresolution: 0.05\norigin: [-6.0, -4.0, 0.0]\n"
    "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)
world = World.load(sys.argv[1] if len(sys.argv) > 1 else folder / "map.yaml")
print(world.bounds, len(world.obstacles), "obstacles: what is occupied, and what has not been seen")

# %%
# The footprint as nav2's parameters have it; ``Robot.load`` reads it from their file.
robot = Robot.parse("[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]")
planner = LandmarkPlanner(world, robot, seed=0)
start, goal = (-5.0, -3.0, 0.0), (5.0, -0.5, 1.57)
if len(sys.argv) > 1:
    start, goal = free_samples(planner.checker, 2, random_state=0)
result = planner.plan(start, goal, time_limit=1.0)
print(result.status, result.path)

# %%
result.plot()
plt.show()

# %%
# ``ros2 topic pub --once /plan nav_msgs/msg/Path "$(cat path.yaml)"`` publishes it.
if result.path is not None:
    result.path.save(folder / "path.yaml")
    print((folder / "path.yaml").read_text()[:200], "...")
