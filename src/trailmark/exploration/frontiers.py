"""Frontiers: where free space that is known borders on what is not known."""

# Tested by tests/exploration/test_survey.py.

from __future__ import annotations

from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN
from trailmark.landmarks.kmeans import lloyd
from trailmark.se2 import FloatArray

__all__ = ["Frontiers", "frontiers_of"]

GAP = 2
"""Cells: as wide a gap in a wall, or a narrower one, is not looked through."""

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

    A gap of up to GAP cells between two occupied ones is none: beams that graze a wall leave such gaps out, and it is
    below the resolution at which a map tells what is open.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        wanted: unknown cells that count, shape (rows, columns).
        longest: cells: about the longest that a group may be; longer ones are divided by K-means.
    """
    from scipy import ndimage

    unknown = (state == UNKNOWN) & wanted
    free = state == FREE
    occupied = np.pad(state == OCCUPIED, GAP, constant_values=True)
    edges, cells = list[FloatArray](), list[NDArray[np.intp]]()
    for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        # Free cells whose neighbour in this direction is unknown.
        beside = np.zeros_like(unknown)
        rows, columns = state.shape
        here = slice(max(-dy, 0), rows - max(dy, 0)), slice(max(-dx, 0), columns - max(dx, 0))
        there = slice(max(dy, 0), rows + min(dy, 0)), slice(max(dx, 0), columns + min(dx, 0))
        beside[here] = free[here] & unknown[there] & ~_narrow(occupied, dy, dx)[here]
        r, c = np.nonzero(beside)
        way = np.broadcast_to(np.array([dx, dy], dtype=np.float64), (len(r), 2))
        edges.append(np.column_stack([c + 0.5 + 0.5 * dx, r + 0.5 + 0.5 * dy, way]))
        cells.append(np.column_stack([r + dy, c + dx]))
    edge, cell = np.concatenate(edges), np.concatenate(cells)
    mask = np.zeros_like(unknown)
    mask[cell[:, 0], cell[:, 1]] = True
    labels = ndimage.label(mask, np.ones((3, 3)))[0]
    group = labels[cell[:, 0], cell[:, 1]].astype(np.intp) - 1
    return Frontiers(edge, cell, _divided(edge[:, :2], group, longest))


def _narrow(occupied: NDArray[np.bool_], dy: int, dx: int) -> NDArray[np.bool_]:
    """Return for each cell whether the gap between it and the next one in a direction is of GAP cells at most.

    Args:
        occupied: with GAP more rows and columns on each side, shape (rows + 2 GAP, columns + 2 GAP).
        dy: rows to the next cell,
        dx: columns to it.
    """
    both = occupied | np.roll(occupied, (-dy, -dx), axis=(0, 1))
    # How near something occupied is on either side.
    narrow = np.zeros_like(both)
    for one in range(1, GAP + 1):
        for other in range(1, GAP + 2 - one):
            narrow |= np.roll(both, one, axis=int(dx == 0)) & np.roll(both, -other, axis=int(dx == 0))
    return narrow[GAP:-GAP, GAP:-GAP]


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
