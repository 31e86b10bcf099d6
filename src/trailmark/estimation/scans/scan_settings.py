"""The settings by which single scans are segmented, with all defaults."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

from trailmark.checked import Count, NonNegativeOrInfinite, Positive, PositiveOrInfinite, Rule, checked_fields
from trailmark.estimation.errors import EstimationError

__all__ = ["ScanSettings"]


@dataclass(frozen=True)
class ScanSettings:
    """How scans are segmented.

    Raises:
        EstimationError: a value that is not allowed.
    """

    sigma_range: Positive = 0.02
    """Standard deviation of a range, metres (a SICK LMS's: some 1 to 2 cm)."""
    sigma_bearing: Positive = 0.003
    """Standard deviation of a beam's direction, radians: its width, not the step from beam to beam."""
    max_range: PositiveOrInfinite = math.inf
    """Metres: end points farther away are left out."""
    groups: Literal["jump", "dbscan"] = "jump"
    """"jump": neighbours in the sweep that are close together; "dbscan": scikit-learn's DBSCAN."""
    incidence: Positive = field(default=math.radians(10.0))
    """"jump": the smallest angle, radians, between a beam and a continuous surface that it is assumed to meet."""
    eps: Positive = 0.3
    """"dbscan": metres between neighbours."""
    min_samples: Count = 3
    """"dbscan": neighbours, itself included, that make a point belong to a group's core."""
    split: Positive = 0.06
    """Metres that an end point may lie off a line before the line is split."""
    min_points: Annotated[int, Rule("a whole number of 4 or more", lambda v: v >= 4)] = 6
    """End points that a line or a disc needs."""
    min_length: Positive = 0.3
    """Metres that a line needs."""
    line_misfit: PositiveOrInfinite = 4.0
    """Sum of squared residuals over variances, per degree of freedom, that a line may have."""
    disc_radii: tuple[Positive, PositiveOrInfinite] = (0.03, 0.6)
    """Metres: radii that a disc may have, the smaller first."""
    disc_arc: NonNegativeOrInfinite = field(default=math.radians(100.0))
    """Radians of a disc's outline that must be seen."""
    disc_misfit: NonNegativeOrInfinite = 2.0
    """The same of a disc; where a line has no more, it is a line."""

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)
        if not self.disc_radii[0] < self.disc_radii[1]:
            raise EstimationError(f"ScanSettings: disc_radii: expected the smaller first, got {self.disc_radii}")
