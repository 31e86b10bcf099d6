"""What a place sees in the known map: frontiers in a free line of sight, and unknown area that may lie behind them."""

from __future__ import annotations

from math import cos, exp, floor, hypot, pi, sin

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.grid import first_step
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = ["expected_areas", "line_is_free", "nearest_looks", "places_in_sight", "sight"]


@callee
def _meets_surface(
    box: NDArray[np.uint8], column: int, row: int, x0: float, y0: float, dx: float, dy: float, begin: float, end: float
) -> bool:
    """Return whether the part of a line from share begin to end of it meets the box of a cell's surface."""
    for axis in range(2):
        at, along, corner = (x0, dx, column) if axis == 0 else (y0, dy, row)
        low, high = corner + box[axis] / 255.0, corner + box[axis + 2] / 255.0
        if along == 0.0:
            if not low <= at <= high:
                return False
            continue
        first, last = (low - at) / along, (high - at) / along
        begin, end = max(begin, min(first, last)), min(end, max(first, last))
    return begin <= end


@callee
def line_is_free(
    state: NDArray[np.uint8], boxes: NDArray[np.uint8], x0: float, y0: float, x1: float, y1: float
) -> bool:
    """Return whether a line of sight leads through cells that are free, or past the surfaces in occupied ones.

    Cells that it only touches in a corner do not count.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        boxes: of the surfaces in occupied cells, xmin, ymin, xmax, ymax in 255ths, shape (rows, columns, 4).
        x0: where it begins, in cells from the grid's corner,
        y0: likewise.
        x1: where it ends; on a cell's edge, the cell on the other side of it does not count,
        y1: likewise.
    """
    dx, dy = x1 - x0, y1 - y0
    column, row, _, _, step_x, step_y, next_x, next_y, each_x, each_y = first_step(x0, y0, x1, y1)
    since = 0.0
    while True:
        if state[row, column] == UNKNOWN:
            return False
        nearest = min(next_x, next_y)
        if state[row, column] == OCCUPIED and _meets_surface(
            boxes[row, column], column, row, x0, y0, dx, dy, since, min(nearest, 1.0)
        ):
            return False
        since = nearest
        if nearest >= 1.0 - 1e-9:
            return True
        if next_x <= nearest + 1e-12:
            next_x += each_x
            column += step_x
        if next_y <= nearest + 1e-12:
            next_y += each_y
            row += step_y


@njit(nogil=True)
def sight(
    state: NDArray[np.uint8],
    boxes: NDArray[np.uint8],
    places: FloatArray,
    edges: FloatArray,
    farthest: FloatArray,
) -> NDArray[np.bool_]:
    """Return which places see which edges between free and unknown cells, shape (n, m).

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        boxes: as for :func:`line_is_free`.
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
                seen[i, j] = line_is_free(state, boxes, places[i, 0], places[i, 1], edges[j, 0], edges[j, 1])
    return seen


@njit(nogil=True)
def nearest_looks(
    state: NDArray[np.uint8],
    boxes: NDArray[np.uint8],
    places: FloatArray,
    cells: NDArray[np.int64],
    farthest: float,
) -> FloatArray:
    """Return the distance from which each cell was wholly in sight, the least one, in cells; infinite if from none.

    It is so from where the middles of its four quarters are in sight, through free cells and the cell itself.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        boxes: as for :func:`line_is_free`.
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
            if away > farthest or away >= nearest[j]:
                continue
            whole = True
            for quarter in range(4):
                end_x, end_y = column + 0.25 + 0.5 * (quarter % 2), row + 0.25 + 0.5 * (quarter // 2)
                whole = whole and line_is_free(state, boxes, x, y, end_x, end_y)
            if whole:
                nearest[j] = away
        state[row, column] = before
    return nearest


@njit(nogil=True)
def places_in_sight(
    state: NDArray[np.uint8],
    boxes: NDArray[np.uint8],
    reached: NDArray[np.uint8],
    edges: FloatArray,
    farthest: FloatArray,
    draws: int,
    spacing: float,
) -> NDArray[np.int64]:
    """Return cells from whose centres edges are seen, drawn at random, row * columns + column, or -1; (m, draws).

    Rays go from the edge's middle through free cells. Cells of the highest kind in sight are drawn from.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        boxes: as for :func:`line_is_free`.
        reached: 0 where the robot cannot get to; of the other cells, the higher the better; shape (rows, columns).
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
                if row < 0 or column < 0 or row >= rows or column >= columns or state[row, column] == UNKNOWN:
                    break
                far += step
                if state[row, column] == OCCUPIED:
                    # Perhaps past the surface in it: whether a place is in sight is looked at exactly.
                    continue
                place = row * columns + column
                if reached[row, column] < best or tested[place] == j:
                    continue
                tested[place] = j
                x, y = column + 0.5, row + 0.5
                if (x0 - x) * edges[j, 2] + (y0 - y) * edges[j, 3] <= 1e-9:
                    continue
                if hypot(x0 - x, y0 - y) > farthest[j]:
                    continue
                sure = False
                for d in range(draws):
                    # The least of their hashes (Broder 1997): edges side by side draw the same cells where they can.
                    mixed = np.uint64(place + 1) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(d)
                    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
                    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
                    if mixed >= least[d] and reached[row, column] == best:
                        continue
                    if not sure and not line_is_free(state, boxes, x, y, x0, y0):
                        break
                    sure = True
                    if reached[row, column] > best:
                        best = reached[row, column]
                        least[:] = np.uint64(0xFFFFFFFFFFFFFFFF)
                    if mixed < least[d]:
                        least[d], found[j, d] = mixed, place
    return found


@njit(nogil=True)
def expected_areas(
    state: NDArray[np.uint8], places: FloatArray, farthest: float, free_path: float, rays: int
) -> FloatArray:
    """Return the unknown area that is expected to be seen from places, in cells, shape (n,).

    It is what lies along rays up to the range or an occupied cell. In unknown space a ray is taken to meet
    something with the probability that the known space suggests: what lies at depth d of it counts exp(-d / free path).

    Source: the area behind free edges as gain: González-Baños & Latombe, "Navigation strategies for exploring indoor
    environments", Int. J. Robotics Research 2002; here without taking all of it for free.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        places: x, y in cells from the grid's corner, shape (n, 2).
        farthest: the sensor's range, in cells.
        free_path: mean length of a ray in free space, in cells.
        rays: how many, all around.
    """
    rows, columns = state.shape
    areas = np.zeros(len(places))
    step = 1.0
    for i in range(len(places)):
        for k in range(rays):
            angle = 2.0 * pi * (k + 0.5) / rays
            ux, uy = cos(angle), sin(angle)
            far, depth = 0.5 * step, 0.0
            while far < farthest:
                column, row = floor(places[i, 0] + far * ux), floor(places[i, 1] + far * uy)
                if row < 0 or column < 0 or row >= rows or column >= columns or state[row, column] == OCCUPIED:
                    break
                if state[row, column] != FREE:
                    areas[i] += far * exp(-depth / free_path)
                    depth += step
                far += step
        areas[i] *= step * 2.0 * pi / rays
    return areas
