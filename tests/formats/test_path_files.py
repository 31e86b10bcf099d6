from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.trials import THOROUGH, few

from trailmark import ConfigurationError, OutputError, Path, WorldError, se2
from trailmark.formats.any_path import read_any_path
from trailmark.formats.path_files import (
    HEADER,
    SUFFIXES,
    message_text,
    path_message,
    path_text,
    trajectory_message,
    write_path,
    write_trajectory,
    write_tum,
)

number = st.floats(-1e9, 1e9)
states = st.lists(st.tuples(number, number, st.floats(-math.pi, math.pi, exclude_min=True)), min_size=1, max_size=9)
MESSAGES = (".yaml", ".yml", ".nav2.json")
ROWS = [[0.1, -2.0, 0.0], [1e-7, 3.5, math.pi]]
TRAJECTORY = Path(np.array([[1.0, 3.0, 0.0], [7.0, 3.0, 1.0], [7.0, 5.0, 1.0]])).timed(1.0, 0.7, 1.0)


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=few(THOROUGH, of=120))
@given(rows=states)
def test_round_trip_is_exact(tmp_path_factory: pytest.TempPathFactory, suffix: str, rows: list[Any]) -> None:
    file = tmp_path_factory.mktemp("paths") / f"a{suffix}"
    write_path(file, rows)
    found = read_any_path(file).states
    expected = Path(np.array(rows if len(rows) > 1 or suffix != ".geojson" else rows * 2)).states
    assert np.array_equal(found[:, :2], expected[:, :2])
    # Messages hold quaternions.
    np.testing.assert_allclose(se2.wrap(found[:, 2] - expected[:, 2]), 0.0, atol=1e-15 if suffix in MESSAGES else 0.0)


def test_json_holds_the_record(tmp_path: FilePath) -> None:
    record = {"world": "öffice", "status": "solved", "states": "ignored", "seed": np.int64(3), "cost": np.float64(1.5)}
    write_path(tmp_path / "a.json", ROWS, {**record, "lower_bound": None, "time": {"total": 0.1}})
    data = json.loads((tmp_path / "a.json").read_text())
    assert data == {
        "world": "öffice",
        "status": "solved",
        "states": ROWS,
        "seed": 3,
        "cost": 1.5,
        "lower_bound": None,
        "time": {"total": 0.1},
    }
    assert list(data) == ["world", "status", "states", "seed", "cost", "lower_bound", "time"]


def test_json_without_a_record_measures_the_path(tmp_path: FilePath) -> None:
    write_path(tmp_path / "a.json", [[0, 0, 0], [3, 4, 1]])
    data = json.loads((tmp_path / "a.json").read_text())
    assert data == {"states": [[0, 0, 0], [3, 4, 1]], "cost": 5.5, "length": 5.0, "rotation": 1.0}


def test_what_cannot_be_written_is_refused_and_leaves_nothing(tmp_path: FilePath) -> None:
    (tmp_path / "folder.csv").mkdir()
    for value in (math.nan, math.inf, object(), {1, 2}):
        with pytest.raises(OutputError, match="the record holds what JSON cannot"):
            write_path(tmp_path / "a.json", ROWS, {"cost": value})
    for rows in ([], [[1, 2]], [[1, 2, math.nan]]):
        with pytest.raises(ConfigurationError):
            write_path(tmp_path / "a.csv", rows)
    for name, problem in (
        ("a.cvs", r"suffix: expected \.csv, .*\.txt, \.yaml, \.yml, got '\.cvs' \(did you mean '\.csv'\?\)"),
        ("a", r"expected \.csv, \.geojson, \.json, .*, got ''"),
        ("none/a.csv", "the directory .* does not exist"),
        ("folder.csv", "is a directory; expected a file"),
    ):
        with pytest.raises(OutputError, match=problem):
            write_path(tmp_path / name, ROWS)
    t, q, dq = TRAJECTORY.t, TRAJECTORY.q, TRAJECTORY.dq
    with pytest.raises(OutputError, match="suffix"):
        write_trajectory(tmp_path / "drive.txt", t, q, dq)
    with pytest.raises(ConfigurationError, match=r"expected shapes \(n,\), \(n, 3\) and \(n, 3\), got"):
        write_trajectory(tmp_path / "drive.csv", t[1:], q, dq)
    with pytest.raises(WorldError, match="trajectory"):
        write_tum(tmp_path / "a.tum", np.zeros((2, 3)))
    assert [p.name for p in tmp_path.iterdir()] == ["folder.csv"]


STATES = np.array([[0.1, -2.0, 0.0], [1e-7, 3.5, 3.0], [1.0, 1.0, -3.0]])


def test_a_path_is_a_line_with_headings() -> None:
    path = Path(STATES)
    text = path_text(path, "odom")
    (line,) = json.loads(text)["features"]
    assert shapely.get_coordinates(shapely.from_geojson(text)).tolist() == STATES[:, :2].tolist()
    assert line["properties"]["theta"] == STATES[:, 2].tolist()
    assert line["properties"]["frame"] == "odom"
    assert line["properties"]["cost"] == path.cost


STATES_NAV2_MESSAGES = np.array([[1e-5, -2.0, 0.0], [1e17, 3.5, math.pi], [0.1, 1e-300, -1.25]])
TIMES = np.array([0.0, 1.9999999999, 12.25])
VELOCITIES = np.array([[0.5, 0.25, 0.0], [1.0, 0.0, -0.5], [0.0, 1.0, 1e-9]])


def messages() -> dict[str, dict[str, Any]]:
    return {
        "nav_msgs/msg/Path": path_message(STATES_NAV2_MESSAGES, "map"),
        "nav_msgs/msg/Trajectory": trajectory_message(TIMES, STATES_NAV2_MESSAGES, VELOCITIES, 'a "frame": 1e5'),
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
    found = read_any_path(tmp_path / "message").states
    assert np.array_equal(found[:, :2], STATES_NAV2_MESSAGES[:, :2])
    np.testing.assert_allclose(found[:, 2], STATES_NAV2_MESSAGES[:, 2], atol=1e-15)


def test_a_trajectory_says_when_and_how_fast() -> None:
    message = trajectory_message(TIMES, STATES_NAV2_MESSAGES, VELOCITIES, "map")
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "map"}
    times = [point["time_from_start"] for point in message["points"]]
    assert times == [{"sec": 0, "nanosec": 0}, {"sec": 2, "nanosec": 0}, {"sec": 12, "nanosec": 250_000_000}]
    for point, state, velocity in zip(message["points"], STATES_NAV2_MESSAGES, VELOCITIES, strict=True):
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

    message = path_message(STATES_NAV2_MESSAGES, "map")
    assert list(message) == fields("nav_msgs/msg/Path")
    assert list(message["poses"][0]) == fields("geometry_msgs/msg/PoseStamped")
    assert list(message["poses"][0]["pose"]) == fields("geometry_msgs/msg/Pose")
    assert list(message["poses"][0]["pose"]["orientation"]) == fields("geometry_msgs/msg/Quaternion")


def test_rows_are_the_arrays(tmp_path: FilePath) -> None:
    file = tmp_path / "drive.csv"
    write_trajectory(file, TRAJECTORY.t, TRAJECTORY.q, TRAJECTORY.dq)
    assert file.read_text().splitlines()[0] == HEADER
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(rows, np.column_stack([TRAJECTORY.t, TRAJECTORY.q, TRAJECTORY.dq]))


@pytest.mark.parametrize("name", ["drive.yaml", "drive.nav2.json"])
def test_nav2s_message_has_a_point_a_row(tmp_path: FilePath, name: str) -> None:
    file = tmp_path / name
    write_trajectory(file, TRAJECTORY.t, TRAJECTORY.q, TRAJECTORY.dq, "odom")
    message = yaml.safe_load(file.read_text())
    assert message["header"]["frame_id"] == "odom"
    assert len(message["points"]) == len(TRAJECTORY.t)
    assert message["points"][-1]["pose"]["position"]["y"] == 5.0


def test_tum_rows_are_time_place_and_quaternion(tmp_path: FilePath) -> None:
    trajectory = np.array(
        [[1134863807.658747, 1.0, -2.0, 0.3], [1134863808.0, 1.5, -2.0, -math.pi / 2], [2e9, 0.0, 0.0, math.pi]]
    )
    write_tum(tmp_path / "a.tum", trajectory)
    rows = np.loadtxt(tmp_path / "a.tum")
    assert rows.shape == (3, 8)
    assert (rows[:, :3] == trajectory[:, :3]).all()
    assert (rows[:, 3:6] == 0.0).all()
    assert np.allclose(2.0 * np.arctan2(rows[:, 6], rows[:, 7]), trajectory[:, 3])
