"""Make the compiled kernels of exploration ready before a clock runs."""

from __future__ import annotations

from trailmark.exploration.explorer import Explorer
from trailmark.exploration.result import ExplorationSettings
from trailmark.shapes import Disc
from trailmark.world import Robot, World

__all__ = ["warm_up_exploration"]


def warm_up_exploration() -> None:
    """Explore a room for a few seconds of the robot's clock, with either sensor and with noise."""
    obstacles = Disc((2.0, 2.0), 0.2), Disc((4.0, 2.0), 0.2)
    room = World("room", (0.0, 0.0, 6.0, 4.0), obstacles, Robot.rectangle(0.6, 0.4))
    settings = ExplorationSettings(confidence=0.9, time_limit=3.0)
    for sensor in ("laser", "detections"):
        Explorer(room, None, sensor, start=(1.0, 1.0, 0.0), sensor_range=2.0, settings=settings).run()
