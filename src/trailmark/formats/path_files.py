"""Paths and trajectories as trailmark writes them: its own JSON, CSV, plain rows, ROS 2 messages, GeoJSON, TUM.

Of one vertex to the next a ``nav_msgs/msg/Path`` says nothing; trailmark means a straight motion. Trajectories have the
fields of ``nav_msgs/msg/Trajectory``, which nav2 released as ``nav2_msgs/msg/Trajectory`` before. Stamps are 0, which
nav2 takes for the newest transform there is. GeoJSON is in metres, in the map's frame, as nav2's route server has it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import checked_arguments, shaped
from trailmark.errors import ConfigurationError, OutputError, WorldError
from trailmark.formats import files
from trailmark.se2 import ROTATION_WEIGHT, FloatArray, configurations, difference

__all__ = [
    "CSV_HEADER",
    "HEADER",
    "SUFFIXES",
    "TRAJECTORY_SUFFIXES",
    "geojson_feature",
    "geojson_text",
    "message_text",
    "path_message",
    "path_text",
    "trajectory_message",
    "write_path",
    "write_trajectory",
    "write_tum",
]

SUFFIXES = (".json", ".csv", ".path", ".txt", ".yaml", ".yml", ".nav2.json", ".geojson")
"""What a path file's suffix may be: it tells the format."""

CSV_HEADER = "x,y,theta"


def write_path(path: FilePath, states: Any, record: Mapping[str, Any] | None = None, frame: str = "map") -> None:
    """Write a path, whole or not at all; every number is written with all its digits.

    - ``.json``: one object: ``record`` with ``states`` as a list of [x, y, theta]; without a record, the states and
      their cost, length and rotation.
    - ``.csv``: the header ``x,y,theta``, then one row a state.
    - ``.path``, ``.txt``: rows ``x y theta``, as OMPL.app publishes its solutions.
    - ``.yaml``, ``.nav2.json``: ``nav_msgs/msg/Path``.
    - ``.geojson``: a line with the headings as ``properties.theta``.

    Args:
        path: where to; its suffix tells the format.
        states: shape (n, 3), metres and radians, or a :class:`trailmark.Path`.
        record: what else a JSON file says; other formats hold the states alone.
        frame: name of the coordinate frame, for messages and GeoJSON.

    Raises:
        ConfigurationError: states of another shape or not finite.
        OutputError: the path cannot be written, or JSON cannot hold the record.
    """
    files.check_writable(path, SUFFIXES)
    checked, facts = _states_and_facts(states)
    rows = [[repr(value) for value in row] for row in checked.tolist()]
    name, suffix = path.name.lower(), path.suffix.lower()
    if suffix in (".yaml", ".yml") or name.endswith(".nav2.json"):
        message = path_message(checked, frame)
        text = message_text(message, "nav_msgs/msg/Path", as_json=suffix == ".json")
    elif suffix == ".geojson":
        text = path_text(states, frame)
    elif suffix == ".json":
        if record is None:
            curve = getattr(states, "record", None)  # of a car's path
            record = {"states": None, **facts, **({} if curve is None else {"curve": curve()})}
        text = _json_text(path, rows, record)
    elif suffix == ".csv":
        text = "\n".join([CSV_HEADER, *map(",".join, rows)]) + "\n"
    else:
        text = "\n".join(map(" ".join, rows)) + "\n"
    files.write_atomically(path, text)


def _states_and_facts(path: Any) -> tuple[FloatArray, dict[str, float]]:
    """Return a path's states, shape (n, 3), and its cost, length and rotation."""
    states = configurations(path.states if hasattr(path, "states") else path, name="path")
    if states.ndim != 2 or len(states) == 0:
        raise ConfigurationError(f"path: expected shape (n, 3) with n >= 1, got {states.shape}")
    if hasattr(path, "states"):
        return states, {"cost": path.cost, "length": path.length, "rotation": path.rotation}
    steps = difference(states[:-1], states[1:])
    length, rotation = float(np.hypot(*steps[:, :2].T).sum()), float(np.abs(steps[:, 2]).sum())
    return states, {"cost": length + ROTATION_WEIGHT * rotation, "length": length, "rotation": rotation}


def _json_text(path: FilePath, rows: list[list[str]], record: Mapping[str, Any]) -> str:
    states = "[\n" + ",\n".join(f"    [{', '.join(row)}]" for row in rows) + "\n  ]"
    try:
        members = {
            key: states if key == "states" else json.dumps(value, allow_nan=False, default=_plain)
            for key, value in (record if "states" in record else {"states": None, **record}).items()
        }
    except (TypeError, ValueError) as error:
        raise OutputError(f"{path}: cannot be written: the record holds what JSON cannot: {error}") from None
    return "{\n" + ",\n".join(f"  {json.dumps(key)}: {value}" for key, value in members.items()) + "\n}\n"


def _plain(value: object) -> object:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} {value!r}")


TRAJECTORY_SUFFIXES = (".csv", ".yaml", ".yml", ".nav2.json")

HEADER = "t [s],x [m],y [m],theta [rad],vx [m/s],vy [m/s],omega [rad/s]"


def write_trajectory(path: FilePath, t: ArrayLike, q: ArrayLike, dq: ArrayLike, frame: str = "map") -> None:
    """Write a trajectory, whole or not at all; every number is written with all its digits.

    ``.csv`` has the columns of :data:`HEADER`, velocities in the world's frame; ``.yaml`` and ``.nav2.json`` are
    ``nav_msgs/msg/Trajectory``, with velocities in the robot's.

    Args:
        path: where to; its suffix tells the format.
        t: seconds, shape (n,).
        q: configurations then, shape (n, 3); metres, radians in (-pi, pi].
        dq: their derivatives by time, shape (n, 3).
        frame: name of the coordinate frame, for messages.

    Raises:
        ConfigurationError: arrays of other shapes.
        OutputError: another suffix, or a file that cannot be written.
    """
    files.check_writable(path, TRAJECTORY_SUFFIXES)
    times, states, rates = (np.asarray(values, dtype=np.float64) for values in (t, q, dq))
    if not times.ndim == 1 or not states.shape == rates.shape == (len(times), 3):
        raise ConfigurationError(
            f"trajectory: expected shapes (n,), (n, 3) and (n, 3), got {times.shape}, {states.shape}, {rates.shape}"
        )
    if path.suffix.lower() == ".csv":
        rows = np.column_stack([times, states, rates]).tolist()
        text = "\n".join([HEADER, *(",".join(map(repr, row)) for row in rows)]) + "\n"
    else:
        message = trajectory_message(times, states, rates, frame)
        as_json = path.suffix.lower() == ".json"
        text = message_text(message, "nav_msgs/msg/Trajectory", as_json=as_json)
    files.write_atomically(path, text)


def geojson_feature(properties: dict[str, Any], kind: str, coordinates: list[Any]) -> dict[str, Any]:
    """Return a feature whose geometry is of a kind such as ``Point``."""
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def geojson_text(features: list[dict[str, Any]]) -> str:
    """Return features as a FeatureCollection, one on a line; every number with all its digits."""
    lines = ",\n".join(json.dumps(item, allow_nan=False) for item in features)
    return f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n'


def path_text(path: Any, frame: str) -> str:
    """Return a path as one line, with its headings as ``properties.theta`` (radians, one for each position).

    A path of one state becomes a line of two equal ones, for a line has two positions or more.
    """
    found, facts = _states_and_facts(path)
    states = found.tolist() * (2 if len(found) == 1 else 1)
    properties = {"frame": frame, **facts, "theta": [state[2] for state in states]}
    return geojson_text([geojson_feature(properties, "LineString", [state[:2] for state in states])])


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


@checked_arguments(WorldError)
def write_tum(path: str | FilePath, trajectory: Annotated[ArrayLike, shaped(None, 4)]) -> None:
    """Write a trajectory.

    Args:
        path: the file.
        trajectory: shape (n, 4), rows t (seconds), x, y (metres), theta (radians).

    Raises:
        WorldError: another shape, not finite.
        OutputError: the path cannot be written.
    """
    rows = np.asarray(trajectory)
    half = 0.5 * rows[:, 3]
    lines = [
        f"{t!r} {x!r} {y!r} 0 0 0 {qz!r} {qw!r}\n"
        for t, x, y, qz, qw in np.column_stack([rows[:, :3], np.sin(half), np.cos(half)]).tolist()
    ]
    files.write_atomically(FilePath(path), "".join(lines))
