"""The settings of a map made from scans, with every default in sight."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

from trailmark.errors import did_you_mean
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.scans.scan_features import ScanSettings

__all__ = ["MappingSettings"]

Unknown = Literal["blocked", "free"]
Shapes = Literal["fitted", "hulls", "boxes"]


@dataclass(frozen=True)
class MappingSettings:
    """How scans become a world.

    Raises:
        EstimationError: a value that is not allowed.
    """

    scan: ScanSettings = field(default_factory=ScanSettings)
    """How single scans are taken apart."""
    pose_sigma: tuple[float, float] = (0.02, 0.005)
    """Standard deviation of the poses: of x and y each (metres), of theta (radians)."""
    pose_memory: float = math.inf
    """Metres of driving after which the errors of poses are others: within them they do not average out. Infinite for
    dead reckoning; a few metres for poses that a SLAM program has corrected."""
    cell: float = 0.05
    """Side of the grid's cells, metres."""
    clear_range: float = 8.0
    """Metres: how far a beam that met nothing shows space to be free, at most."""
    min_hits: int = 2
    """Beams that must have ended in a cell for it to count as occupied."""
    least_share: float = 0.2
    """The share of the beams that came to a cell that must have ended there: less, and what was there is gone."""
    gate: float = 0.99
    """Probability with which a scan's feature passes the gate of its own track."""
    confirm: int = 3
    """Scans that must have shown a feature; others are dropped."""
    thickness: float = 0.05
    """Metres that walls reach behind the front that was seen."""
    gap: float = 0.3
    """Metres between stretches of a wall that are taken to be joined, unless beams went through there."""
    min_wall: float = 0.2
    """Shortest stretch that becomes a wall, metres."""
    explained: float = 0.1
    """Metres from a wall or disc within which occupied cells are taken to be part of it."""
    crumbs: int = 4
    """Cells of an unknown patch, met by no beam, up to which it counts as free like what is around it."""
    shapes: Shapes = "fitted"
    """What obstacles are drawn as. "fitted": walls as rectangles with thickness, discs, and cells for the rest;
    "hulls": the convex hull of each one's end points; "boxes": their plain box, as in the source's Algorithm 2."""
    unknown: Unknown = "blocked"
    """What nobody looked into, or what is cut off from where the robot was: an obstacle, or free."""

    def __post_init__(self) -> None:
        for name in ("cell", "gap", "min_wall", "thickness", "explained", "least_share", "pose_memory"):
            if not getattr(self, name) > 0.0:
                raise EstimationError(f"{name} {getattr(self, name)!r} given, allowed: above 0")
        if not (min(self.pose_sigma) >= 0.0 and self.clear_range >= 0.0 and 0.0 < self.gate < 1.0):
            raise EstimationError(
                f"pose_sigma, clear_range, gate {self.pose_sigma}, {self.clear_range}, {self.gate} given, allowed: 0 "
                "or more, 0 or more, between 0 and 1"
            )
        if self.min_hits < 1 or self.confirm < 1:
            raise EstimationError(f"min_hits, confirm {self.min_hits}, {self.confirm} given, allowed: 1 or more")
        if self.shapes not in get_args(Shapes):
            raise EstimationError(f"shapes {self.shapes!r} given, {did_you_mean(self.shapes, get_args(Shapes))}")
        if self.unknown not in get_args(Unknown):
            raise EstimationError(f"unknown {self.unknown!r} given, {did_you_mean(self.unknown, get_args(Unknown))}")
