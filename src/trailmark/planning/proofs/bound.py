"""LowerBound: what every path of a robot costs at least, and whether there can be one."""

from __future__ import annotations

from functools import cached_property
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.curves import Steering
from trailmark.planning.grids.grid_tangents import GridTangents
from trailmark.planning.pace import Pace
from trailmark.planning.proofs.grown import QUARTER
from trailmark.planning.proofs.mesh import Mesh, locate, triangulated
from trailmark.planning.proofs.polyanya import shortest_point_path
from trailmark.planning.proofs.region import ellipse, free_region, local_origin
from trailmark.planning.proofs.separation import Separation
from trailmark.shapes import Disc
from trailmark.world import Robot, World

__all__ = ["Bound", "LowerBound"]

ROUNDING = 1e-9
"""Relative error that lengths may have; taken off."""

DIGITS = 1e-14
"""Share of the largest coordinate, and of the region's size, that a length may be wrong by, too."""

LARGE = 20_000
"""Vertices of a region from which on it is looked at only as far as a query needs, unless told otherwise."""

MANY = 150_000
"""Vertices of a region for each of which it takes twice as long as in a small one."""

CUTTING = Pace(2.2e-5)
"""For each vertex: cutting a region into triangles, and proving that they fill it."""

ASKING = Pace(0.003)
"""For each query, once the region is cut."""

NEARNESS = 0.25
"""Vertices whose cutting takes as long as telling whether an obstacle lies near a query."""

PART = 500
"""Labels of a search along tangents between two looks at the clock."""

MAX_FREED = 64
"""Obstacles removed after which what was proven before they were is used no more."""

FloatArray = NDArray[np.float64]


class Bound(NamedTuple):
    """A proven lower bound.

    Attributes:
        cost: metres; infinite if no path exists.
        path: the disc centre's shortest path, shape (k, 2); empty if there is none or it was not sought.
    """

    cost: float
    path: FloatArray


def _work(vertices: float) -> float:
    """Return how much work cutting a region into triangles is, in vertices of a small one."""
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

    def of(self, start: FloatArray, goal: FloatArray, limit: float = np.inf, seconds: float = np.inf) -> Bound:
        """Return the bound for a query.

        Args:
            start: valid, shape (3,).
            goal: valid, shape (3,).
            limit: cost (metres) of a known path; in a large world only paths no longer than that are considered.
            seconds: in a grid map the search ends after that, with the bound that it has proven by then.
        """
        work, begin = self._cutting(start, goal, limit), perf_counter()
        found = self._found(start, goal, limit, begin + seconds)
        if work > 0.0:
            CUTTING.note(work, perf_counter() - begin)
        else:
            ASKING.note(1.0, perf_counter() - begin)
        return found

    def _found(self, start: FloatArray, goal: FloatArray, limit: float, by: float) -> Bound:
        """Return what :meth:`of` does."""
        straight = Bound(self._in_the_open(start, goal), np.empty((0, 2)))
        center, offset = self._center
        a, b = (se2.transform(q, center[None])[0] for q in (start, goal))
        # What a path of that cost can make the disc's centre go at most; longer paths cannot cost less.
        longest = limit * self._stretch
        if self.tangents is not None:
            found = self._along_tangents(self.tangents, a, b, by)
        elif self.ready or self._size <= self.large or not np.isfinite(longest):
            found = self._shortest(a, b)
        else:
            found = self._shortest_within(a, b, longest)
        if found is None:
            return straight
        length, path = found
        cost = length / self._stretch
        if self.robot.turning_radius is None:
            turn = abs(float(se2.difference(start, goal)[2]))
            cost += max(0.0, se2.ROTATION_WEIGHT - offset) * turn
        return Bound(max(straight.cost, cost), path)

    def seconds(self, start: FloatArray, goal: FloatArray, limit: float = np.inf) -> float:
        """Return how long :meth:`of` is expected to take."""
        work = self._cutting(start, goal, limit)
        return CUTTING.seconds(work) if work > 0.0 else ASKING.seconds(1.0)

    def _cutting(self, start: FloatArray, goal: FloatArray, limit: float) -> float:
        """Return how much of the region :meth:`of` will have to cut, in vertices of a small one."""
        if self.ready or self.tangents is not None:
            return 0.0
        if self._size <= self.large or not np.isfinite(limit):
            return _work(self._size)
        xmin, ymin, xmax, ymax = self.world.bounds
        center = self._center[0]
        a, b = (se2.transform(q, center[None])[0] for q in (start, goal))
        longest = limit * self._stretch
        share = min(1.0, ellipse(a, b, longest).area / ((xmax - xmin) * (ymax - ymin)))
        return _work(share * self._size) + NEARNESS * len(self.world.obstacles)

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
        """About how many vertices the region has."""
        if self._grid is not None:
            # At once: to go through thousands of obstacles takes as long as planning may.
            return 4 * len(self._grid.segments) + 8 * QUARTER * len(self._grid.discs) + 4
        corners = 0
        for shape in self.world.obstacles:
            corners += 8 * QUARTER if isinstance(shape, Disc) else 4 * sum(len(r) for r in shape.polygon().rings())
        return corners + 4

    @property
    def ready(self) -> bool:
        """Whether the region of the whole world is cut already, so that a bound takes little."""
        return "_parts" in self.__dict__ and bool(self._meshes)

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

    def _shortest_within(self, a: FloatArray, b: FloatArray, longest: float) -> tuple[float, FloatArray] | None:
        """Return what `_shortest` does, as far as it is below ``longest``: all such ways lie within an ellipse."""
        around = ellipse(a - self._origin, b - self._origin, longest)
        parts = self._cut(around)
        # The smaller is soonest proven.
        for part in sorted(self._around(parts, a, b), key=shapely.get_num_coordinates):
            mesh = self._proven(part, (a, b), longest)
            if mesh is not None:
                found = self._in(mesh, a, b)
                return None if found is None else (min(found[0], longest * (1.0 - ROUNDING)), found[1])
        return None

    def _shortest(self, a: FloatArray, b: FloatArray) -> tuple[float, FloatArray] | None:
        """Return the length of the disc centre's shortest path and its bends; None if that cannot be told."""
        near = {int(p) for q in (a, b) for p in self._tree.query(shapely.Point(q - self._origin), "intersects")}
        # The smaller is soonest proven.
        for part in sorted(near, key=lambda n: int(shapely.get_num_coordinates(self._parts[n]))):
            if part not in self._meshes:
                self._meshes[part] = self._proven(self._parts[part])
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

    def _proven(
        self, part: Any, ends: tuple[FloatArray, FloatArray] | None = None, longest: float = np.inf
    ) -> Mesh | None:
        """Return a part of the region cut into triangles, None unless it is proven that none but long paths leave it.

        Args:
            part: polygon relative to the origin.
            ends: of a query: ways longer than ``longest`` may leave it.
            longest: metres.
        """
        mesh = triangulated(part)
        if mesh is None:
            return None
        edges = mesh.points[mesh.edges] + self._origin
        open_ = ~self._separation.edges_block(edges)
        if ends is not None and open_.any():
            open_[open_] = _least_detours(edges[open_], *ends) < longest * (1.0 - ROUNDING)
        return None if open_.any() else mesh

    def _cut(self, within: Any = None) -> Any:
        """Return the region's parts relative to the origin, shape (n,); none if shapely fails."""
        try:
            region = free_region(self.world, self.robot.inscribed_disc.radius, within, origin=self._origin)
        except shapely.errors.GEOSException:
            return np.empty(0, dtype=object)
        parts = shapely.get_parts(region)
        return parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON]

    def _around(self, parts: Any, a: FloatArray, b: FloatArray) -> list[Any]:
        """Return the parts, one or two, in which the ends lie."""
        at = [shapely.intersects_xy(parts, *(end - self._origin)) for end in (a, b)]
        return list(parts[at[0] | at[1]]) if len(parts) else []

    @cached_property
    def _origin(self) -> FloatArray:
        return local_origin(self.world)

    @cached_property
    def _separation(self) -> Separation:
        return Separation(self.world, self.robot.inscribed_disc.radius, self._grid)

    @cached_property
    def _parts(self) -> Any:
        return self._cut()

    @cached_property
    def _tree(self) -> Any:
        return shapely.STRtree(self._parts)

    @cached_property
    def _meshes(self) -> dict[int, Mesh | None]:
        return {}


def _least_detours(edges: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the length of the shortest path from a to b over each edge (n, 2, 2), as if nothing were in between."""
    p, d = edges[:, 0], edges[:, 1] - edges[:, 0]
    square = np.maximum((d * d).sum(axis=1), 1e-300)
    u, v = ((point - p)[:, None] for point in (a, b))
    along = [np.einsum("nij,nj->n", w, d) / square for w in (u, v)]
    off = [np.abs(w[:, 0, 0] * d[:, 1] - w[:, 0, 1] * d[:, 0]) / np.sqrt(square) for w in (u, v)]
    total = np.maximum(off[0] + off[1], 1e-300)
    # As light is mirrored: where the two ends' distances from the line divide it.
    share = np.clip((along[0] * off[1] + along[1] * off[0]) / total, 0.0, 1.0)
    # Of a convex function, the tangent at any point is a lower bound: rounding of the share does no harm.
    at = p + share[:, None] * d
    ways = [at - a, at - b]
    length = sum(np.hypot(*way.T) for way in ways)
    slope = sum((way * d).sum(axis=1) / np.maximum(np.hypot(*way.T), 1e-300) for way in ways)
    return np.asarray(length + np.minimum(slope * (0.0 - share), slope * (1.0 - share)))
