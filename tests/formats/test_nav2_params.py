"""nav2's own parameter file: robot, padding, drive, unknown cells and tolerance, from where nav2 has them."""

from __future__ import annotations

from pathlib import Path

import pytest

from trailmark import Disc, FormatError
from trailmark.world.nav2 import Nav2Parameters

FILE = """
amcl:
  ros__parameters: {{robot_model_type: "nav2_amcl::DifferentialMotionModel"}}
local_costmap:
  local_costmap:
    ros__parameters: {{robot_radius: 0.9, footprint_padding: 0.5}}
global_costmap:
  global_costmap:
    ros__parameters: {{{robot}, footprint_padding: 0.03}}
planner_server:
  ros__parameters:
    planner_plugins: ["GridBased"]
    GridBased: {{plugin: "{plugin}", tolerance: 0.5, allow_unknown: {unknown}{more}}}
"""
RADIUS, FOOTPRINT = "robot_radius: 0.22", 'footprint: "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"'
HYBRID = "nav2_smac_planner::SmacPlannerHybrid"


def load(
    tmp_path: Path, robot: str = RADIUS, plugin: str = "navfn", unknown: str = "true", more: str = ""
) -> Nav2Parameters:
    file = tmp_path / "nav2_params.yaml"
    file.write_text(FILE.format(robot=robot, plugin=plugin, unknown=unknown, more=more))
    return Nav2Parameters.load(file)


def test_a_round_robot_of_a_grid_planner(tmp_path: Path) -> None:
    found = load(tmp_path)
    assert found.robot.footprint == Disc((0.0, 0.0), 0.22)
    assert (found.robot.drive, found.robot.clearance) == ("differential", 0.03)
    assert (found.tolerance, found.unknown) == (0.5, "free")
    assert "global_costmap.global_costmap.robot_radius 0.22" in found.taken
    assert "planner_server.GridBased.tolerance 0.5" in found.taken


@pytest.mark.parametrize(
    ("more", "radius", "reverse"),
    [
        ("", 0.4, False),
        (", minimum_turning_radius: 0.7, motion_model_for_search: REEDS_SHEPP", 0.7, True),
        (", motion_model_for_search: DUBIN", 0.4, False),
    ],
)
def test_a_car_of_smacs_hybrid_planner(tmp_path: Path, more: str, radius: float, reverse: bool) -> None:
    found = load(tmp_path, FOOTPRINT, HYBRID, "false", more)
    assert found.robot.outline.vertices.shape == (4, 2)
    assert (found.robot.drive, found.robot.turning_radius, found.robot.reverse) == ("car", radius, reverse)
    assert found.unknown == "blocked"


def test_what_its_smoother_is_told_is_not_the_planners(tmp_path: Path) -> None:
    inner = "smoother: {tolerance: 1.0e-10, allow_unknown: false}"
    file = tmp_path / "nav2_params.yaml"
    for outer, tolerance, unknown in (("", 0.0, None), (", tolerance: 0.25, allow_unknown: true", 0.25, "free")):
        planner = f'{{{inner}, plugin: "{HYBRID}"{outer}}}'
        for plugins in ("planner_plugins: [GridBased], ", ""):
            server = f"planner_server: {{ros__parameters: {{{plugins}GridBased: {planner}}}}}"
            file.write_text(f"global_costmap: {{robot_radius: 0.2}}\n{server}\n")
            found = Nav2Parameters.load(file)
            assert (found.tolerance, found.unknown, found.robot.drive) == (tolerance, unknown, "car")


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"robot": "robot_radius: -1"}, "robot_radius: expected a number above 0"),
        ({"unknown": "perhaps"}, "allow_unknown: expected true or false, got 'perhaps'"),
        (
            {"plugin": HYBRID, "more": ", minimum_turning_radius: 0"},
            "minimum_turning_radius: expected a number above 0",
        ),
        ({"plugin": HYBRID, "more": ", motion_model_for_search: HOVER"}, "expected DUBIN, REEDS_SHEPP, got 'HOVER'"),
        ({"robot": "width: 3"}, ""),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path: Path, options: dict[str, str], fault: str) -> None:
    if fault:
        with pytest.raises(FormatError, match=fault):
            load(tmp_path, **options)
    else:  # the local costmap's robot, then
        assert load(tmp_path, **options).robot.footprint == Disc((0.0, 0.0), 0.9)
