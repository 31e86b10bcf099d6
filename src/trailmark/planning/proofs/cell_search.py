"""The proof of an enclosure: a plain search over cells that are not blocked, whatever has found and divided them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.jit import njit
from trailmark.planning.proofs.cell_kinds import kind_of, room_for_cores
from trailmark.planning.proofs.cells import BLOCKED, Division, neighbours
from trailmark.planning.proofs.flood import Flood

__all__ = ["meets"]


@njit(nogil=True)
def meets(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    division: Division,
    flood: Flood,
    finest: int,
) -> tuple[bool, NDArray[np.int64], NDArray[np.int64]]:
    """Return whether cells that are not blocked lead from one end's to the other's, each to the next over a face.

    They count as leading there, too, if an end's own cell is blocked: that end is not valid, and nothing is claimed.
    If they do not lead there, the blocked cells around those that they do lead to come with it, shape (n,), and these,
    shape (m,).

    The proof rests on this alone: a path that is nowhere blocked lies in the union of the cells that this flood reaches
    and of the others that are not blocked. Both are closed: to leave the first it must pass a point in both. All cells
    at that point hold it and so are not blocked; they are joined over faces through it (a small ball less finitely many
    edges is connected), so that the flood has reached them all.
    """
    placed, around = room_for_cores(division), np.empty(256, np.int64)
    cells = flood.cells
    for end in range(2, 4):
        if kind_of(cells, flood.counts[end], division, grid, field, robot, placed, finest) == BLOCKED:
            return True, np.empty(0, np.int64), np.empty(0, np.int64)
    seen = np.zeros(flood.counts[0], np.bool_)
    stack = np.empty(flood.counts[0], np.int64)
    stack[0], count = flood.counts[2], 1
    rim, walls = np.empty(flood.counts[0], np.int64), 0
    seen[flood.counts[2]] = True
    while count > 0:
        count -= 1
        cell = stack[count]
        if cell == flood.counts[3]:
            return True, np.empty(0, np.int64), np.empty(0, np.int64)
        number, around = neighbours(cells, division, cell, around)
        for n in range(number):
            near = around[n]
            if seen[near]:
                continue
            seen[near] = True
            if kind_of(cells, near, division, grid, field, robot, placed, finest) == BLOCKED:
                rim[walls] = near
                walls += 1
            else:
                stack[count] = near
                count += 1
    seen[rim[:walls]] = False
    return False, rim[:walls].copy(), np.flatnonzero(seen)
