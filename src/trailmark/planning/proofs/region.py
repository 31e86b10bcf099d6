"""Where a disc's centre may lie: the free space less all that is nearer than the radius, as polygons.

It errs on the free side only: round corners are cut by chords, which lie inside of what is grown, and no polygon is
grown by too much. GEOS's ``buffer`` leaves out vertices that make an outline concave by less than 1 % of the distance,
which fills these places before anything is grown; where an outline has such vertices, it is grown edge by edge instead:
each edge's strip and the sector round its end lie in the sum of that edge and the disc, and so do all unions of them.

``buffer`` also fills a hole of at most seven corners in which hardly a place (some hundredths of the distance) is
farther from the outline. No bound is wrong by that: where neither end lies in the region, none is claimed.
"""

# Kernels are made of this file too: trailmark.jit counts it.
from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Shape
from trailmark.world import World

__all__ = ["MARGIN", "QUARTER", "Stop", "ellipse", "free_region", "grown", "local_origin", "look", "region_parts"]

MARGIN = 2e-6
"""Metres by which the disc is made smaller: more than contact may overlap and polygons' coordinates be wrong by."""

QUARTER = 8
"""Chords for each quarter of a circle: their middles lie 0.5 % of the radius inside of it."""

SHALLOW = 0.011
"""Share of the distance from which on a concavity is left as it is: GEOS's own 0.01 and what rounding may add."""

TOGETHER = 16
"""Polygons grown between two looks at whether to stop."""

Stop = Callable[[], bool]
"""Whether to stop, asked now and then."""


def look(stop: Stop | None) -> None:
    """Raise a TimeoutError if it is time to stop."""
    if stop is not None and stop():
        raise TimeoutError


def local_origin(world: World) -> FloatArray:
    """Return the point, shape (2,), relative to which regions are made: coordinates far from 0 have fewer digits."""
    xmin, ymin, xmax, ymax = world.bounds
    return np.round(np.array([0.5 * (xmin + xmax), 0.5 * (ymin + ymax)]))


def free_region(
    world: World,
    radius: float,
    within: Any = None,
    *,
    origin: FloatArray | tuple[float, float] = (0.0, 0.0),
    inner: bool = False,
    stop: Stop | None = None,
) -> Any:
    """Return a region (shapely) that contains every position of a disc's centre at which the disc is free.

    That is so but for the rounding of shapely's overlays (:mod:`trailmark.planning.proofs.claims`). An inner region
    errs on the other side: the chords lie outside, and the disc is free all over it.

    Args:
        world: obstacles, bounds, boundary.
        radius: of the disc, metres; 0 for a point.
        within: a region, relative to ``origin``, outside of which obstacles do not matter and nothing is returned.
        origin: what the region's coordinates are relative to.
        inner: see above.
        stop: asked between the steps, of which each may take long in a world of many corners.

    Raises:
        TimeoutError: it was stopped.
    """
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
            taken += _strips(shapely.reverse(shapely.get_rings(inside)), r)
    shapes: Sequence[Shape] = world.obstacles
    if within is not None:
        region = shapely.intersection(region, within)
        shapely.prepare(within)
        boxes = np.array([shape.bounding_box() for shape in shapes]).reshape(-1, 4) - [*origin, *origin]
        near = np.asarray(shapely.dwithin(shapely.box(*boxes.T), within, r + MARGIN))
        shapes = [shapes[i] for i in np.flatnonzero(near).tolist()]
    polygons = _moved([s.polygon().shapely() for s in shapes if not isinstance(s, Disc)], origin)
    # GEOS rounds the number of a corner's chords: one may span half as much again as in a whole circle.
    quarter = QUARTER * 3 // 2 if inner else QUARTER
    taken += grown(polygons, r, quarter, stop) if r > 0.0 else list(polygons)
    discs = np.array([(*s.center, s.radius) for s in shapes if isinstance(s, Disc)]).reshape(-1, 3)
    sizes = around_disc * (discs[:, 2] + r / around - margin)
    # A convex line is not simplified; its arcs are drawn inside.
    circles = shapely.buffer(shapely.points(discs[:, :2] - origin), sizes, quad_segs=2 * QUARTER)
    taken += list(circles[sizes > 0.0])
    if not taken:
        return region
    look(stop)
    union = shapely.union_all(taken)
    look(stop)
    return shapely.difference(region, union)


def region_parts(
    world: World, radius: float, within: Any = None, *, origin: FloatArray, stop: Stop | None = None
) -> Any:
    """Return the polygons of :func:`free_region`, shape (n,), which no path joins; none if shapely fails."""
    try:
        parts = shapely.get_parts(free_region(world, radius, within, origin=origin, stop=stop))
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


def grown(polygons: NDArray[Any], r: float, quarter: int = QUARTER, stop: Stop | None = None) -> list[Any]:
    """Return regions that together lie within ``r`` of polygons, and hold all but what chords cut off.

    Args:
        polygons: with holes or without (shapely), shape (n,).
        r: metres, above 0.
        quarter: chords for each quarter of a circle, at least QUARTER.
        stop: asked now and then whether to stop.

    Raises:
        TimeoutError: it was stopped.
    """
    if len(polygons) == 0:
        return []
    shallow = _shallow(polygons, r)
    even, regions = polygons[~shallow], []
    for first in range(0, len(even), TOGETHER):
        look(stop)
        regions += list(shapely.buffer(even[first : first + TOGETHER], r, quad_segs=quarter))
    if shallow.any():
        uneven = shapely.orient_polygons(polygons[shallow])
        regions += [*uneven, *_strips(shapely.get_rings(uneven), r)]
    return regions


def _moved(polygons: list[Any], origin: FloatArray | tuple[float, float]) -> NDArray[Any]:
    """Return polygons relative to an origin, shape (n,)."""
    array: NDArray[Any] = np.array(polygons, dtype=object)
    return array if not np.any(origin) else shapely.transform(array, lambda points: points - origin)


def _strips(rings: NDArray[Any], r: float) -> list[Any]:
    """Return what lies within ``r`` to the right of closed rings, and round their convex corners, as polygons."""
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
