"""Explore with a robot of your own
================================

A class with two methods is a robot; a function is a rule for where to drive next.

``python examples/explore_world.py [WORLD] [SECONDS] [FOLDER]``: seconds of the robot's clock, ``inf`` to the end.
"""

import sys
from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np

from trailmark import Robot, World
from trailmark.estimation.records import Record
from trailmark.exploration import DriveReport, ExplorationSettings, Explorer, Outlook, SimulatedRobot, save_exploration
from trailmark.exploration.simulated_robot import laser_scanner
from trailmark.plotting import draw_exploration, save_exploration_figure
from trailmark.se2 import FloatArray

SENSOR = laser_scanner(5.0, 0.05)


# %%
# Where a ROS node would publish velocities and collect what its laser and its wheels say, a simulator stands.
class MyRobot:
    """It senses and drives."""

    def __init__(self, world: World, body: Robot) -> None:
        self.robot = SimulatedRobot(world, body, world.query().start, SENSOR, seed=1)

    def sense(self) -> Sequence[Record]:
        """Return odometry and scans since the last call."""
        return self.robot.sense()

    def drive(self, states: FloatArray, seconds: float) -> DriveReport:
        """Drive along a path in the robot's own frame for a while."""
        return self.robot.drive(states, seconds)


def most_for_its_way(outlook: Outlook) -> int:
    """Return the landmark that shows most area for the square of its way: impatient, and easy to change."""
    return int(np.argmax(outlook.areas / (1.0 + outlook.costs) ** 2))


# %%
# By default exploration ends when it is proven that nothing more can be seen; here, after some seconds.
world = World.load(sys.argv[1] if len(sys.argv) > 1 else "office")
body, start = world.robot or Robot.disc(0.2), world.query().start
limit = float(sys.argv[2]) if len(sys.argv) > 2 else 20.0
explorer = Explorer(
    MyRobot(world, body),
    body,
    SENSOR,
    strategy=most_for_its_way,
    start=start,
    bounds=world.bounds,
    settings=ExplorationSettings(time_limit=limit),
)
first = explorer.step()
result = explorer.run()
print(
    f"{first.area:.1f} m² known at first, {result.history[-1].area:.1f} m² at the end: {result.status}, {result.reason}"
)

# %%
figure, axes = plt.subplots(figsize=(8, 5))
draw_exploration(axes, result)
plt.show()
if len(sys.argv) > 3:
    save_exploration(result, sys.argv[3])
    save_exploration_figure(f"{sys.argv[3]}/exploration.png", result)
