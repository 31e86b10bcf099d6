"""Estimation: from noisy readings to features with covariances, by the extended Kalman filter.

The names are loaded when they are first used: filterpy's import takes a second, and most of this package does without.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.estimation.ekf import refine_points as refine_points
    from trailmark.estimation.ekf_slam import EkfSlam as EkfSlam
    from trailmark.estimation.ekf_slam import SlamResult as SlamResult
    from trailmark.estimation.ekf_slam import SlamSettings as SlamSettings
    from trailmark.estimation.errors import EstimationError as EstimationError
    from trailmark.estimation.errors import NotCertifiedError as NotCertifiedError
    from trailmark.estimation.errors import RecordError as RecordError
    from trailmark.estimation.map_settings import MappingSettings as MappingSettings
    from trailmark.estimation.map_settings import MapSettings as MapSettings
    from trailmark.estimation.mapping import MappedLog as MappedLog
    from trailmark.estimation.mapping import map_log as map_log
    from trailmark.estimation.models import MotionModel as MotionModel
    from trailmark.estimation.models import PoseIncrement as PoseIncrement
    from trailmark.estimation.models import RangeBearing as RangeBearing
    from trailmark.estimation.models import Unicycle as Unicycle
    from trailmark.estimation.obstacles import ScanMap as ScanMap
    from trailmark.estimation.obstacles import disc_estimates as disc_estimates
    from trailmark.estimation.obstacles import map_scans as map_scans
    from trailmark.estimation.obstacles import wall_estimate as wall_estimate
    from trailmark.estimation.readers import load_log as load_log
    from trailmark.estimation.readers import save_log as save_log
    from trailmark.estimation.records import Detection as Detection
    from trailmark.estimation.records import Increment as Increment
    from trailmark.estimation.records import Log as Log
    from trailmark.estimation.records import Odometry as Odometry
    from trailmark.estimation.records import Pose as Pose
    from trailmark.estimation.records import Scan as Scan
    from trailmark.estimation.risk import grow as grow
    from trailmark.estimation.risk import path_risk as path_risk
    from trailmark.estimation.risk import refined as refined
    from trailmark.estimation.risk import regrow as regrow
    from trailmark.estimation.scan_features import ScanSettings as ScanSettings
    from trailmark.estimation.simulation import Simulation as Simulation
    from trailmark.estimation.simulation import simulate as simulate
    from trailmark.estimation.slam_filter import Innovation as Innovation
    from trailmark.estimation.slam_filter import Prediction as Prediction
    from trailmark.estimation.slam_filter import SlamFilter as SlamFilter
    from trailmark.estimation.virtual_sensors import Detector as Detector
    from trailmark.estimation.virtual_sensors import Scanner as Scanner
    from trailmark.estimation.virtual_sensors import sense_obstacles as sense_obstacles

_NAMES = {
    "ekf": "refine_points",
    "ekf_slam": "EkfSlam SlamResult SlamSettings",
    "errors": "EstimationError NotCertifiedError RecordError",
    "map_settings": "MapSettings MappingSettings",
    "mapping": "MappedLog map_log",
    "models": "MotionModel PoseIncrement RangeBearing Unicycle",
    "obstacles": "ScanMap disc_estimates map_scans wall_estimate",
    "readers": "load_log save_log",
    "records": "Detection Increment Log Odometry Pose Scan",
    "risk": "grow path_risk refined regrow",
    "scan_features": "ScanSettings",
    "simulation": "Simulation simulate",
    "slam_filter": "Innovation Prediction SlamFilter",
    "virtual_sensors": "Detector Scanner sense_obstacles",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = [*_HOME]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'trailmark.estimation' has no attribute {name!r}")
    value = getattr(import_module(f"trailmark.estimation.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
