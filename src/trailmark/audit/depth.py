"""Penetration depth: the shortest translation that takes the robot out of an obstacle, by Minkowski sums in shapely.

Source of the definition: Dobkin, Hershberger, Kirkpatrick & Suri, "Computing the intersection-depth of polyhedra",
Algorithmica 9 (1993).
"""

# Tested by tests/audit/test_depth.py.
from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
import shapely

from trailmark import se2
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Shape, convex_pieces
from trailmark.world import Robot

__all__ = ["Penetration", "bounds_depth", "deepest"]

ARC = 64
"""Chords of a quarter of a circle, where a disc meets what is not convex: short by 7.5e-5 of its radius at most."""

SAMPLES, PRECISION, EFFORT = 17, 1e-3, 400
"""Depths of an interval computed at first; share of the largest to which it is known; depths computed at most."""


class Penetration:
    """How deep a robot is in one obstacle.

    Args:
        robot: footprint.
        shape: of the obstacle.
    """

    def __init__(self, robot: Robot, shape: Shape) -> None:
        self.robot, self.shape = robot, shape

    def at(self, states: FloatArray) -> FloatArray:
        """Return the penetration depth (metres, 0 where there is none) at configurations (n, 3), shape (n,)."""
        body, shape = self.robot.footprint, self.shape
        if isinstance(body, Disc):
            if isinstance(shape, Disc):
                apart = np.hypot(*(states[:, :2] - shape.center).T)
                return np.asarray(np.maximum(0.0, body.radius + shape.radius - apart))
            return _disc_depth(shape.polygon(), states[:, :2], body.radius)
        if isinstance(shape, Disc):
            # As the robot sees it.
            cos, sin = np.cos(states[:, 2]), np.sin(states[:, 2])
            dx, dy = (np.asarray(shape.center) - states[:, :2]).T
            return _disc_depth(
                self.robot.outline, np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx]), shape.radius
            )
        return np.array([self._depth(state) for state in states])

    @cached_property
    def _pieces(self) -> list[FloatArray]:
        return convex_pieces(self.shape.polygon())

    @cached_property
    def _boxes(self) -> FloatArray:
        return np.array([(*piece.min(axis=0), *piece.max(axis=0)) for piece in self._pieces])

    @cached_property
    def _body(self) -> list[FloatArray]:
        return convex_pieces(self.robot.outline)

    def _depth(self, state: FloatArray) -> float:
        """Return the depth of two polygons: how far the origin is inside of their Minkowski difference."""
        parts = [se2.transform(state, part) for part in self._body]
        low, high = np.min([p.min(axis=0) for p in parts], axis=0), np.max([p.max(axis=0) for p in parts], axis=0)
        reach = self.robot.circumradius
        while True:
            # Pieces farther away than the robot is moved do not matter.
            near = (self._boxes[:, :2] <= high + reach).all(axis=1) & (self._boxes[:, 2:] >= low - reach).all(axis=1)
            sums = [(self._pieces[i][:, None] - part).reshape(-1, 2) for i in np.flatnonzero(near) for part in parts]
            if not sums:
                return 0.0
            blocked = shapely.union_all(shapely.convex_hull([shapely.MultiPoint(points) for points in sums]))
            origin = shapely.Point(0.0, 0.0)
            depth = float(shapely.distance(blocked.boundary, origin)) if blocked.contains(origin) else 0.0
            if depth <= reach or near.all():
                return depth
            reach *= 2.0


def bounds_depth(robot: Robot, bounds: tuple[float, float, float, float], states: FloatArray) -> FloatArray:
    """Return how far (metres) robots at configurations (n, 3) must be moved to be inside of bounds again, (n,)."""
    if isinstance(robot.footprint, Disc):
        low, high = states[:, :2] - robot.footprint.radius, states[:, :2] + robot.footprint.radius
    else:
        placed = se2.transform(states, robot.outline.vertices)
        low, high = placed.min(axis=1), placed.max(axis=1)
    over = np.maximum(0.0, np.maximum(np.asarray(bounds[:2]) - low, high - np.asarray(bounds[2:])))
    return np.asarray(np.hypot(*over.T))


def deepest(
    depths: Callable[[FloatArray], FloatArray], poses: Callable[[FloatArray], FloatArray], u0: float, u1: float
) -> float:
    """Return the largest depth on an interval of a path, by branch and bound to :data:`PRECISION`.

    Args:
        depths: of configurations (n, 3); changes by no more than what the robot's points move.
        poses: configurations at places on the path's scale (metres), which no point of the robot outruns.
        u0: where the interval begins.
        u1: where it ends.
    """
    places = np.linspace(u0, u1, SAMPLES) if u1 > u0 else np.array([u0])
    found = depths(poses(places))
    while len(places) > 1 and len(places) < EFFORT:
        highest = 0.5 * (found[1:] + found[:-1] + np.diff(places))
        split = np.flatnonzero(highest > (1.0 + PRECISION) * found.max() + 1e-9)
        if len(split) == 0:
            break
        split = split[np.argsort(-highest[split])][: max(1, EFFORT // 8)]
        new = 0.5 * (places[split] + places[split + 1])
        places, found = np.append(places, new), np.append(found, depths(poses(new)))
        order = np.argsort(places, kind="stable")
        places, found = places[order], found[order]
    return float(found.max())


def _disc_depth(polygon: Polygon, centers: FloatArray, radius: float) -> FloatArray:
    """Return how far discs must be moved to leave a polygon, shape (n,)."""
    region = polygon.shapely()
    points = shapely.points(centers)
    if len(convex_pieces(polygon)) == 1:
        edge = shapely.distance(region.boundary, points)
        return np.asarray(np.maximum(0.0, radius + np.where(shapely.contains(region, points), edge, -edge)))
    grown = shapely.buffer(region, radius, quad_segs=ARC)
    return np.where(shapely.contains(grown, points), shapely.distance(grown.boundary, points), 0.0)
