"""Polygons grown by a disc, never by too much.

GEOS's ``buffer`` leaves out vertices that make an outline concave by less than 1 % of the distance, which fills these
places before anything is grown. Where an outline has such vertices, it is grown edge by edge instead: each edge's strip
and the sector round its end lie in the sum of that edge and the disc, and so do all unions of them.

The time that ``buffer`` takes grows faster than the corners of an outline: what has many is cut into pieces first,
whose sums with the disc are together that of the whole.

It also fills a hole of at most seven corners in which hardly a place (some hundredths of the distance) is farther from
the outline. No bound is wrong by that: where neither end lies in the region, none is claimed (``LowerBound``).
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

__all__ = ["QUARTER", "grown", "pieces_of", "strips"]

QUARTER = 8
"""Chords for each quarter of a circle: their middles lie 0.5 % of the radius inside of it."""

SHALLOW = 0.011
"""Share of the distance from which on a concavity is left as it is: GEOS's own 0.01 and what rounding may add."""

CORNERS = 64
"""Of a piece at most, where a polygon can be cut at all."""

TOGETHER = 16
"""Pieces grown between two looks at the clock."""


def pieces_of(
    polygons: NDArray[Any], near: Callable[[NDArray[Any]], NDArray[np.bool_]] | None = None, by: float = np.inf
) -> NDArray[Any]:
    """Return polygons with those of many corners cut into pieces, shape (m,): but for rounding they hold the same.

    Args:
        polygons: with holes or without (shapely), shape (n,).
        near: which of some polygons, shape (k,), matter; the others are left out. None for all.
        by: reading of ``perf_counter`` at which to stop.

    Raises:
        TimeoutError: it is not done by then.
    """
    done: list[Any] = []
    while len(polygons):
        large = shapely.get_num_coordinates(polygons) > CORNERS
        done += list(polygons[~large])
        halves: list[Any] = []
        for polygon in polygons[large]:
            _look_at(by)
            low, high = np.array(polygon.bounds).reshape(2, 2)
            axis = int(np.argmax(high - low))
            middle = float(np.median(shapely.get_coordinates(polygon)[:, axis]))
            if not low[axis] < middle < high[axis]:
                done.append(polygon)
                continue
            first, last = high.copy(), low.copy()
            first[axis] = last[axis] = middle
            boxes = shapely.box(*np.array([[*low, *first], [*last, *high]]).T)
            halves += list(shapely.get_parts(shapely.intersection(polygon, boxes)))
        polygons = np.array([*halves, None], dtype=object)[:-1]
        polygons = polygons[shapely.get_type_id(polygons) == shapely.GeometryType.POLYGON]
        if near is not None:
            polygons = polygons[near(polygons)]
    return np.array([*done, None], dtype=object)[:-1]


def grown(polygons: NDArray[Any], r: float, quarter: int = QUARTER, by: float = np.inf) -> list[Any]:
    """Return regions that together lie within ``r`` of the polygons, and hold all but what chords cut off.

    Args:
        polygons: with holes or without (shapely), shape (n,).
        r: metres, above 0.
        quarter: chords for each quarter of a circle, at least QUARTER.
        by: reading of ``perf_counter`` at which to stop.

    Raises:
        TimeoutError: it is not done by then.
    """
    if len(polygons) == 0:
        return []
    shallow = _shallow(polygons, r)
    even, regions = polygons[~shallow], []
    for first in range(0, len(even), TOGETHER):
        _look_at(by)
        regions += list(shapely.buffer(even[first : first + TOGETHER], r, quad_segs=quarter))
    if shallow.any():
        uneven = shapely.orient_polygons(polygons[shallow])
        regions += [*uneven, *strips(shapely.get_rings(uneven), r)]
    return regions


def strips(rings: NDArray[Any], r: float) -> list[Any]:
    """Return what lies within ``r`` to the right of rings, and round their convex corners, as polygons.

    Args:
        rings: closed, what is to grow on their left (shapely), shape (n,).
        r: metres, above 0.
    """
    points, ring = shapely.get_coordinates(rings, return_index=True)
    inside = ring[1:] == ring[:-1]
    a, b, owner = points[:-1][inside], points[1:][inside], ring[:-1][inside]
    along = b - a
    length = np.hypot(*along.T)
    keep = length > 0.0
    a, b, along, owner = a[keep], b[keep], along[keep] / length[keep, None], owner[keep]
    following = np.arange(1, len(a) + 1)
    ends = np.flatnonzero(np.diff(owner, append=-1))
    following[ends] = np.concatenate([[0], ends[:-1] + 1])
    ahead = along[following]
    turn = np.arctan2(along[:, 0] * ahead[:, 1] - along[:, 1] * ahead[:, 0], (along * ahead).sum(axis=1))
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    chords = np.where(turn > 0.0, np.ceil(turn / (0.5 * np.pi / QUARTER) - 1e-9), 0).astype(np.int64)
    pieces: list[Any] = []
    for n in np.unique(chords):
        of = chords == n
        # From the next edge's normal back to this one's, about the edge's end.
        angle = np.linspace(1.0, 0.0, n + 1)[None] * np.maximum(turn[of], 0.0)[:, None]
        c, s = np.cos(angle), np.sin(angle)
        x, y = normal[of][:, :1], normal[of][:, 1:]
        arc = b[of][:, None] + r * np.stack([c * x - s * y, s * x + c * y], axis=-1)
        last = (a[of] + r * normal[of])[:, None]
        pieces += list(shapely.polygons(np.concatenate([a[of][:, None], b[of][:, None], arc, last], axis=1)))
    return pieces


def _look_at(by: float) -> None:
    if perf_counter() > by:
        raise TimeoutError


def _shallow(polygons: NDArray[Any], r: float) -> NDArray[np.bool_]:
    """Return which polygons have a concave vertex so near to its neighbours' line that GEOS leaves it out."""
    rings, owner = shapely.get_rings(shapely.orient_polygons(polygons), return_index=True)
    points, ring = shapely.get_coordinates(rings, return_index=True)
    first = np.flatnonzero(np.diff(ring, prepend=-1))
    last = np.concatenate([first[1:], [len(points)]]) - 1
    # A ring ends where it begins: its last point is left out.
    before = np.arange(-1, len(points) - 1)
    before[first] = last - 1
    here = np.ones(len(points), np.bool_)
    here[last] = False
    p0, p1, p2 = points[before[here]], points[here], points[np.flatnonzero(here) + 1]
    u, v = p1 - p0, p2 - p0
    square = (v * v).sum(axis=1)
    share = np.clip((u * v).sum(axis=1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    off = np.hypot(*(u - share[:, None] * v).T)
    size = np.abs(points).max(initial=1.0)
    concave = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < 0.0
    # What rounding alone makes concave is of no account.
    uneven = concave & (off < SHALLOW * r) & (off > 1e-14 * size)
    found = np.zeros(len(polygons), np.bool_)
    found[owner[ring[here][uneven]]] = True
    return found
