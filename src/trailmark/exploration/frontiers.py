"""Frontiers: where free space that is known borders on what is not known."""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN
from trailmark.jit import njit
from trailmark.landmarks.sampling import lloyd
from trailmark.se2 import FloatArray

__all__ = ["Frontiers", "frontiers_of"]

GAP = 2
"""Cells: as wide a gap in a surface, or a narrower one, is not looked through."""

AROUND = np.array([(-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1)])
"""Rows and columns from a cell to those around it, in their order."""

STEPS = 4
"""Of Lloyd's algorithm, by which a long frontier is divided."""


class Frontiers(NamedTuple):
    """Edges between free cells and unknown ones, in groups that lie together.

    Source: Yamauchi, "A frontier-based approach for autonomous exploration", CIRA 1997.
    """

    edges: FloatArray
    """Middles, and directions to the unknown cell, x, y, dx, dy, in cells from the grid's corner, shape (n, 4)."""
    unknown: NDArray[np.intp]
    """Rows and columns of the unknown cells, shape (n, 2)."""
    group: NDArray[np.intp]
    """To which group each edge belongs, from 0 on, shape (n,)."""

    @property
    def groups(self) -> int:
        """How many."""
        return int(self.group.max(initial=-1)) + 1

    def lengths(self, cell: float) -> FloatArray:
        """Return the length of each group, metres, shape (m,)."""
        return np.asarray(np.bincount(self.group, minlength=self.groups) * cell, dtype=np.float64)

    def subset(self, chosen: NDArray[np.bool_]) -> Frontiers:
        """Return those edges alone, their groups numbered anew."""
        group = np.unique(self.group[chosen], return_inverse=True)[1].astype(np.intp)
        return Frontiers(self.edges[chosen], self.unknown[chosen], group)


def frontiers_of(state: NDArray[np.uint8], wanted: NDArray[np.bool_], longest: float) -> Frontiers:
    """Return the frontiers of a map.

    A gap of up to GAP cells in a surface is none, be it in a wall or at a corner: beams that graze a surface leave such
    gaps out, and it is below the resolution at which a map tells what is open.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        wanted: unknown cells that count, shape (rows, columns).
        longest: cells: about the longest that a group may be; longer ones are divided by K-means.
    """
    borders = _borders(state, wanted)
    cells, (dx, dy) = borders[:, :2], borders[:, 2:].T
    edges = np.column_stack([cells[:, ::-1] + 0.5 - 0.5 * borders[:, 2:], dx, dy]).astype(np.float64)
    places, which = np.unique(cells @ [state.shape[1], 1], return_inverse=True)
    number = _connected(places, state.shape[1])
    number[_gaps(state, np.column_stack(np.divmod(places, state.shape[1])), number)] = -1
    group = number[which]
    wide = group >= 0
    edges = edges[wide]
    return Frontiers(edges, cells[wide], _divided(edges[:, :2], group[wide], longest))


@njit(nogil=True)
def _borders(state: NDArray[np.uint8], wanted: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return rows and columns of unknown cells that count, each with a direction x, y to it from a free one, (n, 4)."""
    rows, columns = state.shape
    found, count = np.empty((1024, 4), np.int64), 0
    for r in range(rows):
        for c in range(columns):
            # Each pair of neighbours once; most are alike.
            for dx, dy in ((1, 0), (0, 1)):
                row, column = min(r + dy, rows - 1), min(c + dx, columns - 1)
                if state[r, c] == state[row, column]:
                    continue
                forward = state[r, c] == FREE and state[row, column] == UNKNOWN and wanted[row, column]
                backward = state[r, c] == UNKNOWN and state[row, column] == FREE and wanted[r, c]
                if not forward and not backward:
                    continue
                if count == len(found):
                    found = np.concatenate((found, found))
                found[count] = (row, column, dx, dy) if forward else (r, c, -dx, -dy)
                count += 1
    return found[:count].copy()


def _connected(places: NDArray[np.int64], columns: int) -> NDArray[np.intp]:
    """Return the number, from 0 on, of the connected part that each cell is in, corners included, shape (n,).

    Args:
        places: row * columns + column of cells, in their order, shape (n,).
        columns: of the grid.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = list[NDArray[np.intp]]()
    for dr, dc in ((0, 1), (1, -1), (1, 0), (1, 1)):
        beside = places + dr * columns + dc
        beside[(places % columns + dc < 0) | (places % columns + dc >= columns)] = -1
        at = np.minimum(np.searchsorted(places, beside), len(places) - 1)
        first = np.flatnonzero(places[at] == beside) if len(places) else at
        pairs.append(np.column_stack([first, at[first]]))
    joined = np.concatenate(pairs)
    graph = coo_array((np.ones(len(joined), np.int8), tuple(joined.T)), shape=(len(places), len(places)))
    return np.asarray(connected_components(graph, directed=False)[1], np.intp)


def _gaps(state: NDArray[np.uint8], cells: NDArray[np.int64], number: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return which cells are gaps in surfaces: up to GAP together, each edge of free space beside which is occupied.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        cells: rows and columns of unknown cells beside free ones, shape (n, 2).
        number: of the connected part of each, shape (n,).
    """
    few = np.bincount(number) <= GAP
    among = few[number]
    cells, own = cells[among], number[among]
    closed = np.pad(state, 1, constant_values=OCCUPIED)
    beside = cells[:, None] + AROUND + 1
    touches = (closed[beside[..., 0], beside[..., 1]] == OCCUPIED).any(axis=1)
    closed[cells[:, 0] + 1, cells[:, 1] + 1] = OCCUPIED
    kinds = closed[beside[..., 0], beside[..., 1]]
    after = np.roll(kinds, -1, axis=1)
    # Free and unknown cells side by side.
    is_open = ((np.minimum(kinds, after) == UNKNOWN) & (np.maximum(kinds, after) == FREE)).any(axis=1)
    few[own[is_open]] = False
    few[np.setdiff1d(own, own[touches])] = False
    return np.asarray(few[number])


def _divided(points: FloatArray, group: NDArray[np.intp], longest: float) -> NDArray[np.intp]:
    """Return the groups of points (n, 2), the long ones divided."""
    divided = group.copy()
    count = int(group.max(initial=-1)) + 1
    for g, size in enumerate(np.bincount(group, minlength=count).tolist()):
        if size <= longest:
            continue
        members = np.flatnonzero(group == g)
        first = points[members[np.linspace(0, size - 1, ceil(size / longest)).astype(np.intp)]]
        centres = lloyd(points[members], first, STEPS)
        nearest = np.square(points[members][:, None] - centres[None]).sum(-1).argmin(1)
        divided[members] = np.where(nearest == 0, g, count + nearest - 1)
        count += len(centres) - 1
    return np.unique(divided, return_inverse=True)[1].astype(np.intp)
