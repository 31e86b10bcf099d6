"""Where the robot can get to in the known map: certainly, perhaps, and provably not; and what the ways there cost."""

from __future__ import annotations

from math import sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.field import distance_transform
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.jit import njit
from trailmark.se2 import FloatArray
from trailmark.world.robot import Robot

__all__ = ["CERTAIN", "NOWHERE", "Reach", "Travel", "costs_between", "perhaps_reached", "reach_of"]

# The robot's reference point provably cannot get to any place in a cell; it can get to its centre, with any heading.
# In between it perhaps can: the more, the more room there is.
NOWHERE, CERTAIN = 0, 6
HALF: Final = 0.5 * sqrt(2.0)  # From a cell's centre to its corner.
TIGHT = 2  # Times as much that a metre is taken to cost where it is not certain that the robot fits.
SPARE = 0.6  # Of the robot's inner radius: the coarser cells are no larger, so that no wall lies within one of them.
COARSEST = 16  # Cells, along either side of one of the coarser ones, at most.
PARTS = 6  # Of a cell, along either side, that are looked at one by one where it matters.
CORNERS = np.array([(0, 0), (0, 1), (1, 0), (1, 1)])  # Of a cell, from its first one.
NEAREST = 10  # Places up to which ways from a place are followed; to the others they lead by way of those.
STRAIGHT: Final = 12
DIAGONAL: Final = 17  # Steps, in twelfths of a cell's side: 17/12 is 0.2 % more than the root of two.


class Reach(NamedTuple):
    """Where a robot gets to, arrays of shape (rows, columns)."""

    levels: NDArray[np.uint8]  # From NOWHERE to CERTAIN.
    # Number of the room of each cell: within one the robot gets from everywhere to everywhere, with any heading. 0
    # where it does not fit with any heading.
    rooms: NDArray[np.int32]
    distance: NDArray[np.float32]  # Cells from each centre to that of the nearest cell that is not free.

    def in_rooms_of(self, cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which cells are in the same room as one of some cells, shape (rows, columns)."""
        chosen = np.zeros(int(self.rooms.max(initial=0)) + 1, np.bool_)
        chosen[self.rooms[cells]] = True
        chosen[0] = False
        return np.asarray(np.take(chosen, self.rooms))

    def main_room(self) -> NDArray[np.bool_]:
        """Return the cells of the largest room that the robot gets to, shape (rows, columns)."""
        sizes = np.bincount(self.rooms[self.levels == CERTAIN], minlength=1)
        sizes[0] = 0
        return np.asarray((self.rooms == sizes.argmax()) & (self.rooms > 0))


def reach_of(known: KnownMap, been: NDArray[np.bool_], robot: Robot) -> Reach:
    """Return where a robot gets to through free cells, any part of which that is not free it must not touch.

    Where its inscribed disc cannot get to, it provably cannot; where its circumscribed one can, it certainly can.

    Args:
        known: the map.
        been: cells where the robot's reference point is or was.
        robot: with the clearance that it keeps.
    """
    from scipy import ndimage

    inner, outer = (r / known.cell for r in (robot.reference_radius + robot.clearance, robot.circumradius))
    distance = _cells_away(known.state != FREE)
    # Half a diagonal, since cells have corners, and as much for the way to the centres around.
    rooms = np.asarray(ndimage.label(distance >= outer + 2.0 * HALF, np.ones((3, 3)))[0], np.int32)
    least = inner + 0.5 - HALF
    levels = np.where(_connected((distance >= least) & (known.state == FREE), been), np.uint8(1), np.uint8(NOWHERE))
    room = (distance - least) / max(outer + 2.0 * HALF - least, 1e-9)
    levels[levels > 0] += np.clip(4.0 * room[levels > 0], 0.0, 4.0).astype(np.uint8)
    found = Reach(levels, rooms, distance)
    levels[found.in_rooms_of(been)] = CERTAIN
    return found


def perhaps_reached(known: KnownMap, been: NDArray[np.bool_], robot: Robot) -> NDArray[np.bool_]:
    """Return the cells where the robot may fit and is not proven unable to get to, shape (rows, columns).

    Whatever its heading, its inscribed disc may touch no unknown cell and no point where a beam ended, and cover no
    occupied cell as a whole. On the way there that is asked for whole parts of cells, at its end for their middles.

    Args:
        known: the map.
        been: cells where the robot's reference point is or was.
        robot: without any clearance.
    """
    from scipy.spatial import cKDTree

    radius, ended = robot.reference_radius / known.cell, np.isfinite(known.points[..., 0])
    unknown, occupied, away = known.state == UNKNOWN, known.state == OCCUPIED, _cells_away(known.state != FREE)
    corners = np.argwhere(unknown & (_cells_away(~unknown) < 2.0))[:, None, ::-1] + CORNERS
    met = np.argwhere(occupied & ended)[:, ::-1] + known.points[occupied & ended]
    # What may not be touched, and what not be covered.
    obstacles = [(np.concatenate([corners.reshape(-1, 2), met]), radius)]
    obstacles += [(np.argwhere(occupied & ~ended)[:, ::-1] + 0.5, radius - HALF)]
    trees = [(cKDTree(points), least) for points, least in obstacles if len(points)]
    passed, extent = away >= radius + 2.0 * HALF, np.subtract(known.bounds[2:], known.bounds[:2]) / known.cell
    middles = np.stack(np.meshgrid(*[(np.arange(PARTS) + 0.5) / PARTS] * 2), -1).reshape(-1, 2)
    asked = np.argwhere(~passed & ~unknown & (away >= radius - 3.0 * HALF))
    fits = passed.copy()
    for cells in np.array_split(asked, 1 + len(asked) // 10_000):
        parts = (cells[:, None, ::-1] + middles).reshape(-1, 2)
        spare = np.minimum(parts, extent - parts).min(axis=1) - radius
        for tree, least in trees:
            spare = np.minimum(spare, tree.query(parts, distance_upper_bound=radius)[0] - least)
        spare = spare.reshape(len(cells), -1)
        passed[tuple(cells.T)] = (spare >= -HALF / PARTS).any(axis=1)
        fits[tuple(cells.T)] = (spare >= 0.0).any(axis=1)
    return _connected(passed, been) & fits


def _cells_away(mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the distance from each cell's centre to the nearest in a mask, in cells; what lies outside counts."""
    return distance_transform(np.pad(mask, 1, constant_values=True), 1.0)[1:-1, 1:-1]


def _connected(passed: NDArray[np.bool_], been: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the cells that are joined, through some that are passed, to where the robot was."""
    from scipy import ndimage

    label = ndimage.label(passed | been, np.ones((3, 3)))[0]
    return np.asarray(np.isin(label, np.unique(label[been])) & passed)


class Travel:
    """Estimates of what ways cost, over cells some times as large as the map's.

    Args:
        levels: from NOWHERE to CERTAIN for each cell of the map, shape (rows, columns).
        inner: radius of the robot's disc about its reference point, in cells of the map.
    """

    def __init__(self, levels: NDArray[np.uint8], inner: float) -> None:
        self.factor = f = max(1, min(COARSEST, int(SPARE * inner)))
        rows, columns = -(-levels.shape[0] // f), -(-levels.shape[1] // f)
        padded = np.zeros((rows * f, columns * f), np.uint8)
        padded[: levels.shape[0], : levels.shape[1]] = levels
        # One axis after the other: along both at once takes ten times as long.
        self.fits = padded.reshape(rows, f, -1).max(axis=1).reshape(rows, columns, f).max(axis=2)

    def between(self, cells: NDArray[np.intp]) -> FloatArray:
        """Return the costs of the ways between cells of the map, in cells, infinite where none leads, shape (n, n).

        Args:
            cells: rows and columns, shape (n, 2).
        """
        costs = costs_between(self.fits, np.ascontiguousarray(cells, dtype=np.int64) // self.factor, NEAREST, TIGHT)
        for k in range(len(costs)):  # Floyd 1962
            costs = np.minimum(costs, costs[:, k, None] + costs[None, k])
        return np.asarray(costs * self.factor)


@njit(nogil=True)
def costs_between(fits: NDArray[np.uint8], cells: NDArray[np.int64], nearest: int, tight: int) -> FloatArray:
    """Return the costs of the ways between some cells, in cells, shape (n, n), infinite where none was found.

    Ways lead to the eight cells around, and from each of the cells to the nearest ones. They are followed in the order
    of their costs, which are whole numbers (Dial, "Algorithm 360: shortest-path forest with topological ordering",
    Communications of the ACM 1969).

    Args:
        fits: NOWHERE, up to CERTAIN, shape (rows, columns).
        cells: rows and columns, shape (n, 2), whatever they are.
        nearest: to how many others.
        tight: times as much that a step into a cell that is not CERTAIN costs.
    """
    rows, columns = fits.shape
    n, width = len(cells), columns + 2
    between = np.full((n, n), np.inf)
    # With a cell more on each side, which no way leads to.
    dearer, here = np.zeros((rows + 2) * width, np.int32), np.zeros((rows + 2) * width, np.int32)
    for r in range(rows):
        for c in range(columns):
            if fits[r, c] != NOWHERE:
                dearer[(r + 1) * width + c + 1] = 1 if fits[r, c] == CERTAIN else tight
    at = (cells[:, 0] + 1) * width + cells[:, 1] + 1
    for k in range(n):
        here[at[k]] += 1
        dearer[at[k]] = max(dearer[at[k]], np.int32(1 if fits[cells[k, 0], cells[k, 1]] == CERTAIN else tight))
    around = np.array([-width - 1, -width, -width + 1, -1, 1, width - 1, width, width + 1])
    steps = np.array([DIAGONAL, STRAIGHT, DIAGONAL, STRAIGHT, STRAIGHT, DIAGONAL, STRAIGHT, DIAGONAL], np.int32)
    far = np.iinfo(np.int32).max
    costs = np.empty(len(here), np.int32)
    # No step costs as much as there are buckets: a bucket holds places of one cost, in a list that begins with first.
    first = np.empty(tight * DIAGONAL + 1, np.int64)
    place, after = np.empty(1024, np.int64), np.empty(1024, np.int64)
    for k in range(n):
        costs[:], first[:] = far, -1
        costs[at[k]], place[0], after[0], first[0] = 0, at[k], -1, 0
        used, waiting, cost, found = 1, 1, 0, 0
        # The first is the first of the list, which needs the ways to all others.
        wanted = n if k == 0 else nearest + 1
        while waiting > 0 and found < wanted:
            entry = first[cost % len(first)]
            if entry < 0:
                cost += 1
                continue
            first[cost % len(first)] = after[entry]
            waiting -= 1
            if cost > costs[place[entry]]:
                continue
            found += here[place[entry]]
            for d in range(8):
                there = place[entry] + around[d]
                way = cost + steps[d] * dearer[there]
                if dearer[there] > 0 and way < costs[there]:
                    costs[there] = way
                    if used == len(place):
                        place, after = np.append(place, place), np.append(after, after)
                    bucket = way % len(first)
                    place[used], after[used], first[bucket] = there, first[bucket], used
                    used, waiting = used + 1, waiting + 1
        for other in range(n):
            if costs[at[other]] < far:
                length = costs[at[other]] / STRAIGHT
                between[k, other] = min(between[k, other], length)
                between[other, k] = min(between[other, k], length)
    return between
