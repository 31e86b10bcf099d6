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
    """Settings for obstacles from scans.

    Raises:
        EstimationError: a value that is not allowed.
    """

    scan: ScanSettings = field(default_factory=ScanSettings)  #: The scanner's properties.
    #: Standard deviation of the poses: of x and y each (metres), of theta (radians). Errors of poses do not
    #: average out.
    pose_sigma: tuple[NonNegative, NonNegative] = (0.02, 0.005)
    #: Side of the grid's cells, metres; by default 0.05, or the side of an exploration's own cells if its log
    #: states a larger one: its beams are about as far apart, and smaller cells between them would stay unknown.
    cell: Positive | None = None
    confirm: Count = 3  #: Scans that must have shown a feature; others are dropped.
    #: Cells that no beam has reached, or that obstacles separate from the robot's path: an obstacle, or free.
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
    """Settings of :func:`trailmark.estimation.map_log`.

    The noise here counts where the log states none. That of velocities and ranges was measured on the MRCLAM robots
    against motion capture: small, slow, indoors, with a camera.

    Raises:
        EstimationError: a value that is not allowed.
    """

    #: Source of the obstacles; "auto": scans if the log has any, else detections.
    obstacles: ObstacleSource | Literal["auto"] = "auto"
    #: Source of the poses. "match": scan matching with loop closures, starting from odometry; "slam": EKF-SLAM over
    #: odometry and detections; "log": those in the log; "odometry": odometry alone, which drifts (scans only). "auto":
    #: for scans, the log's if there are any, else match; for detections, slam if there is odometry, else the log's.
    poses: PoseSource | Literal["auto"] = "auto"
    #: Settings of EKF-SLAM.
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
    radius: Positive = 0.1  #: Radius of detected obstacles, metres; a log only says where their centres are.
    radius_sigma: NonNegative = 0.0  #: Standard deviation of that radius, metres.
    #: Settings for obstacles from scans. Its ``pose_sigma`` is also that of poses stated by the log.
    mapping: MappingSettings = field(default_factory=MappingSettings)
    #: First pose of the robot: x, y (metres), theta (radians), in the world's frame. None: from the log, else 0, 0, 0.
    #: Poses in the log are not moved.
    start: tuple[Finite, Finite, Finite] | None = None
    #: Reference of the covariances of detected obstacles. "start": the first pose, so that obstacles also grow for the
    #: error of the map as a whole; "map": the obstacles themselves, for a robot that localises on them. None: start if
    #: ``start`` is given, else map. With fewer than four features, or poses from the log, only "start" is possible; for
    #: obstacles from scans only "map".
    frame: Frame | None = None
    #: Standard deviation of the pose (x and y each, metres; theta, radians) of the robot that will drive in the
    #: world: obstacles grow by it too. None: its pose is exact.
    robot_sigma: tuple[NonNegative, NonNegative] | None = None

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)
