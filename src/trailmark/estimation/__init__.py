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
    from trailmark.estimation.innovation import Innovation as Innovation
    from trailmark.estimation.innovation import Prediction as Prediction
    from trailmark.estimation.motion import MotionModel as MotionModel
    from trailmark.estimation.motion import PoseIncrement as PoseIncrement
    from trailmark.estimation.motion import Unicycle as Unicycle
    from trailmark.estimation.readings import RefinedPoint as RefinedPoint
    from trailmark.estimation.readings import refine_point as refine_point
    from trailmark.estimation.readings import refine_points as refine_points
    from trailmark.estimation.readings import sense_obstacles as sense_obstacles
    from trailmark.estimation.sensor_model import SensorModel as SensorModel
    from trailmark.estimation.sensors import Cartesian as Cartesian
    from trailmark.estimation.sensors import LinePolar as LinePolar
    from trailmark.estimation.sensors import RangeBearing as RangeBearing
    from trailmark.estimation.slam import EkfSlam as EkfSlam
    from trailmark.estimation.slam_result import SlamResult as SlamResult
    from trailmark.estimation.slam_settings import SlamSettings as SlamSettings

_HOME = {
    "SlamFilter": "ekf",
    "EstimationError": "errors",
    "RecordError": "errors",
    "Innovation": "innovation",
    "Prediction": "innovation",
    "MotionModel": "motion",
    "PoseIncrement": "motion",
    "Unicycle": "motion",
    "RefinedPoint": "readings",
    "refine_point": "readings",
    "refine_points": "readings",
    "sense_obstacles": "readings",
    "SensorModel": "sensor_model",
    "Cartesian": "sensors",
    "LinePolar": "sensors",
    "RangeBearing": "sensors",
    "SlamResult": "slam_result",
    "SlamSettings": "slam_settings",
    "EkfSlam": "slam",
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
