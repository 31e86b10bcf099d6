"""Estimation: from noisy readings to features with covariances, by the extended Kalman filter.

The names are loaded when they are first used: filterpy's import takes a second, and most of this package does without.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.estimation.errors import EstimationError as EstimationError
    from trailmark.estimation.errors import NotCertifiedError as NotCertifiedError
    from trailmark.estimation.errors import RecordError as RecordError
    from trailmark.estimation.filter.ekf import SlamFilter as SlamFilter
    from trailmark.estimation.filter.gain import Innovation as Innovation
    from trailmark.estimation.filter.gain import Prediction as Prediction
    from trailmark.estimation.filter.motion import MotionModel as MotionModel
    from trailmark.estimation.filter.motion import PoseIncrement as PoseIncrement
    from trailmark.estimation.filter.motion import Unicycle as Unicycle
    from trailmark.estimation.filter.sensors import Cartesian as Cartesian
    from trailmark.estimation.filter.sensors import RangeBearing as RangeBearing
    from trailmark.estimation.filter.sensors import SensorModel as SensorModel
    from trailmark.estimation.logs import load_log as load_log
    from trailmark.estimation.logs import save_log as save_log
    from trailmark.estimation.logs.records import Detection as Detection
    from trailmark.estimation.logs.records import Increment as Increment
    from trailmark.estimation.logs.records import Log as Log
    from trailmark.estimation.logs.records import Odometry as Odometry
    from trailmark.estimation.logs.records import Pose as Pose
    from trailmark.estimation.logs.records import Scan as Scan
    from trailmark.estimation.maps.log_map import map_log as map_log
    from trailmark.estimation.maps.map_settings import MappingSettings as MappingSettings
    from trailmark.estimation.maps.map_settings import MapSettings as MapSettings
    from trailmark.estimation.maps.mapped_log import MappedLog as MappedLog
    from trailmark.estimation.maps.scan_map import ScanMap as ScanMap
    from trailmark.estimation.maps.scan_map import map_scans as map_scans
    from trailmark.estimation.maps.scan_obstacles import disc_estimates as disc_estimates
    from trailmark.estimation.maps.scan_obstacles import wall_estimate as wall_estimate
    from trailmark.estimation.risk.allocation import refined as refined
    from trailmark.estimation.risk.allocation import regrow as regrow
    from trailmark.estimation.risk.growth import grow as grow
    from trailmark.estimation.risk.path_risk import path_risk as path_risk
    from trailmark.estimation.scans.scan_features import ScanSettings as ScanSettings
    from trailmark.estimation.simulation.readings import refine_points as refine_points
    from trailmark.estimation.simulation.readings import sense_obstacles as sense_obstacles
    from trailmark.estimation.simulation.simulator import Simulation as Simulation
    from trailmark.estimation.simulation.simulator import simulate as simulate
    from trailmark.estimation.simulation.virtual_sensors import Detector as Detector
    from trailmark.estimation.simulation.virtual_sensors import Scanner as Scanner
    from trailmark.estimation.slam.ekf_slam import EkfSlam as EkfSlam
    from trailmark.estimation.slam.slam_result import SlamResult as SlamResult
    from trailmark.estimation.slam.slam_result import SlamSettings as SlamSettings

_NAMES = {
    "errors": "EstimationError NotCertifiedError RecordError",
    "filter.ekf": "SlamFilter",
    "filter.gain": "Innovation Prediction",
    "filter.motion": "MotionModel PoseIncrement Unicycle",
    "filter.sensors": "Cartesian RangeBearing SensorModel",
    "logs": "load_log save_log",
    "logs.records": "Detection Increment Log Odometry Pose Scan",
    "maps.log_map": "map_log",
    "maps.map_settings": "MapSettings MappingSettings",
    "maps.mapped_log": "MappedLog",
    "maps.scan_obstacles": "disc_estimates wall_estimate",
    "maps.scan_map": "ScanMap map_scans",
    "risk.allocation": "refined regrow",
    "risk.path_risk": "path_risk",
    "risk.growth": "grow",
    "scans.scan_features": "ScanSettings",
    "simulation.readings": "refine_points sense_obstacles",
    "simulation.simulator": "Simulation simulate",
    "simulation.virtual_sensors": "Detector Scanner",
    "slam.ekf_slam": "EkfSlam",
    "slam.slam_result": "SlamResult SlamSettings",
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
