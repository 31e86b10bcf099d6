"""Claims about what cannot be, looked at once more by code that shares nothing with what they come from.

A disc of radius r that is centred within r of a convex thing (a segment, a disc) meets it; and what is within r of a
convex thing is convex. So an edge, or a convex cell, blocks the way as soon as all its corners lie nearer than r to one
part of an obstacle's outline. Whoever is shut in by such edges or cells stays inside: by whatever means they were
found, and however wrong these were.
"""

from __future__ import annotations

from math import hypot

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.collision.field import distance_transform
from trailmark.collision.obstacles import ObstacleGrid, build_grid, cell_size_for
from trailmark.jit import callee, njit
from trailmark.landmarks.relaxation import CostMap, Relaxation
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc
from trailmark.world import World

__all__ = ["CERTAIN", "Separation", "contradicted", "grid_separates"]

CERTAIN = 1e-6
"""Metres by which a disc must overlap: more than contact may (1e-7 m) and coordinates up to 1e7 m be rounded by."""

HALVINGS = 24
"""Times at most that an edge is cut in halves: what blocks one half need not block the other."""

ROUNDING = 1e-9
"""Metres, and share of a cost, that a lower bound may be above it by rounding."""

CELL_HALVINGS = 4
"""Times that a cell's edge is halved where no single part of an obstacle blocks all of it."""


def contradicted(bound: float, cost: float) -> bool:
    """Return whether a lower bound (metres) is above the cost of a path that is known."""
    return bound > cost * (1.0 + ROUNDING) + ROUNDING


def grid_separates(relaxation: Relaxation, to_goal: CostMap, start: FloatArray, goal: FloatArray) -> bool:
    """Return whether the relaxed problem's cells prove that no path joins two configurations.

    Of the grid, only which cells may be the goal's component is taken on trust: the cells around them, by edges and by
    corners, are proven anew to block the disc, and the start lies in none of either.

    Args:
        relaxation: the grid.
        to_goal: what the goal's component is taken from.
        start: valid, shape (3,).
        goal: valid, shape (3,).
    """
    checker = relaxation.checker
    separation = Separation(checker.world, checker.robot.inscribed_disc.radius, checker.grid)
    component = np.isfinite(to_goal.cost)
    first, last = (int(relaxation.cells(relaxation.disc_centers(q))) for q in (start, goal))
    if component.ravel()[first] or not component.ravel()[last]:
        return False
    # The eight neighbours of a cell are no farther than the root of two; the next cells are two away.
    around = np.flatnonzero((distance_transform(component, 1.0) < 1.5) & ~component)
    half = 0.5 * relaxation.size * (1.0 + 1e-9) + 1e-8
    return _block(separation, checker.world, relaxation.cell_centers(around), half)


def _block(separation: Separation, world: World, centers: FloatArray, half: float) -> bool:
    """Return whether squares about centres (n, 2), twice ``half`` wide, are all proven to hold no place of the disc."""
    regions = np.array([s.polygon().shapely() for s in world.obstacles if not isinstance(s, Disc)], dtype=object)
    tree = shapely.STRtree(regions)
    square = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    for _ in range(CELL_HALVINGS + 1):
        centers = centers[~separation.cells_block(centers[:, None] + half * square)]
        boxes = shapely.box(*(centers - half).T, *(centers + half).T)
        within = np.zeros(len(centers), np.bool_)
        within[tree.query(boxes, predicate="covered_by")[0]] = True
        if world.boundary is not None:
            within |= shapely.disjoint(world.boundary.shapely(), boxes)
        centers = centers[~within]
        if len(centers) == 0:
            return True
        half *= 0.5
        centers = (centers[:, None] + half * square).reshape(-1, 2)
    return False


class Separation:
    """What a disc of some radius cannot cross in a world.

    Args:
        world: obstacles, bounds, boundary.
        radius: metres.
        grid: the world's outlines in cells, if they are there already, of whatever size.
    """

    def __init__(self, world: World, radius: float, grid: ObstacleGrid | None = None) -> None:
        self.reach = radius - CERTAIN
        if grid is None and self.reach > 0.0:
            grid = build_grid(world, cell_size_for(world, self.reach))
        self._grid = grid

    def edges_block(self, edges: FloatArray) -> NDArray[np.bool_]:
        """Return which edges, shape (n, 2, 2) in the world's frame, the disc's centre can be nowhere on; shape (n,)."""
        if self._grid is None or self.reach <= 0.0:
            return np.zeros(len(edges), np.bool_)
        return np.asarray(_edges_block(self._grid, np.ascontiguousarray(edges), self.reach))

    def shuts_in(self, edges: FloatArray, ends: tuple[FloatArray, FloatArray] | None, longest: float) -> bool:
        """Return whether no path of the disc's centre, or only long ones, can cross the edges around a place.

        Args:
            edges: shape (n, 2, 2), metres, in the world's frame.
            ends: of a query, shape (2,) each: a path from one to the other longer than ``longest`` may cross them.
            longest: metres.
        """
        open_ = ~self.edges_block(edges)
        if ends is not None and open_.any():
            open_[open_] = _least_detours(edges[open_], *ends) < longest
        return not open_.any()

    def cells_block(self, corners: FloatArray) -> NDArray[np.bool_]:
        """Return which convex cells, shape (n, k, 2), the disc's centre can be nowhere in for certain; shape (n,)."""
        if self._grid is None or self.reach <= 0.0:
            return np.zeros(len(corners), np.bool_)
        return np.asarray(_cells_block(self._grid, np.ascontiguousarray(corners), self.reach))


@callee
def _one_blocks(grid: ObstacleGrid, corners: FloatArray, reach: float) -> bool:
    """Return whether all corners, shape (k, 2), lie within reach of one and the same segment or disc."""
    x, y = corners[0, 0], corners[0, 1]
    # All that blocks is within reach of the first corner, too.
    first = max(0, int((x - reach - grid.x0) / grid.size)), max(0, int((y - reach - grid.y0) / grid.size))
    last_column = min(grid.columns - 1, int((x + reach - grid.x0) / grid.size))
    last_row = min(grid.rows - 1, int((y + reach - grid.y0) / grid.size))
    for row in range(first[1], last_row + 1):
        for column in range(first[0], last_column + 1):
            for place in range(grid.cell_start[row, column], grid.cell_start[row, column + 1]):
                item, k = grid.items[place], 0
                while k < len(corners) and _near(grid, item, corners[k, 0], corners[k, 1], reach):
                    k += 1
                if k == len(corners):
                    return True
    return False


@callee
def _near(grid: ObstacleGrid, item: int, x: float, y: float, reach: float) -> bool:
    """Return whether a point lies within reach of a segment or a disc."""
    if item < 0:
        disc = grid.discs[-1 - item]
        return bool(hypot(x - disc[0], y - disc[1]) <= disc[2] + reach)
    ax, ay, bx, by = grid.segments[item]
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    share = ((x - ax) * dx + (y - ay) * dy) / square if square > 0.0 else 0.0
    share = min(1.0, max(0.0, share))
    # Some point of the segment, the nearest but for rounding: its distance is never too small.
    return bool(hypot(x - (ax + share * dx), y - (ay + share * dy)) <= reach)


@njit(nogil=True)
def _edges_block(grid: ObstacleGrid, edges: FloatArray, reach: float) -> NDArray[np.bool_]:
    found = np.zeros(len(edges), np.bool_)
    waiting = np.empty((HALVINGS + 2, 2, 2))
    for n in range(len(edges)):
        waiting[0] = edges[n]
        # How often each has been halved: the stack holds one of each depth at most.
        depth = np.zeros(HALVINGS + 2, np.int64)
        count = 1
        while count > 0:
            edge = waiting[count - 1]
            if _one_blocks(grid, edge, reach):
                count -= 1
                continue
            if depth[count - 1] == HALVINGS:
                break
            deeper = depth[count - 1] + 1
            mx, my = 0.5 * (edge[0, 0] + edge[1, 0]), 0.5 * (edge[0, 1] + edge[1, 1])
            waiting[count, 0] = edge[0]
            waiting[count, 1, 0], waiting[count, 1, 1] = mx, my
            waiting[count - 1, 0, 0], waiting[count - 1, 0, 1] = mx, my
            depth[count - 1] = depth[count] = deeper
            count += 1
        found[n] = count == 0
    return found


@njit(nogil=True)
def _cells_block(grid: ObstacleGrid, corners: FloatArray, reach: float) -> NDArray[np.bool_]:
    found = np.zeros(len(corners), np.bool_)
    for n in range(len(corners)):
        found[n] = _one_blocks(grid, corners[n], reach)
    return found


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
