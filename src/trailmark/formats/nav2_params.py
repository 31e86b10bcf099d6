"""nav2's own parameter file: what it says of the robot and of planning, and where it says so."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from trailmark.arguments import brief, real
from trailmark.errors import FormatError, expected_name
from trailmark.formats.files import read_text
from trailmark.formats.robot_yaml import read_robot
from trailmark.formats.yaml_data import parse_yaml
from trailmark.shapes import Disc

__all__ = ["read_nav2_params"]

CAR_MODELS = {"DUBIN": False, "REEDS_SHEPP": True}
"""Of Smac's hybrid planner: whether the car reverses. The first is nav2's default, as is the radius."""
RADIUS = 0.4

PLANNER = "GridBased"
"""nav2's name of the first planner where none is given."""

DRIVES = {"diff": "differential", "omni": "omnidirectional"}
"""How the names of amcl's and of the controllers' motion models begin, and the drives that they are."""


def read_nav2_params(path: Path) -> dict[str, Any]:
    """Return what a nav2 parameter file says.

    The robot is the costmaps' ``footprint`` or ``robot_radius`` (:func:`trailmark.formats.robot_yaml.read_robot`), a
    car if the first planner is Smac's hybrid one, else driven as amcl's or the controller's motion model says.

    Returns:
        ``robot``: arguments of :class:`trailmark.Robot`; ``padding``: metres by which nav2 pads the footprint;
        ``allow_unknown`` and ``tolerance`` (metres) of the first planner, None where not given; ``taken``: a text for
        each parameter that was taken, with its place.

    Raises:
        FormatError: the file is missing, no YAML, names no robot, or a parameter has no such value.
    """
    robot = read_robot(path)
    values = dict(_flat(parse_yaml(read_text(path), path), ""))
    taken = list[str]()

    def find(*ends: str) -> tuple[str, Any]:
        """Return the place and value of the first parameter whose place ends so, the global costmap's before others."""
        places = [place for place in values if f".{place}".endswith(ends)]
        place = min(places, key=lambda place: "global_costmap" not in place, default="")
        if place:
            taken.append(f"{place} {brief(values[place])}")
        return place, values.get(place)

    def length(place: str, value: Any, allowed: str, low: float) -> float:
        if isinstance(value, bool) or not low <= real(value) < float("inf"):
            raise FormatError(path, f"{place}: expected {allowed} (metres), got {brief(value)}")
        return real(value)

    find(".robot_radius" if isinstance(robot["footprint"], Disc) else ".footprint")
    place, padding = find(".footprint_padding")
    padding = length(place, padding, "0 or more", 0.0) if place else 0.0
    _, plugins = find(".planner_plugins")
    planner = f".{plugins[0] if isinstance(plugins, list) and plugins else PLANNER}."
    _, plugin = find(f"{planner}plugin")
    if "Hybrid" in str(plugin):
        place, radius = find(f"{planner}minimum_turning_radius")
        robot["turning_radius"] = length(place, radius, "a number above 0", 1e-6) if place else RADIUS
        place, model = find(f"{planner}motion_model_for_search")
        name = str(model).upper() if place else "DUBIN"
        if name not in CAR_MODELS:
            raise FormatError(path, f"{place}: {expected_name(name, CAR_MODELS)}")
        robot["reverse"] = CAR_MODELS[name]
    else:
        _, model = find(".robot_model_type", ".motion_model")
        begin = str(model).rpartition("::")[2].lower()[:4]
        robot |= {"drive": DRIVES[begin]} if begin in DRIVES else {}
    place, unknown = find(f"{planner}allow_unknown")
    if place and not isinstance(unknown, bool):
        raise FormatError(path, f"{place}: expected true or false, got {brief(unknown)}")
    place, tolerance = find(f"{planner}tolerance")
    tolerance = length(place, tolerance, "0 or more", 0.0) if place else None
    return {"robot": robot, "padding": padding, "allow_unknown": unknown, "tolerance": tolerance, "taken": taken}


def _flat(data: Any, where: str) -> Iterator[tuple[str, Any]]:
    """Yield each parameter's place, without ``ros__parameters``, and its value."""
    if not isinstance(data, dict):
        yield where.removesuffix("."), data
        return
    for key, value in data.items():
        yield from _flat(value, where if key == "ros__parameters" else f"{where}{key}.")
