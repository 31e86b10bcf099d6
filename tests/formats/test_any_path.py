"""Paths as anybody writes them: each format gives the same states, and what is none is told in one line."""

from __future__ import annotations

import json
import math
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from trailmark.errors import FormatError
from trailmark.formats.any_path import read_any_path
from trailmark.formats.path_files import write_path, write_trajectory

STATES = [[1.0, 2.0, 0.5], [1.5, -2.25, 3.0], [4.0, 0.0, -1.25]]


def message(states: list[list[float]] = STATES, stamped: bool = True) -> dict[str, Any]:
    """Return nav_msgs/Path, as plain data."""
    stamp = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "map"}
    poses: list[dict[str, Any]] = []
    for x, y, theta in states:
        orientation = {"x": 0.0, "y": 0.0, "z": math.sin(theta / 2), "w": math.cos(theta / 2)}
        pose = {"position": {"x": x, "y": y, "z": 0.0}, "orientation": orientation}
        poses.append({"header": stamp, "pose": pose} if stamped else pose)
    return {"header": stamp, "poses": poses}


def echoed(states: list[list[float]] = STATES) -> str:
    """Return the message as ``ros2 topic echo`` prints it."""
    lines = ["header:", "  stamp:", "    sec: 12", "    nanosec: 0", "  frame_id: map", "poses:"]
    for x, y, theta in states:
        lines += ["- header:", "    stamp:", "      sec: 0", "      nanosec: 0", "    frame_id: ''", "  pose:"]
        lines += ["    position:", f"      x: {x}", f"      y: {y}", "      z: 0.0", "    orientation:", "      x: 0.0"]
        lines += ["      y: 0.0", f"      z: {math.sin(theta / 2)!r}", f"      w: {math.cos(theta / 2)!r}"]
    return "\n".join(lines) + "\n"


def rows(separator: str) -> str:
    return "\n".join(separator.join(map(repr, row)) for row in STATES) + "\n"


@pytest.mark.parametrize(
    "text",
    [
        json.dumps({"states": STATES, "cost": 1.0}),
        json.dumps(STATES),
        json.dumps(message()),
        json.dumps(message(stamped=False)),
        json.dumps({"op": "publish", "msg": message()}),
        json.dumps({"result": {"planning_time": 0.1, "path": message()}}),
        echoed(),
        echoed() + "---\n",
        echoed(STATES[:2]) + "---\n" + echoed() + "---\n",
        echoed() + "---\n" + echoed()[:300],
        "x,y,theta\n" + rows(","),
        '"X", "Y", "Yaw"\n' + rows(", "),
        rows(","),
        rows(" "),
        rows("\t"),
        "\n# a note\n" + rows("   ") + "\n\n",
        "x;y;heading\n" + rows(";"),
        "# planned by hand, on a Monday, twice\n" + rows(" "),
        "# planned by hand, on a Monday, twice\n" + rows(","),
        "# the frame: x ahead, y to the left\n" + rows(","),
        "# columns: x y theta\n" + rows(" "),
        "# of robot 7\n# theta,x,y\n" + "".join(f"{t!r},{x!r},{y!r}\n" for x, y, t in STATES),
        "#Yaw [rad] X [m] Y [m]\n" + "".join(f"{t!r} {x!r} {y!r}\n" for x, y, t in STATES),
        "# theta, x, y\n\n" + "".join(f"{t!r}  {x!r}  {y!r}\n" for x, y, t in STATES),
        "## t;heading;x;y\n" + "".join(f"{i};{t!r};{x!r};{y!r}\n" for i, (x, y, t) in enumerate(STATES)),
        "# theta,x,y\nx,y,theta\n" + rows(","),
        "t,theta,x,y\n" + "".join(f"{i},{t!r},{x!r},{y!r}\n" for i, (x, y, t) in enumerate(STATES)),
    ],
)
def test_each_format_gives_the_same_states(tmp_path: FilePath, text: str) -> None:
    file = tmp_path / "path.anything"
    file.write_text(text)
    found = read_any_path(file)
    np.testing.assert_allclose(found.states, STATES, atol=1e-15)
    assert found.headings == pytest.approx(3.0)
    assert found.curve is None


def test_what_trailmark_writes_and_headings_as_they_were_written(tmp_path: FilePath) -> None:
    for suffix in (".json", ".csv", ".path", ".txt"):
        write_path(tmp_path / f"a{suffix}", STATES)
        assert np.array_equal(read_any_path(tmp_path / f"a{suffix}").states, STATES)
    curve = {"kind": "dubins", "turning_radius": 2.0, "knots": STATES}
    write_path(tmp_path / "a.json", STATES, {"curve": curve})
    assert read_any_path(tmp_path / "a.json").curve == curve
    write_trajectory(tmp_path / "a.csv", np.arange(len(STATES)), STATES, np.zeros((len(STATES), 3)))
    np.testing.assert_array_equal(read_any_path(tmp_path / "a.csv").states, STATES)
    (tmp_path / "a.csv").write_text("x,y,yaw\n0,0,90\n1,0,-180\n")
    found = read_any_path(tmp_path / "a.csv")
    assert found.headings == 180.0
    assert (np.abs(found.states[:, 2]) <= math.pi).all()


def geojson(**changes: Any) -> str:
    parts = {"coordinates": [[1.0, 2.0], [3.0, 4.0]], "theta": [0.0, 0.5]} | changes
    geometry = {"type": "LineString", "coordinates": parts["coordinates"]}
    properties = {} if parts["theta"] is None else {"theta": parts["theta"]}
    return json.dumps({"features": [{"type": "Feature", "geometry": geometry, "properties": properties}]})


def zeros() -> str:
    data = message()
    data["poses"][1]["pose"]["orientation"] = dict.fromkeys("xyzw", 0)
    return json.dumps(data)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "expected one or more states, got an empty path"),
        ("[]", "got an empty path"),
        ('{"states": [], "status": "timeout"}', "got a plan without one (status 'timeout')"),
        ("1 2 3\n4 5\n", ":2: expected 3 columns, x, y, theta finite numbers, got row '4 5'"),
        ("1 2 3\n4 5 nan\n", ":2: expected 3 columns, x, y, theta finite numbers, got row '4 5 nan'"),
        ("# a path\n# angle,x,y\n1,2,3\n", ":2: a comment that names columns: expected 3 columns with x, y, theta"),
        ("# px,py,angle\n1,2,3\n", ":1: a comment that names columns"),
        ("# theta x y\n1 2 3 4\n", ":1: a comment that names columns: expected 4 columns"),
        ("# columns: theta x y\n1 2 3\n", ":1: a comment that names columns"),
        ("x,y,theta\n1,2,three\n", ":2: expected 3 columns"),
        ("the quick brown fox\n", "columns x, y, theta (or yaw, heading), got 'the quick brown fox'"),
        ('{"waypoints": [[1, 2, 3]]}', "or poses of a nav_msgs/Path, got neither"),
        ('{"states": [[1, 2, NaN]]}', "not a finite number"),
        ("{", ":1: not valid JSON"),
        ("[" * 100_000, "not valid JSON"),
        ('{"states": [[' + "9" * 5000 + ", 0, 0]]}", "not valid JSON: nested too deeply or a number too long"),
        ('{"states": [[' + "9" * 400 + ", 0, 0]]}", "path: "),
        ('{"states": [[1, 2, "3"]]}', "states[0]: expected three numbers [x, y,"),
        ('{"type": "FeatureCollection", "features": []}', "expected a LineString among the features, got none"),
        ('{"features": [3, {"geometry": 7}, {"geometry": {"type": "Point"}}]}', "expected a LineString among"),
        (geojson(coordinates=[[1, 2], [3]]), "states[1]: expected three numbers [x, y, theta], got [3, 0.5]"),
        (geojson(coordinates=[[1, 2], [3, "4"]]), "states[1]: expected three numbers"),
        ("points: 3\n", "or poses of a nav_msgs/Path, got neither"),
        ("points:\n- {pose: {position: {x: 1}}}\n", "poses[0]: expected finite numbers"),
        ('{"poses": [{"pose": {"position": {"x": 1}}}]}', "poses[0]: expected finite numbers position {x, y}"),
        (zeros(), "poses[1].orientation: expected a quaternion, got all zeros"),
        (echoed() + "- '...'\n", "poses[3]: the message was cut where it was printed; print it with --full-length"),
        ('{"poses": [{"position": {"x": 1' + "0" * 400 + ', "y": 0}, "orientation": {}}]}', "poses[0]: expected"),
        ("header: [\nposes:\n- x\n", "not valid YAML"),
        (echoed().replace("w: ", "v: "), "poses[0]: expected finite numbers"),
    ],
)
def test_what_is_no_path_is_told_in_one_line(tmp_path: FilePath, text: str, problem: str) -> None:
    file = tmp_path / "path"
    file.write_text(text)
    with pytest.raises(FormatError) as caught:
        read_any_path(file)
    assert problem in str(caught.value)


def test_a_missing_file_and_no_text(tmp_path: FilePath) -> None:
    with pytest.raises(FormatError, match="cannot be read: No such file"):
        read_any_path(tmp_path / "none.json")
    (tmp_path / "image.png").write_bytes(b"\x89PNG\r\n\0\0")
    with pytest.raises(FormatError, match="not a text file; expected JSON"):
        read_any_path(tmp_path / "image.png")


def turned(order: str, separator: str) -> str:
    """Return rows with a time, a height and a quaternion, as TUM's tools write them."""
    lines = []
    for i, (x, y, theta) in enumerate(STATES):
        value = {"t": 0.1 * i, "x": x, "y": y, "z": 0.3, "qx": 0.0, "qy": 0.0}
        value |= {"qz": 2.0 * math.sin(theta / 2), "qw": 2.0 * math.cos(theta / 2)}  # of any length
        lines.append(separator.join(repr(value[name]) for name in order.split()))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    "text",
    [
        turned("t x y z qx qy qz qw", " "),
        "# timestamp tx ty tz qx qy qz qw\n" + turned("t x y z qx qy qz qw", " "),
        "t,x,y,z,qx,qy,qz,qw\n" + turned("t x y z qx qy qz qw", ","),
        "x,y,qw,qx,qy,qz\n" + turned("x y qw qx qy qz", ","),
    ],
)
def test_headings_may_be_quaternions(tmp_path: FilePath, text: str) -> None:
    (tmp_path / "path.tum").write_text(text)
    found = read_any_path(tmp_path / "path.tum")
    assert np.abs(found.states - STATES).max() < 1e-12
    assert not found.positions_only


@pytest.mark.parametrize(
    "text", ["1,2\n3,4\n", "x,y\n1,2\n3,4\n", "t;x;y\n0;1;2\n1;3;4\n", "[[1, 2], [3, 4]]", "1 2\n3 4\n"]
)
def test_positions_alone_have_no_headings(tmp_path: FilePath, text: str) -> None:
    (tmp_path / "path").write_text(text)
    found = read_any_path(tmp_path / "path")
    assert found.states.tolist() == [[1.0, 2.0, 0.0], [3.0, 4.0, 0.0]]
    assert found.positions_only


@pytest.mark.parametrize("text", ["x,y,angle\n1,2,3\n", "x,y,qx,qy,qz,qw\n1,2,0,0,0,0\n", "0 1 2 3 0 0 0 0\n"])
def test_a_heading_that_cannot_be_told_is_not_taken_for_none(tmp_path: FilePath, text: str) -> None:
    (tmp_path / "path").write_text(text)
    with pytest.raises(FormatError, match="expected"):
        read_any_path(tmp_path / "path")
