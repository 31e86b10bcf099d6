"""The robot's footprint as flat arrays: outline, covering discs and inner discs, for the compiled kernels."""

# Kernels are made of this file too: trailmark.jit counts it.
from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.shapes import Disc
from trailmark.touching import THINNER, TOUCHING_TOLERANCE, eroded, touching_depth
from trailmark.world import Robot

__all__ = ["DEEP_TOLERANCE", "Footprint", "build_footprint"]

FloatArray = NDArray[np.float64]

DEEP_TOLERANCE = 3e-7
"""Overlap (metres) from which the kernels decide that there is a collision; between the two FCL decides."""

MAX_TILES = 48
"""Maximum number of tiles along each side of a footprint: a very thin one would need any number."""


class Footprint(NamedTuple):
    """A robot's footprint in its own frame, dilated by the clearance that it keeps; all lengths in metres.

    Attributes:
        outline: (v, 2) vertices before the dilation, counter-clockwise; empty for a disc.
        core: (w, 2) the outline, eroded by DEEP_TOLERANCE if it is dilated by no more than that.
        core_gap: no point of the footprint is farther from the core, dilated by what the dilation exceeds
            DEEP_TOLERANCE by, than this; infinite if there is no core.
        cover: (c, 3) discs x, y, radius that together contain the footprint.
        inner: (i, 3) discs that lie inside it.
        circumradius: largest distance of the footprint from the reference point.
        sweep_radius: R in the motion bound ‖Δxy‖ + R·|Δθ|; 0 for a disc.
        dilation: radius of the disc by which the outline is dilated; a disc robot is a point dilated.
        rim: how far inside of the footprint what may meet no obstacle lies (:func:`overlap_core`), but for sharp tips.
    """

    outline: FloatArray
    core: FloatArray
    core_gap: float
    cover: FloatArray
    inner: FloatArray
    circumradius: float
    sweep_radius: float
    dilation: float
    rim: float

    @property
    def is_disc(self) -> bool:
        """Whether the heading makes no difference to what the footprint covers."""
        return len(self.outline) == 0


def build_footprint(robot: Robot, discs: int = 12) -> Footprint:
    """Return the kernels' arrays for a robot, covered by about ``discs`` discs."""
    shape = robot.footprint
    if isinstance(shape, Disc):
        disc = np.array([[0.0, 0.0, robot.circumradius]])
        none = np.empty((0, 2))
        return Footprint(
            none, none, np.inf, disc, disc, robot.circumradius, 0.0, robot.circumradius, TOUCHING_TOLERANCE
        )
    region, clearance = robot.outline.shapely(), robot.clearance
    # A copy: shapes are read-only, which numba would take for another type and compile anew for.
    outline = np.array(robot.outline.rings()[0], order="C")
    cover, inner = _cover(region, discs)
    if clearance > DEEP_TOLERANCE:
        core, gap = outline, DEEP_TOLERANCE
    else:
        core = _largest_ring(eroded(region, DEEP_TOLERANCE))
        gap = _gap(region, core) + clearance
    dilation = np.array([0.0, 0.0, clearance])
    return Footprint(
        outline,
        core,
        gap,
        cover + dilation,
        inner + dilation,
        robot.circumradius,
        robot.sweep_radius,
        clearance,
        THINNER * touching_depth(outline),
    )


def _largest_ring(geometry: shapely.Geometry) -> FloatArray:
    """Return the outline of the largest part, shape (w, 2); empty if nothing is left."""
    parts = shapely.get_parts(geometry)
    if len(parts) == 0 or shapely.is_empty(parts).all():
        return np.empty((0, 2))
    largest = max(parts, key=lambda part: float(part.area))
    return np.ascontiguousarray(shapely.get_coordinates(shapely.orient_polygons(largest).exterior)[:-1])


def _gap(region: shapely.Polygon, core: FloatArray) -> float:
    """Return a proven bound on how far (metres) points of the region are from its core."""
    if len(core) == 0:
        return np.inf
    inside = shapely.Polygon(core)
    gap = 1.1 * float(shapely.distance(shapely.points(region.exterior.coords), inside).max())
    # The corners are the farthest, unless the erosion separated a part. Buffers are polygons within the true ones, and
    # a buffer fills concavities of up to 1 % of its distance: so it is made for less than the gap.
    return gap if shapely.covers(shapely.buffer(inside, 0.98 * gap, quad_segs=16), region) else np.inf


def _cover(region: shapely.Polygon, wanted: int) -> tuple[FloatArray, FloatArray]:
    """Return covering and inner discs: the footprint is divided by square tiles, and each tile has its own discs."""
    box = region.minimum_rotated_rectangle
    corners = shapely.get_coordinates(box)[:4]
    u, v = corners[1] - corners[0], corners[3] - corners[0]
    if np.hypot(*u) < np.hypot(*v):
        u, v = v, u
    length, width = float(np.hypot(*u)), float(np.hypot(*v))
    # Tiles as square as the box allows; a footprint fills only a part of its box.
    tile = np.sqrt(float(region.area) / wanted)
    n, m = (min(MAX_TILES, max(1, round(side / tile))) for side in (length, width))
    cover, inner = [], []
    for i in range(n):
        for j in range(m):
            a = corners[0] + u * (i / n) + v * (j / m)
            cell = shapely.Polygon([a, a + u / n, a + u / n + v / m, a + v / m])
            # Tiles overlap slightly, so that rounding leaves no gap between two of them.
            piece = shapely.intersection(region, cell.buffer(1e-9 * length))
            if piece.is_empty:
                continue
            center = shapely.get_coordinates(shapely.minimum_bounding_circle(piece).centroid)[0]
            reach = float(np.hypot(*(shapely.get_coordinates(piece) - center).T).max()) * (1.0 + 1e-9)
            cover.append((*center, reach))
            point = shapely.Point(center)
            depth = float(region.exterior.distance(point))
            if region.contains(point) and depth > 0.0:
                inner.append((*center, depth * (1.0 - 1e-9)))
    largest = shapely.get_coordinates(shapely.maximum_inscribed_circle(region, tolerance=1e-3 * length))[0]
    inner.append((*largest, float(region.exterior.distance(shapely.Point(largest))) * (1.0 - 1e-9)))
    # The largest inner disc first, since it proves most collisions.
    inner.sort(key=lambda disc: -disc[2])
    return np.array(cover), np.array(inner)
