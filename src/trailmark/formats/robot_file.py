"""Robots in YAML files: as world files have them, and as the parameters of nav2 and move_base have them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from trailmark.arguments import brief, real
from trailmark.errors import FormatError, ShapeError
from trailmark.formats.files import read_text
from trailmark.formats.schema import RobotFile, validate
from trailmark.formats.world_yaml import robot_from_entry
from trailmark.formats.yaml_data import parse_yaml
from trailmark.robot import Robot

__all__ = ["read_robot"]

_ALLOWED = "expected a robot {shape: ...}, a world with one, or parameters with footprint or robot_radius"


def read_robot(path: Path) -> Robot:
    """Return the robot that a YAML file describes.

    - ``shape: rectangle`` and so on, as under ``robot`` in a world file; or a mapping with the key ``robot``, such as a
      world file.
    - Parameters of nav2 or of ROS 1's move_base: a ``footprint`` (a text or a list) that is not empty, else
      ``robot_radius``, at any depth. Where costmaps differ, the global one's counts, in which nav2 plans.
      ``footprint_padding`` is left out: it is a margin, not the robot.

    Raises:
        FormatError: the file is missing, is not YAML, holds no robot, or several different ones.
    """
    data = parse_yaml(read_text(path, _ALLOWED), path)
    entry = data.get("robot", data) if isinstance(data, dict) else None
    try:
        if isinstance(entry, dict) and "shape" in entry:
            return robot_from_entry(validate(RobotFile, {"robot": entry}, path).robot)
        found = dict(_parameters(data, ""))
    except ShapeError as error:
        raise FormatError(path, f"robot: {error}") from None
    # Nodes' names may have a namespace before them: /robot1/global_costmap.
    chosen = {where: robot for where, robot in found.items() if "global_costmap" in where} or found
    if not chosen:
        raise FormatError(path, f"no robot: {_ALLOWED}")
    (where, robot), *others = chosen.items()
    for other, another in others:
        if another != robot:
            raise FormatError(path, f"expected one robot, got different ones at {where} and {other}")
    return robot


def _parameters(data: Any, where: str) -> Iterator[tuple[str, Robot]]:
    """Yield the robots that mappings hold, each with its place in the file."""
    if not isinstance(data, dict):
        return
    footprint, radius = data.get("footprint"), data.get("robot_radius")
    if isinstance(footprint, str | list) and footprint not in ("", "[]", []):
        yield where or "footprint", _of_footprint(footprint, f"{where}footprint")
    elif radius is not None:
        if not real(radius) > 0.0:
            raise ShapeError(f"{where}robot_radius: expected a number above 0 (metres), got {brief(radius)}")
        yield where or "robot_radius", Robot.disc(real(radius))
    for key, value in data.items():
        yield from _parameters(value, f"{where}{key}.")


def _of_footprint(footprint: str | list[Any], where: str) -> Robot:
    try:
        return Robot.parse(footprint) if isinstance(footprint, str) else Robot.polygon(footprint)
    except ShapeError as error:
        raise ShapeError(f"{where}: {error}") from None
