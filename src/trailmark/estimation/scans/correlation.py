"""Correlative scan matching: the best pose of a lattice of them, wherever the first guess lay, and its covariance.

The search (Olson 2009, "Real-time correlative scan matching") is by branch and bound over the map's resolutions (Hess
et al. 2016, "Real-time loop closure in 2D LIDAR SLAM"). The covariance is that of the correlation surface around a
match, so that the direction of a corridor, along which nothing holds the scan, is known as such.
"""

from __future__ import annotations

from math import atan2, ceil, cos, exp, floor, radians, sin
from typing import NamedTuple

import numpy as np

from trailmark.estimation.scans.local_map import SIGMA, LocalMap
from trailmark.estimation.scans.matching import NO_PRIOR, Match
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = ["ELSEWHERE", "Window", "match_covariance", "search"]

FREE = 1.0
"""Metres: the standard deviation along a direction in which the map does not hold the scan."""


class Window(NamedTuple):
    """How far from the first guess a match is searched for, to either side."""

    xy: float
    """Metres along x and along y."""
    theta: float
    """Radians."""


ELSEWHERE = Window(0.5, radians(15.0))
"""How far a pose lies from another, at least, that is another place: metres, or radians."""


def search(
    area: LocalMap,
    points: FloatArray,
    guess: FloatArray,
    window: Window,
    *,
    information: FloatArray = NO_PRIOR,
    coarseness: int = 1,
    min_score: float = 0.0,
    apart_from: FloatArray | None = None,
) -> Match | None:
    """Return the pose of the window under which the points are likeliest, to a cell and the angle that is worth one.

    Args:
        area: the map.
        points: shape (n, 2), in the frame at the pose that is searched for.
        guess: the window's centre, shape (3,).
        window: how large it is.
        information: inverse covariance of the guess, shape (3, 3), of which the diagonal counts. A point that the map
            explains counts as much as a factor e of likelihood.
        coarseness: the angles tried move far points by so many cells.
        min_score: a match must have more.
        apart_from: leave out the poses that are nearer to this one than ELSEWHERE.

    Returns:
        The match, or None where none has more than ``min_score``.
    """
    if len(points) == 0:
        return None
    step = coarseness * angle_step(points, area.cell)
    turns = ceil(window.theta / step)
    cells = ceil(window.xy / area.cell)
    level = max(0, min(len(area.likelihood) - 1, int(np.log2(max(1, cells)))))
    other = np.array([np.inf, np.inf, 0.0]) if apart_from is None else np.asarray(apart_from, dtype=np.float64)
    found, score, penalty = _search(
        area.likelihood, area.x0, area.y0, area.cell, np.ascontiguousarray(points), np.asarray(guess, dtype=np.float64),
        cells, turns, step, level, np.diag(information).copy(), float(min_score), other,
    )  # fmt: skip
    return Match(found, score + penalty) if score > min_score else None


def angle_step(points: FloatArray, cell: float) -> float:
    """Return the angle (radians) that moves the far points of a cloud by a cell."""
    far = float(np.quantile(np.hypot(points[:, 0], points[:, 1]), 0.9))
    return cell / min(max(far, 1.0), 20.0)


def match_covariance(
    area: LocalMap, points: FloatArray, pose: FloatArray, half: float = 0.5, scatter: float = SIGMA
) -> tuple[FloatArray, bool]:
    """Return the covariance of a match by the correlation surface, and whether a direction is left open.

    The surface counts as the likelihood's logarithm, a point in the map's middle as 1 (Olson 2009, section III-D).

    Args:
        area: the map.
        points: shape (n, 2).
        pose: the match, shape (3,).
        half: metres to either side that the surface is looked at.
        scatter: metres by which end points lie off the map's surfaces, one standard deviation: the map takes SIGMA.

    Returns:
        Shape (3, 3), of x, y (in the map's axes), theta; and whether the map leaves the place along some direction
        open, which then has the standard deviation FREE.
    """
    step, cells = angle_step(points, area.cell), ceil(half / area.cell)
    covariance = _surface(
        area.likelihood[0], area.x0, area.y0, area.cell, points, np.asarray(pose, dtype=np.float64), cells, 5, step
    )
    covariance += np.diag([area.cell**2, area.cell**2, step**2]) / 12.0
    values, vectors = np.linalg.eigh(covariance[:2, :2])
    covariance *= (scatter / SIGMA) ** 2
    # Wider than half of a surface that is level from one end to the other.
    if values[1] <= half**2 / 6.0:
        return covariance, False
    open_way = np.append(vectors[:, 1], 0.0)
    return covariance + FREE**2 * np.outer(open_way, open_way), True


@callee
def _sum(level, xs, ys, dx, dy):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the sum of one resolution's likelihood over cells, moved by (dx, dy) cells."""
    rows, columns = level.shape
    total = 0
    for i in range(len(xs)):
        r, c = ys[i] + dy, xs[i] + dx
        if 0 <= r < rows and 0 <= c < columns:
            total += level[r, c]
    return total


@callee
def _cells(points, x, y, theta, x0, y0, cell, xs, ys):  # type: ignore[no-untyped-def]  # numba infers the types
    """Write the column and the row of each point under a pose."""
    c, s = cos(theta), sin(theta)
    for i in range(len(points)):
        xs[i] = floor((x + c * points[i, 0] - s * points[i, 1] - x0) / cell)
        ys[i] = floor((y + s * points[i, 0] + c * points[i, 1] - y0) / cell)


@callee
def _nearest_square(low, high):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the smallest square of the whole numbers from ``low`` to ``high``."""
    return 0.0 if low <= 0 <= high else float(min(low * low, high * high))


@njit
def _search(levels, x0, y0, cell, points, guess, cells, turns, step, top, weights, min_score, other):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the best pose of the lattice, its score less the guess's penalty, and that penalty, by branch and bound.

    A node is a square of 2^level x 2^level places at one heading. Its bound: the sum of that level's likelihood.
    """
    n, rotations = len(points), 2 * turns + 1
    xs, ys = np.empty((rotations, n), dtype=np.int32), np.empty((rotations, n), dtype=np.int32)
    for k in range(rotations):
        _cells(points, guess[0], guess[1], guess[2] + (k - turns) * step, x0, y0, cell, xs[k], ys[k])
    side = 2**top
    tiles = (2 * cells + side) // side
    count = rotations * tiles * tiles
    bounds = np.empty(count)
    per = 1.0 / (255.0 * n)
    wx, wy, wt = 0.5 * weights[0] * cell**2 / n, 0.5 * weights[1] * cell**2 / n, 0.5 * weights[2] * step**2 / n
    for k in range(rotations):
        for i in range(tiles):
            for j in range(tiles):
                dx, dy = i * side - cells, j * side - cells
                penalty = wt * (k - turns) ** 2
                penalty += wx * _nearest_square(dx, dx + side - 1) + wy * _nearest_square(dy, dy + side - 1)
                bounds[(k * tiles + i) * tiles + j] = per * _sum(levels[top], xs[k], ys[k], dx, dy) - penalty
    best, lost, place = min_score, 0.0, guess.copy()
    stack, values = np.empty((4 * top + 4, 3), dtype=np.int64), np.empty(4 * top + 4)
    for at in np.argsort(-bounds):
        if bounds[at] <= best:
            break
        k = at // (tiles * tiles)
        stack[0] = (at // tiles) % tiles * side - cells, at % tiles * side - cells, top
        values[0] = bounds[at]
        height = 1
        while height > 0:
            height -= 1
            if values[height] <= best:
                continue
            dx, dy, level = stack[height]
            if level == 0:
                x, y, theta = guess[0] + dx * cell, guess[1] + dy * cell, guess[2] + (k - turns) * step
                turned = abs(atan2(sin(theta - other[2]), cos(theta - other[2])))
                if turned < ELSEWHERE.theta and (x - other[0]) ** 2 + (y - other[1]) ** 2 < ELSEWHERE.xy**2:
                    continue
                best = values[height]
                lost = wt * (k - turns) ** 2 + wx * dx**2 + wy * dy**2
                place[0], place[1], place[2] = x, y, theta
                continue
            half = 2 ** (level - 1)
            first = height
            for ex in (0, half):
                for ey in (0, half):
                    cx, cy = dx + ex, dy + ey
                    if cx > cells or cy > cells:
                        continue
                    value = per * _sum(levels[level - 1], xs[k], ys[k], cx, cy) - wt * (k - turns) ** 2
                    value -= wx * _nearest_square(cx, cx + half - 1) + wy * _nearest_square(cy, cy + half - 1)
                    if value <= best:
                        continue
                    # The best child on top of the stack.
                    spot = height
                    while spot > first and values[spot - 1] > value:
                        values[spot], stack[spot] = values[spot - 1], stack[spot - 1]
                        spot -= 1
                    values[spot] = value
                    stack[spot] = cx, cy, level - 1
                    height += 1
    return place, best, lost


@njit
def _surface(likelihood, x0, y0, cell, points, pose, cells, turns, step):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the covariance of x, y, theta by the correlation surface, shape (3, 3)."""
    n, width = len(points), 2 * cells + 1
    rows, columns = likelihood.shape
    xs, ys = np.empty(n, dtype=np.int32), np.empty(n, dtype=np.int32)
    sums = np.empty((2 * turns + 1, width, width))
    whole = np.empty((width, width), dtype=np.int32)
    for k in range(2 * turns + 1):
        _cells(points, pose[0], pose[1], pose[2] + (k - turns) * step, x0, y0, cell, xs, ys)
        whole[:] = 0
        # Point by point: what lies around one is added row by row, many cells at a time. Unsigned indices, since numba
        # would ask of each signed one whether it counts from the end.
        for p in range(n):
            row, column = ys[p] - cells, xs[p] - cells
            first, last = max(0, -column), min(width, columns - column)
            for i in range(max(0, -row), min(width, rows - row)):
                for j in range(first, last):
                    whole[np.uint32(i), np.uint32(j)] += likelihood[np.uint32(row + i), np.uint32(column + j)]
        sums[k] = whole.T / 255.0  # by x, then by y
    top = sums.max()
    moments, total = np.zeros((3, 3)), 0.0
    d = np.empty(3)
    for k in range(2 * turns + 1):
        for i in range(width):
            for j in range(width):
                weight = exp(sums[k, i, j] - top)
                if weight < 1e-9:
                    continue
                d[0], d[1], d[2] = (i - cells) * cell, (j - cells) * cell, (k - turns) * step
                total += weight
                for a in range(3):
                    for b in range(3):
                        moments[a, b] += weight * d[a] * d[b]
    return moments / total
