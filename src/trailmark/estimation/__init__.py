"""Estimation: from noisy readings to features with covariances, by the extended Kalman filter.

The names are loaded when they are first used: filterpy's import takes a second, and most of this package does without.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.estimation.ekf import SlamFilter as SlamFilter
    from trailmark.estimation.errors import EstimationError as EstimationError
    from trailmark.estimation.errors import RecordError as RecordError
    from trailmark.estimation.growth import grow as grow
    from trailmark.estimation.innovation import Innovation as Innovation
    from trailmark.estimation.innovation import Prediction as Prediction
    from trailmark.estimation.logs import load_log as load_log
    from trailmark.estimation.logs import save_log as save_log
    from trailmark.estimation.map_log_settings import MapSettings as MapSettings
    from trailmark.estimation.map_settings import MappingSettings as MappingSettings
    from trailmark.estimation.mapped_log import MappedLog as MappedLog
    from trailmark.estimation.mapping import ScanMap as ScanMap
    from trailmark.estimation.mapping import map_scans as map_scans
    from trailmark.estimation.motion import MotionModel as MotionModel
    from trailmark.estimation.motion import PoseIncrement as PoseIncrement
    from trailmark.estimation.motion import Unicycle as Unicycle
    from trailmark.estimation.obstacles import disc_estimates as disc_estimates
    from trailmark.estimation.obstacles import hull_estimate as hull_estimate
    from trailmark.estimation.obstacles import plain_box as plain_box
    from trailmark.estimation.obstacles import wall_estimate as wall_estimate
    from trailmark.estimation.readings import RefinedPoint as RefinedPoint
    from trailmark.estimation.readings import refine_point as refine_point
    from trailmark.estimation.readings import refine_points as refine_points
    from trailmark.estimation.readings import sense_obstacles as sense_obstacles
    from trailmark.estimation.records import Detection as Detection
    from trailmark.estimation.records import Increment as Increment
    from trailmark.estimation.records import Log as Log
    from trailmark.estimation.records import Odometry as Odometry
    from trailmark.estimation.records import Pose as Pose
    from trailmark.estimation.records import Scan as Scan
    from trailmark.estimation.risk import grown_world as grown_world
    from trailmark.estimation.risk import regrow as regrow
    from trailmark.estimation.risk import spend_risk as spend_risk
    from trailmark.estimation.scan_features import ScanSettings as ScanSettings
    from trailmark.estimation.sensor_model import SensorModel as SensorModel
    from trailmark.estimation.sensors import Cartesian as Cartesian
    from trailmark.estimation.sensors import LinePolar as LinePolar
    from trailmark.estimation.sensors import RangeBearing as RangeBearing
    from trailmark.estimation.simulator import Simulation as Simulation
    from trailmark.estimation.simulator import simulate as simulate
    from trailmark.estimation.slam import EkfSlam as EkfSlam
    from trailmark.estimation.slam_result import SlamResult as SlamResult
    from trailmark.estimation.slam_settings import SlamSettings as SlamSettings
    from trailmark.estimation.virtual_sensors import Detector as Detector
    from trailmark.estimation.virtual_sensors import Scanner as Scanner
    from trailmark.estimation.world_from_log import map_log as map_log

_HOME = {
    "SlamFilter": "ekf",
    "EstimationError": "errors",
    "RecordError": "errors",
    "grow": "growth",
    "Innovation": "innovation",
    "Prediction": "innovation",
    "load_log": "logs",
    "save_log": "logs",
    "map_log": "world_from_log",
    "MapSettings": "map_log_settings",
    "MappingSettings": "map_settings",
    "MappedLog": "mapped_log",
    "ScanMap": "mapping",
    "map_scans": "mapping",
    "MotionModel": "motion",
    "PoseIncrement": "motion",
    "Unicycle": "motion",
    "disc_estimates": "obstacles",
    "hull_estimate": "obstacles",
    "plain_box": "obstacles",
    "wall_estimate": "obstacles",
    "RefinedPoint": "readings",
    "refine_point": "readings",
    "refine_points": "readings",
    "sense_obstacles": "readings",
    "Detection": "records",
    "Increment": "records",
    "Log": "records",
    "Odometry": "records",
    "Pose": "records",
    "Scan": "records",
    "grown_world": "risk",
    "regrow": "risk",
    "spend_risk": "risk",
    "ScanSettings": "scan_features",
    "SensorModel": "sensor_model",
    "Cartesian": "sensors",
    "LinePolar": "sensors",
    "RangeBearing": "sensors",
    "Simulation": "simulator",
    "simulate": "simulator",
    "EkfSlam": "slam",
    "SlamResult": "slam_result",
    "SlamSettings": "slam_settings",
    "Detector": "virtual_sensors",
    "Scanner": "virtual_sensors",
}

__all__ = [*_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'trailmark.estimation' has no attribute {name!r}")
    value = getattr(import_module(f"trailmark.estimation.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
