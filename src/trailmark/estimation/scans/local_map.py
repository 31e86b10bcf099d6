"""A map of the surroundings, made of a few scans, that another scan is matched against.

It holds how likely an end point is at each cell, at several resolutions (Olson 2009, "Real-time correlative scan
matching"; the maxima over squares of cells are those of Hess et al. 2016, "Real-time loop closure in 2D LIDAR SLAM"),
and for each cell the nearest of the surface points that the map is made of.
"""

from __future__ import annotations

from math import ceil, exp, floor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.scans.clouds import GRAZED, PointCloud
from trailmark.jit import njit
from trailmark.se2 import FloatArray

__all__ = ["LEVELS", "LocalMap", "in_view", "levels_for", "local_map"]

CELL = 0.05
"""Side of a cell, metres: what the points of a surface scatter by."""

SIGMA = 0.1
"""Metres by which an end point may lie off the surface that it belongs to: the scanner's noise, the cells and the
errors of the scans that the map is made of."""

REACH = 0.4
"""Metres from a surface point to the cells that know it: beyond, a point's likelihood is under 0.04 % of the best."""

ALONG = 0.97
"""Cosine of the angle between the directions of neighbouring end points, at least, that lie on one surface."""

ASIDE = 0.02, 0.1
"""Metres, and in metres for each metre that they lie apart: how far each may lie off the other's line."""

LEVELS = 6
"""Resolutions of the likelihood: a cell of level k has the largest of 2^k x 2^k cells."""


BEHIND = 0.5
"""Metres behind a surface up to which points count as in view: poses err, and what stands at walls is cluttered."""

NEIGHBOURS = 0.06
"""Radians between end points up to which a scan has seen what lies between them."""


class LocalMap(NamedTuple):
    """Surface points, and grids around them; row 0 has the smallest y."""

    x0: float
    """Outer corner of cell (0, 0), metres."""
    y0: float
    cell: float
    """Metres."""
    points: FloatArray
    """Shape (m, 2): the mean of the end points of each cell."""
    normals: FloatArray
    """Shape (m, 2): their mean direction, zero where there is none."""
    nearest: NDArray[np.int32]
    """Shape (rows, columns): the nearest point; -1 where none is within REACH."""
    likelihood: NDArray[np.uint8]
    """Shape (levels, rows, columns): of level 0, 255·exp(−d²/2σ²) at the distance d of the nearest point; of level k,
    the largest of level 0 over the rows r to r + 2^k − 1 and as many columns."""


def local_map(
    cloud: PointCloud,
    bounds: tuple[float, float, float, float] | None = None,
    levels: int = LEVELS,
    gap: float = np.inf,
) -> LocalMap:
    """Return the local map of a cloud.

    Where beams lie so far apart that the points of a surface would count each for itself, the next scan's, met in
    between, would seem to lie elsewhere: the line between neighbours on one surface is filled in.

    Args:
        cloud: points of one scan, or of several.
        bounds: xmin, ymin, xmax, ymax to which it is cut.
        levels: resolutions.
        gap: metres from which on the line between neighbours is filled in.
    """
    points, normals = _surfaces(cloud, gap)
    if bounds is not None:
        low, high = np.array(bounds[:2]), np.array(bounds[2:])
        inside = ((points >= low) & (points <= high)).all(axis=1)
        points, normals = points[inside], normals[inside]
    if len(points) == 0:
        points, normals = np.zeros((1, 2)) if bounds is None else 0.5 * (low + high)[None] + 1e6, np.zeros((1, 2))
    x0, y0 = points.min(axis=0) - (REACH + CELL * 2**levels)
    columns, rows = (int(v) for v in np.ceil((points.max(axis=0) + REACH - [x0, y0]) / CELL) + 1)
    place = ((points - [x0, y0]) / CELL).astype(np.int64)
    _, at, counts = np.unique(place[:, 1] * columns + place[:, 0], return_inverse=True, return_counts=True)
    sums = [np.bincount(at, values, len(counts)) / counts for values in (*points.T, *normals.T)]
    means, across = np.column_stack(sums[:2]), np.column_stack(sums[2:])
    length = np.hypot(*across.T)
    # Points of two sides of something thin, or of a corner, have no direction in common.
    across = np.where((length > 0.7)[:, None], across / np.maximum(length, 1e-9)[:, None], 0.0)
    nearest, likelihood = _grids(means, float(x0), float(y0), rows, columns, levels)
    for k in range(1, levels):
        half, below, level = 2 ** (k - 1), likelihood[k - 1], likelihood[k]
        level[:] = below
        np.maximum(level[:-half], below[half:], out=level[:-half])
        np.maximum(level[:, :-half], level[:, half:].copy(), out=level[:, :-half])
    return LocalMap(float(x0), float(y0), CELL, means, across, nearest, likelihood)


def _surfaces(cloud: PointCloud, gap: float) -> tuple[FloatArray, FloatArray]:
    """Return the points of a map and their normals, shape (n, 2) each; see :func:`local_map`."""
    points, normals, spacing = cloud
    step = np.diff(points, axis=0)
    apart = np.hypot(*step.T)
    offsets = np.abs([(step * normals[:-1]).sum(axis=1), (step * normals[1:]).sum(axis=1)]).max(axis=0, initial=0.0)
    filled = (apart > gap) & (apart <= GRAZED * np.maximum(spacing[:-1], spacing[1:]))
    filled &= ((normals[:-1] * normals[1:]).sum(axis=1) >= ALONG) & (offsets <= ASIDE[0] + ASIDE[1] * apart)
    first = np.flatnonzero(filled)
    counts = np.ceil(apart[first] / CELL).astype(np.intp) - 1
    own = np.repeat(first, counts)
    number = np.arange(1, len(own) + 1) - np.repeat(np.cumsum(counts) - counts, counts)
    between = points[own] + (number / (np.repeat(counts, counts) + 1))[:, None] * step[own]
    return np.concatenate([points, between]), np.concatenate([normals, normals[own]])


def levels_for(window: float) -> int:
    """Return how many resolutions a search over ``window`` metres to either side makes use of."""
    return max(1, min(LEVELS, 1 + int(np.log2(max(1.0, np.ceil(window / CELL))))))


@njit
def _grids(points, x0, y0, rows, columns, levels):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return each cell's nearest point, and the likelihood with its first level filled in."""
    nearest = np.full((rows, columns), -1, dtype=np.int32)
    squares = np.full((rows, columns), np.inf, dtype=np.float32)
    likelihood = np.zeros((levels, rows, columns), dtype=np.uint8)
    k = ceil(REACH / CELL)
    limit = np.float32((REACH / CELL) ** 2)
    for i in range(len(points)):
        px, py = (points[i, 0] - x0) / CELL, (points[i, 1] - y0) / CELL
        column, row = floor(px), floor(py)
        for r in range(max(0, row - k), min(rows, row + k + 1)):
            across = np.float32((r + 0.5 - py) ** 2)
            for c in range(max(0, column - k), min(columns, column + k + 1)):
                square = across + np.float32((c + 0.5 - px) ** 2)
                if square <= limit and square < squares[r, c]:
                    squares[r, c] = square
                    nearest[r, c] = i
    factor = -0.5 * (CELL / SIGMA) ** 2
    for r in range(rows):
        for c in range(columns):
            if nearest[r, c] >= 0:
                likelihood[0, r, c] = np.uint8(255.0 * exp(factor * squares[r, c]) + 0.5)
    return nearest, likelihood


def in_view(cloud: PointCloud, points: FloatArray) -> NDArray[np.bool_]:
    """Return which points lie where a scan's beams passed, or at the surfaces that they met, shape (n,).

    Args:
        cloud: the scan's end points, in the frame of its robot.
        points: shape (n, 2), in that frame.
    """
    if len(cloud.points) < 2:
        return np.zeros(len(points), dtype=bool)
    bearings, ranges = np.arctan2(cloud.points[:, 1], cloud.points[:, 0]), np.hypot(*cloud.points.T)
    order = np.argsort(bearings)
    bearings, ranges = bearings[order], ranges[order]
    bearing, distance = np.arctan2(points[:, 1], points[:, 0]), np.hypot(*points.T)
    after = np.searchsorted(bearings, bearing).clip(1, len(bearings) - 1)
    right, left = bearings[after - 1], bearings[after]
    between = (right <= bearing) & (bearing <= left) & (left - right <= NEIGHBOURS)
    return np.asarray(between & (distance <= np.maximum(ranges[after - 1], ranges[after]) + BEHIND))
