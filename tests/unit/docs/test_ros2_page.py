"""The page, the parameter file and the launch file of the ROS 2 node say what the node takes, without a ROS 2."""

from __future__ import annotations

import os
import re
import runpy
import shlex
import subprocess
import sys
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from trailmark.ros.settings import Settings

ROOT = Path(__file__).resolve().parents[3]
PAGE = (ROOT / "docs" / "how-to" / "ros2.md").read_text()
LAUNCHED = ROOT / "examples" / "ros2"


def rows(title: str) -> dict[str, list[str]]:
    """Return the rows of the table under a title by their first cell."""
    section = PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]
    found = re.findall(r"^\| (`.*?) \|$", section, flags=re.M)
    return {row.split(" | ")[0]: row.split(" | ")[1:] for row in found}


def test_the_page_lists_the_parameters_with_their_defaults() -> None:
    listed = {name.strip("`"): default.strip("`") for name, (default, _) in rows("Parameters").items()}
    assert list(listed) == [setting.name for setting in fields(Settings)]
    for setting in fields(Settings):
        value = yaml.safe_load(listed[setting.name])
        assert (value, type(value)) == (setting.default, type(setting.default)), setting.name


def test_the_page_lists_the_error_codes() -> None:
    source = "".join(file.read_text() for file in (ROOT / "src" / "trailmark" / "ros").glob("*.py"))
    ends = {f"{end}_{what}" for end in ("START", "GOAL") for what in ("OUTSIDE_MAP", "OCCUPIED")}
    others = {"NONE", "UNKNOWN", "TIMEOUT", "NO_VALID_PATH", "TF_ERROR", "NO_VIAPOINTS_GIVEN"}
    assert set(re.findall(r"`(\w+)`", " ".join(rows("Error codes")))) == ends | others
    assert all(f'"{code}"' in source for code in others)


OFFERED = """
import rclpy
rclpy.init(args=["--ros-args", "-r", "__ns:=/here", "-p", "robot_radius:=0.2"])
from trailmark.ros.node import PlannerServer
node = PlannerServer()
kinds = node.get_publisher_names_and_types_by_node, node.get_subscriber_names_and_types_by_node
kinds += (node.get_service_names_and_types_by_node,)
print(*(name for kind in kinds for name, _ in kind("planner_server", "/here")))
rclpy.shutdown()
"""
OF_EACH_NODE = r"/here/planner_server/.*|/rosout|/parameter_events|/clock|/tf|/tf_static"
OF_PACKAGES = {"map_updates", "bond", "is_path_valid", "compute_path_to_pose", "compute_path_through_poses"}
"""What is there only where the packages of their messages are; bond only while the node is active."""


@pytest.mark.slow
@pytest.mark.skipif(find_spec("rclpy") is None, reason="there is no ROS 2 here (rclpy)")
def test_the_page_lists_what_the_node_offers(tmp_path: Path) -> None:
    own = {"ROS_DOMAIN_ID": str(os.getpid() % 100 + 1), "ROS_LOG_DIR": str(tmp_path)}
    local = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    done = subprocess.run(
        [sys.executable, "-c", OFFERED], env=os.environ | own | local, capture_output=True, text=True, timeout=120.0
    )
    assert done.returncode == 0, done.stderr
    names = {name for name in done.stdout.split() if not re.fullmatch(OF_EACH_NODE, name)}
    offered = {name.removeprefix("/here/").partition("/_action/")[0] for name in names}
    listed = set(re.findall(r"`([\w/]+)`", " ".join(rows("Topics, services and actions"))))
    assert offered <= listed
    assert listed - offered <= OF_PACKAGES


def test_the_parameter_file_is_taken() -> None:
    (values,) = yaml.safe_load((LAUNCHED / "planner_server.yaml").read_text()).values()
    given = values["ros__parameters"]
    assert set(given) <= {setting.name for setting in fields(Settings)}
    settings = Settings(**given)
    assert settings.robot.drive == "differential"


def test_the_launch_file_starts_the_node(monkeypatch: pytest.MonkeyPatch) -> None:
    """The launch system is no part of Python's package index: these stand for what the file takes of it."""
    declared: dict[str, str] = {}
    monkeypatch.setitem(sys.modules, "launch", SimpleNamespace(LaunchDescription=list))
    actions = SimpleNamespace(
        DeclareLaunchArgument=lambda name, default_value, description: declared.update({name: default_value}),
        ExecuteProcess=lambda cmd, output: cmd,
    )
    monkeypatch.setitem(sys.modules, "launch.actions", actions)
    substitutions = SimpleNamespace(LaunchConfiguration="{{{}}}".format)
    monkeypatch.setitem(sys.modules, "launch.substitutions", substitutions)
    made: list[Any] = runpy.run_path(str(LAUNCHED / "planner.launch.py"))["generate_launch_description"]()
    words = ["".join(word).format(**declared) for word in made[-1]]
    program, command, *arguments = words
    assert (program, command, arguments[0]) == ("trailmark", "ros", "--ros-args")
    assert arguments[1:7] == ["-r", "__node:=planner_server", "-r", "__ns:=/", "-r", "map:=map"]
    assert Path(arguments[arguments.index("--params-file") + 1]) == LAUNCHED / "planner_server.yaml"
    assert arguments[-4:] == ["-p", "autostart:=true", "-p", "use_sim_time:=false"]
    shown = [shlex.split(line)[3:] for line in PAGE.splitlines() if line.startswith("ros2 launch ")]
    assert len(shown) == 2
    assert all(word.partition(":=")[0] in declared for line in shown for word in line)
