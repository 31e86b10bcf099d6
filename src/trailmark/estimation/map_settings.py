"""How a log becomes a world, with every default in sight."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from trailmark.arguments import Count, Finite, NonNegative, Positive, checked_fields
from trailmark.estimation.ekf_slam import SlamSettings
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.models import PoseIncrement, RangeBearing, Unicycle
from trailmark.estimation.scan_features import ScanSettings
from trailmark.world.estimates import Frame

CELL = 0.05  # Metres: side of a map's cells, at least, where none is asked for.

ObstacleSource = Literal["detections", "scans"]
PoseSource = Literal["match", "slam", "log", "odometry"]


@dataclass(frozen=True)
class MappingSettings:
    """How scans become a world.

    Raises:
        EstimationError: a value that is not allowed.
    """

    scan: ScanSettings = field(default_factory=ScanSettings)  #: What is known of the scanner.
    #: Standard deviation of the poses: of x and y each (metres), of theta (radians). Errors of poses do not
    #: average out.
    pose_sigma: tuple[NonNegative, NonNegative] = (0.02, 0.005)
    #: Side of the grid's cells, metres; by default 0.05, or the side of an exploration's own cells if its log
    #: states a larger one: its beams are about as far apart, and smaller cells between them would stay unknown.
    cell: Positive | None = None
    confirm: Count = 3  #: Scans that must have shown a feature; others are dropped.
    #: What no beam has reached, or what is separated from where the robot was: an obstacle, or free.
    unknown: Literal["blocked", "free"] = "blocked"

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)

    def cell_side(self, explored: float | None) -> float:
        """Return the side of the grid's cells, metres.

        Args:
            explored: side of the cells that the log states, metres (:attr:`trailmark.estimation.Log.cell`), or None.
        """
        return self.cell or max(CELL, explored or 0.0)


@dataclass(frozen=True)
class MapSettings:
    """What :func:`trailmark.estimation.map_log` goes by.

    The noise is for what the log itself states none for. Velocities and ranges are those measured on the MRCLAM
    robots against motion capture: small, slow, indoors, with a camera.

    Raises:
        EstimationError: a value that is not allowed.
    """

    #: What they are made of; "auto": scans if the log has any, else detections.
    obstacles: ObstacleSource | Literal["auto"] = "auto"
    #: "match": by matching scans and closing loops, from odometry on; "slam": by EKF-SLAM over odometry and
    #: detections; "log": as the log states them; "odometry": by odometry alone, which drifts (scans only). "auto":
    #: for scans the log's if it states them, else match; for detections slam if it has odometry, else the log's.
    poses: PoseSource | Literal["auto"] = "auto"
    #: How EKF-SLAM goes about it.
    slam: SlamSettings = field(default_factory=lambda: SlamSettings("auto", confirm=5))
    #: Noise of detections by range and bearing.
    range_bearing: RangeBearing = field(default_factory=lambda: RangeBearing(0.06, 0.015, growth=0.3))
    velocity: Unicycle = field(default_factory=lambda: Unicycle(0.012, 0.04, period=1.0))  #: Noise of velocities.
    #: Noise of increments: 5 cm and 1.8 degrees by each metre, 2.9 degrees by each radian.
    increment: PoseIncrement = field(
        default_factory=lambda: PoseIncrement(1e-3, 1e-3, 1e-3, growth=(2.5e-3, 1e-3, 2.5e-3))
    )
    #: Whether the covariances that the log states for detections and increments count, in place of those above.
    stated_noise: bool = True
    #: Whether the batch over the whole log estimates noise and systematic errors from it. "auto": where the residuals
    #: show more noise than is stated, or much less.
    fit_noise: bool | Literal["auto"] = "auto"
    radius: Positive = 0.1  #: Radius of what was detected, metres: a log says where its centre is, not how large it is.
    radius_sigma: NonNegative = 0.0  #: Standard deviation of that radius, metres.
    #: How scans become obstacles. Its ``pose_sigma`` is also that of poses stated by the log.
    mapping: MappingSettings = field(default_factory=MappingSettings)
    #: Where the robot stood first: x, y (metres), theta (radians), in the world's frame. None: where the log says,
    #: else 0, 0, 0. Poses of the log stay where they are.
    start: tuple[Finite, Finite, Finite] | None = None
    #: What the covariances of detected obstacles are relative to. "start": the start, so that obstacles grow for
    #: the error of where the map lies, too; "map": the obstacles themselves, for a robot that localises on them.
    #: None: start if it is given here, else map. Fewer than four features, and those of poses that
    #: are stated, have no frame but the start's; what scans show has none but the map's.
    frame: Frame | None = None
    #: Standard deviation of the pose (x and y each, metres; theta, radians) of the robot that will drive in the
    #: world: obstacles grow by it too. None: it knows where it is.
    robot_sigma: tuple[NonNegative, NonNegative] | None = None

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)
