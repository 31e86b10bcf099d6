"""The node in a process of its own, what speaks with it as nav2, RViz and sensors do, and a judge of paths."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from copy import deepcopy
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from tests.slow.ros.interfaces import environment, why_not

if reason := why_not():
    pytest.skip(reason, allow_module_level=True)
SETTINGS = environment()
os.environ.update({name: value for name, value in SETTINGS.items() if name != "PYTHONPATH"})
sys.path[:0] = SETTINGS["PYTHONPATH"].split(os.pathsep)

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # lark, which rclpy imports, is of an older Python
    import rosidl_generator_py  # noqa: F401

import rclpy  # noqa: E402  # after the environment that it looks at
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402
from lifecycle_msgs.srv import ChangeState, GetState  # noqa: E402
from nav2_msgs.action import ComputePathThroughPoses, ComputePathToPose  # noqa: E402
from nav_msgs.msg import OccupancyGrid  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from rclpy.action import ActionClient  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
KEEP = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
PATIENCE = 60.0
"""Seconds after which a test gives up waiting: many, as what is waited for never takes so long."""

CORNERS = np.array([[-0.3, -0.2], [0.3, -0.2], [0.3, 0.2], [-0.3, 0.2]])
SQUARE = str(CORNERS.tolist())
LONG = "[[-1.2, -0.2], [1.2, -0.2], [1.2, 0.2], [-1.2, 0.2]]"
"""A robot as wide as the gap of `slit`: in contact on both sides no way is certified, and none is proven away."""
FROM, TO = (4.0, 1.6, 0.0), (4.0, 10.4, 0.0)
NUMBERS = count()


def name_space() -> str:
    """One of its own for each node, so that nodes do not meet."""
    return f"/trailmark_{os.getpid()}_{next(NUMBERS)}"


class Running:
    """A node's process."""

    def __init__(self, space: str, parameters: dict[str, object], log: Path, arguments: Sequence[str]) -> None:
        self.log = log
        values = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
        words = ["--ros-args", "-r", f"__ns:={space}", *values, *arguments]
        environ = os.environ | SETTINGS | {"ROS_LOG_DIR": str(log.parent)}
        with log.open("ab") as out:
            command = [sys.executable, "-m", "trailmark.ros", *words]
            self.process = subprocess.Popen(command, env=environ, stdout=out, stderr=out)

    def memory(self) -> float:
        """Return what it holds in main memory, MB."""
        words = Path(f"/proc/{self.process.pid}/status").read_text().split()
        return float(words[words.index("VmRSS:") + 1]) / 1024.0

    def end(self, sign: int = signal.SIGINT) -> int:
        """Return the status with which it ends after a signal."""
        self.process.send_signal(sign)
        return self.process.wait(PATIENCE)

    def said(self) -> str:
        return self.log.read_text()


@contextmanager
def running(space: str, *arguments: str, **parameters: object) -> Iterator[Running]:
    """Start a node, and leave no process behind."""
    with tempfile.TemporaryDirectory() as folder:
        node = Running(space, parameters, Path(folder, "log"), arguments)
        try:
            yield node
        finally:
            node.process.kill()
            node.process.wait()


class Client:
    """What is beside the node on a robot; it waits for answers by spinning."""

    process: Running

    def __init__(self, space: str) -> None:
        if not rclpy.ok():
            rclpy.init()
        self.node = rclpy.create_node("client", namespace=space)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.publisher = cache(self._publisher)
        self.caller = cache(self._caller)
        self.diagnostics = self.hear(DiagnosticArray, "/diagnostics")
        self.shown: Any = None
        self.changed = True

    def _publisher(self, kind: Any, name: str) -> Any:
        made = self.node.create_publisher(kind, name, LATCHED if name == "map" else KEEP)
        self.until(lambda: made.get_subscription_count() > 0)
        return made

    def _caller(self, kind: Any, name: str) -> Any:
        if hasattr(kind, "Goal"):
            made = ActionClient(self.node, kind, name)
            self.until(made.server_is_ready)
        else:
            made = self.node.create_client(kind, name)
            self.until(made.service_is_ready)
        return made

    def hear(self, kind: Any, name: str, qos: Any = KEEP) -> list[Any]:
        """Return the list to which messages come from now on."""
        heard: list[Any] = []
        self.node.create_subscription(kind, name, heard.append, qos)
        return heard

    def until(self, condition: Callable[[], object], seconds: float = PATIENCE) -> None:
        """Wait until something is so, or fail."""
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, "it took too long"
            self.executor.spin_once(timeout_sec=0.02)

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self.executor.spin_once(timeout_sec=left)

    def wait(self, future: Any) -> Any:
        self.until(future.done)
        return future.result()

    def call(self, kind: Any, name: str, **fields: Any) -> Any:
        """Return a service's answer; it is asked twice if need be, as answers may get lost on a busy machine."""
        caller = self.caller(kind, name)
        future, asked = caller.call_async(kind.Request(**fields)), time.monotonic()
        while not future.done() and time.monotonic() < asked + 0.3 * PATIENCE:
            self.executor.spin_once(timeout_sec=0.02)
        if not future.done():
            future = caller.call_async(kind.Request(**fields))
        return self.wait(future)

    def now(self) -> Any:
        return self.node.get_clock().now().to_msg()

    # What the node offers

    def send(self, goal: Any, start: Any = None, kind: Any = ComputePathToPose) -> Any:
        """Send a goal; return the future of its handle."""
        request = kind.Goal(use_start=start is not None)
        if start is not None:
            request.start = stamped(start)
        if kind is ComputePathThroughPoses:
            request.goals.goals = [stamped(one) for one in goal]
        else:
            request.goal = stamped(goal)
        name = "compute_path_to_pose" if kind is ComputePathToPose else "compute_path_through_poses"
        return self.caller(kind, name).send_goal_async(request)

    def goal(self, *goal: Any) -> Any:
        """Return the handle of an accepted (or refused) goal."""
        return self.wait(self.send(*goal))

    def result(self, handle: Any) -> Any:
        return self.wait(handle.get_result_async()).result

    def plan(self, start: Any, goal: Any, kind: Any = ComputePathToPose, seconds: float | None = None) -> Any:
        """Return an action's result; None if its goal is refused, or not taken in some seconds."""
        future = self.send(goal, start, kind)
        end = time.monotonic() + (seconds or PATIENCE)
        self.until(lambda: future.done() or (seconds and time.monotonic() > end))
        return self.result(future.result()) if future.done() and future.result().accepted else None

    def set(self, **values: object) -> list[str]:
        """Set parameters one by one; return the reasons for which some are refused."""
        parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        self.changed = True
        answer = self.call(SetParameters, "planner_server/set_parameters", parameters=parameters)
        return [result.reason for result in answer.results if not result.successful]

    def change(self, transition: int) -> bool:
        """Ask for a lifecycle transition; return whether it was made."""
        request = ChangeState.Request()
        request.transition.id = transition
        call = self.caller(ChangeState, "planner_server/change_state").call_async(request)
        return bool(self.wait(call).success)

    def state(self) -> str:
        return str(self.call(GetState, "planner_server/get_state").current_state.label)

    def publish(self, name: str, message: Any) -> None:
        self.publisher(message.__class__, name).publish(message)

    def show(self, occupied: NDArray[Any], resolution: float = 0.1, origin: Any = (0.0, 0.0, 0.0)) -> None:
        """Publish a map, and wait until the node plans in it."""
        message = grid(occupied, resolution, origin)
        if message != self.shown:
            self.shown = deepcopy(message)
            message.header.stamp = self.now()
            self.publish("map", message)
            self.until(lambda: self.map_stamp() == f"{message.header.stamp.sec}.{message.header.stamp.nanosec:09d}")

    def map_stamp(self) -> str:
        """Return the stamp of the map that the node plans in."""
        self.diagnostics.clear()
        self.plan((1e6, 0.0, 0.0), (0.0, 0.0, 0.0))
        self.until(lambda: self.diagnostics)
        return facts(self.diagnostics[-1])["map stamp"]

    def close(self) -> None:
        self.node.destroy_node()
        self.executor.shutdown()


def facts(message: DiagnosticArray) -> dict[str, str]:
    return {pair.key: pair.value for pair in message.status[0].values}


def stamped(pose: Any, frame: str = "map") -> PoseStamped:
    """Return a pose of x, y and heading; messages stay as they are."""
    if isinstance(pose, PoseStamped):
        return pose
    x, y, theta = pose
    message = PoseStamped()
    message.header.frame_id = frame
    message.pose.position.x, message.pose.position.y = float(x), float(y)
    message.pose.orientation.z, message.pose.orientation.w = float(np.sin(theta / 2)), float(np.cos(theta / 2))
    return message


def grid(occupied: NDArray[Any], resolution: float = 0.1, origin: Any = (0.0, 0.0, 0.0)) -> OccupancyGrid:
    """Return a map of truths, or of values from -1 to 100."""
    values = occupied * np.int8(100) if occupied.dtype == np.bool_ else occupied.astype(np.int8)
    message = OccupancyGrid()
    message.header.frame_id = "map"
    message.info.height, message.info.width = occupied.shape
    message.info.resolution = resolution
    message.info.origin = stamped(origin).pose
    message.data.frombytes(values.tobytes())
    return message


def room() -> NDArray[np.bool_]:
    """Return a map of 20 x 12 m: two rooms with two doors, cells of 0.1 m."""
    cells = np.zeros((120, 200), np.bool_)
    cells[[0, -1]] = cells[:, [0, -1]] = True
    cells[:, 98:102] = True
    cells[18:34, 98:102] = cells[90:100, 98:102] = False
    return cells


def slit() -> NDArray[np.bool_]:
    cells = np.zeros((120, 200), np.bool_)
    cells[58:62] = True
    cells[58:62, 98:102] = False
    return cells


def states(path: Any) -> NDArray[np.float64]:
    """Return x, y and heading of a path's poses, shape (n, 3)."""
    found = [(p.pose.position, p.pose.orientation) for p in path.poses]
    return np.array([(at.x, at.y, 2.0 * np.arctan2(q.z, q.w)) for at, q in found]).reshape(-1, 3)


def turned(angle: Any) -> Any:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def filled(path: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return poses along the straight motions between those of a path."""
    away = np.diff(path, axis=0)
    away[:, 2] = turned(away[:, 2])
    pieces = [path[:1]]
    for here, move in zip(path[:-1], away, strict=True):
        n = 1 + int((np.hypot(*move[:2]) + 0.5 * abs(move[2])) / step)
        pieces.append(here + np.linspace(0.0, 1.0, n + 1)[1:, None] * move)
    return np.vstack(pieces)


def collides(
    path: Any, cells: NDArray[np.bool_], footprint: Any, resolution: float = 0.1, origin: Any = (0.0, 0.0, 0.0)
) -> bool:
    """Return whether a footprint (corners, or a disc's radius) meets an occupied cell or leaves the map, by shapely."""
    x, y, yaw = origin
    poses = path if isinstance(path, np.ndarray) else states(path)
    if isinstance(footprint, float):
        footprint = shapely.Point(0, 0).buffer(footprint - 1e-6, 32).exterior.coords[:-1]
    corners = np.asarray(footprint, float)
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    around = np.stack([cos * corners[:, 0] - sin * corners[:, 1], sin * corners[:, 0] + cos * corners[:, 1]], 2)
    around += poses[:, None, :2] - [x, y]
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    bodies = shapely.polygons(around @ turn / resolution)
    rows, columns = cells.shape
    low, high = np.floor(shapely.total_bounds(bodies)).reshape(2, 2)
    if low.min() < -1 or high[0] > columns or high[1] > rows:
        return True
    (left, bottom), (right, top) = np.maximum(low, 0).astype(int), high.astype(int) + 1
    row, column = np.nonzero(cells[bottom:top, left:right])
    boxes = shapely.box(column + left, row + bottom, column + left + 1, row + bottom + 1)
    outside = shapely.box(0, 0, columns, rows)
    body, box = shapely.STRtree(boxes).query(bodies, predicate="intersects")
    deep = shapely.area(shapely.intersection(bodies[body], boxes[box]))
    return bool(np.any(deep > 1e-6) or np.any(shapely.area(shapely.difference(bodies, outside)) > 1e-6))
