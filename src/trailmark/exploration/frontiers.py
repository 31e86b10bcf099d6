"""Frontiers: where free space that is known borders on what is not known, and from where they are in sight."""

from __future__ import annotations

from math import ceil, cos, floor, hypot, pi, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.grid import first_step
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, next_cell
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = ["Frontiers", "frontiers_of", "places_in_sight", "sight"]

GAP = 2  # Cells: as wide a gap in a surface, or a narrower one, is not looked through.
# Rows and columns from a cell to those around it, in their order.
AROUND = np.array([(-1, -1), (-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1)])


class Frontiers(NamedTuple):
    """Edges between free cells and unknown ones, in groups that lie together.

    Source: Yamauchi, "A frontier-based approach for autonomous exploration", CIRA 1997.
    """

    # Middles, and directions to the unknown cell, x, y, dx, dy, in cells from the grid's corner, shape (n, 4).
    edges: FloatArray
    unknown: NDArray[np.intp]  # Rows and columns of the unknown cells, shape (n, 2).
    group: NDArray[np.intp]  # To which group each edge belongs, from 0 on, shape (n,).

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
        longest: cells: longer groups are divided, along the axis along which they are longer.
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
    edges, group, part = edges[wide], group[wide], np.zeros(int(wide.sum()), np.intp)
    for g in np.flatnonzero(np.bincount(group) > longest).tolist():
        own = np.flatnonzero(group == g)
        own = own[np.argsort(edges[own, np.ptp(edges[own, :2], axis=0).argmax()], kind="stable")]
        part[own] = np.arange(len(own)) * ceil(len(own) / longest) // len(own)
    numbers = np.unique(np.column_stack([group, part]), axis=0, return_inverse=True)[1]
    return Frontiers(edges, cells[wide], numbers.ravel().astype(np.intp))


def _gaps(state: NDArray[np.uint8], cells: NDArray[np.intp], number: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return which parts, by number, of unknown cells beside free ones are gaps in surfaces, of up to GAP cells."""
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


@njit(nogil=True)
def sight(state: NDArray[np.uint8], places: FloatArray, ends: FloatArray, farthest: FloatArray) -> NDArray[np.bool_]:
    """Return which places see which points along lines through free cells, shape (n, m).

    The cell that holds a point, and cells that a line only touches in a corner, do not count.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        places: x, y in cells from the grid's corner, shape (n, 2).
        ends: points x, y in cells, and directions dx, dy in which they are looked at; 0, 0 for any; shape (m, 4).
        farthest: from which each point is seen at most, in cells, shape (m,).
    """
    seen = np.zeros((len(places), len(ends)), np.bool_)
    for b in range(len(ends)):
        x, y, towards_x, towards_y = ends[b]
        any_way = towards_x == 0.0 and towards_y == 0.0
        # From the point on: most lines to what is hidden end near it. On an edge, from the cell before it.
        x, y = x - 1e-7 * towards_x, y - 1e-7 * towards_y
        for a in range(len(places)):
            dx, dy = places[a, 0] - x, places[a, 1] - y
            facing = any_way or dx * towards_x + dy * towards_y < -1e-6
            if not facing or dx * dx + dy * dy > farthest[b] ** 2:
                continue
            i, j, _, _, step_i, step_j, next_i, next_j, each_i, each_j = first_step(x, y, x + dx, y + dy)
            seen[a, b] = any_way or state[j, i] == FREE
            while seen[a, b] and min(next_i, next_j) < 1.0 - 1e-9:
                i, j, next_i, next_j = next_cell(i, j, step_i, step_j, next_i, next_j, each_i, each_j)
                seen[a, b] = state[j, i] == FREE
    return seen


@callee
def line_is_free(state: NDArray[np.uint8], x0: float, y0: float, x1: float, y1: float) -> bool:
    """Return whether a line leads through free cells; the cell beyond the edge that it ends on does not count."""
    i, j, _, _, step_i, step_j, next_i, next_j, each_i, each_j = first_step(x0, y0, x1, y1)
    while state[j, i] == FREE:
        if min(next_i, next_j) >= 1.0 - 1e-9:
            return True
        i, j, next_i, next_j = next_cell(i, j, step_i, step_j, next_i, next_j, each_i, each_j)
    return False


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
