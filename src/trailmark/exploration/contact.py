"""What a robot knows that ran into something: where that must stand, and the way back, on which nothing stood."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.exploration.known_map import OCCUPIED, KnownMap
from trailmark.path import Path
from trailmark.robot import Robot
from trailmark.se2 import FloatArray, motion_bound, transform

__all__ = ["contact_points", "way_back", "way_back_to"]

AHEAD = 4
"""Half cells of the way on: what the robot ran into is taken to fill all that it would have swept there."""

BESIDE = 0.1
"""Cells beside the robot as it stands: what does not lead farther has not run into anything."""

DEEP = 1.5
"""Cells inside the robot: a surface that deep in its body, where it has driven, has come there since; one less deep may
be a matter of the map's resolution."""


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


def way_back(driven: FloatArray, distance: float, reach: float) -> FloatArray:
    """Return the last stretch of what was driven, backwards, shape (m, 3), m >= 1.

    Args:
        driven: poses in the order of time, the last where the robot is, shape (n, 3).
        distance: metres that some point of the robot is to move by, if it has come as far.
        reach: metres from the robot's reference point to its farthest one.
    """
    back = driven[::-1]
    along = np.concatenate([[0.0], np.cumsum(motion_bound(back[:-1], back[1:], reach))])
    return np.array(back[: int(np.searchsorted(along, distance)) + 1])


def way_back_to(driven: FloatArray, there: NDArray[np.bool_], known: KnownMap, robot: Robot) -> FloatArray | None:
    """Return what was driven since the robot was last in some cells, backwards, shape (m, 3).

    The map may take this way for blocked, by a cell or so (:data:`DEEP`). None if the robot was never there, if
    something stands in the way now, or if it cannot drive backwards.

    Args:
        driven: poses in the order of time, the last where the robot is, shape (n, 3).
        there: which cells, shape (rows, columns).
        known: the map.
        robot: that drove.
    """
    was = np.flatnonzero(there[known.cells_of(driven[:, :2])])
    body = robot.outline.shapely().buffer(-DEEP * known.cell)
    if not len(was) or body.is_empty or not robot.reverse:
        return None
    back = driven[was[-1] :][::-1]
    surfaces = known.centres(*np.nonzero(known.state == OCCUPIED))
    for pose in Path(back).resample(known.cell).states if len(back) > 1 else back:
        near = surfaces[np.hypot(*(surfaces - pose[:2]).T) <= robot.circumradius]
        placed = shapely.Polygon(transform(pose, shapely.get_coordinates(body)))
        if shapely.contains_xy(placed, near).any():
            return None
    return np.array(back)
