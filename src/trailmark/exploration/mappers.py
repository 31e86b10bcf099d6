"""Which sensors there are, which mapper one needs, and which worlds it can see."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from trailmark.arguments import brief
from trailmark.errors import ConfigurationError
from trailmark.estimation.simulation.virtual_sensors import Detector, Scanner
from trailmark.exploration.detection_mapper import DetectionMapper
from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.known_map import KnownMap
from trailmark.exploration.mapper import Mapper
from trailmark.exploration.scan_mapper import ScanMapper
from trailmark.exploration.simulated_robot import disc_detector, laser_scanner
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc
from trailmark.world import Robot, World

__all__ = ["check_visible", "mapper_for", "sensor_of"]


def mapper_for(
    sensor: Scanner | Detector,
    robot: Robot,
    start: FloatArray,
    bounds: tuple[float, float, float, float],
    settings: ExplorationSettings,
    radii: Mapping[int, float] | None = None,
) -> Mapper:
    """Return a mapper that knows nothing yet.

    Args:
        sensor: its range, and the noise that there is.
        robot: of the world.
        start: where it stands first, shape (3,).
        bounds: of what is to be explored.
        settings: of the exploration.
        radii: of the discs that a detector reads, by their identity, metres.

    Raises:
        ConfigurationError: a detector of discs of any size, and no radii.
    """
    known = KnownMap(bounds, settings.cell_side(robot, bounds))
    if isinstance(sensor, Detector):
        return DetectionMapper(start, known, sensor, robot, settings, radii)
    return ScanMapper(start, known, sensor, robot, settings)


def sensor_of(
    sensor: object, sensor_range: float, cell: float, bounds: tuple[float, float, float, float]
) -> Scanner | Detector:
    """Return a sensor's description; its range ends where all that is to be explored does.

    Args:
        sensor: ``laser``, ``detections``, or a description.
        sensor_range: metres, of a sensor that is given by its name.
        cell: side of the map's cells, metres.
        bounds: of what is to be explored.

    Raises:
        ConfigurationError: no such sensor, or no such range.
    """
    if sensor == "laser":
        sensor = laser_scanner(sensor_range, cell)
    elif sensor == "detections":
        sensor = disc_detector(sensor_range)
    if not isinstance(sensor, Scanner | Detector):
        raise ConfigurationError(f"sensor: expected laser, detections, a Scanner or a Detector, got {brief(sensor)}")
    return replace(sensor, max_range=min(sensor.max_range, math.dist(bounds[:2], bounds[2:])))


def check_visible(world: World, sensor: Scanner | Detector) -> None:
    """Raise if there are obstacles that a sensor never sees.

    Raises:
        ConfigurationError: a detector of discs, and an obstacle that is none or too large for it, or a boundary.
    """
    if isinstance(sensor, Scanner):
        return
    for i, shape in enumerate(world.obstacles):
        if not (isinstance(shape, Disc) and shape.radius <= sensor.max_radius):
            raise ConfigurationError(
                f"sensor: expected discs alone for a sensor of detections, got {type(shape).__name__.lower()} "
                f"obstacles[{i}] (--sensor laser sees it)"
            )
    if world.boundary is not None:
        raise ConfigurationError("sensor: expected no boundary for a sensor of detections (--sensor laser sees it)")
