"""A robot and planning options from nav2's own parameter file."""

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
    """A robot and planning options, as nav2 has them.

    Attributes:
        robot: footprint and drive; its clearance is nav2's ``footprint_padding``.
        tolerance: distance from the goal at which a path may end, metres; 0 if the file does not say.
        unknown: how unknown cells count (:meth:`trailmark.World.load`); None if the file does not say.
        taken: each parameter that was used, with its place and value.
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
