"""LowerBound: what every path of a robot costs at least, and whether there can be one.

1. A disc inside the footprint meets no obstacle either. Its centre stays in a region: the free space less all that is
   nearer than the radius, drawn never too small (:mod:`.region`).
2. The region falls into parts. Around the one that holds an end each edge is proven anew, by code that shares nothing
   with what has drawn it, to be nowhere that the disc's centre can be (:class:`.claims.Separation`): it stays inside.
3. If the other end lies outside of that part, there is no path. If not, the part is cut into triangles,
   among which the centre's shortest path is found exactly (:mod:`.mesh`), D metres long.
4. A path of length L and rotation T costs L + w·T, w = 0.5 (se2.ROTATION_WEIGHT). With the disc's centre c metres from
   the reference point, D <= L + c·T. So the cost is at least D + (w − c)·T, and T at least the turn between the
   headings, if c <= w; otherwise L + w·T >= (w/c)·(L + c·T) >= (w/c)·D. A car's path costs L, and T <= L/ρ: so
   D <= (1 + c/ρ)·L. No path costs less than the way in the open either.

In a large world a known path's cost says how far to look: all ways that are no longer lie within an ellipse, and what
leaves that costs more. Of a grid map the shortest path is found along tangents, without a region.

Under another objective a path costs at least ρ·L + r·T, ρ the least density anywhere and r the cost of a radian: at
least min(ρ, r/w) times L + w·T. The other bound is that of the densities on a grid (:mod:`.eikonal`). The larger holds.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import shapely

from trailmark import se2
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.curves import Steering
from trailmark.motion import Motion
from trailmark.proofs.claims import Separation
from trailmark.proofs.eikonal import Eikonal
from trailmark.proofs.mesh import Mesh, locate, shortest_point_path, triangulated
from trailmark.proofs.region import MARGIN, QUARTER, Stop, ellipse, local_origin, look, region_parts
from trailmark.se2 import FloatArray
from trailmark.search.grid_tangents import GridTangents
from trailmark.shapes import Disc
from trailmark.world import Robot, World
from trailmark.world.goals import Goal

__all__ = ["Bound", "LowerBound", "lower_bound_of"]

ROUNDING, DIGITS = 1e-9, 1e-14
"""Relative error that lengths may have; and the share of the largest coordinate that they may be wrong by, too."""

LARGE, LARGEST = 20_000, 100_000
"""Corners of obstacles from which on a world is looked at only as far as a query needs, unless told otherwise; and from
which on none is cut into triangles: shapely then takes seconds, and cannot be interrupted."""

PART = 500
"""Labels of a search along tangents between two looks at whether to stop."""


class Bound(NamedTuple):
    """A proven lower bound.

    Attributes:
        cost: metres; infinite if no path exists.
        path: the disc centre's shortest path, shape (k, 2); empty if there is none or it was not sought.
    """

    cost: float
    path: FloatArray


class LowerBound:
    """Lower bounds for one robot in one world; what queries share is kept.

    Args:
        world: obstacles, bounds, boundary.
        robot: footprint.
        grid: the world's outlines in cells, if they are there already.
        large: corners of obstacles from which on it is looked at only as far as a query needs.
        motion: tells what paths cost, if not what :class:`~trailmark.Path` says.

    Attributes:
        corners: about how many all obstacles have.
        least: that a metre costs, or half a metre's turn.
    """

    def __init__(
        self,
        world: World,
        robot: Robot,
        grid: ObstacleGrid | None = None,
        *,
        large: int = LARGE,
        motion: Motion | None = None,
    ) -> None:
        self.world, self.robot, self.large, self._grid = world, robot, large, grid
        disc, self._origin = robot.inscribed_disc, local_origin(world)
        self._center, self._offset = np.array(disc.center), float(np.hypot(*disc.center))
        self._radius = disc.radius
        # How many metres the disc's centre goes at most for each metre of cost, as that of length and turns.
        turns = max(1.0, self._offset / se2.ROTATION_WEIGHT)
        self._stretch = turns if robot.turning_radius is None else 1.0 + self._offset / robot.turning_radius
        self.least, self._eikonal = 1.0, None
        if motion is not None:
            density = motion.density
            # A car's turning costs nothing by itself.
            each = (density.least, np.inf if robot.turning_radius is not None else density.rotation)
            self.least = min(each[0], each[1] / se2.ROTATION_WEIGHT)
            self._eikonal = Eikonal(motion)
        if grid is not None:
            # To go through thousands of obstacles takes as long as planning may.
            self.corners = 4 * len(grid.segments) + 8 * QUARTER * len(grid.discs) + 4
        else:
            discs = sum(isinstance(shape, Disc) for shape in world.obstacles)
            rings = [r for s in world.obstacles if not isinstance(s, Disc) for r in s.polygon().rings()]
            self.corners = 4 * sum(map(len, rings)) + 8 * QUARTER * discs + 4
        self._parts: Any = None
        self._meshes: dict[int, Mesh | None] = {}

    def of(self, start: FloatArray, goal: FloatArray, limit: float = np.inf, stop: Stop | None = None) -> Bound:
        """Return the bound for a query.

        Args:
            start: valid, shape (3,).
            goal: valid, shape (3,).
            limit: cost (metres) of a known path; in a large world only paths that cost no more are considered.
            stop: asked now and then whether to stop, with a bound that leaves obstacles aside, or that of a grid map
                as far as it is known by then.
        """
        steering = Steering.of(self.robot)
        cost = float(se2.distance(start, goal) if steering is None else steering.lengths(start, goal))
        a, b = (se2.transform(q, self._center[None])[0] for q in (start, goal))
        try:
            length, path = self._shortest(a, b, limit / self.least * self._stretch, stop)
        except TimeoutError:
            length, path = 0.0, np.empty((0, 2))
        bound = length / self._stretch
        if self.robot.turning_radius is None:
            turn = abs(float(se2.difference(start, goal)[2]))
            bound += max(0.0, se2.ROTATION_WEIGHT - self._offset) * turn
        cost = self.least * max(cost, bound)
        if self._eikonal is not None and np.isfinite(cost) and not (stop is not None and stop()):
            cost = max(cost, self._eikonal.of(start, goal))
        return Bound(cost, path)

    def between(self, a: FloatArray, b: FloatArray, near: float = 0.0) -> float:
        """Return what any way between positions (2,), or so near to them, costs at least, metres, for all headings."""
        return self.least * max(0.0, float(np.hypot(*(b - a))) - near)

    def shuts_out(self, start: FloatArray, goal: Goal, stop: Stop | None = None) -> bool:
        """Return whether it is proven that no path from a valid start, shape (3,), ends anywhere in a goal.

        No path leads the disc's centre out of a part, and wherever it may be in the goal lies outside of that.
        """
        a = se2.transform(start, self._center[None])[0]
        place = shapely.Point(goal.disc[0]) if goal.region is None else goal.region.shapely()
        place = shapely.transform(place, lambda points: points - self._origin)
        try:
            for part, mesh in self._around(a, a, np.inf, stop):
                if locate(mesh, a - self._origin) >= 0:
                    away = float(shapely.distance(part, place))
                    return away > (goal.position_tolerance + self._offset) * (1.0 + ROUNDING) + MARGIN
        except TimeoutError:
            pass
        return False

    @property
    def ready(self) -> bool:
        """Whether what queries share is computed."""
        return self._parts is not None or self.tangents is not None

    @property
    def takes_long(self) -> bool:
        """Whether a bound may take more than a few tenths of a second."""
        return self.corners > self.large and not self.ready

    @cached_property
    def tangents(self) -> GridTangents | None:
        """What proves the bounds of a grid map; None for other worlds."""
        return GridTangents.of(self.world, self._radius)

    def _shortest(self, a: FloatArray, b: FloatArray, longest: float, stop: Stop | None) -> tuple[float, FloatArray]:
        """Return a length (metres) that no way of the disc's centre from a to b is shorter than, and that way's bends.

        It is infinite if there is no way; 0 if nothing can be told.
        """
        if self.tangents is not None:
            search = self.tangents.search(a, b)
            while not (stop is not None and stop()) and not search.run(PART):
                pass
            # That there is none is proven elsewhere, by two programs.
            known = self.tangents.bound(search) if np.isfinite(search.bound) else 0.0
            return known, np.empty((0, 2))
        ends = a - self._origin, b - self._origin
        most = np.inf if self._whole(longest) else longest * (1.0 - ROUNDING)
        for _, mesh in self._around(a, b, longest, stop):
            inside = [locate(mesh, end) >= 0 for end in ends]
            if not all(inside):
                # Of neither, by rounding, nothing is claimed.
                return (most if any(inside) else 0.0), np.empty((0, 2))
            length, path = shortest_point_path(mesh, *ends)
            if not np.isfinite(length):
                break
            size = max(float(np.abs(self.world.bounds).max()), float(np.abs(mesh.points).max()))
            least = max(0.0, length * (1.0 - ROUNDING) - DIGITS * size * (len(path) + 4))
            return min(least, most), path + self._origin
        return 0.0, np.empty((0, 2))

    def _whole(self, longest: float) -> bool:
        """Return whether ways that go so far (metres) are looked for in the region of the whole world."""
        return self._parts is not None or self.corners <= self.large or not np.isfinite(longest)

    def _around(self, a: FloatArray, b: FloatArray, longest: float, stop: Stop | None) -> Iterator[tuple[Any, Mesh]]:
        """Yield the parts that an end lies in, the smaller first, and that none but longer ways are proven to leave.

        Args:
            a: where the disc's centre begins, shape (2,).
            b: where it ends.
            longest: metres; in a large world only ways no longer than that are looked at.
            stop: may raise a TimeoutError.
        """
        whole = self._whole(longest)
        within = None if whole else ellipse(a - self._origin, b - self._origin, longest)
        xmin, ymin, xmax, ymax = self.world.bounds
        share = 1.0 if within is None else min(1.0, float(within.area) / ((xmax - xmin) * (ymax - ymin)))
        if share * self.corners > LARGEST:
            return
        parts, meshes = self._parts, self._meshes
        if not whole or parts is None:
            parts = region_parts(self.world, self._radius, within, origin=self._origin, stop=stop)
            meshes = {}
        if whole:
            self._parts, self._meshes = parts, meshes
        at = [shapely.intersects_xy(parts, *(end - self._origin)) for end in (a, b)]
        for n in sorted(
            np.flatnonzero(at[0] | at[1]).tolist(), key=lambda n: int(shapely.get_num_coordinates(parts[n]))
        ):
            if n not in meshes:
                look(stop)
                mesh = triangulated(parts[n])
                if mesh is not None:
                    edges = mesh.points[mesh.edges] + self._origin
                    ends = None if whole else (a, b)
                    if not self._separation.shuts_in(edges, ends, longest * (1.0 - ROUNDING)):
                        mesh = None
                meshes[n] = mesh
            if (known := meshes[n]) is not None:
                yield parts[n], known

    @cached_property
    def _separation(self) -> Separation:
        return Separation(self.world, self._radius, self._grid)


def lower_bound_of(motion: Motion) -> LowerBound:
    """Return what proves lower bounds on the cost of paths of a robot's motions."""
    checker = motion.checker
    return LowerBound(checker.world, checker.robot, checker.grid, motion=motion if motion.weighted else None)
