"""What is known of a scanner: its noise, and how far to trust it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from trailmark.checked import Positive, PositiveOrInfinite, checked_fields
from trailmark.estimation.errors import EstimationError

__all__ = ["ScanSettings"]


@dataclass(frozen=True)
class ScanSettings:
    """What is known of a scanner.

    Raises:
        EstimationError: a value that is not allowed.
    """

    sigma_range: Positive = 0.02
    """Standard deviation of a range, metres (a SICK LMS's: some 1 to 2 cm)."""
    sigma_bearing: Positive = 0.003
    """Standard deviation of a beam's direction, radians: its width, not the step from beam to beam."""
    max_range: PositiveOrInfinite = math.inf
    """Metres: end points farther away are left out."""

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)
