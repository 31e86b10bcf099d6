"""Start trailmark's node with the parameters beside this file: ``ros2 launch planner.launch.py``.

It activates itself; under nav2's lifecycle manager give it ``autostart:=false``. With ``map:=/global_costmap/costmap``
it plans in the costmap instead of the static map. ``program:=`` is for a command that is not on the path.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration

ARGUMENTS = {
    "program": ("trailmark", "the command"),
    "params_file": (str(Path(__file__).with_name("planner_server.yaml")), "parameters of the node"),
    "namespace": ("/", "of the node, with its slash"),
    "map": ("map", "topic of the map, or of a costmap"),
    "autostart": ("true", "whether the node activates itself"),
    "use_sim_time": ("false", "whether a simulation's clock counts"),
}


def generate_launch_description() -> LaunchDescription:
    """Return what is started: a process, as trailmark is a Python package and none of ROS."""
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    node = ExecuteProcess(
        cmd=[
            *(given["program"], "ros", "--ros-args"),
            *("-r", "__node:=planner_server", "-r", ["__ns:=", given["namespace"]], "-r", ["map:=", given["map"]]),
            *("--params-file", given["params_file"]),
            *("-p", ["autostart:=", given["autostart"]], "-p", ["use_sim_time:=", given["use_sim_time"]]),
        ],
        output="screen",
    )
    declared = [
        DeclareLaunchArgument(name, default_value=v, description=about) for name, (v, about) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, node])
