"""Penetration depth: the shortest translation that takes the robot out of an obstacle.

Source of the definition: Dobkin, Hershberger, Kirkpatrick & Suri, "Computing the intersection-depth of polyhedra",
Algorithmica 9 (1993).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
import shapely

from trailmark import se2
from trailmark.audit.minkowski import penetration_depths
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Shape, convex_pieces, signed_area
from trailmark.world import Robot

__all__ = ["RISE", "Penetration", "bounds_depth", "deepest", "first_rise"]

ARC = 64
"""Chords of a quarter of a circle, where a disc meets what is not convex: short by 7.5e-5 of its radius at most."""

RISE = 1e-4
"""Metres by which a robot on its way out may be deeper than it was before."""

LOOKS = 50_000
"""Depths computed at most to see that they never rise: an interval for which that is not enough counts as one."""

SAMPLES, PRECISION, EFFORT = 17, 1e-3, 200
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
        if isinstance(body, Disc) and isinstance(shape, Disc):
            apart = np.hypot(*(states[:, :2] - shape.center).T)
            return np.asarray(np.maximum(0.0, body.radius + shape.radius - apart))
        if isinstance(body, Disc):
            return self._disc_depths(states[:, :2])
        if isinstance(shape, Disc):
            # As the robot sees it.
            cos, sin = np.cos(states[:, 2]), np.sin(states[:, 2])
            dx, dy = (np.asarray(shape.center) - states[:, :2]).T
            return self._disc_depths(np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx]))
        return np.asarray(penetration_depths(*self._pieces, np.array(states)))

    def _disc_depths(self, centers: FloatArray) -> FloatArray:
        """Return how far a disc at some places (n, 2) must be moved to leave the polygon, which is one of the two."""
        grown, edge, spare = self._grown
        points = shapely.points(centers)
        apart = shapely.distance(edge, points)
        return np.asarray(np.maximum(0.0, spare + np.where(shapely.contains(grown, points), apart, -apart)))

    @cached_property
    def _grown(self) -> tuple[shapely.Polygon, shapely.Geometry, float]:
        """The polygon in which the disc's centre may not be, its edge, and how much farther the disc reaches."""
        body, shape = self.robot.footprint, self.shape
        disc, polygon = (body, shape.polygon()) if isinstance(body, Disc) else (shape, self.robot.outline)
        assert isinstance(disc, Disc)  # noqa: S101 # one of the two is
        region = polygon.shapely()
        if len(convex_pieces(polygon)) == 1:
            return region, region.boundary, disc.radius
        grown = shapely.buffer(region, disc.radius, quad_segs=ARC)
        return grown, grown.boundary, 0.0

    @cached_property
    def _pieces(self) -> tuple[FloatArray, FloatArray]:
        """Convex pieces of obstacle and robot, counter-clockwise, each of shape (k, m, 2)."""
        return _pieces_of(self.shape.polygon()), _pieces_of(self.robot.outline)


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


def first_rise(
    depths: Callable[[FloatArray], FloatArray],
    poses: Callable[[FloatArray], FloatArray],
    u0: float,
    u1: float,
    rise: float,
) -> float | None:
    """Return a place on an interval of a path before which depths are proven not to rise; None if that is so for all.

    Proven is that nowhere the depth is larger by more than ``rise`` (metres) than anywhere before. Other arguments are
    those of :func:`deepest`.
    """
    places = np.linspace(u0, u1, SAMPLES) if u1 > u0 else np.array([u0])
    found = depths(poses(places))
    while True:
        least = np.minimum.accumulate(found)
        # Between two places, depths change by no more than the path goes.
        most = 0.5 * (found[1:] + found[:-1] + np.diff(places)) - least[:-1]
        rises = found[1:] - least[:-1] > rise
        split = np.flatnonzero(rises | (most > rise))
        if rises.any() or (len(split) and len(places) > LOOKS):
            return float(places[split[0]])
        if len(split) == 0:
            return None
        new = 0.5 * (places[split] + places[split + 1])
        places, found = np.append(places, new), np.append(found, depths(poses(new)))
        order = np.argsort(places, kind="stable")
        places, found = places[order], found[order]


def _pieces_of(polygon: Polygon) -> FloatArray:
    pieces = np.array(convex_pieces(polygon))
    area = np.array([signed_area(piece) for piece in pieces])
    pieces[area < 0.0] = pieces[area < 0.0, ::-1]
    # Triangles without area lie on the edges of others.
    return np.ascontiguousarray(pieces[np.abs(area) > 1e-12 * np.abs(area).max()])
