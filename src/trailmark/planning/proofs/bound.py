"""LowerBound: what every path of a robot costs at least, and whether there can be one."""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import shapely

from trailmark import se2
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.curves import Steering
from trailmark.goals import Goal
from trailmark.planning.grids.grid_tangents import GridTangents
from trailmark.planning.proofs.grown import QUARTER
from trailmark.planning.proofs.mesh import Mesh, locate, triangulated
from trailmark.planning.proofs.polyanya import shortest_point_path
from trailmark.planning.proofs.region import MARGIN, ellipse, local_origin, region_parts
from trailmark.planning.proofs.separation import Separation
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc
from trailmark.world import Robot, World

__all__ = ["CUTTING", "SLOWER", "Bound", "LowerBound", "region_work"]

ROUNDING = 1e-9
"""Relative error that lengths may have; taken off."""

DIGITS = 1e-14
"""Share of the largest coordinate, and of the region's size, that a length may be wrong by, too."""

LARGE = 20_000
"""Vertices of a region from which on it is looked at only as far as a query needs, unless told otherwise."""

MANY = 150_000
"""Vertices of a region for each of which it takes twice as long as in a small one."""

GROWING = 4.5e-6
"""Seconds for each corner of the obstacles: making the region, in parts that nothing joins.

This and the like are constants: an answer must not depend on how long earlier queries happened to take.
"""

CUTTING = 1e-5
"""Seconds for each vertex of a part: cutting it into triangles, and proving that no path leaves them."""

SLOWER = 2.0
"""Times as long as expected that must be left for what cannot be ended halfway: a machine may be slow, or busy."""

ROUNDED = 1.5
"""Vertices of a region for each corner of the obstacles, around which it is rounded."""

ASKING = 0.003
"""Seconds for each query, once the region is cut."""

NEARNESS = 0.25
"""Corners that take as long as telling whether an obstacle lies near a query."""

LAST = 0.9
"""Share of the time left after which making a region, or cutting it, is given up."""

PART = 500
"""Labels of a search along tangents between two looks at the clock."""

MAX_FREED = 64
"""Obstacles removed after which what was proven before they were is used no more."""


Ends = tuple[FloatArray, FloatArray]


class Bound(NamedTuple):
    """A proven lower bound.

    Attributes:
        cost: metres; infinite if no path exists.
        path: the disc centre's shortest path, shape (k, 2); empty if there is none or it was not sought.
    """

    cost: float
    path: FloatArray


def region_work(vertices: float) -> float:
    """Return how much work making a region or cutting it into triangles is, in vertices of a small one."""
    return vertices * (1.0 + vertices / MANY)


class LowerBound:
    """The shortest path of a disc inside the robot's footprint, among obstacles that are never too large.

    A path of length L and rotation T costs L + w·T, w = 0.5 (se2.ROTATION_WEIGHT). A disc whose centre lies c from the
    reference point goes D metres, D <= L + c·T. So the cost is at least D + (w − c)·T, and T at least the turn between
    the headings, if c <= w; otherwise L + w·T >= (w/c)·(L + c·T) >= (w/c)·D. A car's path costs L, and T <= L/ρ: so
    D <= (1 + c/ρ)·L; and L is no less than the length of the shortest curve in the open.

    Args:
        world: obstacles, bounds, boundary.
        robot: footprint.
        grid: the world's outlines in cells, if they are there already.
        large: vertices of a region from which on it is looked at only as far as a query needs.
    """

    def __init__(self, world: World, robot: Robot, grid: ObstacleGrid | None = None, *, large: int = LARGE) -> None:
        self.world, self.robot, self.large, self._grid = world, robot, large, grid
        self._before: tuple[LowerBound, FloatArray] | None = None
        self._parts: Any = None

    def edited(self, world: World, grid: ObstacleGrid, freed: FloatArray) -> LowerBound:
        """Return what proves lower bounds in a world that differs from this one's in its obstacles.

        Until its own region is cut, :meth:`known` makes do with this one's.

        Args:
            world: that world.
            grid: its outlines in cells.
            freed: boxes xmin, ymin, xmax, ymax (metres) that hold what was removed, shape (f, 4).
        """
        changed = LowerBound(world, self.robot, grid, large=self.large)
        if self.ready:
            changed._before = self, freed
        elif self._before is not None:
            changed._before = self._before[0], np.concatenate([self._before[1], freed])
        if changed._before is not None and len(changed._before[1]) > MAX_FREED:
            changed._before = None
        return changed

    def known(self, start: FloatArray, goal: FloatArray) -> float:
        """Return a lower bound (metres) on any path's cost that takes little time, from what is computed already.

        A path that does not enter what was removed since is a path of the world before. One that does leads the disc's
        centre within its radius of that place.

        Args:
            start: valid, shape (3,).
            goal: valid, shape (3,).
        """
        cost = self._in_the_open(start, goal)
        if self.ready:
            return max(cost, self.of(start, goal).cost)
        if self._before is None:
            return cost
        before, freed = self._before
        ends = [se2.transform(q, self._center[0][None])[0] for q in (start, goal)]
        gap = [np.hypot(*np.maximum(np.maximum(freed[:, :2] - p, p - freed[:, 2:]), 0.0).T) for p in ends]
        detour = float(np.min(gap[0] + gap[1], initial=np.inf)) - 2.0 * self.robot.inscribed_disc.radius
        through = max(0.0, detour * (1.0 - ROUNDING)) / self._stretch
        return max(cost, min(before.of(start, goal).cost, through))

    def of(
        self, start: FloatArray, goal: FloatArray, limit: float = np.inf, seconds: float = np.inf, left: float = np.inf
    ) -> Bound:
        """Return the bound for a query.

        Args:
            start: valid, shape (3,).
            goal: valid, shape (3,).
            limit: cost (metres) of a known path; in a large world only paths no longer than that are considered.
            seconds: in a grid map the search ends after that, with the bound that it has proven by then.
            left: seconds; what would hardly end by then is given up, and the bound is the way's cost without obstacles.
        """
        straight = Bound(self._in_the_open(start, goal), np.empty((0, 2)))
        center, offset = self._center
        a, b = (se2.transform(q, center[None])[0] for q in (start, goal))
        # What a path of that cost can make the disc's centre go at most; longer paths cannot cost less.
        longest = limit * self._stretch
        begin = perf_counter()
        by = begin + LAST * left
        try:
            if self.tangents is not None:
                found = self._along_tangents(self.tangents, a, b, begin + seconds)
            elif self._whole(longest):
                found = self._shortest(a, b, by)
            else:
                found = self._shortest_within(a, b, longest, by)
        except TimeoutError:
            found = None
        if found is None:
            return straight
        length, path = found
        cost = length / self._stretch
        if self.robot.turning_radius is None:
            turn = abs(float(se2.difference(start, goal)[2]))
            cost += max(0.0, se2.ROTATION_WEIGHT - offset) * turn
        return Bound(max(straight.cost, cost), path)

    def shuts_out(self, start: FloatArray, goal: Goal) -> bool:
        """Return whether it is proven that no path from a valid start, shape (3,), ends anywhere in a goal.

        No path leads the disc's centre out of a region, and wherever it may be in the goal lies outside of that.
        """
        center, offset = self._center
        a = se2.transform(start, center[None])[0]
        place = shapely.Point(goal.disc[0]) if goal.region is None else goal.region.shapely()
        place = shapely.transform(place, lambda points: points - self._origin)
        parts = self._whole_region()
        for part in self._around(parts, a, a):
            if part not in self._meshes:
                self._meshes[part] = self._proven(parts[part], np.inf)
            mesh = self._meshes[part]
            if mesh is not None and locate(mesh, a - self._origin) >= 0:
                away = float(shapely.distance(parts[part], place))
                return away > (goal.position_tolerance + offset) * (1.0 + ROUNDING) + MARGIN
        return False

    def seconds(self, start: FloatArray, goal: FloatArray, limit: float = np.inf) -> float:
        """Return how long :meth:`of` is expected to take."""
        growing, cutting = self._work_left(start, goal, limit)
        return GROWING * growing + CUTTING * cutting or ASKING

    def seconds_for_region(self) -> float:
        """Return how long :meth:`make_region` is expected to take; 0 if there is nothing to do."""
        begun = self._parts is not None or self.tangents is not None
        return 0.0 if begun else self.seconds_for_parts()

    def seconds_for_parts(self) -> float:
        """Return how long it is expected to take to make a disc's region in the whole world, whatever its radius."""
        return GROWING * region_work(self._size)

    def make_region(self, left: float = np.inf) -> None:
        """Make the region of the whole world, by which :meth:`seconds` tells how large the parts are that matter.

        Args:
            left: seconds; it is given up if it would hardly be made by then.
        """
        if self.tangents is None:
            with suppress(TimeoutError):
                self._whole_region(perf_counter() + LAST * left)

    def _work_left(self, start: FloatArray, goal: FloatArray, limit: float) -> tuple[float, float]:
        """Return how much work making the region, and cutting it, :meth:`of` has to do, in vertices of a small one."""
        if self.tangents is not None:
            return 0.0, 0.0
        a, b = (se2.transform(q, self._center[0][None])[0] for q in (start, goal))
        longest = limit * self._stretch
        if not self._whole(longest):
            corners = self._corners(ellipse(a, b, longest))
            return region_work(corners), region_work(ROUNDED * corners)
        if self.seconds_for_region() > 0.0:
            return region_work(self._size), region_work(ROUNDED * self._size)
        parts = self._whole_region()
        for part in self._around(parts, a, b):
            if part not in self._meshes:
                return 0.0, region_work(int(shapely.get_num_coordinates(parts[part])))
            if self._meshes[part] is not None:
                break
        return 0.0, 0.0

    def _whole(self, longest: float) -> bool:
        """Return whether a query whose paths go so far (metres) looks at the region of the whole world."""
        return self.ready or self._size <= self.large or not np.isfinite(longest)

    def _corners(self, within: Any = None) -> float:
        """Return about how many corners obstacles have in a polygon, or everywhere; to tell which are in it counts."""
        if within is None:
            return float(self._size)
        xmin, ymin, xmax, ymax = self.world.bounds
        share = min(1.0, float(within.area) / ((xmax - xmin) * (ymax - ymin)))
        return share * self._size + NEARNESS * len(self.world.obstacles)

    def _in_the_open(self, start: FloatArray, goal: FloatArray) -> float:
        """Return what the way would cost without obstacles, metres."""
        steering = Steering.of(self.robot)
        return float(se2.distance(start, goal) if steering is None else steering.lengths(start, goal))

    @cached_property
    def tangents(self) -> GridTangents | None:
        """What proves the bounds of a grid map; None for other worlds."""
        return GridTangents.of(self.world, self.robot.inscribed_disc.radius)

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
        """About how many corners all obstacles have."""
        if self._grid is not None:
            # At once: to go through thousands of obstacles takes as long as planning may.
            return 4 * len(self._grid.segments) + 8 * QUARTER * len(self._grid.discs) + 4
        corners = 0
        for shape in self.world.obstacles:
            corners += 8 * QUARTER if isinstance(shape, Disc) else 4 * sum(len(r) for r in shape.polygon().rings())
        return corners + 4

    @property
    def ready(self) -> bool:
        """Whether some of the region of the whole world is cut already, so that a bound there takes little."""
        return self._parts is not None and bool(self._meshes)

    def _along_tangents(
        self, tangents: GridTangents, a: FloatArray, b: FloatArray, by: float
    ) -> tuple[float, FloatArray] | None:
        """Return what `_shortest` does, or a lower bound on the length where the clock says ``by`` before."""
        search = tangents.search(a, b)
        while perf_counter() < by and not search.run(PART):
            pass
        if not np.isfinite(search.bound):
            # That there is none is proven elsewhere, by two programs.
            return None
        return tangents.bound(search), np.empty((0, 2))

    def _shortest_within(
        self, a: FloatArray, b: FloatArray, longest: float, by: float
    ) -> tuple[float, FloatArray] | None:
        """Return what `_shortest` does, as far as it is below ``longest``: all such ways lie within an ellipse."""
        around = ellipse(a - self._origin, b - self._origin, longest)
        parts = self._cut(around, by)
        for part in self._around(parts, a, b):
            mesh = self._proven(parts[part], by, (a, b), longest)
            if mesh is not None:
                found = self._in(mesh, a, b)
                return None if found is None else (min(found[0], longest * (1.0 - ROUNDING)), found[1])
        return None

    def _shortest(self, a: FloatArray, b: FloatArray, by: float) -> tuple[float, FloatArray] | None:
        """Return the length of the disc centre's shortest path and its bends; None if that cannot be told.

        Raises:
            TimeoutError: what is left to do would not be done when the clock says ``by``.
        """
        parts = self._whole_region(by)
        for part in self._around(parts, a, b):
            if part not in self._meshes:
                self._meshes[part] = self._proven(parts[part], by)
            mesh = self._meshes[part]
            if mesh is not None:
                return self._in(mesh, a, b)
        return None

    def _in(self, mesh: Mesh, a: FloatArray, b: FloatArray) -> tuple[float, FloatArray] | None:
        """Return what `_shortest` does, by a mesh that no path leaves; None if it holds neither end."""
        ends = a - self._origin, b - self._origin
        inside = [locate(mesh, end) >= 0 for end in ends]
        if not any(inside):
            # Rounding. Nothing is claimed.
            return None
        if not all(inside):
            return np.inf, np.empty((0, 2))
        length, path = shortest_point_path(mesh, *ends)
        if not np.isfinite(length):
            return None
        size = max(float(np.abs(self.world.bounds).max()), float(np.abs(mesh.points).max()))
        return max(0.0, length * (1.0 - ROUNDING) - DIGITS * size * (len(path) + 4)), path + self._origin

    def _proven(self, part: Any, by: float, ends: Ends | None = None, longest: float = np.inf) -> Mesh | None:
        """Return a part of the region cut into triangles, None unless it is proven that none but long paths leave it.

        Args:
            part: polygon relative to the origin.
            by: reading of the clock by which it is to be done, or a TimeoutError is raised.
            ends: of a query: ways longer than ``longest`` may leave it.
            longest: metres.
        """
        if perf_counter() + SLOWER * CUTTING * region_work(int(shapely.get_num_coordinates(part))) > by:
            raise TimeoutError
        mesh, shut_in = triangulated(part), False
        if mesh is not None:
            edges = mesh.points[mesh.edges] + self._origin
            shut_in = self._separation.shuts_in(edges, ends, longest * (1.0 - ROUNDING))
        return mesh if shut_in else None

    def _cut(self, within: Any, by: float) -> Any:
        """Return the region's parts, in a polygon or everywhere, relative to the origin, shape (n,)."""
        return region_parts(self.world, self.robot.inscribed_disc.radius, within, origin=self._origin, by=by)

    def _around(self, parts: Any, a: FloatArray, b: FloatArray) -> list[int]:
        """Return the parts, one or two, in which the ends lie; the smaller first, which is soonest proven."""
        at = [shapely.intersects_xy(parts, *(end - self._origin)) for end in (a, b)]
        return sorted(np.flatnonzero(at[0] | at[1]).tolist(), key=lambda n: int(shapely.get_num_coordinates(parts[n])))

    @cached_property
    def _origin(self) -> FloatArray:
        return local_origin(self.world)

    @cached_property
    def _separation(self) -> Separation:
        return Separation(self.world, self.robot.inscribed_disc.radius, self._grid)

    def _whole_region(self, by: float = np.inf) -> Any:
        """Return the parts of the whole world's region, shape (n,), made once."""
        if self._parts is None:
            self._parts = self._cut(None, by)
        return self._parts

    @cached_property
    def _meshes(self) -> dict[int, Mesh | None]:
        return {}
