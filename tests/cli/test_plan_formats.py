"""``trailmark plan``: robots as nav2 has them, headings in degrees, and paths as others read them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.formats.any_path import read_any_path
from trailmark.robot import Robot

Shell = Callable[..., Any]

STATES = [[1.0, 1.0, 0.0], [5.0, 1.0, 0.5], [9.0, 5.0, 1.5]]
PARAMETERS = "global_costmap:\n  global_costmap:\n    ros__parameters: {robot_radius: 0.22}\n"


@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".nav2.json", ".geojson"])
def test_a_path_for_others_comes_back(shell: Shell, yard: Path, tmp_path: Path, planner: Any, suffix: str) -> None:
    file = tmp_path / f"path{suffix}"
    for frame in ("map", "odom"):  # the second one replaces the first
        assert shell("plan", yard, "--output", file, "--frame-id", frame).status == 0
        assert f'"{frame}"' in file.read_text()
        np.testing.assert_allclose(read_any_path(file).path.states, STATES, atol=1e-15)
    planner.status = "timeout"
    before = file.read_text()
    assert shell("plan", yard, "--output", file).status == 3
    assert file.read_text() == before, "what is no path replaces none"


@pytest.mark.parametrize(
    ("text", "robot"),
    [
        ("[[0.3, 0.2], [0.3, -0.2], [-0.3, 0]]", Robot.polygon([[0.3, 0.2], [0.3, -0.2], [-0.3, 0.0]])),
        ("robot_radius:0.22", Robot.disc(0.22)),
        ("PARAMETERS", Robot.disc(0.22)),
    ],
)
def test_robots_as_nav2_has_them(
    shell: Shell, yard: Path, tmp_path: Path, planner: Any, text: str, robot: Robot
) -> None:
    (tmp_path / "nav2_params.yaml").write_text(PARAMETERS)
    given = str(tmp_path / "nav2_params.yaml") if text == "PARAMETERS" else text
    assert shell("plan", yard, "--robot", given).status == 0
    assert planner.calls[0]["robot"] == robot


def test_headings_in_degrees(shell: Shell, yard: Path, planner: Any) -> None:
    run = shell("plan", yard, "--start", "1,1,-90deg", "--goal", "9,5,450 deg", "--json")
    assert (run.status, run.err) == (0, "")
    assert planner.calls[0]["start"] == (1.0, 1.0, -math.pi / 2)
    assert json.loads(run.out)["states"][0][2] == -math.pi / 2
