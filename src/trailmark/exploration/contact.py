"""What a robot knows that ran into something: where that must stand."""

from __future__ import annotations

import numpy as np
import shapely

from trailmark.path import Path
from trailmark.robot import Robot
from trailmark.se2 import FloatArray, transform

__all__ = ["contact_points"]

AHEAD = 4
"""Half cells of the way on: what the robot ran into is taken to fill all that it would have swept there."""

BESIDE = 0.1
"""Cells beside the robot as it stands: what does not lead farther has not run into anything."""


def contact_points(robot: Robot, states: FloatArray, cell: float) -> FloatArray:
    """Return points that the robot's outline would have come to, x, y, shape (m, 2), none of them where it stands.

    Args:
        robot: that stands in contact.
        states: where it stands, and how its path would have gone on, shape (n, 3).
        cell: side of the map's cells, metres.
    """
    outline = robot.outline
    rim = shapely.get_coordinates(shapely.segmentize(outline.shapely().exterior, 0.5 * cell))
    ahead = Path(states).resample(0.5 * cell).states[1 : 1 + AHEAD]
    swept = np.asarray(transform(ahead, rim)).reshape(-1, 2)
    body = shapely.Polygon(transform(states[0], outline.vertices)).buffer(BESIDE * cell)
    return np.asarray(swept[~shapely.contains_xy(body, swept)])
