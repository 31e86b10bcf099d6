"""What counts as touching, which is allowed: the part of a footprint that may meet no obstacle."""

# Kernels are made of this file too: trailmark.jit counts it.
from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

__all__ = ["THINNER", "TOUCHING_TOLERANCE", "eroded", "overlap_core", "touching_depth"]

FloatArray = NDArray[np.float64]

TOUCHING_TOLERANCE = 1e-7
"""Overlap (metres) up to which two regions count as touching, which is allowed."""

THINNER = 0.9
"""Times what corners allow, an erosion is deep: the error of buffers is a few per cent of their distance."""

FINER = 6
"""How many times an erosion is made ten times thinner for sharp tips: to about 1e-14 m, the size of rounding."""


def eroded(region: shapely.Polygon, depth: float) -> shapely.Geometry:
    """Return the region shrunk by ``depth`` metres.

    Convex corners stay sharp. Reflex ones are rounded by an inscribed polyline, so that nothing deeper than ``depth``
    is lost there: a mitre would extend far inside the region from the end of a narrow notch.
    """
    return shapely.buffer(region, -depth, join_style="round", quad_segs=2)


def overlap_core(outline: FloatArray) -> list[shapely.Polygon]:
    """Return the parts of a footprint that may meet no obstacle: all of it but a rim, since touching is allowed.

    No point of the footprint is farther from them than TOUCHING_TOLERANCE. An erosion alone shortens sharp tips by much
    more (by d / sin(a) at a corner of angle 2a): thinner and thinner erosions add what it loses there.

    Args:
        outline: vertices, shape (v, 2), counter-clockwise, metres.
    """
    region = shapely.Polygon(outline)
    depth = THINNER * touching_depth(outline)
    parts = shapely.get_parts(eroded(region, depth)).tolist()
    for _ in range(FINER):
        core = shapely.union_all(parts)
        lost = shapely.difference(region.exterior, shapely.buffer(core, 0.95 * TOUCHING_TOLERANCE, quad_segs=16))
        if lost.is_empty:
            break
        depth *= 0.1
        # Only around what is lost, so that the rim is left out elsewhere. The new parts overlap the earlier ones.
        ends = shapely.points(shapely.get_coordinates(lost))
        reach = float(np.hypot(*np.ptp(outline, axis=0))) if core.is_empty else shapely.distance(ends, core).max()
        around = shapely.buffer(lost, 1.1 * reach)
        parts += shapely.get_parts(shapely.intersection(eroded(region, depth), around)).tolist()
    return [part for part in parts if part.geom_type == "Polygon" and not part.is_empty]


def touching_depth(outline: FloatArray) -> float:
    """Return the depth (metres) of erosion that shortens no corner by more than TOUCHING_TOLERANCE.

    An erosion by d shortens a corner of angle 2a by d / sin(a). Corners sharper than 11 degrees may be shortened by
    more: the depth is never less than a tenth of the tolerance, because of rounding.

    Args:
        outline: shape (v, 2), counter-clockwise.
    """
    back, ahead = np.roll(outline, 1, axis=0) - outline, np.roll(outline, -1, axis=0) - outline
    angle = np.arctan2(ahead[:, 0] * back[:, 1] - ahead[:, 1] * back[:, 0], (ahead * back).sum(axis=1))
    convex = angle[angle > 0.0]
    return TOUCHING_TOLERANCE * max(0.1, float(np.sin(0.5 * convex).min(initial=1.0)))
