"""Frontiers: where free space that is known borders on what is not known."""

# Tested by tests/exploration/test_survey.py.

from __future__ import annotations

from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN
from trailmark.landmarks.kmeans import lloyd
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
    from scipy import ndimage

    unknown = (state == UNKNOWN) & wanted
    free = state == FREE
    edges, cells = list[FloatArray](), list[NDArray[np.intp]]()
    for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        # Free cells whose neighbour in this direction is unknown.
        beside = np.zeros_like(unknown)
        rows, columns = state.shape
        here = slice(max(-dy, 0), rows - max(dy, 0)), slice(max(-dx, 0), columns - max(dx, 0))
        there = slice(max(dy, 0), rows + min(dy, 0)), slice(max(dx, 0), columns + min(dx, 0))
        beside[here] = free[here] & unknown[there]
        r, c = np.nonzero(beside)
        way = np.broadcast_to(np.array([dx, dy], dtype=np.float64), (len(r), 2))
        edges.append(np.column_stack([c + 0.5 + 0.5 * dx, r + 0.5 + 0.5 * dy, way]))
        cells.append(np.column_stack([r + dy, c + dx]))
    edge, cell = np.concatenate(edges), np.concatenate(cells)
    mask = np.zeros_like(unknown)
    mask[cell[:, 0], cell[:, 1]] = True
    labels = ndimage.label(mask, np.ones((3, 3)))[0]
    labels[_gaps(state, labels)] = 0
    group = labels[cell[:, 0], cell[:, 1]].astype(np.intp) - 1
    wide = group >= 0
    edge = edge[wide]
    return Frontiers(edge, cell[wide], _divided(edge[:, :2], group[wide], longest))


def _gaps(state: NDArray[np.uint8], labels: NDArray[np.integer[Any]]) -> NDArray[np.bool_]:
    """Return the cells of gaps in surfaces: up to GAP together, each edge of free space beside which is occupied.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        labels: numbers of connected unknown cells beside free ones, 0 for the other cells, shape (rows, columns).
    """
    few = np.bincount(labels.ravel()) <= GAP
    few[0] = False
    cells = np.argwhere(np.take(few, labels))
    closed = np.pad(state, 1, constant_values=OCCUPIED)
    beside = cells[:, None] + AROUND + 1
    touches = (closed[beside[..., 0], beside[..., 1]] == OCCUPIED).any(axis=1)
    closed[cells[:, 0] + 1, cells[:, 1] + 1] = OCCUPIED
    kinds = closed[beside[..., 0], beside[..., 1]]
    after = np.roll(kinds, -1, axis=1)
    # Free and unknown cells side by side.
    is_open = ((np.minimum(kinds, after) == UNKNOWN) & (np.maximum(kinds, after) == FREE)).any(axis=1)
    number = labels[cells[:, 0], cells[:, 1]]
    few[number[is_open]] = False
    few[np.setdiff1d(number, number[touches])] = False
    return np.asarray(np.take(few, labels))


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
