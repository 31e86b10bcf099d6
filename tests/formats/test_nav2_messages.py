"""Messages for ``ros2 topic pub``: read back they say the same, whichever YAML reads them."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import yaml

from trailmark.formats.any_path import read_any_path
from trailmark.formats.path_files import message_text, path_message, trajectory_message

STATES = np.array([[1e-5, -2.0, 0.0], [1e17, 3.5, math.pi], [0.1, 1e-300, -1.25]])
TIMES = np.array([0.0, 1.9999999999, 12.25])
VELOCITIES = np.array([[0.5, 0.25, 0.0], [1.0, 0.0, -0.5], [0.0, 1.0, 1e-9]])


def messages() -> dict[str, dict[str, Any]]:
    return {
        "nav_msgs/msg/Path": path_message(STATES, "map"),
        "nav_msgs/msg/Trajectory": trajectory_message(TIMES, STATES, VELOCITIES, 'a "frame": 1e5'),
    }


@pytest.mark.parametrize("name", messages())
def test_every_reader_of_yaml_understands_them(name: str) -> None:
    message = messages()[name]
    text = message_text(message, name, as_json=False)
    assert text.startswith("# Written by trailmark")
    # PyYAML reads YAML 1.1, as ROS's tools do; its numbers with exponents must have a point.
    assert yaml.safe_load(text) == message
    text = message_text(message, name, as_json=True)
    assert yaml.safe_load(text) == json.loads(text) == message


@pytest.mark.parametrize("name", messages())
@pytest.mark.parametrize("as_json", [False, True])
def test_paths_come_back(tmp_path: FilePath, name: str, as_json: bool) -> None:
    (tmp_path / "message").write_text(message_text(messages()[name], name, as_json=as_json))
    found = read_any_path(tmp_path / "message").path.states
    assert np.array_equal(found[:, :2], STATES[:, :2])
    np.testing.assert_allclose(found[:, 2], STATES[:, 2], atol=1e-15)


def test_a_trajectory_says_when_and_how_fast() -> None:
    message = trajectory_message(TIMES, STATES, VELOCITIES, "map")
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "map"}
    times = [point["time_from_start"] for point in message["points"]]
    assert times == [{"sec": 0, "nanosec": 0}, {"sec": 2, "nanosec": 0}, {"sec": 12, "nanosec": 250_000_000}]
    for point, state, velocity in zip(message["points"], STATES, VELOCITIES, strict=True):
        twist = complex(point["velocity"]["linear"]["x"], point["velocity"]["linear"]["y"])
        turned = twist * complex(math.cos(state[2]), math.sin(state[2]))
        assert (turned.real, turned.imag) == pytest.approx(tuple(velocity[:2]))
        assert point["velocity"]["angular"] == {"x": 0.0, "y": 0.0, "z": velocity[2]}


def test_messages_have_the_fields_of_ros() -> None:
    """The definitions of nav_msgs/Path, as rosbags has them, take the message."""
    typesys = pytest.importorskip("rosbags.typesys")
    types = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE).types

    def fields(name: str) -> list[str]:
        return [field.name for field in dataclasses.fields(types[name]) if field.name != "__msgtype__"]

    message = path_message(STATES, "map")
    assert list(message) == fields("nav_msgs/msg/Path")
    assert list(message["poses"][0]) == fields("geometry_msgs/msg/PoseStamped")
    assert list(message["poses"][0]["pose"]) == fields("geometry_msgs/msg/Pose")
    assert list(message["poses"][0]["pose"]["orientation"]) == fields("geometry_msgs/msg/Quaternion")
