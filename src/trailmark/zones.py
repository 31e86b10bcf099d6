"""Zones of a world: where a metre costs more or less, where no robot may be, which way it may go, and how fast.

A zone is the region of a polygon, its outline included, convex or not, with holes or without. Zones may overlap one
another, obstacles and the bounds: cost factors then multiply, the lowest speed limit holds, and a direction of travel
has to suit every one-way zone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from trailmark.arguments import number, warn_of_degrees
from trailmark.errors import WorldError
from trailmark.se2 import wrap
from trailmark.shapes import Polygon, shape_of

__all__ = ["CostZone", "KeepOutZone", "OneWayZone", "SpeedZone", "Zone"]


@dataclass(frozen=True)
class _Zone:
    """What all zones have: a region, and a kind, by which world files tell them apart."""

    region: Polygon

    def __post_init__(self) -> None:
        region = shape_of(self.region, "zone: region")
        object.__setattr__(self, "region", region if isinstance(region, Polygon) else Polygon(region))

    def _check(self, name: str, **limits: float) -> None:
        value = number(getattr(self, name), f"zone: {name}:", error=WorldError, **limits)  # type: ignore[arg-type]
        object.__setattr__(self, name, value)


@dataclass(frozen=True)
class CostZone(_Zone):
    """Where a metre that the reference point travels costs ``factor`` metres: above 1 to avoid, below 1 to prefer.

    Attributes:
        region: a :class:`trailmark.Polygon`, or its vertices, shape (n, 2), metres.
        factor: from 0.1 to 1e6: with a factor of 0 a path could go on in circles for nothing.

    Raises:
        ShapeError: vertices that bound no region.
        WorldError: a factor out of range.
    """

    factor: float
    kind: ClassVar[str] = "cost"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("factor", minimum=0.1, maximum=1e6)


@dataclass(frozen=True)
class KeepOutZone(_Zone):
    """Where no part of the robot may be; it may touch the outline. A robot that starts inside may leave.

    On its way out it gets deeper in no zone, and it does not come back into one that it left.

    Attributes:
        region: a :class:`trailmark.Polygon`, or its vertices, shape (n, 2), metres.

    Raises:
        ShapeError: vertices that bound no region.
    """

    kind: ClassVar[str] = "keep-out"


@dataclass(frozen=True)
class OneWayZone(_Zone):
    """Where the robot's reference point may only travel along a heading, within a tolerance.

    It is the direction of travel that counts, not where the robot points. Turning in place is allowed, and so is
    touching the outline or travelling along it.

    Attributes:
        region: a :class:`trailmark.Polygon`, or its vertices, shape (n, 2), metres.
        heading: radians, counter-clockwise from the x axis; brought into (-pi, pi].
        tolerance: radians, 0 to pi, by which the direction of travel may differ from the heading.

    Raises:
        ShapeError: vertices that bound no region.
        WorldError: a heading that is not finite, a tolerance out of range.
    """

    heading: float
    tolerance: float
    kind: ClassVar[str] = "one-way"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("heading")
        self._check("tolerance", minimum=0.0, maximum=math.pi)
        warn_of_degrees(self.heading, "one-way zone: heading")
        object.__setattr__(self, "heading", float(wrap(self.heading)))


@dataclass(frozen=True)
class SpeedZone(_Zone):
    """Where the robot's reference point may not travel faster than a limit.

    Attributes:
        region: a :class:`trailmark.Polygon`, or its vertices, shape (n, 2), metres.
        limit: metres per second, above 0.

    Raises:
        ShapeError: vertices that bound no region.
        WorldError: a limit that is not a finite number above 0.
    """

    limit: float
    kind: ClassVar[str] = "speed"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check("limit", above=0.0)


Zone = CostZone | KeepOutZone | OneWayZone | SpeedZone
