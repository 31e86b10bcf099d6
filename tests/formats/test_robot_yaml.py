"""Robots in YAML files: as world files have them, and as parameters of nav2 and move_base."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark import FormatError, Robot

CORNERS = [[0.21, 0.195], [0.21, -0.195], [-0.21, -0.195], [-0.21, 0.195]]
BOX = Robot.polygon(CORNERS)

NAV2 = """\
controller_server:
  ros__parameters:
    controller_plugins: ["FollowPath"]
    FollowPath: {plugin: "dwb_core::DWBLocalPlanner", max_vel_x: 0.26}
local_costmap:
  local_costmap:
    ros__parameters:
      resolution: 0.05
      footprint: "[ [0.21, 0.195], [0.21, -0.195], [-0.21, -0.195], [-0.21, 0.195] ]"
      footprint_padding: 0.03
      plugins: ["voxel_layer", "inflation_layer"]
"""
GLOBAL = """\
global_costmap:
  global_costmap:
    ros__parameters:
      footprint: "[]"
      robot_radius: 0.3
"""


def read(folder: Path, text: str) -> Robot:
    file = folder / "params.yaml"
    file.write_text(text)
    return Robot.load(file)


@pytest.mark.parametrize(
    ("text", "robot"),
    [
        ("shape: disc\nradius: 0.3\n", Robot.disc(0.3)),
        ("{shape: rectangle, length: 4, width: 1.8, turning_radius: 4.5}", Robot.rectangle(4, 1.8).steered(4.5)),
        ("robot: {shape: disc, radius: 0.3}\n", Robot.disc(0.3)),
        ("trailmark: 1\nbounds: [0, 0, 1, 1]\nrobot: {shape: disc, radius: 0.1}\n", Robot.disc(0.1)),
        (NAV2, BOX),
        # nav2's tutorial has two: it plans in the global costmap.
        (NAV2 + GLOBAL, Robot.disc(0.3)),
        (NAV2 + GLOBAL.replace("global_costmap:\n  g", "/robot1/global_costmap:\n  g", 1), Robot.disc(0.3)),
        (NAV2 + NAV2.replace("local", "other").replace("controller_server", "again"), BOX),
        (f"footprint: {CORNERS}\nfootprint_padding: 0.01\n", BOX),
        ("robot_radius: 0.22\n", Robot.disc(0.22)),
        (f"robot_radius: 0.0\nfootprint: {CORNERS}\n", BOX),
        ("footprint: []\nrobot_radius: 1\n", Robot.disc(1)),
        ("footprint: ''\nrobot_radius: 1\n", Robot.disc(1)),
    ],
)
def test_robots_are_read(tmp_path: Path, text: str, robot: Robot) -> None:
    assert read(tmp_path, text) == robot


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "no robot: expected a robot {shape: ...}, a world with one, or parameters with footprint or robot_radius"),
        ("[1, 2]", "no robot: expected"),
        ("trailmark: 1\nbounds: [0, 0, 1, 1]\n", "no robot: expected"),
        ("shape: disc\n", "robot.radius: field required"),
        ("shape: disk\nradius: 1\n", "robot: input tag 'disk'"),
        ("shape: disc\nradius: 1\ncolour: red\n", "robot.colour: unknown key"),
        ("robot_radius: -1\n", "robot_radius: expected a number above 0 (metres), got -1"),
        ("a: {robot_radius: wide}\n", "a.robot_radius: expected a number above 0 (metres), got 'wide'"),
        ("footprint: '[[0, 0], [1, 0]]'\n", "footprint: polygon: vertices: expected 3 or more different points, got 2"),
        ("b: {footprint: '[[0, 0], [1, 0], [1]]'}\n", "b.footprint: expected disc:RADIUS, "),
        ("footprint: [[0, 0], [1, 0], [a, 1]]\n", "footprint: polygon: vertices: "),
        (NAV2 + "other: {robot_radius: 1.0}\n", "expected one robot, got different ones at"),
        ("a: *b\n", "expected no anchors and aliases, got alias *b"),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path: Path, text: str, problem: str) -> None:
    with pytest.raises(FormatError) as caught:
        read(tmp_path, text)
    assert problem in str(caught.value)
    assert "params.yaml" in str(caught.value)
