"""Estimation: from noisy readings to features with covariances, by the extended Kalman filter.

The names are loaded when they are first used: filterpy's import takes a second, and most of this package does without.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trailmark.estimation.errors import EstimationError as EstimationError
    from trailmark.estimation.errors import RecordError as RecordError
    from trailmark.estimation.filter.ekf import SlamFilter as SlamFilter
    from trailmark.estimation.filter.innovation import Innovation as Innovation
    from trailmark.estimation.filter.innovation import Prediction as Prediction
    from trailmark.estimation.filter.motion import MotionModel as MotionModel
    from trailmark.estimation.filter.motion import PoseIncrement as PoseIncrement
    from trailmark.estimation.filter.motion import Unicycle as Unicycle
    from trailmark.estimation.filter.sensor_model import SensorModel as SensorModel
    from trailmark.estimation.filter.sensors import Cartesian as Cartesian
    from trailmark.estimation.filter.sensors import LinePolar as LinePolar
    from trailmark.estimation.filter.sensors import RangeBearing as RangeBearing
    from trailmark.estimation.logs import load_log as load_log
    from trailmark.estimation.logs import save_log as save_log
    from trailmark.estimation.logs.records import Detection as Detection
    from trailmark.estimation.logs.records import Increment as Increment
    from trailmark.estimation.logs.records import Log as Log
    from trailmark.estimation.logs.records import Odometry as Odometry
    from trailmark.estimation.logs.records import Pose as Pose
    from trailmark.estimation.logs.records import Scan as Scan
    from trailmark.estimation.maps.log_map import map_log as map_log
    from trailmark.estimation.maps.map_settings import MapSettings as MapSettings
    from trailmark.estimation.maps.mapped_log import MappedLog as MappedLog
    from trailmark.estimation.maps.mapping_settings import MappingSettings as MappingSettings
    from trailmark.estimation.maps.obstacle_estimates import disc_estimates as disc_estimates
    from trailmark.estimation.maps.obstacle_estimates import hull_estimate as hull_estimate
    from trailmark.estimation.maps.obstacle_estimates import plain_box as plain_box
    from trailmark.estimation.maps.obstacle_estimates import wall_estimate as wall_estimate
    from trailmark.estimation.maps.scan_map import ScanMap as ScanMap
    from trailmark.estimation.maps.scan_map import map_scans as map_scans
    from trailmark.estimation.risk.allocation import grown_world as grown_world
    from trailmark.estimation.risk.allocation import regrow as regrow
    from trailmark.estimation.risk.allocation import spend_risk as spend_risk
    from trailmark.estimation.risk.growth import grow as grow
    from trailmark.estimation.scans.scan_features import ScanSettings as ScanSettings
    from trailmark.estimation.simulation.readings import RefinedPoint as RefinedPoint
    from trailmark.estimation.simulation.readings import refine_point as refine_point
    from trailmark.estimation.simulation.readings import refine_points as refine_points
    from trailmark.estimation.simulation.readings import sense_obstacles as sense_obstacles
    from trailmark.estimation.simulation.simulator import Simulation as Simulation
    from trailmark.estimation.simulation.simulator import simulate as simulate
    from trailmark.estimation.simulation.virtual_sensors import Detector as Detector
    from trailmark.estimation.simulation.virtual_sensors import Scanner as Scanner
    from trailmark.estimation.slam.ekf_slam import EkfSlam as EkfSlam
    from trailmark.estimation.slam.slam_result import SlamResult as SlamResult
    from trailmark.estimation.slam.slam_settings import SlamSettings as SlamSettings

_HOME = {
    "SlamFilter": "filter.ekf",
    "EstimationError": "errors",
    "RecordError": "errors",
    "grow": "risk.growth",
    "Innovation": "filter.innovation",
    "Prediction": "filter.innovation",
    "load_log": "logs",
    "save_log": "logs",
    "map_log": "maps.log_map",
    "MapSettings": "maps.map_settings",
    "MappingSettings": "maps.mapping_settings",
    "MappedLog": "maps.mapped_log",
    "ScanMap": "maps.scan_map",
    "map_scans": "maps.scan_map",
    "MotionModel": "filter.motion",
    "PoseIncrement": "filter.motion",
    "Unicycle": "filter.motion",
    "disc_estimates": "maps.obstacle_estimates",
    "hull_estimate": "maps.obstacle_estimates",
    "plain_box": "maps.obstacle_estimates",
    "wall_estimate": "maps.obstacle_estimates",
    "RefinedPoint": "simulation.readings",
    "refine_point": "simulation.readings",
    "refine_points": "simulation.readings",
    "sense_obstacles": "simulation.readings",
    "Detection": "logs.records",
    "Increment": "logs.records",
    "Log": "logs.records",
    "Odometry": "logs.records",
    "Pose": "logs.records",
    "Scan": "logs.records",
    "grown_world": "risk.allocation",
    "regrow": "risk.allocation",
    "spend_risk": "risk.allocation",
    "ScanSettings": "scans.scan_features",
    "SensorModel": "filter.sensor_model",
    "Cartesian": "filter.sensors",
    "LinePolar": "filter.sensors",
    "RangeBearing": "filter.sensors",
    "Simulation": "simulation.simulator",
    "simulate": "simulation.simulator",
    "EkfSlam": "slam.ekf_slam",
    "SlamResult": "slam.slam_result",
    "SlamSettings": "slam.slam_settings",
    "Detector": "simulation.virtual_sensors",
    "Scanner": "simulation.virtual_sensors",
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
