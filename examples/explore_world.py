"""A robot of your own explores: a class with two methods, and a rule of your own for where to drive next.

python examples/explore_world.py [WORLD] [SECONDS] [FOLDER]
"""

import sys
from collections.abc import Sequence

import numpy as np

from trailmark import Robot, World
from trailmark.estimation.logs.records import Record
from trailmark.exploration import DriveReport, ExplorationSettings, Explorer, Outlook, SimulatedRobot, save_exploration
from trailmark.exploration.simulated_robot import laser_scanner
from trailmark.plotting import save_exploration_page
from trailmark.se2 import FloatArray

SENSOR = laser_scanner(5.0, 0.05)


class MyRobot:
    """Where a ROS node would publish velocities and collect what its laser and its wheels say, a simulator stands."""

    def __init__(self, world: World, body: Robot) -> None:
        self.robot = SimulatedRobot(world, body, world.query().start, SENSOR, seed=1)

    def sense(self) -> Sequence[Record]:
        """Return odometry and scans since the last call."""
        return self.robot.sense()

    def drive(self, states: FloatArray, seconds: float) -> DriveReport:
        """Drive along a path in the robot's own frame for a while."""
        return self.robot.drive(states, seconds)


def most_for_its_way(outlook: Outlook) -> int:
    """Return the landmark that shows most for the square of its way: impatient, and easy to change."""
    return int(np.argmax(outlook.areas / (1.0 + outlook.costs) ** 2))


world = World.load(sys.argv[1] if len(sys.argv) > 1 else "worlds/office.yaml")
body = world.robot or Robot.disc(0.2)
settings = ExplorationSettings(time_limit=float(sys.argv[2]) if len(sys.argv) > 2 else np.inf)
explorer = Explorer(
    MyRobot(world, body),
    body,
    SENSOR,
    strategy=most_for_its_way,
    start=world.query().start,
    bounds=world.bounds,
    settings=settings,
)
landmarks = 0
while explorer.ended is None:
    state = explorer.step()
    if state.landmarks > landmarks:
        landmarks = state.landmarks
        print(f"{state.time:6.1f} s: {state.area:6.1f} m² known, {state.distance:6.1f} m driven, landmark {landmarks}")
result = explorer.result()
print(f"{result.status}: {result.reason}")
if len(sys.argv) > 3:
    save_exploration(result, sys.argv[3])
    save_exploration_page(f"{sys.argv[3]}/exploration.html", result)
    print(f"{sys.argv[3]}: written")
