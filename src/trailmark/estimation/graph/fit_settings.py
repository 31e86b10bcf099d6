"""What a batch estimate takes for granted, with every default in sight."""

from __future__ import annotations

from dataclasses import dataclass

from trailmark.checked import Count, NonNegative, Positive, Probability, checked_fields
from trailmark.estimation.errors import EstimationError

__all__ = ["FitSettings"]


@dataclass(frozen=True)
class FitSettings:
    """How noise and systematic errors are estimated from a log.

    The deviations are those of the errors that instruments are expected to have before anything is known of the log.

    Raises:
        EstimationError: a value that is not allowed.
    """

    rounds: Count = 8
    """How often at most poses, calibration and noise are estimated in turns."""
    gate: Probability = 0.9999
    """Probability that a good reading passes: of ten thousand one is left out wrongly, a misread one nearly always."""
    distance_sigma: Positive = 0.2
    """Of the scale of distances from one reading to the next, as slip and inertia leave it."""
    turn_sigma: Positive = 0.2
    """Of the scale of turns, 1 for each radian: what slip and an uncertain wheelbase make of them."""
    curvature_sigma: Positive = 0.1
    """Radians for each metre: wheels that differ by 3 % on a base of 0.3 m turn a robot by 0.1 in each metre."""
    direction_sigma: Positive = 0.05
    """Radians between the sensor's axis and the direction of driving: a mount is 3 degrees off."""
    delay_sigma: Positive = 0.3
    """Seconds between an odometry record and the motion: transport and inertia."""
    tilt_sigma: Positive = 0.1
    """Of a range's relative error that grows with the bearing, by each radian."""
    projection_sigma: Positive = 0.5
    """Likewise with the bearing's square: a camera that takes depth for range has −0.5."""
    scale_share: NonNegative = 0.25
    """How uncertain the scale of all ranges is, as a share of the relative error that is found across the view: no
    reading shows it, and a sensor that is wrong by some percent from one bearing to another is not right on average."""
    odometry_scale_sigma: Positive = 0.03
    """How uncertain the scale of all that was driven is: the size of wheels is known to a few percent."""

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)
