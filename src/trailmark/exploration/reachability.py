"""Where the robot can get to in the known map: certainly, perhaps, and provably not."""

from __future__ import annotations

from math import ceil, floor, hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.collision.field import distance_transform
from trailmark.collision.footprint import build_footprint
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray
from trailmark.world.robot import Robot

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
        # Farther away nothing makes a difference.
        self._cap = robot.circumradius / cell + 3.0
        self.rooms = np.empty((0, 0), np.int32)
        self._state, self._levels = np.empty((0, 0), np.uint8), np.empty((0, 0), np.uint8)
        self._distance, self._solid = np.empty((0, 0), np.float32), np.empty((0, 0), np.float32)
        self._begin = np.empty((0, 0), np.bool_)
        self._known, self._passed = np.empty((0, 0), np.uint8), np.empty((0, 0), np.uint64)

    def levels(self, state: NDArray[np.uint8], been: NDArray[np.bool_]) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """Return what each cell is, from NOWHERE to CERTAIN, and around which cells that may have changed.

        Both have shape (rows, columns).

        Args:
            state: UNKNOWN, FREE or OCCUPIED; what lies outside is not free.
            been: cells where the robot's reference point is or was.
        """
        from scipy import ndimage

        new, before = self._note_changes(state), self._begin
        # Half a diagonal, since cells have corners, and as much for the way to the centres around.
        roomy = self._distance >= self.outer / self.cell + sqrt(2.0)
        if new.any():
            self.rooms = np.asarray(ndimage.label(roomy, np.ones((3, 3)))[0])
        certain = self.in_rooms_of(been)
        self._begin = been | certain
        if new.any() or not np.array_equal(self._begin, before):
            masks = flood(self._solid, roomy, self._begin, self.offsets, self.least, self._known, self._passed)
            self._levels = np.where(masks != 0, 1 + np.bitwise_count(masks) // 16, NOWHERE).astype(np.uint8)
            self._levels[certain] = CERTAIN
        return self._levels, new

    def in_rooms_of(self, cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which cells are in the same room as one of some cells, shape (rows, columns)."""
        chosen = np.zeros(int(self.rooms.max(initial=0)) + 1, np.bool_)
        chosen[self.rooms[cells]] = True
        chosen[0] = False
        return np.asarray(np.take(chosen, self.rooms))

    def _note_changes(self, state: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Bring the distances up to date, and return the cells near to where they are others now.

        Which headings are free in these is forgotten.
        """
        near: NDArray[np.bool_] = np.zeros(state.shape, np.bool_)
        if state.shape != self._state.shape:
            self._distance, self._solid = np.full((2, *state.shape), -1.0, np.float32)
            self._known, self._passed = np.zeros(state.shape, np.uint8), np.zeros(state.shape, np.uint64)
            self._begin, changed = near, np.ones_like(near)
        else:
            changed = state != self._state
        self._state = state.copy()
        if not changed.any():
            return near
        inner, outer = _window(changed, ceil(self._cap)), _window(changed, 2 * ceil(self._cap))
        distance, solid = (part[_within(inner, outer)] for part in self._distances(state, outer))
        new = np.zeros(near[outer].shape, np.bool_)
        new[_within(inner, outer)] = (distance != self._distance[inner]) | (solid != self._solid[inner])
        near[outer] = distance_transform(new, 1.0) <= self._cap
        self._known[near] = 0
        self._distance[inner], self._solid[inner] = distance, solid
        return near

    def _distances(
        self, state: NDArray[np.uint8], window: tuple[slice, slice]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the distances to what is not free, and those that :func:`flood` takes, in a part of the map.

        They are told up to the cap; where the part ends before the map does, they are right as far from there as that.
        """
        # What lies outside the map is not free.
        padded = np.pad(state, 1, constant_values=UNKNOWN)[window[0].start : window[0].stop + 2]
        padded = padded[:, window[1].start : window[1].stop + 2]
        cap = np.float32(self._cap)
        unknown = np.minimum(distance_transform((padded != FREE) & (padded != OCCUPIED), 1.0)[1:-1, 1:-1], cap)
        distance = np.minimum(distance_transform(padded != FREE, 1.0)[1:-1, 1:-1], cap)
        # Of an occupied cell all has to be met: without the disc around its middle, and half a diagonal farther.
        beyond = np.float32(0.5 + 0.5 * sqrt(2.0))
        return distance, np.minimum(unknown, distance + beyond)


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


def _window(cells: NDArray[np.bool_], around: int) -> tuple[slice, slice]:
    """Return the rows and columns that hold some cells, at least one, and as many more on each side."""
    ends = [np.flatnonzero(cells.any(axis=1 - axis))[[0, -1]].tolist() for axis in range(2)]
    rows, columns = (
        slice(max(first - around, 0), min(last + around + 1, size))
        for (first, last), size in zip(ends, cells.shape, strict=True)
    )
    return rows, columns


def _within(inner: tuple[slice, slice], outer: tuple[slice, slice]) -> tuple[slice, slice]:
    """Return the rows and columns of a window counted from where another one begins."""
    rows, columns = (slice(a.start - b.start, a.stop - b.start) for a, b in zip(inner, outer, strict=True))
    return rows, columns


@njit(nogil=True)
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
        begin: cells where the robot is or was, and where it gets to from there with any heading.
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
    for r in range(rows):
        for c in range(columns):
            if begin[r, c] and not begin[max(r - 1, 0) : r + 2, max(c - 1, 0) : c + 2].all():
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


@callee
def free_headings(
    distance: NDArray[np.float32], row: int, column: int, offsets: FloatArray, least: FloatArray
) -> np.uint64:
    """Return the headings with which not every configuration in a cell is proven to collide, one for each bit."""
    rows, columns = distance.shape
    free = np.uint64(0)
    near = len(least)
    # Discs that do not come as far as what is nearest to the cell, a cell's corner included, meet nothing.
    while near > 0 and (
        hypot(offsets[near - 1, 0, 0] - 0.5, offsets[near - 1, 0, 1] - 0.5) + least[near - 1] + 0.75
        <= distance[row, column]
    ):
        near -= 1
    for k in range(HEADINGS):
        met = False
        for d in range(near):
            x, y = column + offsets[d, k, 0], row + offsets[d, k, 1]
            i, j = floor(y), floor(x)
            if i < 0 or j < 0 or i >= rows or j >= columns:
                # Outside nothing is free; without the half cell that a cell's middle has around it.
                met = least[d] > 0.5
            else:
                left = least[d] - distance[i, j]
                met = left > 0.0 and (x - j - 0.5) ** 2 + (y - i - 0.5) ** 2 < left * left
            if met:
                break
        if not met:
            free |= np.uint64(1) << np.uint64(k)
    return free
