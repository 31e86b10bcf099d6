"""The settings by which the poses of scans are found, with all defaults."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from trailmark.checked import Count, NonNegative, Positive, PositiveOrInfinite, Probability, Share, checked_fields
from trailmark.estimation.errors import EstimationError
from trailmark.se2 import FloatArray

__all__ = ["GraphSettings"]


@dataclass(frozen=True)
class GraphSettings:
    """How scans are matched, and loops closed.

    Raises:
        EstimationError: a value that is not allowed.
    """

    max_range: Positive = 20.0
    """Metres: end points farther away are not matched. A heading's error of a third of a degree moves them by 0.1 m."""
    key_distance: Positive = 0.4
    """Metres of motion from one node of the graph to the next: what is seen has hardly changed in between."""
    key_angle: Positive = field(default=math.radians(15.0))
    """Radians of rotation likewise."""
    local_length: Positive = 10.0
    """Metres of driving over which the scans before one make its local map: beyond, matching has drifted."""
    local_scans: Count = 15
    """Scans of a local map, at most."""
    max_nodes: Count = 3000
    """Nodes from which on a scan where the graph has one already gets none of its own: memory is bounded by the places
    that were seen, not by the time of the drive."""
    scatter: Positive = 0.1
    """Metres by which end points lie off the surfaces that they belong to, one standard deviation: the scanner's noise,
    and what moves, leans or is not flat. As sure is a match; in a world of walls it is the scanner's noise alone."""
    filled_gap: PositiveOrInfinite = 0.8
    """Metres between neighbouring end points of one straight surface from which on local maps have the line between
    them. Without it each of such points would count as a shape of its own."""
    window: tuple[Positive, Positive] = (0.5, math.radians(20.0))
    """How far from what odometry says a match is searched for at least: metres along x and y each, radians."""
    odometry: tuple[NonNegative, NonNegative] = (0.1, 0.1)
    """Standard deviation of odometry: metres for each metre, radians for each radian."""
    odometry_floor: tuple[Positive, Positive] = (0.05, 0.05)
    """The least standard deviation of a step by odometry: metres, radians."""
    loop_distance: Positive = 8.0
    """Metres between two places from which mostly the same is seen."""
    loop_score: Share = 0.55
    """Mean likelihood of the end points that a loop closure needs."""
    loop_ambiguity: Share = 0.9
    """Share of its likelihood that no other place within the window may have."""
    rounds: Count = 2
    """How often each scan is matched against the maps of all other visits to its place, and the graph optimised."""
    outlier_gate: Probability = 0.999
    """Probability with which a right closure is consistent with another, and with the optimised graph."""

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)

    def odometry_noise(self, step: FloatArray) -> FloatArray:
        """Return the covariance of a step by odometry, x, y and theta, shape (3,), as of shape (3, 3)."""
        (place, heading), (floor, floor_theta) = self.odometry, self.odometry_floor
        length = float(np.hypot(*step[:2]))
        xy = floor**2 + (place * length) ** 2
        return np.diag([xy, xy, floor_theta**2 + (0.5 * heading * length) ** 2 + (heading * step[2]) ** 2])
