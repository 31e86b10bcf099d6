"""What nav2's own parameter file says of a robot and of how to plan for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from trailmark.errors import FormatError, ShapeError
from trailmark.formats.nav2_params import read_nav2_params
from trailmark.world.robot import Robot

__all__ = ["Nav2Parameters"]


@dataclass(frozen=True)
class Nav2Parameters:
    """A robot and how to plan for it, as nav2 is told.

    Attributes:
        robot: footprint and drive; its clearance is nav2's ``footprint_padding``.
        tolerance: metres that a path may end beside the goal's position; 0 where nothing is said.
        unknown: what unknown cells are (:meth:`trailmark.World.load`); None where nothing is said.
        taken: each parameter that was taken, with its place and value.
    """

    robot: Robot
    tolerance: float
    unknown: Literal["free", "blocked"] | None
    taken: tuple[str, ...]

    @classmethod
    def load(cls, path: str | Path) -> Nav2Parameters:
        """Read a parameter file of nav2 (``nav2_params.yaml``).

        Raises:
            FormatError: the file is missing, no YAML, names no robot, or a parameter has no such value.
        """
        found = read_nav2_params(Path(path))
        try:
            robot = replace(Robot(**found["robot"]), clearance=found["padding"])
        except ShapeError as error:
            raise FormatError(path, str(error)) from None
        allowed = found["allow_unknown"]
        unknown: Literal["free", "blocked"] | None = None if allowed is None else "free" if allowed else "blocked"
        return cls(robot, found["tolerance"] or 0.0, unknown, tuple(found["taken"]))
