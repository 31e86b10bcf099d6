"""How a log becomes a world, with every default in sight."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

from trailmark.errors import did_you_mean
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.motion import PoseIncrement, Unicycle
from trailmark.estimation.filter.sensors import Cartesian, RangeBearing
from trailmark.estimation.maps.mapping_settings import MappingSettings
from trailmark.estimation.slam.slam_settings import AssociationMethod

__all__ = ["MOST_OUTLIERS", "OUTLIER_GATE", "MapSettings", "ObstacleSource", "PoseSource"]

ObstacleSource = Literal["auto", "detections", "scans"]
PoseSource = Literal["auto", "slam", "log", "odometry"]

OUTLIER_GATE = 0.9999
"""Probability that a good reading passes. Misread barcodes, some in a thousand, lie far outside."""

MOST_OUTLIERS = 0.02
"""The share of a log's detections that may be misread."""


@dataclass(frozen=True)
class MapSettings:
    """What :func:`trailmark.estimation.map_log` goes by.

    The noise is for what the log itself states none for. Velocities and ranges are those measured on the MRCLAM
    robots against motion capture: small, slow, indoors, with a camera.

    Raises:
        EstimationError: a value that is not allowed.
    """

    obstacles: ObstacleSource = "auto"
    """What they are made of; "auto": scans if the log has any, else detections."""
    poses: PoseSource = "auto"
    """"slam": by EKF-SLAM over odometry and detections; "log": as the log states them; "odometry": by odometry alone,
    which drifts (scans only). "auto": for scans the log's if it states them, else slam if it has detections, else
    odometry; for detections slam if it has odometry, else the log's."""
    association: AssociationMethod | Literal["auto"] = "auto"
    """See :class:`trailmark.estimation.SlamSettings`; "auto": known if any detection has an identity, else joint."""
    gate: float = 0.99
    """Probability that a reading of unknown identity passes the gate of its own feature."""
    new_gate: float = 0.9999
    """Probability that such a reading passes its feature's second gate: what passes none is new."""
    outlier_gate: float | Literal["auto"] | None = "auto"
    """Probability that a reading of known identity passes; None lets all pass. "auto": OUTLIER_GATE, but None for a log
    of which that would refuse more than MOST_OUTLIERS: where the filter errs, not the readings, a gate would lock
    out the very readings that set it right."""
    confirm: int = 5
    """Readings of unknown identity that confirm a feature."""
    timeout: float = 60.0
    """Seconds without a reading after which a feature that is not confirmed is dropped."""
    range_bearing: RangeBearing = field(default_factory=lambda: RangeBearing(0.06, 0.015, growth=0.3))
    """Noise of detections by range and bearing."""
    cartesian: Cartesian = field(default_factory=lambda: Cartesian(0.1, 0.1))
    """Noise of detections by x and y."""
    stated_sensor_noise: bool = True
    """Whether the covariances that the log states for detections count, in place of the two above."""
    velocity: Unicycle = field(default_factory=lambda: Unicycle(0.012, 0.04, period=1.0))
    """Noise of velocities."""
    increment: PoseIncrement = field(
        default_factory=lambda: PoseIncrement(1e-3, 1e-3, 1e-3, growth=(2.5e-3, 1e-3, 2.5e-3))
    )
    """Noise of increments: 5 cm and 1.8 degrees by each metre, 2.9 degrees by each radian."""
    stated_motion_noise: bool = True
    """Whether the covariances that the log states for increments count, in place of the one above."""
    radius: float = 0.1
    """Radius of what was detected, metres: a log says where its centre is, not how large it is."""
    radius_sigma: float = 0.0
    """Standard deviation of that radius, metres."""
    mapping: MappingSettings = field(default_factory=MappingSettings)
    """How scans become obstacles. Its ``pose_sigma`` is also that of poses stated by the log."""
    start: tuple[float, float, float] | None = None
    """Where the robot stood first: x, y (metres), theta (radians), in the world's frame. None: where the log says, else
    0, 0, 0. Poses of the log stay where they are."""
    margin: float = 1.0
    """Metres of free space, beside the robot's own size, around all that was detected."""
    robot_sigma: tuple[float, float] | None = None
    """Standard deviation of the pose (x and y each, metres; theta, radians) of the robot that will drive in the world:
    obstacles grow by it too. None: it knows where it is."""

    def __post_init__(self) -> None:
        for name, kind in (("obstacles", ObstacleSource), ("poses", PoseSource)):
            given = getattr(self, name)
            if given not in get_args(kind):
                raise EstimationError(f"{name} {given!r} given, {did_you_mean(str(given), get_args(kind))}")
        if self.association not in ("auto", *get_args(AssociationMethod)):
            hint = did_you_mean(str(self.association), ("auto", *get_args(AssociationMethod)))
            raise EstimationError(f"association {self.association!r} given, {hint}")
        if not 0.0 < self.radius < math.inf:
            raise EstimationError(f"radius {self.radius!r} given, allowed: metres above 0")
        for name in ("radius_sigma", "margin"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise EstimationError(f"{name} {getattr(self, name)!r} given, allowed: metres, 0 or more")
        sigma = self.robot_sigma
        if sigma is not None and not (len(sigma) == 2 and all(0.0 <= value < math.inf for value in sigma)):
            raise EstimationError(f"robot_sigma {sigma!r} given, allowed: two numbers of 0 or more, or None")
        if self.start is not None and not (len(self.start) == 3 and all(map(math.isfinite, self.start))):
            raise EstimationError(f"start {self.start!r} given, allowed: three finite numbers x, y, theta, or None")
