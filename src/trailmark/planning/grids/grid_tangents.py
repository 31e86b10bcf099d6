"""GridTangents: a disc among the cells of a grid map, its shortest paths and lower bounds on their length."""

from __future__ import annotations

from functools import cached_property
from math import atan2

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.field import distance_transform
from trailmark.formats.grid import CellObstacles, cells_of
from trailmark.jit import njit
from trailmark.planning.grids.search import TangentSearch, lengths_to
from trailmark.planning.grids.sight import Corners, all_fit, corners_of
from trailmark.planning.grids.tangents import ends_of_tangent
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["GridTangents"]

MARGIN, CERTAIN = 2e-6, 1e-6
"""Metres by which circles are smaller than the disc, as in other proofs, and by which a tangent may be nearer still."""

WIDEST = 16.0
"""Radius in cells from which on too many corners lie where no disc goes."""

ROUNDING = 1e-7
"""Relative error that lengths may have, by rounding and by tangents that turn back by a hair; taken off."""

ARC = np.pi / 16.0
"""Angle of an arc that two tangents stand for at most: they are 0.5 % of the radius outside of it."""

MANY = 5_000
"""Corners of a path from which on its arcs are drawn half as finely: it takes long to check."""


class GridTangents:
    """Shortest paths of a disc in one grid map; :meth:`of` makes it.

    Args:
        cells: the obstacles.
        radius: of the disc, metres.
    """

    def __init__(self, cells: CellObstacles, radius: float) -> None:
        self.radius, self._cell = radius, cells.cell
        # One more row and column of cells around, which are blocked as all that lies beyond the bounds.
        self._origin = np.array(cells.origin[:2]) - cells.cell
        self._cells = cells

    @classmethod
    def of(cls, world: World, radius: float) -> GridTangents | None:
        """Return it for a world and a disc's radius (metres); None unless the world is a grid map and no more."""
        cells = cells_of(world)
        if cells is None or world.boundary is not None or not CERTAIN + MARGIN < radius <= WIDEST * cells.cell:
            return None
        rows, columns = cells.occupied.shape
        x, y = cells.origin[:2]
        covered = x, y, x + columns * cells.cell, y + rows * cells.cell
        if np.abs(np.subtract(covered, world.bounds)).max() > 1e-9 * cells.cell:
            return None
        return cls(cells, radius)

    @cached_property
    def grid(self) -> Corners:
        """The cells and their corners."""
        return Corners(*corners_of(np.pad(self._cells.occupied, 1, constant_values=True)))

    def search(
        self,
        a: FloatArray,
        b: FloatArray,
        *,
        spare: float | None = None,
        guide: NDArray[np.float32] | None = None,
    ) -> TangentSearch:
        """Return a search for the shortest path between two points, shape (2,).

        Args:
            a: where the disc's centre starts, metres.
            b: where it is to get, metres.
            spare: share by which the disc is larger; None for one that is never too large, which proves something.
            guide: of these ends, times a factor: soon there, but neither is the path the shortest nor anything proven.
        """
        radius = (self.radius - MARGIN if spare is None else (1.0 + spare) * self.radius) / self._cell
        given = np.empty((0, 0), np.float32) if guide is None else guide.astype(np.float32)
        start, goal = self._in_cells(a, b)
        return TangentSearch(self.grid, start, goal, radius, radius - CERTAIN / self._cell, given)

    def guide(self, a: FloatArray, b: FloatArray) -> NDArray[np.float32]:
        """Return the lengths to b by steps from cell to cell, as far as they matter from a, shape (rows, columns)."""
        columns = self.grid.blocked.shape[1]
        start, goal = (int(point[1]) * columns + int(point[0]) for point in self._in_cells(a, b))
        return np.asarray(lengths_to(self._open, goal, start))

    def certified(self, bends: FloatArray) -> bool:
        """Return whether the disc is free along a path of bends, shape (n, 2), metres, with a micrometre to spare."""
        return bool(all_fit(self.grid, (bends - self._origin) / self._cell, (self.radius + CERTAIN) / self._cell))

    def _in_cells(self, a: FloatArray, b: FloatArray) -> list[FloatArray]:
        return [(np.asarray(point, np.float64) - self._origin) / self._cell for point in (a, b)]

    def bound(self, search: TangentSearch) -> float:
        """Return the length (metres) that no path is shorter than, as far as an unguided search has come."""
        return max(0.0, search.bound * self._cell * (1.0 - ROUNDING) - CERTAIN)

    def bends(self, search: TangentSearch, spare: float) -> FloatArray:
        """Return the bends of the path that a search has found, for a disc larger by a share ``spare``; shape (n, 2).

        Arcs are replaced by tangents: it keeps the larger disc's radius from the corners that it passes.
        """
        corners = search.corners().astype(np.float64)
        circles = np.vstack([[*search.task.start, -1.0], corners, [*search.task.goal, -1.0]])
        arc = ARC if len(corners) < MANY else 2.0 * ARC
        found = _bends(circles, (1.0 + spare) * self.radius / self._cell, arc)
        return np.asarray(found * self._cell + self._origin)

    @cached_property
    def _open(self) -> NDArray[np.bool_]:
        """The cells in whose middle the disc may be, or nearly, shape (rows, columns)."""
        if self.radius <= 0.5 * self._cell:
            return ~self.grid.blocked
        return np.asarray(distance_transform(self.grid.blocked, 1.0) >= self.radius / self._cell)


@njit
def _bends(circles: FloatArray, radius: float, arc: float) -> FloatArray:
    """Return the bends (n, 2) of a path along circles (k, 3: x, y, and its side as of tangents), in cells."""
    most = 2 + int(np.ceil(np.pi / arc))
    found, n = np.empty((most * len(circles), 2)), 1
    found[0] = circles[0, :2]
    before = 0.0
    for k in range(1, len(circles)):
        x, y, side = circles[k - 1]
        _, dx, dy, _ = ends_of_tangent(x, y, int(side), circles[k, 0], circles[k, 1], int(circles[k, 2]), radius)
        after = atan2(dy, dx)
        if k > 1:
            sign = -1.0 if side > 0.0 else 1.0
            turn = sign * ((after - before + np.pi) % (2.0 * np.pi) - np.pi)
            # Where the tangents at the arc's ends, and between, meet: on a larger circle. Without an arc, where they
            # touch the circle.
            count = max(1, int(np.ceil(turn / arc)))
            out = radius / np.cos(0.5 * turn / count) if turn > 0.0 else radius
            for i in range(count if turn > 0.0 else 2):
                at = before + sign * ((i + 0.5) * turn / count if turn > 0.0 else i * turn) - sign * 0.5 * np.pi
                found[n, 0], found[n, 1] = x + out * np.cos(at), y + out * np.sin(at)
                n += 1
        before = after
    found[n] = circles[-1, :2]
    return found[: n + 1]
