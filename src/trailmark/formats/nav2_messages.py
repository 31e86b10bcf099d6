"""Paths and trajectories as ROS 2 messages, in the YAML and JSON that ``ros2 topic pub`` takes.

Of one vertex to the next a ``nav_msgs/msg/Path`` says nothing; trailmark means a straight motion. Trajectories have the
fields of ``nav_msgs/msg/Trajectory``, which nav2 released as ``nav2_msgs/msg/Trajectory`` before. Stamps are 0, which
nav2 takes for the newest transform there is.
"""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.se2 import FloatArray

__all__ = ["message_text", "path_message", "trajectory_message"]

_NANOSECONDS = 10**9


def path_message(states: FloatArray, frame: str) -> dict[str, Any]:
    """Return ``nav_msgs/msg/Path``.

    Args:
        states: shape (n, 3), metres and radians.
        frame: the coordinate frame's name, such as ``map``.
    """
    poses = [{"header": {"frame_id": frame}, "pose": _pose(state)} for state in states.tolist()]
    return {**_header(frame), "poses": poses}


def trajectory_message(t: FloatArray, q: FloatArray, dq: FloatArray, frame: str) -> dict[str, Any]:
    """Return ``nav_msgs/msg/Trajectory``; velocities are turned into the robot's own frame, as twists are by custom.

    Args:
        t: shape (n,), seconds from 0.
        q: shape (n, 3), configurations then.
        dq: shape (n, 3), their derivatives by time, m/s and rad/s.
        frame: the coordinate frame's name, such as ``map``.
    """
    points = []
    for time, state, (vx, vy, turn) in zip(t.tolist(), q.tolist(), dq.tolist(), strict=True):
        seconds, nanoseconds = divmod(round(time * _NANOSECONDS), _NANOSECONDS)
        cos, sin = math.cos(state[2]), math.sin(state[2])
        linear = {"x": cos * vx + sin * vy, "y": cos * vy - sin * vx, "z": 0.0}
        velocity = {"linear": linear, "angular": {"x": 0.0, "y": 0.0, "z": turn}}
        duration = {"sec": seconds, "nanosec": nanoseconds}
        points.append({"time_from_start": duration, "pose": _pose(state), "velocity": velocity})
    return {**_header(frame), "points": points}


def message_text(message: dict[str, Any], name: str, *, as_json: bool) -> str:
    """Return a message as YAML, one line a pose, or as JSON, which is YAML too; every number with all its digits.

    Args:
        message: plain data, whose last member is a list.
        name: of the message's type, for the YAML file's first line.
        as_json: which of the two.
    """
    *members, (key, rows) = message.items()
    if as_json:
        head = ", ".join(f'"{member}": {_text(value)}' for member, value in members)
        lines = ",\n".join(map(_text, rows))
        return f'{{{head}, "{key}": [\n{lines}\n]}}\n'
    usage = f'ros2 topic pub --once TOPIC {name} "$(cat FILE)"'
    lines = "".join(f"- {_text(row)}\n" for row in rows)
    return f"# Written by trailmark: {usage}\n" + "".join(f"{k}: {_text(v)}\n" for k, v in members) + f"{key}:\n{lines}"


def _header(frame: str) -> dict[str, Any]:
    return {"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame}}


def _pose(state: list[float]) -> dict[str, Any]:
    x, y, theta = state
    orientation = {"x": 0.0, "y": 0.0, "z": math.sin(0.5 * theta), "w": math.cos(0.5 * theta)}
    return {"position": {"x": x, "y": y, "z": 0.0}, "orientation": orientation}


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f'"{key}": {_text(part)}' for key, part in value.items()) + "}"
    if isinstance(value, float):
        # Readers of YAML 1.1, such as ROS's, take 1e-05 for a text, but 1.0e-05 for a number.
        mantissa, mark, exponent = repr(value).partition("e")
        return f"{mantissa}.0e{exponent}" if mark and "." not in mantissa else repr(value)
    return json.dumps(value)
