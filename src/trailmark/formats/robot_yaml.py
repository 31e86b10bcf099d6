"""Robots as shell arguments and YAML files describe them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.arguments import brief, one_of, real
from trailmark.errors import FormatError, ShapeError
from trailmark.formats.yaml_data import read_yaml
from trailmark.shapes import Disc, Polygon, Rectangle, Shape

if TYPE_CHECKING:
    from trailmark.formats import schema

__all__ = ["parse_footprint", "read_robot", "robot_fields"]


def parse_footprint(text: str) -> Shape:
    """Return the footprint that a shell argument describes; :meth:`trailmark.Robot.parse` says how.

    Raises:
        ShapeError: anything else.
    """
    kind, _, rest = one_of(text, str, "robot:", error=ShapeError).strip().partition(":")
    try:
        if kind in ("disc", "robot_radius"):
            return Disc((0.0, 0.0), float(rest))
        if kind == "rectangle":
            length, width = (float(v) for v in rest.split("x"))
            return Rectangle((0.0, 0.0), length, width)
        points = rest.split(";") if kind == "polygon" else re.findall(r"\[([^][]*)\]", text)
        if kind == "polygon" or re.sub(r"\[[^][]*\]|[\s,]", "", text) == "[]":
            return Polygon(np.array([[float(v) for v in point.split(",")] for point in points]))
    except ShapeError:
        raise
    except ValueError:
        pass
    allowed = "disc:RADIUS, rectangle:LENGTHxWIDTH, polygon:x,y;x,y;x,y or [[x, y], ...] (metres)"
    raise ShapeError(f"expected {allowed}, got robot {brief(text)}")


def robot_fields(entry: schema.DiscRobot | schema.RectangleRobot | schema.PolygonRobot) -> dict[str, Any]:
    """Return a world file's ``robot`` as arguments of :class:`trailmark.Robot`."""
    shape: Shape
    if entry.shape == "disc":
        shape = Disc((0.0, 0.0), entry.radius)
    elif entry.shape == "rectangle":
        shape = Rectangle((0.0, 0.0), entry.length, entry.width)
    else:
        shape = Polygon(entry.vertices)  # type: ignore[arg-type]  # it makes arrays itself
    # What is not given is as the rest says.
    given = {"turning_radius": entry.turning_radius, "reverse": entry.reverse, "drive": entry.drive}
    return {"footprint": shape, **given}


_ALLOWED = "expected a robot {shape: ...}, a world with one, or parameters with footprint or robot_radius"


def read_robot(path: Path) -> dict[str, Any]:
    """Return what a YAML file says of a robot, as arguments of :class:`trailmark.Robot`.

    - ``shape: rectangle`` and so on, as under ``robot`` in a world file; or a mapping with the key ``robot``, such as a
      world file.
    - Parameters of nav2 or of ROS 1's move_base: a ``footprint`` (a text or a list) that is not empty, else
      ``robot_radius``, at any depth. Where costmaps differ, the global one's counts, in which nav2 plans.
      ``footprint_padding`` is left out: it is a margin, not the robot.

    Raises:
        FormatError: the file is missing, is not YAML, holds no robot, or several different ones.
    """
    from trailmark.formats.schema import RobotFile, validate

    data = read_yaml(path, _ALLOWED)
    entry = data.get("robot", data) if isinstance(data, dict) else None
    try:
        if isinstance(entry, dict) and "shape" in entry:
            return robot_fields(validate(RobotFile, {"robot": entry}, path).robot)
        found = dict(_parameters(data, ""))
    except ShapeError as error:
        raise FormatError(path, f"robot: {error}") from None
    # Nodes' names may have a namespace before them: /robot1/global_costmap.
    chosen = {where: shape for where, shape in found.items() if "global_costmap" in where} or found
    if not chosen:
        raise FormatError(path, f"no robot: {_ALLOWED}")
    (where, footprint), *others = chosen.items()
    for other, another in others:
        if another != footprint:
            raise FormatError(path, f"expected one robot, got different ones at {where} and {other}")
    return {"footprint": footprint}


def _parameters(data: Any, where: str) -> Iterator[tuple[str, Shape]]:
    """Yield the robots' footprints that mappings hold, each with its place in the file."""
    if not isinstance(data, dict):
        return
    footprint, radius = data.get("footprint"), data.get("robot_radius")
    if isinstance(footprint, str | list) and footprint not in ("", "[]", []):
        yield where or "footprint", _of_footprint(footprint, f"{where}footprint")
    elif radius is not None:
        if not real(radius) > 0.0:
            raise ShapeError(f"{where}robot_radius: expected a number above 0 (metres), got {brief(radius)}")
        yield where or "robot_radius", Disc((0.0, 0.0), real(radius))
    for key, value in data.items():
        yield from _parameters(value, f"{where}{key}.")


def _of_footprint(footprint: str | list[Any], where: str) -> Shape:
    try:
        return parse_footprint(footprint) if isinstance(footprint, str) else Polygon(footprint)  # type: ignore[arg-type]  # it makes arrays itself
    except ShapeError as error:
        raise ShapeError(f"{where}: {error}") from None
