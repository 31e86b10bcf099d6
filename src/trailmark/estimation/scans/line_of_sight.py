"""What a scan saw into: between the robot and the surfaces that its beams met."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.scans.clouds import PointCloud
from trailmark.se2 import FloatArray

__all__ = ["in_view"]

BEHIND = 0.5
"""Metres behind a surface up to which points count as in view: poses err, and what stands at walls is cluttered."""

NEIGHBOURS = 0.06
"""Radians between end points up to which a scan has seen what lies between them."""


def in_view(cloud: PointCloud, points: FloatArray) -> NDArray[np.bool_]:
    """Return which points lie where a scan's beams passed, or at the surfaces that they met, shape (n,).

    Args:
        cloud: the scan's end points, in the frame of its robot.
        points: shape (n, 2), in that frame.
    """
    if len(cloud.points) < 2:
        return np.zeros(len(points), dtype=bool)
    bearings, ranges = np.arctan2(cloud.points[:, 1], cloud.points[:, 0]), np.hypot(*cloud.points.T)
    order = np.argsort(bearings)
    bearings, ranges = bearings[order], ranges[order]
    bearing, distance = np.arctan2(points[:, 1], points[:, 0]), np.hypot(*points.T)
    after = np.searchsorted(bearings, bearing).clip(1, len(bearings) - 1)
    right, left = bearings[after - 1], bearings[after]
    between = (right <= bearing) & (bearing <= left) & (left - right <= NEIGHBOURS)
    return np.asarray(between & (distance <= np.maximum(ranges[after - 1], ranges[after]) + BEHIND))
