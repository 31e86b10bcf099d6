"""The fast marching method: costs from a place over a grid of densities, by fronts and not by edges.

Unlike a search along edges, which knows eight directions, it does not take a way for longer than it is because of its
direction. Each square is cut into two triangles, mirrored from square to square.

Source: Kimmel & Sethian, "Computing geodesic paths on manifolds", PNAS 95, 1998.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = ["march", "on_diagonal"]


@njit
def march(density: FloatArray, size: float, row: int, column: int) -> FloatArray:
    """Return the costs from a square's corners to the vertices of all squares, shape (rows + 1, columns + 1).

    Args:
        density: what a metre costs in each square, shape (rows, columns); infinite where nothing leads through.
        size: edge of a square, metres.
        row: of the square.
        column: likewise.
    """
    rows, columns = density.shape
    width = columns + 1
    value, trial = np.full((rows + 1, width), np.inf), np.full((rows + 1, width), np.inf)
    keys, vertices, waiting = np.empty(1024), np.empty(1024, np.int64), 0
    for i in range(row, row + 2):
        for j in range(column, column + 2):
            trial[i, j] = 0.0
            waiting = heap_push(keys, vertices, waiting, 0.0, i * width + j)
    while waiting > 0:
        waiting = heap_pop(keys, vertices, waiting)
        i, j = vertices[waiting] // width, vertices[waiting] % width
        if value[i, j] < np.inf or keys[waiting] > trial[i, j]:
            continue
        value[i, j] = trial[i, j]
        if waiting + 8 > len(keys):
            keys, vertices = heap_grow(keys, vertices)
        for u in range(max(0, i - 1), min(rows, i + 1) + 1):
            for v in range(max(0, j - 1), min(columns, j + 1) + 1):
                if value[u, v] < np.inf:
                    continue
                found = _value_at(value, density, size, u, v)
                if found < trial[u, v]:
                    trial[u, v] = found
                    waiting = heap_push(keys, vertices, waiting, found, u * width + v)
    return value


@callee
def _value_at(value: FloatArray, density: FloatArray, size: float, i: int, j: int) -> float:
    """Return the value at a vertex by what is known of the other vertices of its triangles."""
    found = np.inf
    for a in range(2):
        for b in range(2):
            row, column = i - a, j - b
            if not (0 <= row < density.shape[0] and 0 <= column < density.shape[1]) or density[row, column] == np.inf:
                continue
            step = density[row, column] * size
            across, along = value[row + 1 - a, j], value[i, column + 1 - b]
            if on_diagonal(row, column, a, b):
                opposite = value[row + 1 - a, column + 1 - b]
                found = min(found, _acute(across, opposite, step), _acute(along, opposite, step))
            else:
                found = min(found, _right(across, along, step))
    return found


@callee
def on_diagonal(row: int, column: int, a: int, b: int) -> bool:
    """Return whether a square's corner lies on the diagonal that cuts it in two; neighbours have mirrored ones."""
    return ((row + column) & 1 == 0) == (a == b)


@callee
def _right(a: float, b: float, step: float) -> float:
    """Return the value at the right angle's vertex by those at the legs' ends: (u − a)² + (u − b)² = step²."""
    gap = abs(a - b)
    if gap >= step:
        # No front comes from between the two; if one is not known yet, none can.
        return min(a, b) + step
    return 0.5 * (a + b + sqrt(2.0 * step * step - gap * gap))


@callee
def _acute(right: float, other: float, step: float) -> float:
    """Return the value at a leg's end by the right angle's and the other leg's end: (u − r)² + (o − r)² = step²."""
    gap = right - other
    if 0.0 <= gap <= step * sqrt(0.5):
        return right + sqrt(step * step - gap * gap)
    return min(right + step, other + sqrt(2.0) * step)
