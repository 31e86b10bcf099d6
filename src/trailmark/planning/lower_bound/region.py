"""Where a disc's centre may lie: the free space less all that is nearer than the radius, as polygons."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.shapes import Disc, Shape
from trailmark.world import World

__all__ = ["MARGIN", "ellipse", "free_region"]

MARGIN = 2e-6
"""Metres by which the disc is made smaller: more than contact may overlap and polygons' coordinates be wrong by."""

QUARTER = 8
"""Chords for each quarter of a circle: their middles lie 0.5 % of the radius inside of it."""


def free_region(world: World, radius: float, within: Any = None) -> Any:
    """Return a region (shapely) that contains every position of a disc's centre at which the disc is free.

    Round corners are cut by chords, which lie inside the obstacles grown by the radius; so the region errs on the free
    side only.

    Args:
        world: obstacles, bounds, boundary.
        radius: of the disc, metres; 0 for a point.
        within: a region outside of which obstacles do not matter and nothing is returned.
    """
    r = max(radius - MARGIN, 0.0)
    xmin, ymin, xmax, ymax = world.bounds
    region = shapely.box(xmin + r, ymin + r, xmax - r, ymax - r)
    if world.boundary is not None:
        inside = world.boundary.shapely()
        region = shapely.intersection(region, shapely.buffer(inside, -r, quad_segs=QUARTER) if r > 0.0 else inside)
    if within is not None:
        region = shapely.intersection(region, within)
    shapes = world.obstacles
    if within is not None:
        boxes = shapely.box(*np.array([s.bounding_box() for s in shapes]).reshape(-1, 4).T)
        near = shapely.dwithin(boxes, within, r + MARGIN)
        shapes = tuple(s for s, close in zip(shapes, near, strict=True) if close)
    grown = [*_polygons(shapes, r), *_discs(shapes, r)]
    return shapely.difference(region, shapely.union_all(grown)) if grown else region


def _polygons(shapes: Sequence[Shape], r: float) -> list[Any]:
    regions = np.array([s.polygon().shapely() for s in shapes if not isinstance(s, Disc)], dtype=object)
    if len(regions) == 0:
        return []
    return list(shapely.buffer(regions, r, quad_segs=QUARTER)) if r > 0.0 else list(regions)


def _discs(shapes: Sequence[Shape], r: float) -> list[Any]:
    rows = [(*s.center, s.radius - MARGIN + r) for s in shapes if isinstance(s, Disc)]
    return [shapely.Point(x, y).buffer(size, quad_segs=2 * QUARTER) for x, y, size in rows if size > 0.0]


def ellipse(a: NDArray[np.float64], b: NDArray[np.float64], longest: float) -> Any:
    """Return a polygon around all points whose distances to a and b add up to no more than ``longest``."""
    apart = float(np.hypot(*(b - a)))
    major = 0.5 * max(longest, apart) + MARGIN
    minor = float(np.sqrt(max(major**2 - 0.25 * apart**2, MARGIN**2)))
    angle = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    # Around the ellipse, not in it.
    u, v = (size * f(angle) / np.cos(np.pi / 64) for size, f in ((major, np.cos), (minor, np.sin)))
    c, s = (b - a) / apart if apart > 0.0 else (1.0, 0.0)
    return shapely.Polygon(np.column_stack([c * u - s * v, s * u + c * v]) + 0.5 * (a + b))
