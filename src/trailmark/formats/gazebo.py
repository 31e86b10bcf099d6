"""Gazebo worlds (``.world``, SDF): the cylinders and boxes that stand on the plane, seen from above.

Read are the collision shapes of the world's models, placed by the poses of model, link and collision, one after the
other. Planes (the ground) are passed over, and so is a recorded ``<state>``.

Source: Open Robotics, SDFormat specification 1.6.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element

from trailmark.errors import FormatError, ShapeError
from trailmark.formats.xml_file import local_name, read_xml
from trailmark.shapes import Disc, Rectangle, Shape

__all__ = ["read_gazebo_shapes"]

UPRIGHT = 1e-3
"""Radians by which a shape may lean: it is taken as upright then."""

Placement = tuple[float, float, float]
"""x, y (metres) and yaw (radians)."""


def read_gazebo_shapes(path: Path) -> tuple[Shape, ...]:
    """Return the obstacles of a Gazebo world in the plane, in the order of the file.

    Raises:
        FormatError: the file is missing, no XML, no SDF with a world, or holds a shape that leans, or one other than
            cylinders, boxes, spheres and planes.
    """
    root = read_xml(path)
    world = root.find("world")
    if local_name(root) != "sdf" or world is None:
        raise FormatError(path, f"expected <sdf> with a <world>, got <{local_name(root)}>")
    found: list[Shape] = []
    try:
        for model in world.iterfind("model"):
            at = _placed((0.0, 0.0, 0.0), model)
            for link in model.iterfind("link"):
                for collision in link.iterfind("collision"):
                    found += _shapes(_placed(_placed(at, link), collision), collision)
    except (ShapeError, ValueError) as error:
        raise FormatError(path, str(error)) from None
    return tuple(found)


def _placed(frame: Placement, element: Element) -> Placement:
    """Return where an element's own pose, given in a frame, puts it."""
    values = _numbers(element.findtext("pose") or "0 0 0 0 0 0", 6, "pose")
    x, y, _, roll, pitch, yaw = values
    if max(abs(math.remainder(roll, math.tau)), abs(math.remainder(pitch, math.tau))) > UPRIGHT:
        given = f"roll {roll:g}, pitch {pitch:g}"
        raise ShapeError(f"{element.tag} {element.get('name')!r}: expected an upright pose, got {given}")
    x0, y0, turn = frame
    cos, sin = math.cos(turn), math.sin(turn)
    return x0 + cos * x - sin * y, y0 + sin * x + cos * y, turn + yaw


def _shapes(at: Placement, collision: Element) -> Iterator[Shape]:
    x, y, yaw = at
    for shape in collision.iterfind("geometry/*"):
        if shape.tag in ("cylinder", "sphere"):
            (radius,) = _numbers(shape.findtext("radius") or "", 1, f"{shape.tag}: radius")
            yield Disc((x, y), radius)
        elif shape.tag == "box":
            length, width, _ = _numbers(shape.findtext("size") or "", 3, "box: size")
            yield Rectangle((x, y), length, width, yaw)
        elif shape.tag != "plane":
            raise ShapeError(f"geometry: expected a cylinder, box, sphere or plane, got <{shape.tag}>")


def _numbers(text: str, count: int, name: str) -> list[float]:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise ShapeError(f"{name}: expected {count} finite numbers, got {text.strip()!r}")
    return values
