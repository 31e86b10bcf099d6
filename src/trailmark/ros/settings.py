"""The node's parameters: names, defaults, descriptions, and what they make of the robot and the planner."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

from trailmark import Objective, Robot, World
from trailmark.arguments import brief
from trailmark.errors import ConfigurationError, expected_name
from trailmark.world.zones import Zone

__all__ = ["Settings"]

MOTION_MODELS = ("omnidirectional", "differential", "dubins", "reeds_shepp")


def _setting(default: Any, about: str, low: float | None = None, high: float | None = None) -> Any:
    return field(default=default, metadata={"about": about, "low": low, "high": high})


@dataclass(frozen=True)
class Settings:
    """Parameters of the node by their ROS names; those of nav2 mean what they mean there.

    Raises:
        ConfigurationError: a value out of range, no footprint, or a file that cannot be read.
    """

    autostart: bool = _setting(True, "configure and activate at once, without a lifecycle manager")
    footprint: str = _setting("", "the robot's outline '[[x, y], ...]' in metres")
    robot_radius: float = _setting(0.0, "metres: a round robot's, where there is no footprint", 0.0, 1e3)
    motion_model: str = _setting("omnidirectional", ", ".join(MOTION_MODELS))
    minimum_turning_radius: float = _setting(0.4, "metres: of dubins and reeds_shepp", 1e-3, 1e4)
    clearance: float = _setting(0.0, "metres that every path keeps from all obstacles", 0.0, 1e3)
    objective: str = _setting("", "length, time, clearance, or name=weight pairs; empty: length and a car's maneuvers")
    tolerance: float = _setting(0.0, "metres that a path may end away from a goal's position", 0.0, 1e3)
    escape: bool = _setting(False, "lead a robot that stands in an obstacle out of it first, never deeper")
    time_limit: float = _setting(1.0, "seconds to find a path or the proof that there is none", 1e-3, 3600.0)
    improvement_time: float = _setting(0.003, "seconds to go on bettering a path once there is one", 0.0, 3600.0)
    lethal_cost_threshold: int = _setting(100, "cells of this value or more are occupied", 1, 100)
    allow_unknown: bool = _setting(False, "take unknown cells for free")
    zones_file: str = _setting("", "world file (YAML) whose zones hold: cost, keep-out, one-way, speed")
    path_spacing: float = _setting(0.1, "metres between the poses of a published path", 1e-3, 1e3)
    robot_base_frame: str = _setting("base_link", "the robot's frame, whose pose tf tells")

    def __post_init__(self) -> None:
        for name, value in self.checked(vars(self)).items():
            object.__setattr__(self, name, value)
        if self.footprint or self.robot_radius:  # else it must be set before it is configured
            _ = self.robot, self.zones, self.planner_objective  # says what is wrong with them

    @classmethod
    def checked(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return those of some values that settings have, in their types.

        Raises:
            ConfigurationError: a value out of range or of another type.
        """
        return {one.name: _checked(one, values[one.name]) for one in fields(cls) if one.name in values}

    @cached_property
    def robot(self) -> Robot:
        """The robot that paths are for."""
        if not self.footprint and self.robot_radius == 0.0:
            raise ConfigurationError("expected a footprint '[[x, y], ...]' or a robot_radius above 0, got neither")
        shape = (Robot.parse(self.footprint) if self.footprint else Robot.disc(self.robot_radius)).footprint
        if self.motion_model in ("omnidirectional", "differential"):
            return Robot(shape, drive=self.motion_model)  # type: ignore[arg-type]  # one of two
        return Robot(shape, self.minimum_turning_radius, reverse=self.motion_model == "reeds_shepp")

    @cached_property
    def planner_objective(self) -> Objective:
        """What paths cost."""
        return Objective.of(self.objective or None, self.robot)

    @cached_property
    def zones(self) -> tuple[Zone, ...]:
        """Where a path costs more, must not lead, has one direction or a speed limit."""
        return World.load(self.zones_file).zones if self.zones_file else ()


def _checked(setting: Any, value: Any) -> Any:
    """Return a parameter's value in its type, or say what is wrong with it."""
    kind, low, high = type(setting.default), setting.metadata["low"], setting.metadata["high"]
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind:
        names = {bool: "true or false", str: "a text", float: "a number", int: "a whole number"}
        raise ConfigurationError(f"{setting.name}: expected {names[kind]}, got {brief(value)}")
    if low is not None and not low <= value <= high:
        raise ConfigurationError(f"{setting.name}: expected {low:g} to {high:g}, got {value:g}")
    if setting.name == "motion_model":
        value = {"dubin": "dubins"}.get(value.lower(), value.lower())  # as nav2 writes it
        if value not in MOTION_MODELS:
            raise ConfigurationError(f"motion_model: {expected_name(value, MOTION_MODELS)}")
    return value
