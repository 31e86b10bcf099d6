"""The clearance field: for every cell of a grid, proven bounds on the distance to the nearest obstacle."""

from __future__ import annotations

from math import floor, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.obstacles import ObstacleGrid
from trailmark.jit import callee, njit

__all__ = ["ClearanceField", "build_field", "distance_transform", "interpolated"]


class ClearanceField(NamedTuple):
    """Distances from cell centres to the nearest occupied cell's centre.

    A cell is occupied if any part of an obstacle or of the outside touches it. For every point p of a cell
    with value D the distance to the nearest obstacle lies in [D - slack, D + slack]: p and the obstacle's
    point are each at most half a cell's diagonal from their cells' centres.

    Attributes:
        distance: (rows, columns) float32, metres; 0 in occupied cells.
        x0: left edge of the first column, metres.
        y0: lower edge of the first row, metres.
        size: edge of a cell, metres.
        slack: one cell diagonal and the rounding of float32, metres.
    """

    distance: NDArray[np.float32]
    x0: float
    y0: float
    size: float
    slack: float


def build_field(grid: ObstacleGrid) -> ClearanceField:
    """Return the clearance field on the cells of ``grid``, by an exact Euclidean distance transform."""
    occupied = (np.diff(grid.cell_start, axis=1) > 0) | (grid.winding > 0)
    distance = distance_transform(occupied, grid.size)
    # The cells that an item touches are found with 1e-6 of a cell to spare; float32 keeps 1e-7 of a value.
    slack = grid.size * sqrt(2.0) * (1.0 + 1e-5) + 1e-6 * float(distance.max(initial=0.0))
    return ClearanceField(distance, grid.x0, grid.y0, grid.size, slack)


@njit(nogil=True)
def distance_transform(occupied: NDArray[np.bool_], size: float) -> NDArray[np.float32]:
    """Return each cell's distance (metres, shape (rows, columns)) to the nearest occupied cell, centre to centre.

    Along each column by two scans, then along each row by the lower envelope of the columns' parabolas; exact, in time
    linear in the number of cells. Source: Felzenszwalb & Huttenlocher, "Distance transforms of sampled functions",
    Theory of Computing 2012, section 2. (SciPy's is as exact, but takes several times as long, and its import a tenth
    of a second.)

    Args:
        occupied: shape (rows, columns).
        size: edge of a cell, metres.
    """
    rows, columns = occupied.shape
    # Farther than any other cell of the grid.
    far = rows + columns
    steps = np.empty((rows, columns), np.int32)
    for row in range(rows):
        for column in range(columns):
            above = steps[row - 1, column] if row > 0 else far
            steps[row, column] = 0 if occupied[row, column] else min(above + 1, far)
    for row in range(rows - 2, -1, -1):
        for column in range(columns):
            steps[row, column] = min(steps[row, column], steps[row + 1, column] + 1, far)
    distance = np.empty((rows, columns), np.float32)
    # The envelope's parabolas by the column of their vertex, and where each of them replaces the one before.
    vertex, begin = np.empty(columns, np.int64), np.empty(columns)
    for row in range(rows):
        down, last = steps[row], 0
        vertex[0], begin[0] = 0, -np.inf
        for column in range(1, columns):
            height = down[column] ** 2 + column**2
            while True:
                other = vertex[last]
                crossing = (height - down[other] ** 2 - other**2) / (2.0 * (column - other))
                if crossing > begin[last]:
                    break
                last -= 1
            last += 1
            vertex[last], begin[last] = column, crossing
        k = 0
        for column in range(columns):
            while k < last and begin[k + 1] < column:
                k += 1
            across = column - vertex[k]
            distance[row, column] = size * sqrt(across * across + down[vertex[k]] * down[vertex[k]])
    return distance


@callee
def interpolated(field: ClearanceField, x: float, y: float) -> tuple[float, float, float]:
    """Return the field's (unproven) distance between cell centres and its slope along x and y.

    Out of the grid the distance is minus infinity and the slope 0.
    """
    rows, columns = field.distance.shape
    u, v = (x - field.x0) / field.size - 0.5, (y - field.y0) / field.size - 0.5
    column, row = floor(u), floor(v)
    if not (0 <= column < columns - 1 and 0 <= row < rows - 1):
        return -np.inf, 0.0, 0.0
    u, v = u - column, v - row
    a, b = field.distance[row, column], field.distance[row, column + 1]
    c, d = field.distance[row + 1, column], field.distance[row + 1, column + 1]
    low, high = (1.0 - u) * a + u * b, (1.0 - u) * c + u * d
    gx, gy = (1.0 - v) * (b - a) + v * (d - c), high - low
    return (1.0 - v) * low + v * high, gx / field.size, gy / field.size
