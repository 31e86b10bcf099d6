"""What a robot covers along a path, as a region of the plane."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark.se2 import difference, interpolate, transform
from trailmark.shapes import triangulate
from trailmark.world.robot import Robot

__all__ = ["swept_region"]


def swept_region(robot: Robot, states: ArrayLike, *, turn: float = 0.02) -> Any:
    """Return a region that contains what the robot covers along a path, as a shapely geometry.

    Args:
        robot: its footprint.
        states: the path's configurations, shape (n, 3), n >= 1.
        turn: radians: motions are cut into pieces that turn by no more. The region reaches at most R·turn beyond
            the truth, R the robot's circumradius, and for a disc its outline's 1 mm.
    """
    import shapely

    q = np.atleast_2d(np.array(states, dtype=np.float64))
    # Relative to where it begins: overlays round, and may snap, by shares of their coordinates.
    origin = q[0, :2].copy()
    q[:, :2] -= origin
    placed = [q[:1]]
    for a, b in itertools.pairwise(q):
        n = 1 if robot.sweep_radius == 0.0 else max(1, math.ceil(abs(float(difference(a, b)[2])) / turn))
        placed.append(interpolate(a, b, np.arange(1, n + 1) / n))
    outline = robot.outline
    solid = shapely.area(shapely.convex_hull(outline.shapely())) <= outline.area * (1.0 + 1e-12)
    pieces = outline.vertices[None] if solid else triangulate(outline)
    poses = np.concatenate(placed)
    # Shape (pieces, poses, corners, 2); what lies between two poses is the hull of a piece at both.
    corners = np.stack([transform(poses, piece) for piece in pieces])
    pairs = np.concatenate([corners[:, :-1], corners[:, 1:]], axis=2) if len(poses) > 1 else corners
    swept = shapely.convex_hull(shapely.multipoints(pairs.reshape(-1, pairs.shape[2], 2)))
    # Within a piece a point keeps within R·turn²/8 of the line from its first to its last place. The arcs of a
    # buffer are drawn inside of it, by 1.1 % at most; what else it does to outlines makes them larger.
    region = shapely.buffer(shapely.union_all(swept), 1.02 * robot.sweep_radius * turn**2 / 8.0)
    return shapely.transform(region, lambda points: points + origin)
