"""The campaign's judge: how deep a robot overlaps what blocks it, by shapely and, where that is close, in fractions.

It knows shapes, nothing of :mod:`trailmark.collision`. The depth of an overlap is the largest distance from a point
that both regions share to the outline of one of them: no shorter shift undoes the overlap. Found at corners and at
middles of edges it may come out too small, never too large; so what is called a collision is one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.soundness import exact
from trailmark.shapes import Disc, Polygon
from trailmark.world import Robot, World

__all__ = ["ALLOWED", "REFUSED", "Reference", "deepest", "least_room", "moves", "short_turn"]

FloatArray = NDArray[np.float64]

ALLOWED = 1e-7
"""Metres of overlap that the checker's docstring allows."""

REFUSED = 1e-6
"""Metres of room with which a configuration has to be called valid."""

KEPT = 16
"""Intervals of a motion that are looked at in each level: those with the least room."""

PRECISE = 1e-4
"""Metres by which the least room along a way may be less than the one found."""

LEVELS = 16
"""Times that a motion's intervals are halved."""


class Reference:
    """Room and overlap of one robot in one world.

    A robot that keeps a clearance is its footprint dilated by it.

    Attributes:
        round: whether the robot is round, with or without a clearance.
        radius: metres by which the robot's ring of vertices is dilated; that of a round robot is a point.
        reach: largest distance (metres) of the robot's outline from its reference point.
        sweep: the same of its ring, 0 for a round robot: how far a radian of turning moves it.
        allowed: metres of overlap that count as touching: ALLOWED, and what the rounding of coordinates makes of them.
    """

    def __init__(self, world: World, robot: Robot) -> None:
        self.bounds = world.bounds
        shape = robot.footprint
        self.round = isinstance(shape, Disc)
        self.radius = robot.clearance + (shape.radius if isinstance(shape, Disc) else 0.0)
        ring = np.zeros((1, 2)) if isinstance(shape, Disc) else np.asarray(shape.polygon().vertices)
        self.ring = ring[:, 0] + 1j * ring[:, 1]
        self.sweep = float(np.abs(self.ring).max())
        self.reach = self.sweep + self.radius
        far = max(abs(v) for v in world.bounds) + self.reach
        self.allowed = ALLOWED + 8.0 * np.finfo(float).eps * far
        regions = [_region(shape.polygon()) for shape in world.obstacles if not isinstance(shape, Disc)]
        if world.boundary is not None:
            xmin, ymin, xmax, ymax = world.bounds
            room = 4.0 * self.reach + (xmax - xmin) + (ymax - ymin)
            outside = shapely.box(xmin - room, ymin - room, xmax + room, ymax + room).exterior
            regions.append(shapely.Polygon(outside, [world.boundary.vertices]))
        self.regions = np.array(regions, dtype=object)
        self.outlines = shapely.boundary(self.regions)
        shapely.prepare(self.regions)
        self.tree = shapely.STRtree(self.regions)
        # Single edges: the distance to a region of thousands takes as many looks each time.
        self.edges = shapely.STRtree(_edges(self.regions))
        discs = [(*shape.center, shape.radius) for shape in world.obstacles if isinstance(shape, Disc)]
        self.discs = np.array(discs, dtype=np.float64).reshape(-1, 3)

    def bodies(self, q: FloatArray) -> NDArray[Any]:
        """Return the robot at configurations of shape (n, 3), not dilated: points for a disc, else polygons."""
        if self.round:
            return np.asarray(shapely.points(q[:, :2]))
        z = np.exp(1j * q[:, 2, None]) * self.ring
        return np.asarray(shapely.polygons(np.stack([q[:, 0, None] + z.real, q[:, 1, None] + z.imag], axis=-1)))

    def clearance(self, q: FloatArray, bodies: NDArray[Any] | None = None) -> FloatArray:
        """Return the room (metres, shape (n,)) of configurations of shape (n, 3); 0 or less on touching or overlap."""
        bodies = self.bodies(q) if bodies is None else bodies
        room = -self._beyond(q)
        if len(self.regions):
            (body, _), gap = self.edges.query_nearest(bodies, return_distance=True, all_matches=False)
            room[body] = np.minimum(room[body], gap - self.radius)
            corner = q[:, 0] + 1j * q[:, 1] + np.exp(1j * q[:, 2]) * self.ring[0]
            for region in self.regions:
                # A body that meets no edge lies inside or outside as a whole.
                room[shapely.intersects_xy(region, corner.real, corner.imag)] = -self.radius
        for x, y, r in self.discs:
            near = np.flatnonzero(np.hypot(q[:, 0] - x, q[:, 1] - y) - r - self.reach < room)
            if len(near):
                room[near] = np.minimum(
                    room[near], shapely.distance(bodies[near], shapely.Point(x, y)) - r - self.radius
                )
        return np.asarray(room)

    def depth(self, q: FloatArray) -> FloatArray:
        """Return how deep (metres, shape (n,)) configurations of shape (n, 3) overlap; 0 if they do not."""
        bodies = self.bodies(q)
        found = np.maximum(0.0, self._beyond(q))
        if len(self.regions):
            body, region = self.tree.query(bodies, predicate="dwithin", distance=self.radius)
            apart = shapely.distance(bodies[body], self.regions[region])
            if self.round:
                within = shapely.distance(bodies[body], self.outlines[region])
            else:
                within = self._shared(bodies[body], region)
            np.maximum.at(found, body, self.radius + np.where(apart > 0.0, -apart, within))
        for x, y, r in self.discs:
            near = np.flatnonzero(np.hypot(q[:, 0] - x, q[:, 1] - y) < r + self.reach)
            if len(near):
                center = shapely.Point(x, y)
                gap = shapely.distance(bodies[near], center)
                if not self.round:
                    within = shapely.distance(shapely.boundary(bodies[near]), center)
                    gap = np.where(gap > 0.0, gap, -within)
                found[near] = np.maximum(found[near], r + self.radius - gap)
        return found

    def collides(self, q: FloatArray) -> NDArray[np.bool_]:
        """Return which configurations, shape (n, 3), overlap by more than is allowed; close ones in fractions."""
        depth = self.depth(q)
        wrong = depth > self.allowed
        for i in np.flatnonzero(wrong & (depth < self.allowed + 1e-8)):
            wrong[i] = self.certainly(q[i])
        return np.asarray(wrong)

    def certainly(self, q: FloatArray) -> bool:
        """Return whether the overlap of a configuration, shape (3,), is more than allowed, decided in fractions."""
        depth = Fraction(self.allowed)
        if self._beyond(q[None])[0] > self.allowed:
            return True
        z = np.exp(1j * q[2]) * self.ring
        body = exact.points_of(np.column_stack([q[0] + z.real, q[1] + z.imag]))
        # Metres that the ring has to keep from an outline; if negative, it may overlap so deep.
        near_by = Fraction(self.radius) - depth
        near = self.tree.query(self.bodies(q[None])[0], predicate="dwithin", distance=self.radius + 1e-6)
        for region in self.regions[near] if len(self.regions) else ():
            rings = [exact.points_of(shapely.get_coordinates(r)[:-1]) for r in (region.exterior, *region.interiors)]
            if self.round:
                if exact.inside(body[0], rings) or exact.nearer(body[0], rings, near_by):
                    return True
            elif exact.overlaps([body], rings, max(-near_by, Fraction(0))) or exact.apart_less([body], rings, near_by):
                return True
        for x, y, r in self.discs:
            center = (Fraction(float(x)), Fraction(float(y)))
            if self.round:
                if sum((u - v) ** 2 for u, v in zip(center, body[0], strict=True)) < (Fraction(r) + near_by) ** 2:
                    return True
            elif exact.inside(center, [body]) or exact.nearer(center, [body], Fraction(r) + near_by):
                return True
        return False

    def _shared(self, bodies: NDArray[Any], region: NDArray[np.int64]) -> FloatArray:
        """Return how deep each body and its region reach into one another, metres."""
        common = shapely.intersection(bodies, self.regions[region])
        found = np.zeros(len(bodies))
        points, owner = shapely.get_coordinates(common, return_index=True)
        if len(points) == 0:
            return found
        alike = owner[1:] == owner[:-1]
        middles = 0.5 * (points[1:] + points[:-1])[alike]
        points, owner = np.concatenate([points, middles]), np.concatenate([owner, owner[1:][alike]])
        places = shapely.points(points)
        # A middle between two rings of the same geometry may lie outside of both.
        within = shapely.distance(places, common[owner]) <= 1e-9
        for outlines in (self.outlines[region], shapely.boundary(bodies)):
            np.maximum.at(found, owner, np.where(within, shapely.distance(places, outlines[owner]), 0.0))
        return found

    def _beyond(self, q: FloatArray) -> FloatArray:
        """Return how far (metres) the robot reaches over the bounds; negative where it stays inside."""
        xmin, ymin, xmax, ymax = self.bounds
        z = np.exp(1j * q[:, 2, None]) * self.ring
        x, y = q[:, 0, None] + z.real, q[:, 1, None] + z.imag
        return np.asarray(
            np.maximum(np.maximum(xmin - x, x - xmax), np.maximum(ymin - y, y - ymax)).max(axis=1) + self.radius
        )


def _edges(regions: NDArray[Any]) -> NDArray[Any]:
    """Return the edges of regions as lines."""
    points, ring = shapely.get_coordinates(shapely.get_rings(regions), return_index=True)
    alike = ring[1:] == ring[:-1]
    return np.asarray(shapely.linestrings(np.stack([points[:-1][alike], points[1:][alike]], axis=1)))


def _region(polygon: Polygon) -> Any:
    return shapely.Polygon(polygon.vertices, polygon.holes)


def short_turn(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the turn from headings a to b the shorter way round, radians; half a turn may go either way."""
    turn = np.asarray(b - a, dtype=np.float64)
    return np.where(turn > math.pi, turn - 2.0 * math.pi, np.where(turn < -math.pi, turn + 2.0 * math.pi, turn))


def moves(a: FloatArray, b: FloatArray) -> Callable[[NDArray[np.int64], FloatArray], FloatArray]:
    """Return what places motions from a to b, shapes (n, 3): from indices and fractions, shapes (m,), to (m, 3)."""
    way = np.column_stack([b[:, :2] - a[:, :2], short_turn(a[:, 2], b[:, 2])])
    return lambda which, t: np.asarray(a[which] + t[:, None] * way[which])


def deepest(
    reference: Reference,
    place: Callable[[NDArray[np.int64], FloatArray], FloatArray],
    bounds: FloatArray,
    pieces: int = 1,
) -> tuple[FloatArray, FloatArray]:
    """Return how deep each of n motions overlaps at worst, and where: metres and fractions, each of shape (n,).

    Intervals are halved, as long as the room in their middle leaves a collision possible; of each motion the KEPT ones
    with the least room.

    Args:
        reference: the judge.
        place: from indices of motions and fractions, each of shape (m,), to configurations of shape (m, 3).
        bounds: metres that each motion moves any point of the robot at most, shape (n,).
        pieces: equal intervals that each motion begins with.
    """
    n = len(bounds)
    worst, where = np.zeros(n), np.zeros(n)
    which = np.repeat(np.arange(n), pieces)
    low = np.tile(np.arange(pieces) / pieces, n)
    width = 1.0 / pieces
    for _ in range(LEVELS):
        if len(which) == 0:
            break
        middle = low + 0.5 * width
        q = place(which, middle)
        room = reference.clearance(q)
        hit = np.flatnonzero(room <= 1e-9)
        if len(hit):
            depth = reference.depth(q[hit])
            order = np.argsort(depth)
            deeper = order[depth[order] > worst[which[hit[order]]]]
            worst[which[hit[deeper]]], where[which[hit[deeper]]] = depth[deeper], middle[hit[deeper]]
        need = 0.5 * width * bounds[which] * (1.0 + 1e-9)
        open_ = np.flatnonzero((room < need) & (need > 1e-8))
        open_ = open_[np.lexsort((room[open_], which[open_]))]
        rank = np.arange(len(open_)) - np.searchsorted(which[open_], which[open_])
        open_ = open_[rank < max(KEPT, pieces)]
        which, low = np.repeat(which[open_], 2), np.repeat(low[open_], 2)
        width *= 0.5
        low[1::2] += width
    return worst, where


def least_room(reference: Reference, place: Callable[[FloatArray], FloatArray], bound: float) -> float:
    """Return the least room (metres) along a way, at most PRECISE above the true one.

    Args:
        reference: the judge.
        place: from fractions of the way, shape (m,), to configurations of shape (m, 3).
        bound: metres that the way moves any point of the robot at most.
    """
    least, width, low = float(reference.clearance(place(np.array([0.0, 1.0]))).min()), 1.0, np.zeros(1)
    while len(low):
        room = reference.clearance(place(low + 0.5 * width))
        least = min(least, float(room.min()))
        low = np.repeat(low[room - 0.5 * width * bound < least - PRECISE], 2)
        width *= 0.5
        low[1::2] += width
    return least
