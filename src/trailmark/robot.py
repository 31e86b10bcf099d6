"""Robot: a footprint, and how it may move."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from trailmark import se2
from trailmark.arguments import brief, number, one_of, truth
from trailmark.errors import ShapeError, expected_name
from trailmark.shapes import Disc, Polygon, Rectangle, Shape, shape_of
from trailmark.shown import Shown

__all__ = ["DRIVES", "TURNING_LIMIT", "Drive", "Robot"]

TURNING_LIMIT = 1e4
"""Metres: curves of a larger turning radius would miss their ends by more than rounding."""

Drive = Literal["omnidirectional", "differential", "car"]
DRIVES = get_args(Drive)

MAX_CLEARANCE = 1e7
"""Metres: no world is larger."""


@dataclass(frozen=True)
class Robot(Shown):
    """A robot: its footprint in its own frame, whose origin is the reference point that a configuration places.

    Attributes:
        footprint: a disc or a rectangle centred on the reference point, or any simple polygon without holes.
        turning_radius: of a car-like robot: metres, radius of the smallest circle that its reference point, which moves
            along the heading, can drive on. None: the robot turns in place.
        reverse: whether a robot that drives along its heading drives backwards too: by default a car does, a
            differential drive does not.
        clearance: metres that it keeps from obstacles, bounds and boundary: it collides with what is nearer. World
            files hold none; planners and checkers take it as an argument.
        drive: ``omnidirectional`` (it moves in every direction), ``differential`` (it turns in place and drives along
            its heading) or ``car``; by default a car if there is a turning radius, else omnidirectional.

    Raises:
        ShapeError: a footprint with holes, a disc or rectangle that is not centred on the reference point, a turning
            radius or a clearance out of range, another drive or one that does not go with the turning radius, or
            ``reverse`` False for a robot that moves in every direction.
    """

    footprint: Shape
    turning_radius: float | None = None
    reverse: bool = None  # type: ignore[assignment]  # known once it is made
    clearance: float = 0.0
    drive: Drive = None  # type: ignore[assignment]  # known once it is made

    def __post_init__(self) -> None:
        self._check_steering()
        kept = number(self.clearance, "robot: clearance", minimum=0.0, maximum=MAX_CLEARANCE, error=ShapeError)
        hint = " (from text: Robot.parse('disc:1'))" if isinstance(self.footprint, str) else ""
        shape = shape_of(self.footprint, "robot: footprint")
        one_of(shape, (Disc, Rectangle, Polygon), "robot: footprint:", hint=hint, error=ShapeError)
        if isinstance(shape, Polygon):
            if shape.holes:
                raise ShapeError(f"robot: expected a polygon without holes, got one with {len(shape.holes)}")
        elif shape.center != (0.0, 0.0) or (isinstance(shape, Rectangle) and shape.heading != 0.0):
            raise ShapeError("robot: disc and rectangle lie centred on the reference point, unrotated")
        self.__dict__.update(clearance=kept, footprint=shape)

    @classmethod
    def disc(cls, radius: float) -> Robot:
        """Return a round robot; ``radius`` in metres."""
        return cls(Disc((0.0, 0.0), radius))

    @classmethod
    def rectangle(cls, length: float, width: float) -> Robot:
        """Return a rectangular robot centred on its reference point, ``length`` along its heading, in metres."""
        return cls(Rectangle((0.0, 0.0), length, width))

    @classmethod
    def polygon(cls, vertices: Sequence[Sequence[float]] | se2.FloatArray) -> Robot:
        """Return a robot with any simple outline; ``vertices`` of shape (n, 2), metres, robot frame."""
        return cls(Polygon(vertices))  # type: ignore[arg-type]  # it makes arrays itself

    @classmethod
    def parse(cls, text: str) -> Robot:
        """Return the robot that a shell argument names.

        Args:
            text: ``disc:RADIUS``, ``rectangle:LENGTHxWIDTH``, ``polygon:x,y;x,y;x,y…``, or as nav2 has it
                ``robot_radius:RADIUS`` or a footprint ``[[x, y], [x, y], …]``; metres.

        Raises:
            ShapeError: anything else.
        """
        kind, _, rest = one_of(text, str, "robot:", error=ShapeError).strip().partition(":")
        try:
            if kind in ("disc", "robot_radius"):
                return cls.disc(float(rest))
            if kind == "rectangle":
                length, width = (float(v) for v in rest.split("x"))
                return cls.rectangle(length, width)
            points = rest.split(";") if kind == "polygon" else re.findall(r"\[([^][]*)\]", text)
            if kind == "polygon" or re.sub(r"\[[^][]*\]|[\s,]", "", text) == "[]":
                return cls.polygon(np.array([[float(v) for v in point.split(",")] for point in points]))
        except ShapeError:
            raise
        except ValueError:
            pass
        allowed = "disc:RADIUS, rectangle:LENGTHxWIDTH, polygon:x,y;x,y;x,y or [[x, y], ...] (metres)"
        raise ShapeError(f"expected {allowed}, got robot {brief(text)}")

    @classmethod
    def load(cls, path: str | Path) -> Robot:
        """Read a robot from a YAML file.

        Args:
            path: a robot as world files have it (``shape: rectangle`` …), a world file with one, or parameters of nav2
                or move_base with ``footprint`` or ``robot_radius`` (:func:`trailmark.formats.world_yaml.read_robot`).

        Raises:
            FormatError: the file is missing, is not YAML, or holds no robot.
        """
        from trailmark.formats.world_yaml import read_robot

        return read_robot(Path(path))

    @cached_property
    def outline(self) -> Polygon:
        """The footprint as a polygon; a disc's contains it and reaches at most 1 mm (or 0.1 % of r) beyond."""
        tolerance = min(1e-3, 1e-3 * self.footprint.radius) if isinstance(self.footprint, Disc) else 0.0
        return self.footprint.polygon(tolerance)

    @cached_property
    def circumradius(self) -> float:
        """Largest distance (metres) from the reference point of a point of the footprint, dilated by the clearance."""
        return (self.footprint.radius if isinstance(self.footprint, Disc) else self.sweep_radius) + self.clearance

    @cached_property
    def sweep_radius(self) -> float:
        """R in the motion bound ‖Δxy‖ + R·|Δθ| (metres): the outline's reach; 0 for a disc, which turns in place."""
        return 0.0 if isinstance(self.footprint, Disc) else float(np.hypot(*self.outline.vertices.T).max())

    @cached_property
    def inscribed_disc(self) -> Disc:
        """The largest disc inside the footprint (robot frame), dilated by the clearance; 1e-6 too small at most."""
        if isinstance(self.footprint, Disc):
            return replace(self.footprint, radius=self.footprint.radius + self.clearance)
        import shapely

        region = self.outline.shapely()
        line = shapely.maximum_inscribed_circle(region, tolerance=1e-6 * self.circumradius)
        center = shapely.get_coordinates(line)[0]
        # The distance is measured again from the centre, so that it is right whatever the search's tolerance.
        radius = float(shapely.distance(shapely.Point(center), region.exterior))
        return Disc((float(center[0]), float(center[1])), radius + self.clearance)

    @cached_property
    def reference_radius(self) -> float:
        """Radius (metres) of the largest disc about the reference point inside the footprint; 0 if it lies outside."""
        if isinstance(self.footprint, Disc):
            return self.footprint.radius
        import shapely

        region, origin = self.outline.shapely(), shapely.Point(0.0, 0.0)
        return float(shapely.distance(origin, region.exterior)) if region.contains(origin) else 0.0

    def steered(self, turning_radius: float | None, reverse: bool = True) -> Robot:
        """Return a car of the same shape with a turning radius (metres), or one that moves in every direction."""
        return replace(self, turning_radius=turning_radius, reverse=reverse, drive=None)  # type: ignore[arg-type]  # as the radius says

    def differential(self, reverse: bool = False) -> Robot:
        """Return a robot of the same shape that turns in place and drives along its heading, backwards too if asked."""
        return replace(self, turning_radius=None, reverse=reverse, drive="differential")

    @property
    def heading_matters(self) -> bool:
        """Whether the heading makes a difference to how it may move: not for a disc that moves in every direction."""
        return self.drive != "omnidirectional" or not isinstance(self.footprint, Disc)

    def keeping(self, clearance: float) -> Robot:
        """Return a robot of the same shape that keeps a clearance, metres."""
        return self if clearance == self.clearance else replace(self, clearance=clearance)

    def describe(self) -> str:
        """Return a short text such as ``rectangle 0.6 x 0.4 m``."""
        shape = self.footprint
        if isinstance(shape, Disc):
            text = f"disc {shape.radius:g} m"
        elif isinstance(shape, Rectangle):
            text = f"rectangle {shape.length:g} x {shape.width:g} m"
        else:
            text = f"polygon of {len(shape.vertices)} vertices"
        if self.drive == "differential":
            text += ", differential drive" + (", in reverse too" if self.reverse else "")
        if self.turning_radius is not None:
            text += f", turning radius {self.turning_radius:g} m" + ("" if self.reverse else ", forward only")
        return text + (f", clearance {self.clearance:g} m" if self.clearance > 0.0 else "")

    def _check_steering(self) -> None:
        radius: Any = self.turning_radius
        if radius is not None:
            name = "robot: turning_radius"
            radius = number(radius, name, above=0.0, maximum=TURNING_LIMIT, unit="m", error=ShapeError)
        drive: Any = self.drive if self.drive is not None else "omnidirectional" if radius is None else "car"
        if not isinstance(drive, str) or drive not in DRIVES:
            raise ShapeError(f"robot: drive: {expected_name(str(drive), DRIVES)}")
        if (drive == "car") != (radius is not None):
            given = f"turning_radius {radius} with {drive!r}"
            raise ShapeError(f"robot: expected a turning radius with drive 'car' and no other, got {given}")
        reverse: Any = drive != "differential" if self.reverse is None else self.reverse
        reverse = truth(reverse, "robot: reverse", error=ShapeError)
        if drive == "omnidirectional" and not reverse:
            raise ShapeError("robot: expected a turning radius with reverse False, got none")
        self.__dict__.update(turning_radius=radius, reverse=reverse, drive=drive)
