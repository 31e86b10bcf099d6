"""Where a disc's centre may lie: the free space less all that is nearer than the radius, as polygons."""

# Kernels are made of this file too: trailmark.jit counts it.
from __future__ import annotations

from collections.abc import Sequence
from time import perf_counter
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.planning.proofs.grown import QUARTER, grown, pieces_of, strips
from trailmark.shapes import Disc, Polygon, Shape
from trailmark.world import World

__all__ = ["MARGIN", "ellipse", "free_region", "local_origin", "near_shapes", "region_parts"]

FloatArray = NDArray[np.float64]

MARGIN = 2e-6
"""Metres by which the disc is made smaller: more than contact may overlap and polygons' coordinates be wrong by."""

AT_ORIGIN = (0.0, 0.0)


def local_origin(world: World) -> FloatArray:
    """Return the point, shape (2,), relative to which regions are made: coordinates far from 0 have fewer digits."""
    xmin, ymin, xmax, ymax = world.bounds
    return np.round(np.array([0.5 * (xmin + xmax), 0.5 * (ymin + ymax)]))


def free_region(
    world: World,
    radius: float,
    within: Any = None,
    *,
    origin: FloatArray | tuple[float, float] = AT_ORIGIN,
    inner: bool = False,
    by: float = np.inf,
) -> Any:
    """Return a region (shapely) that contains every position of a disc's centre at which the disc is free.

    Round corners are cut by chords, which lie inside the obstacles grown by the radius; so the region errs on the free
    side only, but for the rounding of shapely's overlays (:mod:`trailmark.planning.proofs.separation`). An inner region
    errs on the other side: the chords lie outside, and the disc is free all over it.

    Args:
        world: obstacles, bounds, boundary.
        radius: of the disc, metres; 0 for a point.
        within: a region, relative to ``origin``, outside of which obstacles do not matter and nothing is returned.
        origin: what the region's coordinates are relative to.
        inner: see above.
        by: reading of ``perf_counter`` by which it is to be done, as far as that can be told.

    Raises:
        TimeoutError: it would not be done by then.
    """
    begin = perf_counter()
    margin = -MARGIN if inner else MARGIN
    r = max(radius - margin, 0.0)
    xmin, ymin, xmax, ymax = np.asarray(world.bounds) - [*origin, *origin]
    if min(xmax - xmin, ymax - ymin) < 2.0 * r:
        return shapely.Polygon()
    region = shapely.box(xmin + r, ymin + r, xmax - r, ymax - r)
    # A regular polygon around a circle has its corners outside of it by this factor; discs' have twice as many.
    around, around_disc = (1.0 / np.cos(np.pi / (n * QUARTER)) if inner else 1.0 for n in (4, 8))
    r *= around
    taken: list[Any] = []
    if world.boundary is not None:
        inside = shapely.orient_polygons(_moved([world.boundary.shapely()], origin))
        region = shapely.intersection(region, inside[0])
        if r > 0.0:
            taken += strips(shapely.reverse(shapely.get_rings(inside)), r)
    if within is not None:
        region = shapely.intersection(region, within)
    shapes = world.obstacles if within is None else near_shapes(world, within, r + MARGIN, origin)
    polygons = _moved([s.polygon().shapely() for s in shapes if not isinstance(s, Disc)], origin)
    # GEOS rounds the number of a corner's chords: one may span half as much again as in a whole circle.
    quarter = QUARTER * 3 // 2 if inner else QUARTER
    if r > 0.0:
        near = None if within is None else lambda cut: _boxes_near(shapely.bounds(cut), within, r + MARGIN)
        taken += grown(pieces_of(polygons, near, by), r, quarter, by)
    else:
        taken += list(polygons)
    taken += _discs(shapes, r / around - margin, around_disc, origin)
    # What is left takes no longer than what was done so far.
    if 2.0 * perf_counter() - begin > by:
        raise TimeoutError
    return shapely.difference(region, shapely.union_all(taken)) if taken else region


def near_shapes(
    world: World, within: Any, distance: float, origin: FloatArray | tuple[float, float] = AT_ORIGIN
) -> list[Shape]:
    """Return the obstacles that may be so near (metres) to a region, relative to ``origin``: all that are, and more."""
    shapes = np.array([*world.obstacles, None], dtype=object)[:-1]
    boxes = np.empty((len(shapes), 4))
    polygons = np.array([isinstance(shape, Polygon) for shape in shapes], np.bool_)
    if polygons.any():
        rings = [shape.vertices for shape in shapes[polygons]]
        points, first = np.concatenate(rings), np.cumsum([0, *(len(ring) for ring in rings[:-1])])
        boxes[polygons, :2] = np.minimum.reduceat(points, first)
        boxes[polygons, 2:] = np.maximum.reduceat(points, first)
    rows = [
        (*shape.center, shape.radius if isinstance(shape, Disc) else 0.5 * np.hypot(shape.length, shape.width))
        for shape in shapes[~polygons]
    ]
    x, y, reach = np.array(rows).reshape(-1, 3).T
    boxes[~polygons] = np.column_stack([x - reach, y - reach, x + reach, y + reach])
    return list(shapes[_boxes_near(boxes - [*origin, *origin], within, distance)])


def _boxes_near(boxes: FloatArray, within: Any, distance: float) -> NDArray[np.bool_]:
    """Return which boxes xmin, ymin, xmax, ymax, shape (n, 4), are so near (metres) to a region, shape (n,)."""
    shapely.prepare(within)
    return np.asarray(shapely.dwithin(shapely.box(*boxes.T), within, distance))


def _moved(polygons: list[Any], origin: FloatArray | tuple[float, float]) -> NDArray[Any]:
    """Return polygons relative to an origin, shape (n,)."""
    array: NDArray[Any] = np.array(polygons, dtype=object)
    return array if not np.any(origin) else shapely.transform(array, lambda points: points - origin)


def _discs(shapes: Sequence[Shape], r: float, around: float, origin: FloatArray | tuple[float, float]) -> list[Any]:
    """Return the discs among shapes grown by r (metres) and then by a factor."""
    rows = np.array([(*s.center, s.radius) for s in shapes if isinstance(s, Disc)]).reshape(-1, 3)
    sizes = around * (rows[:, 2] + r)
    # A convex line is not simplified; its arcs are drawn inside.
    discs = shapely.buffer(shapely.points(rows[:, :2] - origin), sizes, quad_segs=2 * QUARTER)
    return [disc for disc, size in zip(discs, sizes, strict=True) if size > 0.0]


def region_parts(world: World, radius: float, within: Any = None, *, origin: FloatArray, by: float = np.inf) -> Any:
    """Return the polygons of :func:`free_region`, shape (n,), which no path joins; none if shapely fails."""
    try:
        parts = shapely.get_parts(free_region(world, radius, within, origin=origin, by=by))
    except shapely.errors.GEOSException:
        return np.empty(0, dtype=object)
    return parts[(shapely.get_type_id(parts) == shapely.GeometryType.POLYGON) & ~shapely.is_empty(parts)]


def ellipse(a: FloatArray, b: FloatArray, longest: float) -> Any:
    """Return a polygon around all points whose distances to a and b add up to no more than ``longest``."""
    apart = float(np.hypot(*(b - a)))
    major = 0.5 * max(longest, apart) + MARGIN
    minor = float(np.sqrt(max(major**2 - 0.25 * apart**2, MARGIN**2)))
    angle = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    # Around the ellipse, not in it.
    u, v = (size * f(angle) / np.cos(np.pi / 64) for size, f in ((major, np.cos), (minor, np.sin)))
    c, s = (b - a) / apart if apart > 0.0 else (1.0, 0.0)
    return shapely.Polygon(np.column_stack([c * u - s * v, s * u + c * v]) + 0.5 * (a + b))
