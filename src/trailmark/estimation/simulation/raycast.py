"""Rays cast through a world: what a sensor would meet first, and how far away."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.se2 import FloatArray
from trailmark.shapes import Disc
from trailmark.world import World

__all__ = ["RayCaster"]

IntArray = NDArray[np.intp]

WALL = -1
"""The owner of the bounds' and the boundary's edges."""

_CORNER = 1e-12
"""Share of an edge's length that a ray may pass beyond its end and still meet it: no ray slips between two edges."""

_TOUCH = 2e-6
"""Metres that an origin may lie behind an edge and still count as touching it."""

_BLOCK = 500_000
"""Pairs of ray and edge that are processed together."""


class RayCaster:
    """The edges and discs of a world, and exact distances along rays to the first of them.

    A ray meets an edge only from its free side: one that begins on an edge, as of a sensor that touches a wall, leaves
    it freely on one side and has length 0 on the other.

    Args:
        world: its obstacles, its boundary, and its bounds.
        bounds: whether the bounds are walls that a ray meets.

    Attributes:
        discs: indices of the obstacles that are discs, shape (k,).
    """

    def __init__(self, world: World, *, bounds: bool = True) -> None:
        rings: list[FloatArray] = []
        owners: list[int] = []
        for index, obstacle in enumerate(world.obstacles):
            if not isinstance(obstacle, Disc):
                own = obstacle.polygon().rings()
                rings += own
                owners += [index] * len(own)
        # What is solid lies left of every edge: inside an obstacle, outside a wall.
        if world.boundary is not None:
            rings.append(world.boundary.rings()[0][::-1])
            owners.append(WALL)
        if bounds:
            xmin, ymin, xmax, ymax = world.bounds
            rings.append(np.array([[xmin, ymin], [xmin, ymax], [xmax, ymax], [xmax, ymin]]))
            owners.append(WALL)
        sizes = [len(ring) for ring in rings]
        self._start = np.concatenate([*rings, np.empty((0, 2))])
        self._edge = np.concatenate([*(np.roll(ring, -1, axis=0) - ring for ring in rings), np.empty((0, 2))])
        self._edge_owner = np.repeat(np.array(owners, dtype=np.intp), sizes)
        round_ones = [(i, shape) for i, shape in enumerate(world.obstacles) if isinstance(shape, Disc)]
        self.discs: IntArray = np.array([i for i, _ in round_ones], dtype=np.intp)
        self._center = np.array([shape.center for _, shape in round_ones], dtype=np.float64).reshape(-1, 2)
        self._radius = np.array([shape.radius for _, shape in round_ones], dtype=np.float64)

    def distances(
        self, origin: ArrayLike, angles: ArrayLike, max_range: float = np.inf, passing: ArrayLike | None = None
    ) -> FloatArray:
        """Return how far each ray goes until it meets something, shape (b,), metres; infinite beyond ``max_range``.

        Args:
            origin: x, y in metres, where all rays begin; in free space.
            angles: their directions in the world, shape (b,), radians.
            max_range: metres.
            passing: index of an obstacle that each ray passes through, shape (b,), −2 for none.
        """
        o, angle = np.asarray(origin, dtype=np.float64), np.asarray(angles, dtype=np.float64)
        directions = np.column_stack([np.cos(angle), np.sin(angle)])
        through = np.full(len(angle), -2) if passing is None else np.asarray(passing)
        edges, discs = self._near(o, max_range)
        found = np.full(len(angle), np.inf)
        step = max(1, _BLOCK // max(1, len(edges) + len(discs)))
        for first in range(0, len(angle), step):
            rows = slice(first, first + step)
            d, own = directions[rows], through[rows, None]
            to_edge = _to_edges(self._start[edges] - o, self._edge[edges], d)
            to_disc = _to_discs(self._center[discs] - o, self._radius[discs], d)
            to_edge[own == self._edge_owner[edges]] = np.inf
            to_disc[own == self.discs[discs]] = np.inf
            found[rows] = np.minimum(to_edge.min(axis=1, initial=np.inf), to_disc.min(axis=1, initial=np.inf))
        found[found > max_range] = np.inf
        return found

    def _near(self, o: FloatArray, max_range: float) -> tuple[IntArray, IntArray]:
        """Return the indices of the edges and discs that come within the range."""
        w = o - self._start
        length2 = np.einsum("ij,ij->i", self._edge, self._edge)
        along = np.clip(np.einsum("ij,ij->i", w, self._edge) / length2, 0.0, 1.0)
        off = w - along[:, None] * self._edge
        edges = np.flatnonzero(np.hypot(off[:, 0], off[:, 1]) <= max_range)
        away = np.hypot(*(self._center - o).T)
        return edges, np.flatnonzero(away - self._radius <= max_range)


def _to_edges(w: FloatArray, e: FloatArray, d: FloatArray) -> FloatArray:
    """Return the distances along rays d (b, 2) to edges that begin at w and run along e (m, 2), shape (b, m)."""
    # t d = w + u e; the cross products with e and d give t and u.
    det = d[:, :1] * e[:, 1] - d[:, 1:] * e[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):  # a ray along an edge meets its neighbours' ends
        t = (w[:, 0] * e[:, 1] - w[:, 1] * e[:, 0]) / det
        u = (w[:, 0] * d[:, 1:] - w[:, 1] * d[:, :1]) / det
        # A negative determinant means that the ray leads to the left of the edge, where the obstacle is.
        met = (det < 0.0) & (t >= -_TOUCH) & (u >= -_CORNER) & (u <= 1.0 + _CORNER)
    return np.where(met, np.maximum(t, 0.0), np.inf)


def _to_discs(w: FloatArray, radius: FloatArray, d: FloatArray) -> FloatArray:
    """Return the distances along rays d (b, 2) to discs about w (k, 2), shape (b, k)."""
    along = d[:, :1] * w[:, 0] + d[:, 1:] * w[:, 1]
    # From the cross product: |w|² − along² would lose the digits of a far disc.
    across = d[:, :1] * w[:, 1] - d[:, 1:] * w[:, 0]
    inside = radius**2 - across**2
    met = (inside >= 0.0) & (along >= 0.0)
    return np.where(met, np.maximum(along - np.sqrt(np.maximum(inside, 0.0)), 0.0), np.inf)
