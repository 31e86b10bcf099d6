"""How the poses of scans are found: what depends on sensor and odometry as settings, the rest as constants."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trailmark.arguments import NonNegative, Positive, checked_fields
from trailmark.estimation.errors import EstimationError
from trailmark.se2 import FloatArray

__all__ = [
    "KEY_ANGLE",
    "LOCAL_SCANS",
    "LOOP_AMBIGUITY",
    "LOOP_SCORE",
    "MAX_NODES",
    "OUTLIER_GATE",
    "ROUNDS",
    "WINDOW",
    "GraphSettings",
]

KEY_ANGLE = math.radians(15.0)
"""Radians of rotation from one node of the graph to the next: what is seen has hardly changed in between."""

LOCAL_SCANS = 15
"""Scans of a local map, at most."""

MAX_NODES = 3000
"""Nodes from which on a scan where the graph has one already gets none of its own: memory is bounded by the places
that were seen, not by the time of the drive."""

WINDOW = (0.5, math.radians(20.0))
"""How far from what odometry says a match is searched for at least: metres along x and y each, radians."""

LOOP_SCORE = 0.55
"""Mean likelihood of the end points that a loop closure needs."""

LOOP_AMBIGUITY = 0.9
"""Share of its likelihood that no other place within the window may have."""

ROUNDS = 2
"""How often each scan is matched against the maps of all other visits to its place, and the graph optimised."""

OUTLIER_GATE = 0.999
"""Probability with which a right closure is consistent with another, and with the optimised graph."""


@dataclass(frozen=True)
class GraphSettings:
    """How scans are matched, and loops closed.

    Raises:
        EstimationError: a value that is not allowed.
    """

    scale: Positive = 1.0
    """Times the lengths below, for sensors that see, and robots that drive, farther than those of a building."""
    max_range: Positive = 20.0
    """Metres: end points farther away are not matched. A heading's error of a third of a degree moves them by 0.1 m."""
    scatter: Positive = 0.1
    """Metres by which end points lie off the surfaces that they belong to, one standard deviation: the scanner's noise,
    and what moves, leans or is not flat. As sure is a match; in a world of walls it is the scanner's noise alone."""
    odometry: tuple[NonNegative, NonNegative] = (0.1, 0.1)
    """Standard deviation of odometry: metres for each metre, radians for each radian."""
    odometry_floor: tuple[Positive, Positive] = (0.05, 0.05)
    """The least standard deviation of a step by odometry: metres, radians."""

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)

    @property
    def filled_gap(self) -> float:
        """Metres between neighbouring end points of one straight surface from which on local maps have the line.

        Without it each of such points would count as a shape of its own, the sooner the less they scatter.
        """
        return max(0.1, 8.0 * self.scatter)

    @property
    def key_distance(self) -> float:
        """Metres of motion from one node of the graph to the next: what is seen has hardly changed in between."""
        return 0.4 * self.scale

    @property
    def local_length(self) -> float:
        """Metres of driving over which the scans before one make its local map: beyond, matching has drifted."""
        return 10.0 * self.scale

    @property
    def loop_distance(self) -> float:
        """Metres between two places from which mostly the same is seen."""
        return 8.0 * self.scale

    def odometry_noise(self, step: FloatArray) -> FloatArray:
        """Return the covariance of a step by odometry, x, y and theta, shape (3,), as of shape (3, 3)."""
        (place, heading), (floor, floor_theta) = self.odometry, self.odometry_floor
        length = float(np.hypot(*step[:2]))
        xy = floor**2 + (place * length) ** 2
        return np.diag([xy, xy, floor_theta**2 + (0.5 * heading * length) ** 2 + (heading * step[2]) ** 2])
