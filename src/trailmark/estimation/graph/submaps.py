"""The scans that are nodes of a pose graph, and local maps made of some of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.graph.pose_graph import Relation
from trailmark.estimation.scans.clouds import PointCloud, joined
from trailmark.estimation.scans.clouds import relative as relative_pose
from trailmark.estimation.scans.local_map import LocalMap, levels_for, local_map
from trailmark.se2 import FloatArray

__all__ = ["MIN_POINTS", "KeyScans", "in_frame"]

IntArray = NDArray[np.intp]

MIN_POINTS = 10
"""End points that a scan needs to be matched: fewer do not show a shape."""

THIN = 0.1
"""Metres: a cloud of several scans has one point for each square of this side."""

REVISITED = 0.003, 0.001
"""Metres and radians by which the maps of two visits to a place disagree, each with the errors of its own scans, which
all matches between the two have in common."""

MAX_POINTS = 300
"""Points of such a cloud, at most: more make a search slower, and hardly surer."""


class KeyScans:
    """Scans with their poses, in the order of time, and the relations between them.

    Attributes:
        clouds: of each, in the robot's frame.
        poses: shape (n, 3).
        travel: shape (n,), metres driven before each.
        steps: shape (n, 3, 3), covariance of each pose beside the one before, in the world's axes.
        relations: between them.

    Args:
        gap: metres between neighbouring end points of a surface from which on local maps have the line between them.
    """

    def __init__(self, gap: float) -> None:
        self._gap = gap
        self.clouds: list[PointCloud] = []
        self.poses = np.empty((0, 3))
        self.travel = np.empty(0)
        self.steps = np.empty((0, 3, 3))
        self.relations: list[Relation] = []

    def __len__(self) -> int:
        return len(self.clouds)

    def add(self, cloud: PointCloud, pose: FloatArray, step: FloatArray, gap: float = 0.0) -> None:
        """Add a scan after the others, ``gap`` metres further on than its place says.

        Args:
            cloud: in the robot's frame.
            pose: shape (3,).
            step: covariance of that beside the last scan's, shape (3, 3), in the world's axes.
            gap: metres.
        """
        way = 0.0 if not self.clouds else self.travel[-1] + float(np.hypot(*(pose - self.poses[-1])[:2])) + gap
        self.clouds.append(cloud)
        self.poses, self.travel = np.vstack([self.poses, pose]), np.append(self.travel, way)
        self.steps = np.concatenate([self.steps, step[None]])

    def chain(self, middle: int, length: float, count: int, *, before: bool = False) -> IntArray:
        """Return the scans around one: at most ``count`` of them, at most half of ``length`` metres driven from it.

        With ``before``, the scans up to that one, at most ``length`` metres before it.
        """
        reach = length if before else 0.5 * length
        first = int(np.searchsorted(self.travel, self.travel[middle] - reach))
        last = middle + 1 if before else int(np.searchsorted(self.travel, self.travel[middle] + reach, side="right"))
        half = count - 1 if before else count // 2
        return np.arange(max(first, middle - half), min(last, middle + half + 1))

    def area(self, chosen: IntArray, centre: FloatArray, reach: float, window: float) -> LocalMap:
        """Return the local map that some scans make, within ``reach`` metres of a place along each axis.

        It has the resolutions that a search over ``window`` metres to either side needs.
        """
        cloud = joined([self.clouds[i] for i in chosen], self.poses[chosen])
        x, y = float(centre[0]), float(centre[1])
        return local_map(cloud, (x - reach, y - reach, x + reach, y + reach), levels_for(window), self._gap)

    def spread(self, chain: IntArray, middle: int) -> FloatArray:
        """Return the mean covariance of a chain's scans beside one of them, shape (3, 3), in the world's axes.

        Along a corridor, where odometry alone holds each scan by the one before, the map that they make is no surer.
        """
        first, last = int(chain[0]), int(chain[-1])
        step = np.arange(first + 1, last + 1)
        beyond = np.where(step > middle, last - step + 1, step - first)  # scans that lie on its other side
        return np.asarray(np.einsum("n,nij->ij", beyond / len(chain), self.steps[step]))

    def query(self, chosen: IntArray, frame: int) -> PointCloud:
        """Return what some scans show, in the frame of one of them, thinned."""
        cloud = joined([self.clouds[i] for i in chosen], relative_pose(self.poses[frame], self.poses[chosen]))
        place = np.floor(cloud.points / THIN).astype(np.int64)
        _, one = np.unique(place[:, 0] * 2**31 + place[:, 1], return_index=True)
        one = one[:: -(-len(one) // MAX_POINTS)]
        return PointCloud(*(array[one] for array in cloud))

    def related(self, a: int, b: int, pose: FloatArray, covariance: FloatArray, *, certain: bool) -> Relation:
        """Return the relation that the pose of b, found in the world where a lies as it does now, stands for.

        Args:
            a: the scan that others are held by.
            b: the one that was matched.
            pose: of b, shape (3,).
            covariance: of that pose, in the world's axes, shape (3, 3).
            certain: see :class:`Relation`.
        """
        if not certain:
            covariance = covariance + np.diag([REVISITED[0] ** 2, REVISITED[0] ** 2, REVISITED[1] ** 2])
        return Relation(a, b, relative_pose(self.poses[a], pose), in_frame(covariance, pose[2]), certain)


def in_frame(covariance: FloatArray, heading: float) -> FloatArray:
    """Return a covariance of x, y, theta in the world's axes, shape (3, 3), in those of a frame with that heading."""
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ covariance @ turn.T)
