"""The numbers of an exploration that a person may want to change."""

from __future__ import annotations

import math
from dataclasses import dataclass

from trailmark.arguments import Positive, PositiveOrInfinite, Probability, checked_fields
from trailmark.errors import ConfigurationError
from trailmark.world.robot import Robot

__all__ = ["ExplorationSettings"]


MAX_CELLS = 4_000_000
"""Cells of the map, at most: each takes about 30 bytes."""

FINEST = 1.0 / 50.0
"""Of the robot's inscribed radius: side of a cell, at least, that comes of dividing others."""


@dataclass(frozen=True)
class ExplorationSettings:
    """How to explore.

    Raises:
        ConfigurationError: a value that is not allowed.
    """

    cell: Positive | None = None
    """Metres: side of a cell of the map; by default a fifth of the robot's inscribed radius, at least 0.02 m and within
    MAX_CELLS: the width of a passage is known to about two cells. Where it has to be known better, cells by default
    are divided, as far as MAX_CELLS and the sensor's noise let them."""
    sense_period: Positive = 0.1
    """Seconds that the robot drives between two readings."""
    confidence: Probability | None = None
    """Probability with which a path is to meet nothing that the noise hides; None: distances are taken as measured."""
    time_limit: PositiveOrInfinite = math.inf
    """Seconds of the robot's clock."""
    distance_limit: PositiveOrInfinite = math.inf
    """Metres driven."""
    planning_time: Positive = 1.0
    """Seconds for a path to a landmark; one that is neither found nor proven impossible is tried again later."""
    return_home: bool = False
    """Whether to drive back to the start at the end."""

    def __post_init__(self) -> None:
        checked_fields(self, ConfigurationError)

    def may_divide(self, robot: Robot, cell: float, count: int) -> bool:
        """Return whether a map's cells may be divided to as many of a side, metres."""
        return self.cell is None and cell >= FINEST * robot.inscribed_disc.radius and count <= MAX_CELLS

    def cell_side(self, robot: Robot, bounds: tuple[float, float, float, float]) -> float:
        """Return the side of the map's cells, metres."""
        if self.cell is not None:
            return self.cell
        xmin, ymin, xmax, ymax = bounds
        fine = max(0.02, robot.inscribed_disc.radius / 5.0)
        return max(fine, math.sqrt((xmax - xmin) * (ymax - ymin) / MAX_CELLS))
