"""Where a disc's shortest path goes on from a corner: along the common tangents of circles about corners, compiled.

A shortest path of the disc's centre is made of arcs of circles about corners and of segments that touch two of them.
Round a corner it turns one way, left (the corner lies on its left) or right: a node is a corner and a way to turn.
A segment from circle to circle lies in a strip as wide as the disc, whose edges the corners lie on: so the one corner
sees the other, and only corners that are seen come into question.

Source: Liu & Arimoto, "Path planning using a tangent graph for mobile robots among polygonal and curved obstacles",
International Journal of Robotics Research 11(4), 1992.
"""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import callee
from trailmark.planning.grids.sight import Corners, IntArray, fits, seen
from trailmark.se2 import FloatArray

__all__ = ["ends_of_tangent", "from_point", "successors", "turns_at"]

Int32Array = NDArray[np.int32]

AHEAD = 1e-9
"""By how much (sine of an angle) a path may seem to turn back, for rounding."""

_BLOCKED_X = np.array([-1, 1, -1, 1])
_BLOCKED_Y = np.array([-1, -1, 1, 1])


@callee
def quadrant(grid: Corners, column: int, row: int, right: int) -> tuple[int, int]:
    """Return the signs of x and y of all directions in which a path passes a corner; ``right`` is 1, or 0 for left."""
    side = grid.side[row, column]
    bx, by = _BLOCKED_X[side], _BLOCKED_Y[side]
    return (-by, bx) if right else (by, -bx)


@callee
def passes(grid: Corners, column: int, row: int, right: int, dx: float, dy: float) -> bool:
    """Return whether a path in a direction may touch a corner's circle."""
    qx, qy = quadrant(grid, column, row, right)
    return dx * qx >= -AHEAD and dy * qy >= -AHEAD


@callee
def turns_at(grid: Corners, column: int, row: int, right: int) -> tuple[float, float]:
    """Return the last direction in which a path leaves a corner that it goes all the way round."""
    qx, qy = quadrant(grid, column, row, right)
    # To the left of an axis direction lies the quadrant's other axis, or not.
    turn = -1 if right else 1
    return (0.0, float(qy)) if qx * qy == turn else (float(qx), 0.0)


@callee
def ends_of_tangent(
    ax: float, ay: float, right_a: int, bx: float, by: float, right_b: int, radius: float
) -> tuple[bool, float, float, float]:
    """Return whether there is a tangent from circle a to circle b, its direction and its length.

    Args:
        ax: centre of the circle that is left.
        ay: likewise.
        right_a: 1 if the centre lies on the path's right, 0 on its left, -1 for a point instead of a circle.
        bx: centre of the circle that is reached.
        by: likewise.
        right_b: as ``right_a``.
        radius: of the circles.
    """
    ex, ey = bx - ax, by - ay
    # How far right of the tangent each centre lies: by the difference the tangent slants against the centres' line.
    off_a = 0.0 if right_a < 0 else radius if right_a else -radius
    off_b = 0.0 if right_b < 0 else radius if right_b else -radius
    off = off_b - off_a
    square = ex * ex + ey * ey - off * off
    if square <= 0.0:
        return False, 0.0, 0.0, 0.0
    length, norm = sqrt(square), ex * ex + ey * ey
    # e = length * d + off * (right of d), with right of d = (dy, -dx).
    return True, (length * ex - off * ey) / norm, (length * ey + off * ex) / norm, length


@callee
def touching(x: float, y: float, right: int, dx: float, dy: float, radius: float) -> tuple[float, float]:
    """Return where a path in a direction touches a circle (or the point itself)."""
    off = 0.0 if right < 0 else -radius if right else radius
    return x + off * dy, y - off * dx


@callee
def successors(
    grid: Corners,
    node: int,
    radius: float,
    needed: float,
    found: Int32Array,
    waiting: FloatArray,
    nodes: IntArray,
    ways: FloatArray,
    count: int,
) -> int:
    """Write where a path may go on from a node; return how many such ways are written in all, -1 without memory.

    Args:
        grid: cells and corners.
        node: (row * columns of vertices + column) * 2, and 1 more for turning right.
        radius: of the circles, cells.
        needed: distance that the disc's centre keeps from cells, less than the radius by rounding, cells.
        found: memory for corners, (n, 2).
        waiting: memory, (m, 3).
        nodes: (c,) written to from ``count`` on: where the ways lead to.
        ways: (c, 3) likewise: their direction and length.
        count: of ways that are there already.
    """
    width = grid.side.shape[1]
    right, vertex = node & 1, node >> 1
    row, column = vertex // width, vertex % width
    qx, qy = quadrant(grid, column, row, right)
    end_x, _ = turns_at(grid, column, row, right)
    x, y, strip = float(column), float(row), 2.0 * radius + 1e-6
    seen_here = seen(grid, x, y, qx, qy, inf, inf, found, 0, waiting)
    if seen_here < 0:
        return -1
    # Beyond the first direction, tangents that change sides lead to what lies in a strip beside it.
    if end_x == 0.0:
        seen_here = seen(grid, x, y, qx, -qy, inf, strip, found, seen_here, waiting)
    else:
        seen_here = seen(grid, x, y, -qx, qy, strip, inf, found, seen_here, waiting)
    if seen_here < 0:
        return -1
    for k in range(seen_here):
        bx, by = found[k, 0], found[k, 1]
        for right_b in range(2):
            there, dx, dy, length = ends_of_tangent(x, y, right, float(bx), float(by), right_b, radius)
            if not there or dx * qx < -AHEAD or dy * qy < -AHEAD or not passes(grid, bx, by, right_b, dx, dy):
                continue
            px, py = touching(x, y, right, dx, dy, radius)
            if not fits(grid, px, py, px + length * dx, py + length * dy, needed):
                continue
            if count == len(nodes):
                return -1
            nodes[count] = (by * width + bx) * 2 + right_b
            ways[count, 0], ways[count, 1], ways[count, 2] = dx, dy, length
            count += 1
    return count


@callee
def from_point(
    grid: Corners,
    x: float,
    y: float,
    forward: bool,
    radius: float,
    needed: float,
    found: Int32Array,
    waiting: FloatArray,
    nodes: IntArray,
    ways: FloatArray,
) -> int:
    """Write the ways from a point to nodes, or those from nodes to the point; return their number, -1 without memory.

    Arguments are those of :func:`successors`.
    """
    width = grid.side.shape[1]
    seen_here = 0
    for k in range(4):
        seen_here = seen(grid, x, y, 1 if k % 2 else -1, 1 if k > 1 else -1, inf, inf, found, seen_here, waiting)
        if seen_here < 0:
            return -1
    count = 0
    for k in range(seen_here):
        bx, by = found[k, 0], found[k, 1]
        for right in range(2):
            if forward:
                there, dx, dy, length = ends_of_tangent(x, y, -1, float(bx), float(by), right, radius)
                px, py = x, y
            else:
                there, dx, dy, length = ends_of_tangent(float(bx), float(by), right, x, y, -1, radius)
                px, py = touching(float(bx), float(by), right, dx, dy, radius)
            if not there or not passes(grid, bx, by, right, dx, dy):
                continue
            if not fits(grid, px, py, px + length * dx, py + length * dy, needed):
                continue
            if count == len(nodes):
                return -1
            nodes[count] = (by * width + bx) * 2 + right
            ways[count, 0], ways[count, 1], ways[count, 2] = dx, dy, length
            count += 1
    return count
