"""Two processes that send each other the interfaces of nav2: `python exchange.py server` and `… client`."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from typing import Any

import rclpy
from bond.msg import Status
from geometry_msgs.msg import PoseStamped, TransformStamped
from map_msgs.msg import OccupancyGridUpdate
from nav2_msgs.action import ComputePathThroughPoses, ComputePathToPose
from nav2_msgs.srv import IsPathValid
from rclpy.action import ActionClient, ActionServer
from rclpy.executors import ExternalShutdownException
from tf2_msgs.msg import TFMessage

MESSAGES = [
    Status(id="nav", instance_id="7", active=True, heartbeat_timeout=4.0, heartbeat_period=0.5),
    OccupancyGridUpdate(x=-1, y=2, width=2, height=2, data=[-1, 0, 100, 7]),
    TFMessage(transforms=[TransformStamped(child_frame_id="base_link")]),
]


def server(node: Any) -> None:
    def to_pose(handle: Any) -> Any:
        result = ComputePathToPose.Result()
        result.path.poses = [handle.request.start, handle.request.goal]
        result.planning_time.sec = 3
        if hasattr(result, "error_code"):  # Humble's has none
            result.error_code, result.error_msg = result.GOAL_OCCUPIED, handle.request.planner_id
        handle.succeed()
        return result

    def through_poses(handle: Any) -> Any:
        result = ComputePathThroughPoses.Result()
        result.path.poses = goals_of(handle.request)
        handle.succeed()
        return result

    def valid(request: Any, response: Any) -> Any:
        response.is_valid = getattr(request, "max_cost", 254) == 254
        response.invalid_pose_indices = [0, len(request.path.poses)]
        return response

    ActionServer(node, ComputePathToPose, "to_pose", to_pose)
    ActionServer(node, ComputePathThroughPoses, "through_poses", through_poses)
    node.create_service(IsPathValid, "valid", valid)
    for message in MESSAGES:
        kind, name = type(message), type(message).__name__.lower()
        node.create_subscription(kind, name, node.create_publisher(kind, f"{name}_back", 10).publish, 10)
    with suppress(ExternalShutdownException):
        rclpy.spin(node)


def client(node: Any) -> None:
    poses = [PoseStamped() for _ in range(3)]
    for x, pose in enumerate(poses):
        pose.header.frame_id, pose.pose.position.x = "map", float(x)
    goal = ComputePathToPose.Goal(start=poses[0], goal=poses[1], planner_id="p")
    result = done(node, ComputePathToPose, "to_pose", goal)
    assert result.path.poses == poses[:2]
    assert result.planning_time.sec == 3
    assert [getattr(result, "error_code", 206), getattr(result, "error_msg", "p")] == [206, "p"]
    goal = ComputePathThroughPoses.Goal()
    goals_of(goal).extend(poses)
    assert done(node, ComputePathThroughPoses, "through_poses", goal).path.poses == poses
    service = node.create_client(IsPathValid, "valid")
    assert service.wait_for_service(10.0)
    request = IsPathValid.Request()
    request.path.poses = poses
    response = waited(node, service.call_async(request))
    assert response.is_valid
    assert list(response.invalid_pose_indices) == [0, 3]
    for message in MESSAGES:
        got: list[Any] = []
        kind, name = type(message), type(message).__name__.lower()
        node.create_subscription(kind, f"{name}_back", got.append, 10)
        publisher = node.create_publisher(kind, name, 10)
        end = time.monotonic() + 10.0
        while not got and time.monotonic() < end:
            publisher.publish(message)
            rclpy.spin_once(node, timeout_sec=0.1)
        assert got[0] == message


def goals_of(goal: Any) -> Any:
    return getattr(goal.goals, "goals", goal.goals)  # a message of its own since Kilted


def done(node: Any, action: Any, name: str, goal: Any) -> Any:
    caller = ActionClient(node, action, name)
    assert caller.wait_for_server(10.0)
    return waited(node, waited(node, caller.send_goal_async(goal)).get_result_async()).result


def waited(node: Any, future: Any) -> Any:
    rclpy.spin_until_future_complete(node, future, timeout_sec=10.0)
    assert future.done()
    return future.result()


if __name__ == "__main__":
    rclpy.init()
    {"server": server, "client": client}[sys.argv[1]](rclpy.create_node(sys.argv[1]))
