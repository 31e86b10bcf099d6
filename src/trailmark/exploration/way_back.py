"""The way back, along which a robot came: nothing stood there, whatever its map says now."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.collision.footprint import Footprint
from trailmark.estimation.scans.clouds import relative
from trailmark.exploration.following import STEP, PathFollower
from trailmark.exploration.known_map import OCCUPIED, KnownMap
from trailmark.path import Path
from trailmark.robot import Robot
from trailmark.se2 import FloatArray, motion_bound

__all__ = ["BACK", "WayBack", "way_back", "way_back_to"]

BACK = 0.5
"""Circumradii by which the robot backs off from what it ran into, besides what its map cannot tell."""

DEEP = 1.5
"""Cells inside the robot: a surface that deep in its body, where it has driven, has come there since; one less deep may
be a matter of the map's resolution."""


def way_back(driven: FloatArray, distance: float, reach: float) -> FloatArray:
    """Return the last stretch of what was driven, backwards, shape (m, 3), m >= 1.

    Args:
        driven: poses in the order of time, the last where the robot is, shape (n, 3).
        distance: metres that some point of the robot is to move by, if it has come as far.
        reach: metres from the robot's reference point to its farthest one.
    """
    back = driven[::-1]
    along = np.concatenate([[0.0], np.cumsum(motion_bound(back[:-1], back[1:], reach))])
    return _spaced(back[: int(np.searchsorted(along, distance)) + 1], reach)


def _spaced(driven: FloatArray, reach: float) -> FloatArray:
    """Return the first pose, those that are a step away from the one before, and the last.

    Where a robot stood, its poses are alike; a follower looks only a few rows ahead.

    Args:
        driven: poses, shape (n, 3).
        reach: metres from the robot's reference point to its farthest one.
    """
    kept, last = [0], len(driven) - 1
    for i in range(1, len(driven)):
        if motion_bound(driven[kept[-1]], driven[i], reach) >= STEP:
            kept.append(i)
    return np.array(driven[[*(kept[:-1] or kept[:last]), last]])


class WayBack(PathFollower):
    """Follows back what was driven, which nothing but what the map's resolution makes of it may block (:data:`DEEP`).

    Args:
        driven: poses in the order of time, the last where the robot is, shape (n, 3), n >= 2.
        robot: that drove.
        footprint: of the robot, dilated by the clearance that it keeps.
    """

    def __init__(self, driven: FloatArray, robot: Robot, footprint: Footprint) -> None:
        super().__init__(Path(_spaced(driven[::-1], robot.circumradius)), robot, footprint)
        self._robot = robot

    def endangered(self, known: KnownMap) -> bool:
        """Return whether a surface stands deep in the robot's body on the rest of the way."""
        from scipy.spatial import cKDTree

        body = self._robot.outline.shapely().buffer(-DEEP * known.cell)
        if body.is_empty:
            return True
        surfaces, rest = known.centres(*np.nonzero(known.state == OCCUPIED)), self.rest
        near = cKDTree(rest[:, :2]).query_ball_tree(cKDTree(surfaces), self._robot.circumradius)
        pose = np.repeat(np.arange(len(rest)), [len(some) for some in near])
        points = surfaces[np.concatenate(near).astype(np.intp)]
        ahead = relative(rest[pose], np.column_stack([points, np.zeros(len(points))]))
        return bool(shapely.contains_xy(body, ahead[:, :2]).any())


def way_back_to(
    there: NDArray[np.bool_], driven: FloatArray, known: KnownMap, robot: Robot, footprint: Footprint
) -> WayBack | None:
    """Return what follows back what was driven since the robot was last in some cells.

    None if it never was, if something stands in the way now, or if it cannot drive backwards.

    Args:
        there: which cells, shape (rows, columns).
        driven: poses in the order of time, the last where the robot is, shape (n, 3).
        known: the map.
        robot: that drove.
        footprint: of the robot, dilated by the clearance that it keeps.
    """
    was = np.flatnonzero(there[known.cells_of(driven[:, :2])])
    if not len(was) or was[-1] == len(driven) - 1 or not robot.reverse:
        return None
    back = WayBack(driven[was[-1] :], robot, footprint)
    return None if back.endangered(known) else back
