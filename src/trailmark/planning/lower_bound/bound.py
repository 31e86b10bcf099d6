"""LowerBound: what every path of a robot costs at least, and whether there can be one."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark import se2
from trailmark.planning.lower_bound.mesh import Mesh, triangulated
from trailmark.planning.lower_bound.polyanya import shortest_way
from trailmark.planning.lower_bound.region import free_region
from trailmark.world import Robot, World

__all__ = ["Bound", "LowerBound"]

ROUNDING = 1e-9
"""Relative error that lengths may have; taken off."""

FloatArray = NDArray[np.float64]


class Bound(NamedTuple):
    """A proven lower bound.

    Attributes:
        cost: metres; infinite if no path exists.
        way: the disc centre's shortest way, shape (k, 2); empty if there is none or it was not sought.
    """

    cost: float
    way: FloatArray


class LowerBound:
    """The shortest way of a disc inside the robot's footprint, among obstacles that are never too large.

    A path of length L and rotation T costs L + w·T, w = 0.5 (se2.ROTATION_WEIGHT). A disc whose centre lies c from the
    reference point goes a way of D <= L + c·T. So the cost is at least D + (w − c)·T, and T at least the turn between
    the headings, if c <= w; otherwise L + w·T >= (w/c)·(L + c·T) >= (w/c)·D.

    Args:
        world: obstacles, bounds, boundary.
        robot: footprint.
    """

    def __init__(self, world: World, robot: Robot) -> None:
        self.world, self.robot = world, robot

    def of(self, start: FloatArray, goal: FloatArray) -> Bound:
        """Return the bound for a query; ends of shape (3,), valid."""
        straight = Bound(float(se2.distance(start, goal)), np.empty((0, 2)))
        center = np.array(self.robot.inscribed_disc.center)
        offset = float(np.hypot(*center))
        a, b = (se2.transform(q, center[None])[0] for q in (start, goal))
        found = self._way(a, b)
        if found is None:
            return straight
        length, way = found
        turn = abs(float(se2.difference(start, goal)[2]))
        w = se2.ROTATION_WEIGHT
        cost = length + (w - offset) * turn if offset <= w else (w / offset) * length
        return Bound(max(straight.cost, cost), way)

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
