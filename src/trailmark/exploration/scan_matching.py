"""How an exploring robot's scans are matched: by what its laser and its odometry say of their noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from trailmark.estimation.graph.graph_settings import GraphSettings
from trailmark.estimation.simulation.virtual_sensors import Scanner
from trailmark.se2 import FloatArray

__all__ = ["graph_settings"]

SLIPPING: Final = 1.5
"""Times the standard deviation of a step that odometry states, for matching: what it does not know of."""

LEAST: Final = 0.01
"""Metres by which end points scatter at least about a map made of cells."""

FAR: Final = 10.0
"""Metres: for sensors of a longer range, the lengths of scan matching grow in proportion, as the robot's speed does."""

SHORTEST: Final = 0.1
"""Share of the distance between nodes that counts as driven at least: before, hardly anything has been stated."""


def graph_settings(sensor: Scanner, errors: FloatArray, driven: float, exact: bool) -> GraphSettings:
    """Return how scans are matched.

    Args:
        sensor: its range and noise.
        errors: variances of place (m²) and heading (rad²) that odometry has stated so far, shape (2,).
        driven: metres, and radians of turns, over which it has stated them.
        exact: whether these are to count for nothing, since scans say otherwise.
    """
    s, far = GraphSettings(), max(1.0, sensor.max_range / FAR)
    s = replace(
        s,
        scale=far,
        max_range=min(far * s.max_range, sensor.max_range),
        scatter=max(sensor.sigma, LEAST),
    )
    if exact:
        return s
    # Of a step from node to node, with something for wheels that slip.
    place, heading = SLIPPING * np.sqrt(errors / max(driven, SHORTEST * s.key_distance) * s.key_distance)
    floor = min(float(place), far * s.odometry_floor[0]), min(float(heading), s.odometry_floor[1])
    grown = min(floor[0] / s.key_distance, s.odometry[0]), min(floor[1] / s.key_distance, s.odometry[1])
    return replace(s, odometry=grown, odometry_floor=floor)
