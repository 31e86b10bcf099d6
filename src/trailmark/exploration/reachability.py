"""Where the robot can get to in the known map: certainly, perhaps, and provably not."""

from __future__ import annotations

from math import floor, sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.collision.field import distance_transform
from trailmark.collision.footprint import build_footprint
from trailmark.compiled import njit
from trailmark.exploration.known_map import FREE, OCCUPIED, KnownMap
from trailmark.robot import Robot
from trailmark.se2 import FloatArray

__all__ = ["CERTAIN", "NOWHERE", "Reach", "excluded_with"]

NOWHERE, CERTAIN = 0, 6
"""The robot's reference point provably cannot get to any place in a cell; it can get to its centre, with any heading.
In between it perhaps can: the more, the more headings are not excluded."""

HEADINGS = 64
"""Into which a turn is divided, one for each bit of a mask."""


class Reach:
    """Tells where a robot gets to among cells that are not free.

    What it calls NOWHERE rests on a flood over positions and headings: a cell of the map with one of HEADINGS intervals
    of headings is passed unless discs inside the robot meet an unknown cell, or contain an occupied one (a surface may
    lie anywhere in it), whatever configuration in it the robot has. Motions of a robot that cannot move in every
    direction are among those that are flooded.

    Attributes:
        rooms: number of the room of each cell, shape (rows, columns): within one the robot gets from everywhere to
            everywhere, with any heading. 0 where it does not fit with any heading.

    Args:
        robot: with the clearance that it keeps.
        cell: side of a cell, metres.
    """

    def __init__(self, robot: Robot, cell: float) -> None:
        self.cell, self.outer = cell, robot.circumradius
        discs = build_footprint(robot).inner
        away = np.hypot(discs[:, 0], discs[:, 1])
        # What is left of each disc whatever the configuration in a cell and an interval of headings. Around the
        # middle of a cell that is met there is a disc of half its side.
        left = (discs[:, 2] - away * np.pi / HEADINGS) / cell + 0.5 - 0.5 * sqrt(2.0) - 1e-6
        # The outermost first: they meet most.
        order = np.argsort(-away - left * cell)
        order = order[left[order] > 0.0]
        angle = np.arange(HEADINGS) * 2.0 * np.pi / HEADINGS
        turned = discs[order, None, 0] + 1j * discs[order, None, 1]
        turned = turned * np.exp(1j * angle) / cell
        self.offsets = np.ascontiguousarray(np.stack([turned.real, turned.imag], axis=-1) + 0.5)
        self.least = np.ascontiguousarray(left[order])
        self.rooms = np.empty((0, 0), np.int32)
        self._distance = np.empty((0, 0), np.float32)
        self._solid = np.empty((0, 0), np.float32)
        self._known, self._passed = np.empty((0, 0), np.uint8), np.empty((0, 0), np.uint64)

    def levels(self, state: NDArray[np.uint8], been: NDArray[np.bool_]) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Return what each cell is, from NOWHERE to CERTAIN, and around which cells that may have changed.

        Both have shape (rows, columns).

        Args:
            state: UNKNOWN, FREE or OCCUPIED; what lies outside is not free.
            been: cells where the robot's reference point is or was.
        """
        from scipy import ndimage

        # To the nearest centre of a cell that is not free.
        distance = _distance(state != FREE)
        # Of an occupied cell all has to be met: without the disc around its middle, and half a diagonal farther.
        beyond = 0.5 + 0.5 * sqrt(2.0)
        solid = np.minimum(_distance((state != FREE) & (state != OCCUPIED)), distance + np.float32(beyond))
        changed = self._forget(distance, solid)
        # Half a diagonal, since cells have corners, and as much for the way to the centres around.
        roomy = distance >= self.outer / self.cell + sqrt(2.0)
        masks = flood(solid, roomy, been, self.offsets, self.least, self._known, self._passed)
        levels = np.where(masks != 0, 1 + np.bitwise_count(masks) // 16, NOWHERE).astype(np.uint8)
        self.rooms = np.asarray(ndimage.label(roomy, np.ones((3, 3)))[0])
        levels[self.in_rooms_of(been)] = CERTAIN
        return levels, changed

    def in_rooms_of(self, cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which cells are in the same room as one of some cells, shape (rows, columns)."""
        chosen = np.zeros(int(self.rooms.max(initial=0)) + 1, np.bool_)
        chosen[self.rooms[cells]] = True
        chosen[0] = False
        return np.asarray(np.take(chosen, self.rooms))

    def _forget(self, distance: NDArray[np.float32], solid: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Forget which headings are free in cells near to where the distances are others now, and return those."""
        if distance.shape != self._distance.shape:
            self._known, self._passed = np.zeros(distance.shape, np.uint8), np.zeros(distance.shape, np.uint64)
            near = np.ones(distance.shape, np.bool_)
        else:
            new = (distance != self._distance) | (solid != self._solid)
            near = distance_transform(new, 1.0) <= self.outer / self.cell + 3.0
            self._known[near] = 0
        self._distance, self._solid = distance, solid
        return np.asarray(near)


def excluded_with(
    known: KnownMap, checker: StateChecker, among: NDArray[np.bool_], row: int, column: int
) -> NDArray[np.bool_]:
    """Return the cells to which there is no way if there is none to one of them, shape (rows, columns).

    Certified motions join their centres to that one's, or their centres are not valid themselves.

    Args:
        known: the map.
        checker: of a robot whose heading makes no difference.
        among: cells to ask for, shape (rows, columns).
        row: of the cell.
        column: of the cell.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    number = np.full(among.shape, -1)
    cells = np.argwhere(among)
    number[among] = np.arange(len(cells))
    states = np.column_stack([known.centres(*cells.T), np.zeros(len(cells))])
    pairs = np.concatenate(
        [
            np.column_stack([number[:-1].ravel(), number[1:].ravel()]),
            np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
        ]
    )
    pairs = pairs[(pairs >= 0).all(axis=1)]
    pairs = pairs[np.asarray(checker.motions_valid(states[pairs[:, 0]], states[pairs[:, 1]]), dtype=bool)]
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(cells), len(cells)))
    _, part = connected_components(graph, directed=False)
    found = np.zeros(among.shape, np.bool_)
    found[among] = (part == part[number[row, column]]) | ~np.asarray(checker.valid(states), dtype=bool)
    return found


def _distance(mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the distance from each cell's centre to the nearest in a mask, what lies outside included, in cells."""
    return np.ascontiguousarray(distance_transform(np.pad(mask, 1, constant_values=True), 1.0)[1:-1, 1:-1])


@njit(cache=True, nogil=True)
def flood(
    distance: NDArray[np.float32],
    roomy: NDArray[np.bool_],
    begin: NDArray[np.bool_],
    offsets: FloatArray,
    least: FloatArray,
    known: NDArray[np.uint8],
    passed: NDArray[np.uint64],
) -> NDArray[np.uint64]:
    """Return the headings with which a robot perhaps gets to each cell, one for each bit, shape (rows, columns).

    Args:
        distance: from each cell's centre to the nearest centre of an unknown cell; of an occupied one, so much more as
            it takes to contain it; in cells.
        roomy: cells where no heading meets anything.
        begin: cells where the robot is or was.
        offsets: from a cell's corner to the centres of n discs inside the robot in its middle, x, y, in cells, for each
            heading, shape (n, HEADINGS, 2).
        least: a cell is met if its centre is nearer than this to that of a disc, in cells, shape (n,).
        known: cells of which the free headings are known, shape (rows, columns), written to.
        passed: these headings, shape (rows, columns), written to.
    """
    rows, columns = distance.shape
    every = np.uint64(0xFFFFFFFFFFFFFFFF)
    one, last = np.uint64(1), np.uint64(63)
    masks = np.zeros((rows, columns), np.uint64)
    # Cells wait once at most.
    queue, waits = np.empty(rows * columns, np.int64), np.zeros((rows, columns), np.bool_)
    head, size = 0, 0
    for r in range(rows):
        for c in range(columns):
            if begin[r, c]:
                masks[r, c] = every
                queue[size] = r * columns + c
                size += 1
                waits[r, c] = True
    while size > 0:
        place = queue[head]
        head, size = (head + 1) % len(queue), size - 1
        r, c = place // columns, place % columns
        waits[r, c] = False
        mask = masks[r, c]
        mask |= (mask << one) | (mask >> last) | (mask >> one) | (mask << last)
        for i in range(max(r - 1, 0), min(r + 2, rows)):
            for j in range(max(c - 1, 0), min(c + 2, columns)):
                if masks[i, j] == every or distance[i, j] == 0.0:
                    continue
                if known[i, j] == 0:
                    known[i, j] = 1
                    passed[i, j] = every if roomy[i, j] else free_headings(distance, i, j, offsets, least)
                more = every if roomy[i, j] else masks[i, j] | (mask & passed[i, j])
                if more != masks[i, j]:
                    masks[i, j] = more
                    if not waits[i, j]:
                        waits[i, j] = True
                        queue[(head + size) % len(queue)] = i * columns + j
                        size += 1
    return masks


@njit(cache=True)
def free_headings(
    distance: NDArray[np.float32], row: int, column: int, offsets: FloatArray, least: FloatArray
) -> np.uint64:
    """Return the headings with which not every configuration in a cell is proven to collide, one for each bit."""
    rows, columns = distance.shape
    free = np.uint64(0)
    for k in range(HEADINGS):
        met = False
        for d in range(len(least)):
            x, y = column + offsets[d, k, 0], row + offsets[d, k, 1]
            i, j = floor(y), floor(x)
            if i < 0 or j < 0 or i >= rows or j >= columns:
                # Outside nothing is free; without the half cell that a cell's middle has around it.
                met = least[d] > 0.5
            else:
                near = least[d] - distance[i, j]
                met = near > 0.0 and (x - j - 0.5) ** 2 + (y - i - 0.5) ** 2 < near * near
            if met:
                break
        if not met:
            free |= np.uint64(1) << np.uint64(k)
    return free
