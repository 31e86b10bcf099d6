"""Frontiers: where free space that is known borders on what is not known, and from where they are in sight."""

from __future__ import annotations

from math import ceil, cos, floor, hypot, pi, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.grid import first_step
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN
from trailmark.jit import callee, njit
from trailmark.landmarks.sampling import lloyd
from trailmark.se2 import FloatArray

__all__ = ["Frontiers", "frontiers_of", "nearest_looks", "places_in_sight", "sight"]

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
    def sizes(self) -> NDArray[np.intp]:
        """How many edges each group has, shape (m,)."""
        return np.bincount(self.group)

    def subset(self, chosen: NDArray[np.bool_]) -> Frontiers:
        """Return those edges alone, their groups numbered anew."""
        group = np.unique(self.group[chosen], return_inverse=True)[1].astype(np.intp)
        return Frontiers(self.edges[chosen], self.unknown[chosen], group)


def frontiers_of(state: NDArray[np.uint8], longest: float) -> Frontiers:
    """Return the frontiers of a map.

    A gap of up to GAP cells in a surface is none, be it in a wall or at a corner: beams that graze a surface leave such
    gaps out, and it is below the resolution at which a map tells what is open.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        longest: cells: about the longest that a group may be; longer ones are divided by K-means.
    """
    from scipy import ndimage

    borders = []
    for dx, dy in ((1, 0), (0, 1)):
        first, second = state[: state.shape[0] - dy, : state.shape[1] - dx], state[dy:, dx:]
        for a, b, sign in ((first, second, 1), (second, first, -1)):
            rows, columns = np.nonzero((a == FREE) & (b == UNKNOWN))
            at = np.column_stack([rows, columns]) + ((dy, dx) if sign > 0 else (0, 0))
            borders.append(np.column_stack([at, np.full(len(at), sign * dx), np.full(len(at), sign * dy)]))
    found = np.concatenate(borders)
    cells, direction = found[:, :2], found[:, 2:]
    edges = np.column_stack([cells[:, ::-1] + 0.5 - 0.5 * direction, direction]).astype(np.float64)
    mask = np.zeros(state.shape, np.bool_)
    mask[tuple(cells.T)] = True
    label = ndimage.label(mask, np.ones((3, 3)))[0]
    group = label[tuple(cells.T)].astype(np.intp) - 1
    own = np.unique(cells, axis=0)
    wide = ~_gaps(state, own, label[tuple(own.T)].astype(np.intp) - 1)[group] if len(own) else np.zeros(0, np.bool_)
    return Frontiers(edges[wide], cells[wide], _divided(edges[wide, :2], group[wide], longest))


def _gaps(state: NDArray[np.uint8], cells: NDArray[np.intp], number: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return which groups are gaps in surfaces: up to GAP cells, each edge of free space beside which is occupied.

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
    return np.asarray(few)


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


@callee
def line_is_free(state: NDArray[np.uint8], x0: float, y0: float, x1: float, y1: float) -> bool:
    """Return whether a line of sight leads through free cells; those that it only touches in a corner do not count.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        x0: where it begins, in cells from the grid's corner,
        y0: likewise.
        x1: where it ends; on a cell's edge, the cell on the other side of it does not count,
        y1: likewise.
    """
    column, row, _, _, step_x, step_y, next_x, next_y, each_x, each_y = first_step(x0, y0, x1, y1)
    while True:
        if state[row, column] != FREE:
            return False
        nearest = min(next_x, next_y)
        if nearest >= 1.0 - 1e-9:
            return True
        if next_x <= nearest + 1e-12:
            next_x += each_x
            column += step_x
        if next_y <= nearest + 1e-12:
            next_y += each_y
            row += step_y


@njit(nogil=True)
def sight(state: NDArray[np.uint8], places: FloatArray, edges: FloatArray, farthest: FloatArray) -> NDArray[np.bool_]:
    """Return which places see which edges between free and unknown cells, shape (n, m).

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        places: x, y in cells from the grid's corner, shape (n, 2).
        edges: middles, and the directions to the unknown cell, x, y, dx, dy, in cells, shape (m, 4).
        farthest: from which each edge is seen at most, in cells, shape (m,).
    """
    seen = np.zeros((len(places), len(edges)), np.bool_)
    for i in range(len(places)):
        for j in range(len(edges)):
            dx, dy = edges[j, 0] - places[i, 0], edges[j, 1] - places[i, 1]
            # From the free side only.
            if dx * edges[j, 2] + dy * edges[j, 3] > 1e-9 and dx * dx + dy * dy <= farthest[j] ** 2:
                seen[i, j] = line_is_free(state, places[i, 0], places[i, 1], edges[j, 0], edges[j, 1])
    return seen


@njit(nogil=True)
def nearest_looks(
    state: NDArray[np.uint8], places: FloatArray, cells: NDArray[np.int64], farthest: float
) -> FloatArray:
    """Return the least distance, in cells, from which each unknown cell was wholly in sight; infinite if from none.

    It is so from where the middles of its four quarters are in sight: what is half hidden may well be seen from
    elsewhere.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        places: x, y in cells from the grid's corner, shape (n, 2).
        cells: rows and columns, shape (m, 2).
        farthest: in cells.
    """
    nearest = np.full(len(cells), np.inf)
    for j in range(len(cells)):
        row, column = cells[j, 0], cells[j, 1]
        before = state[row, column]
        state[row, column] = FREE
        for i in range(len(places)):
            x, y = places[i, 0], places[i, 1]
            away = hypot(column + 0.5 - x, row + 0.5 - y)
            whole = away <= farthest and away < nearest[j]
            for quarter in range(4):
                end_x, end_y = column + 0.25 + 0.5 * (quarter % 2), row + 0.25 + 0.5 * (quarter // 2)
                whole = whole and line_is_free(state, x, y, end_x, end_y)
            if whole:
                nearest[j] = away
        state[row, column] = before
    return nearest


@njit(nogil=True)
def places_in_sight(
    state: NDArray[np.uint8],
    ranks: NDArray[np.uint8],
    edges: FloatArray,
    farthest: FloatArray,
    draws: int,
    spacing: float,
) -> NDArray[np.int64]:
    """Return cells from whose centres edges are seen, drawn at random, row * columns + column, or -1; (m, draws).

    Rays go from the edge's middle through free cells. Cells of the highest rank in sight are drawn from.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        ranks: of all cells, the higher the better, 0 for those that do not count, shape (rows, columns).
        edges: middles, and the directions to the unknown cell, x, y, dx, dy, in cells, shape (m, 4).
        farthest: from which each edge is seen at most, in cells, shape (m,).
        draws: how many; some may be the same.
        spacing: of rays where they end, in cells; 0.5 leaves out no cell.
    """
    rows, columns = state.shape
    # Rays that leave cells out may as well leave some out along them.
    step = max(0.7, 0.35 * spacing)
    found = np.full((len(edges), draws), -1, np.int64)
    tested = np.full(rows * columns, -1, np.int64)
    least = np.empty(draws, np.uint64)
    for j in range(len(edges)):
        x0, y0 = edges[j, 0], edges[j, 1]
        towards = np.arctan2(-edges[j, 3], -edges[j, 2]) - 0.5 * pi
        rays = int(pi * farthest[j] / spacing) + 8
        best = 1
        least[:] = np.uint64(0xFFFFFFFFFFFFFFFF)
        for k in range(rays):
            angle = towards + pi * (k + 0.5) / rays
            ux, uy = cos(angle), sin(angle)
            far = 0.5
            while far < farthest[j] + 1.0:
                column, row = floor(x0 + far * ux), floor(y0 + far * uy)
                if row < 0 or column < 0 or row >= rows or column >= columns or state[row, column] != FREE:
                    break
                far += step
                place = row * columns + column
                if ranks[row, column] < best or tested[place] == j:
                    continue
                tested[place] = j
                x, y = column + 0.5, row + 0.5
                if (x0 - x) * edges[j, 2] + (y0 - y) * edges[j, 3] <= 1e-9 or hypot(x0 - x, y0 - y) > farthest[j]:
                    continue
                sure = False
                for d in range(draws):
                    # The least of their hashes (Broder 1997): edges side by side draw the same cells where they can.
                    mixed = np.uint64(place + 1) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(d)
                    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
                    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
                    if mixed >= least[d] and ranks[row, column] == best:
                        continue
                    if not sure and not line_is_free(state, x, y, x0, y0):
                        break
                    sure = True
                    if ranks[row, column] > best:
                        best = ranks[row, column]
                        least[:] = np.uint64(0xFFFFFFFFFFFFFFFF)
                    if mixed < least[d]:
                        least[d], found[j, d] = mixed, place
    return found
