"""The referee of the collision tests and benchmarks: shapely and numpy alone, none of trailmark's checks.

Obstacle polygons go to shapely as they are given; discs and bounds are compared by exact formulas; the robot is
placed by complex multiplication. It is meant to be right and simple; speed comes from shapely's STRtree.
"""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.shapes import Disc
from trailmark.world import Robot, World

__all__ = ["BAND", "Oracle", "motion_states"]

FloatArray = NDArray[np.float64]

BAND = 1e-6
"""Metres of gap or overlap within which a configuration counts as touching: no verdict is wrong there."""


class Oracle:
    """Exact distances and overlaps of one robot in one world.

    Args:
        world: obstacles, bounds, boundary.
        robot: footprint.
        band: overlap (metres) from which :meth:`collides` calls a collision.
    """

    def __init__(self, world: World, robot: Robot, band: float = BAND) -> None:
        self.bounds = world.bounds
        self.band = band
        self.radius = robot.footprint.radius if isinstance(robot.footprint, Disc) else None
        self.outline = np.zeros(1, complex)
        self.core = np.zeros(1, complex)
        if self.radius is None:
            ring = shapely.Polygon(robot.footprint.polygon().vertices)
            # What is left of the footprint after the band is taken off all round.
            core = shapely.buffer(ring, -band)
            self.outline = _complex(ring)
            self.core = _complex(max(shapely.get_parts(core), key=shapely.area))
        self.reach = float(np.abs(self.outline).max()) + (self.radius or 0.0)
        # Obstacles are kept apart, not merged: a union would move vertices by rounding.
        polygons = [shape.polygon().shapely() for shape in world.obstacles if not isinstance(shape, Disc)]
        if world.boundary is not None:
            xmin, ymin, xmax, ymax = world.bounds
            far = 4.0 * self.reach + 10.0
            frame = shapely.box(xmin - far, ymin - far, xmax + far, ymax + far)
            polygons.append(shapely.difference(frame, world.boundary.shapely()))
        self.polygons = np.array(polygons, dtype=object)
        shapely.prepare(self.polygons)
        self.tree = shapely.STRtree(self.polygons)
        # Overlap counts either way: of the robot less the band, or of an obstacle less the band. A corner of either
        # may lie deep in the other although little of it does.
        shrunk = shapely.buffer(self.polygons, -band) if polygons else self.polygons
        self.shrunk_tree = shapely.STRtree(shrunk[~shapely.is_empty(shrunk)] if polygons else shrunk)
        discs = [(*shape.center, shape.radius) for shape in world.obstacles if isinstance(shape, Disc)]
        self.discs = np.array(discs, dtype=np.float64).reshape(-1, 3)

    def clearance(self, q: FloatArray) -> FloatArray:
        """Return the distance (metres) to what blocks the robot at q, shape (n, 3); 0 on overlap or outside."""
        bodies = self._bodies(q, self.outline)
        best = np.maximum(0.0, -self._beyond(q))
        if len(self.polygons):
            (body, _), gap = self.tree.query_nearest(bodies, return_distance=True, all_matches=False)
            best[body] = np.minimum(best[body], np.maximum(0.0, gap - (self.radius or 0.0)))
        for x, y, r in self.discs:
            gap = shapely.distance(bodies, shapely.Point(x, y)) - r - (self.radius or 0.0)
            best = np.minimum(best, np.maximum(0.0, gap))
        return np.asarray(best)

    def collides(self, q: FloatArray) -> NDArray[np.bool_]:
        """Return which configurations, shape (n, 3), overlap an obstacle or leave the bounds by more than band."""
        hit = self._beyond(q) > self.band
        near = np.flatnonzero(~hit & self._near(q))
        if self.radius is not None:
            points = shapely.points(q[near, :2])
            if self.radius > self.band:
                found = self.tree.query(points, predicate="dwithin", distance=self.radius - self.band)[0]
            else:
                found = self.tree.query(points, predicate="intersects")[0]
        else:
            found = self.tree.query(self._bodies(q[near], self.core), predicate="intersects")[0]
            hit[near[found]] = True
            near = near[~hit[near]]
            found = self.shrunk_tree.query(self._bodies(q[near], self.outline), predicate="intersects")[0]
        hit[near[found]] = True
        return hit | self._hits_disc(q)

    def _near(self, q: FloatArray) -> NDArray[np.bool_]:
        """Return which reference points have a polygon within the robot's reach: the others cannot overlap one."""
        near = np.zeros(len(q), bool)
        if len(self.polygons):
            found = self.tree.query(shapely.points(q[:, :2]), predicate="dwithin", distance=self.reach)[0]
            near[found] = True
        return near

    def _hits_disc(self, q: FloatArray) -> NDArray[np.bool_]:
        hit = np.zeros(len(q), bool)
        for x, y, r in self.discs:
            near = np.flatnonzero(np.hypot(q[:, 0] - x, q[:, 1] - y) <= r + self.reach)
            if self.radius is not None:
                hit[near] |= np.hypot(q[near, 0] - x, q[near, 1] - y) < r + self.radius - self.band
            else:
                hit[near] |= shapely.distance(self._bodies(q[near], self.outline), shapely.Point(x, y)) < r - self.band
        return hit

    def disagrees(self, q: FloatArray, valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return where ``valid``, shape (n,), is wrong: a collision called valid, or clear space called invalid."""
        collides = self.collides(q)
        wrong = valid & collides
        refused = np.flatnonzero(~valid & ~collides)
        wrong[refused] = self.clearance(q[refused]) > self.band
        return wrong

    def _beyond(self, q: FloatArray) -> FloatArray:
        """Return how far (metres) the robot reaches over the bounds; negative where it stays inside."""
        xmin, ymin, xmax, ymax = self.bounds
        # Only its outermost points matter, and those stand on the outline.
        z = np.exp(1j * q[:, 2, None]) * self.outline
        x, y, r = q[:, 0, None] + z.real, q[:, 1, None] + z.imag, self.radius or 0.0
        beyond = np.maximum(np.maximum(xmin - x, x - xmax), np.maximum(ymin - y, y - ymax)).max(axis=1) + r
        return np.asarray(beyond)

    def _bodies(self, q: FloatArray, ring: NDArray[np.complex128]) -> NDArray[np.object_]:
        """Return the robot placed at each configuration: points for a disc, else polygons with outline ``ring``."""
        if self.radius is not None:
            return np.asarray(shapely.points(q[:, :2]))
        z = np.exp(1j * q[:, 2, None]) * ring
        rings = np.stack([q[:, 0, None] + z.real, q[:, 1, None] + z.imag], axis=-1)
        return np.asarray(shapely.polygons(rings))


def motion_states(a: FloatArray, b: FloatArray, samples: int) -> FloatArray:
    """Return ``samples`` configurations of each motion, shape (n, samples, 3), both ends among them.

    x and y go linearly, the heading along the shorter arc; half a turn goes counter-clockwise.
    """
    turn = b[:, 2] - a[:, 2]
    turn = turn - 2.0 * math.pi * np.round(turn / (2.0 * math.pi))
    turn = np.where(turn <= -math.pi, math.pi, turn)
    way = np.column_stack([b[:, :2] - a[:, :2], turn])
    return a[:, None] + np.linspace(0.0, 1.0, samples)[None, :, None] * way[:, None]


def _complex(ring: shapely.Polygon) -> NDArray[np.complex128]:
    points = shapely.get_coordinates(ring.exterior)[:-1]
    return np.asarray(points[:, 0] + 1j * points[:, 1])
