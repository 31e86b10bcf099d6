"""LowerBound: what every path of a robot costs at least, and whether there can be one."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark import se2
from trailmark.curves import Steering
from trailmark.planning.lower_bound.mesh import Mesh, triangulated
from trailmark.planning.lower_bound.polyanya import shortest_way
from trailmark.planning.lower_bound.region import QUARTER, ellipse, free_region
from trailmark.shapes import Disc
from trailmark.world import Robot, World

__all__ = ["SECONDS_A_WAY", "Bound", "LowerBound"]

ROUNDING = 1e-9
"""Relative error that lengths may have; taken off."""

LARGE = 20_000
"""Vertices of a region from which on it is looked at only as far as a query needs."""

MANY = 150_000
"""Vertices of a region for each of which it takes twice as long as in a small one."""

SECONDS_A_VERTEX, SECONDS_A_WAY = 2.2e-5, 0.003
"""What cutting a region into triangles takes, and a query once that is done, with some to spare."""

FloatArray = NDArray[np.float64]


class Bound(NamedTuple):
    """A proven lower bound.

    Attributes:
        cost: metres; infinite if no path exists.
        way: the disc centre's shortest way, shape (k, 2); empty if there is none or it was not sought.
    """

    cost: float
    way: FloatArray


def _seconds(vertices: float) -> float:
    """Return how long cutting a region into triangles, and a way over them, are expected to take."""
    return SECONDS_A_VERTEX * vertices * (1.0 + vertices / MANY)


class LowerBound:
    """The shortest way of a disc inside the robot's footprint, among obstacles that are never too large.

    A path of length L and rotation T costs L + w·T, w = 0.5 (se2.ROTATION_WEIGHT). A disc whose centre lies c from the
    reference point goes a way of D <= L + c·T. So the cost is at least D + (w − c)·T, and T at least the turn between
    the headings, if c <= w; otherwise L + w·T >= (w/c)·(L + c·T) >= (w/c)·D. A car's path costs L, and T <= L/ρ: so
    D <= (1 + c/ρ)·L; and L is no less than the length of the shortest curve in the open.

    Args:
        world: obstacles, bounds, boundary.
        robot: footprint.
    """

    def __init__(self, world: World, robot: Robot) -> None:
        self.world, self.robot = world, robot

    def of(self, start: FloatArray, goal: FloatArray, most: float = np.inf) -> Bound:
        """Return the bound for a query.

        Args:
            start: valid, shape (3,).
            goal: valid, shape (3,).
            most: cost (metres) of a path that is known; in a large world only ways no longer than that are looked at.
        """
        straight = Bound(self._in_the_open(start, goal), np.empty((0, 2)))
        center, offset = self._center
        a, b = (se2.transform(q, center[None])[0] for q in (start, goal))
        # What a path of that cost can make the disc's centre go at most; longer ways are no rivals.
        longest = most * self._stretch
        if self._whole or self._size <= LARGE or not np.isfinite(longest):
            found = self._way(a, b)
        else:
            found = self._way_within(a, b, longest)
        if found is None:
            return straight
        length, way = found
        cost = length / self._stretch
        if self.robot.turning_radius is None:
            turn = abs(float(se2.difference(start, goal)[2]))
            cost += max(0.0, se2.ROTATION_WEIGHT - offset) * turn
        return Bound(max(straight.cost, cost), way)

    def seconds(self, start: FloatArray, goal: FloatArray, most: float = np.inf) -> float:
        """Return how long :meth:`of` is expected to take."""
        if self._whole or self._size <= LARGE or not np.isfinite(most):
            return SECONDS_A_WAY if self._whole else _seconds(self._size)
        xmin, ymin, xmax, ymax = self.world.bounds
        center = self._center[0]
        a, b = (se2.transform(q, center[None])[0] for q in (start, goal))
        longest = most * self._stretch
        share = min(1.0, ellipse(a, b, longest).area / ((xmax - xmin) * (ymax - ymin)))
        return _seconds(share * self._size)

    def _in_the_open(self, start: FloatArray, goal: FloatArray) -> float:
        """Return what the way would cost without obstacles, metres."""
        steering = Steering.of(self.robot)
        return float(se2.distance(start, goal) if steering is None else steering.lengths(start, goal))

    @property
    def _stretch(self) -> float:
        """How many metres the disc's centre goes at most for each metre that a path costs."""
        offset, radius = self._center[1], self.robot.turning_radius
        return max(1.0, offset / se2.ROTATION_WEIGHT) if radius is None else 1.0 + offset / radius

    @cached_property
    def _center(self) -> tuple[FloatArray, float]:
        """The disc's centre in the robot's frame, shape (2,), and its distance from the reference point, metres."""
        center = np.array(self.robot.inscribed_disc.center)
        return center, float(np.hypot(*center))

    @cached_property
    def _size(self) -> int:
        """About how many vertices the region has."""
        corners = 0
        for shape in self.world.obstacles:
            corners += 8 * QUARTER if isinstance(shape, Disc) else 4 * sum(len(r) for r in shape.polygon().rings())
        return corners + 4

    @property
    def _whole(self) -> bool:
        """Whether the region of the whole world is there already."""
        return "_parts" in self.__dict__ and bool(self._meshes)

    def _way_within(self, a: FloatArray, b: FloatArray, longest: float) -> tuple[float, FloatArray] | None:
        """Return what :meth:`_way` does, as far as it is below ``longest``: all such ways lie within an ellipse."""
        around = ellipse(a, b, longest)
        parts = shapely.get_parts(free_region(self.world, self.robot.inscribed_disc.radius, around))
        at = [np.flatnonzero(shapely.intersects_xy(parts, *point)) for point in (a, b)]
        if len(at[0]) == 0 or len(at[1]) == 0:
            return None
        if at[0][0] != at[1][0]:
            return longest, np.empty((0, 2))
        length, way = shortest_way(triangulated(parts[at[0][0]]), a, b)
        return (min(length, longest) * (1.0 - ROUNDING), way) if np.isfinite(length) else None

    def _way(self, a: FloatArray, b: FloatArray) -> tuple[float, FloatArray] | None:
        """Return the length of the disc centre's shortest way and its bends; None if that cannot be told."""
        parts = [int(p) for point in (a, b) for p in self._tree.query(shapely.Point(point), predicate="intersects")[:1]]
        if len(parts) < 2:
            # An end outside of the region: rounding. Nothing is claimed.
            return None
        if parts[0] != parts[1]:
            return np.inf, np.empty((0, 2))
        length, way = shortest_way(self._mesh(parts[0]), a, b)
        return (length * (1.0 - ROUNDING), way) if np.isfinite(length) else None

    @cached_property
    def _parts(self) -> Any:
        return shapely.get_parts(free_region(self.world, self.robot.inscribed_disc.radius))

    @cached_property
    def _tree(self) -> Any:
        return shapely.STRtree(self._parts)

    def _mesh(self, part: int) -> Mesh:
        if part not in self._meshes:
            self._meshes[part] = triangulated(self._parts[part])
        return self._meshes[part]

    @cached_property
    def _meshes(self) -> dict[int, Mesh]:
        return {}
