"""``trailmark ros``: a ROS 2 node in the place of nav2's planner server."""

from __future__ import annotations

import typer

__all__ = ["ros"]


def ros(context: typer.Context) -> None:
    """Run a ROS 2 node in the place of nav2's planner server, until Ctrl-C.

    Parameters and remappings as of any node: --ros-args -p robot_radius:=0.22 -r map:=/global_costmap/costmap. Needs
    your ROS 2, or the extra 'ros2'.
    """
    from trailmark.ros import main

    main(context.args)
