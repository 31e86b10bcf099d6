"""A ROS 2 node in the place of nav2's planner server: plans for the whole footprint, certified, with a proven bound.

It takes what three releases of ROS 2 have in common (Humble, Jazzy, Kilted). rclpy comes from the user's ROS 2, or from
the extra ``ros2``; nothing else of trailmark imports it.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec

from trailmark.errors import ConfigurationError

__all__ = ["main"]

NEEDED = ("rclpy", "nav_msgs", "visualization_msgs", "diagnostic_msgs")


def main(args: Sequence[str] = ()) -> None:
    """Run the node until it is interrupted.

    Args:
        args: arguments of ROS 2, such as ``--ros-args -p robot_radius:=0.22 -r map:=/global_costmap/costmap``.

    Raises:
        ConfigurationError: there is no rclpy, or the arguments or parameters are not allowed.
    """
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise ConfigurationError(
            f"trailmark ros needs {', '.join(missing)}: source your ROS 2, for whose Python trailmark must be "
            "installed, or, with CPython 3.11 on x86-64, pip install 'trailmark[ros2]'"
        )
    from trailmark.ros.node import run

    run(list(args))
