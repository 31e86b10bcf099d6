"""What a robot covers whatever the configuration within a cell: its core, as polygons."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.planning.proofs.region import MARGIN
from trailmark.world import Robot

__all__ = ["core", "discs", "pivot"]

FloatArray = NDArray[np.float64]

QUARTER = 4
"""Chords for each quarter of a circle."""

COARSE = 0.03
"""Share of the distance to the edges' sweeps that the core's corners may be simplified by."""


def core(outline: FloatArray, shift: float, turn: float) -> list[FloatArray]:
    """Return polygons that the robot covers with MARGIN to spare after any shift and turn.

    A point of the footprint is covered still unless an edge passes over it. Each edge, turned by up to ``turn`` either
    way, stays within the hull of its two extreme positions, grown by the rise of its ends' arcs over their chords;
    shifts grow that by ``shift``. So what lies farther from all those hulls is covered.

    Args:
        outline: vertices about the pivot, shape (v, 2), counter-clockwise, metres.
        shift: metres, at most, in any direction.
        turn: radians, at most, either way about the pivot.

    Returns:
        Rings of shape (n, 2), none if nothing is left or turns are too large to be worth a look.
    """
    if turn > 0.25 * np.pi:
        return []
    radius = float(np.hypot(*outline.T).max())
    rise = radius * (1.0 - np.cos(turn))
    reach = shift + rise + MARGIN
    hulls = shapely.convex_hull(shapely.multipoints(_turned(outline, turn)))
    # Chords lie inside of circles, and simplifying moves corners: a little more, and measured again at the end.
    bands = shapely.buffer(hulls, reach * (1.0 + 2.0 * COARSE) / np.cos(np.pi / (4 * QUARTER)), quad_segs=QUARTER)
    robot = shapely.Polygon(outline)
    left = shapely.difference(robot, shapely.union_all(bands))
    found = []
    for part in shapely.get_parts(left):
        simple = shapely.simplify(part, COARSE * reach) if part.geom_type == "Polygon" else part
        if _is_core(simple, robot, hulls, reach):
            found.append(np.ascontiguousarray(shapely.get_coordinates(shapely.orient_polygons(simple).exterior)[:-1]))
    area = [shapely.Polygon(ring).area for ring in found]
    return [ring for ring, size in zip(found, area, strict=True) if size > 0.02 * sum(area)]


def _turned(outline: FloatArray, turn: float) -> FloatArray:
    """Return both ends of each edge turned either way, shape (v, 4, 2)."""
    ends = np.concatenate([outline, np.roll(outline, -1, axis=0)], axis=1).reshape(-1, 2, 2)
    c, s = np.cos(turn), np.sin(turn)
    left, right = ends @ np.array([[c, s], [-s, c]]), ends @ np.array([[c, -s], [s, c]])
    return np.concatenate([left, right], axis=1)


def _is_core(part: Any, robot: Any, hulls: Any, reach: float) -> bool:
    """Return whether a part is a polygon without holes inside the robot, and far enough from all hulls."""
    if part.geom_type != "Polygon" or part.is_empty or not part.is_valid or len(part.interiors):
        return False
    return bool(shapely.covers(robot, part) and (shapely.distance(hulls, part) >= reach).all())


def discs(outline: FloatArray, most: int = 24) -> FloatArray:
    """Return discs inside the robot, all over it, the largest first.

    Args:
        outline: vertices, shape (v, 2), metres.
        most: how many, at most.

    Returns:
        Rows x, y, radius; shape (n, 3).
    """
    robot = shapely.Polygon(outline)
    low, high = outline.min(axis=0), outline.max(axis=0)
    step = max(float(np.sqrt(np.prod(high - low))) / 64.0, float((high - low).max()) / 400.0)
    x, y = (np.linspace(a, b, 2 + 2 * int(0.5 * (b - a) / step) + 1) for a, b in zip(low, high, strict=True))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    places = places[shapely.contains_xy(robot, places)]
    radius = shapely.distance(robot.exterior, shapely.points(places)) * (1.0 - 1e-9)
    order = np.argsort(-radius, kind="stable")
    rows = np.column_stack([places, radius])[order]
    # None lies near a larger one; ever fewer, until they are not too many.
    apart = 0.6 * rows[:, 2]
    while True:
        found: list[FloatArray] = []
        left = np.ones(len(rows), np.bool_)
        while left.any() and len(found) <= most:
            best = int(np.argmax(left))
            found.append(rows[best])
            left &= np.hypot(*(rows[:, :2] - rows[best, :2]).T) > apart[best]
        if len(found) <= most:
            return np.array(found).reshape(-1, 3)
        apart = np.maximum(1.2 * apart, 0.6 * rows[0, 2])


def pivot(robot: Robot) -> FloatArray:
    """Return the point (robot frame, shape (2,)) whose place stands for the robot's: turns about it leave most covered.

    One of the centre of the smallest circle around the footprint, the inscribed disc's, and their middle.
    """
    outline = np.asarray(robot.outline.rings()[0])
    around = shapely.get_coordinates(shapely.minimum_bounding_circle(shapely.Polygon(outline)).centroid)[0]
    inscribed = np.array(robot.inscribed_disc.center)
    shift = 0.25 * robot.inscribed_disc.radius
    area = []
    candidates = (around, inscribed, 0.5 * (around + inscribed))
    for candidate in candidates:
        rings = core(outline - candidate, shift, shift / robot.circumradius)
        area.append(sum(shapely.Polygon(ring).area for ring in rings))
    return candidates[int(np.argmax(area))]
