"""Where a path travels through one-way zones in a wrong direction."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely

from trailmark import se2
from trailmark.audit.attribution import merged
from trailmark.audit.depth import deepest
from trailmark.audit.result import Collision
from trailmark.audit.scale import Scale
from trailmark.collision.footprint import TOUCHING_TOLERANCE
from trailmark.se2 import FloatArray
from trailmark.zones import OneWayZone, Zone

__all__ = ["wrong_ways"]

SLACK, IN_PLACE = 1e-6, 1e-9
"""Radians by which a direction may be beyond the tolerance, and metres: what is shorter is a turn in place."""


def wrong_ways(zones: Iterable[Zone], scale: Scale, chords: bool = False) -> list[Collision]:
    """Return the intervals of a path that lead through one-way zones in a wrong direction.

    Args:
        zones: of the world.
        scale: of the path, straight motions.
        chords: whether these are chords of a car's curves, of which any part may go in the direction that suits best.

    Returns:
        Collisions with ``one-way zone i``; the depth is the reference point's distance from the outline.
    """
    one_way = [(i, zone) for i, zone in enumerate(zones) if isinstance(zone, OneWayZone)]
    if not one_way:
        return []
    states, found = scale.states, []
    steps = np.diff(states[:, :2], axis=0)
    lengths, ahead = np.hypot(*steps.T), np.arctan2(steps[:, 1], steps[:, 0])
    directions = [ahead]
    if chords:
        headings = np.stack([states[:-1, 2], states[1:, 2]])
        directions += list(headings + np.pi * (np.cos(headings - ahead) < 0.0))
    for i, zone in one_way:
        outline = zone.region.shapely().boundary

        def depths(q: FloatArray, outline: shapely.Geometry = outline) -> FloatArray:
            return np.asarray(shapely.distance(outline, shapely.points(q[:, :2])))

        region = shapely.buffer(zone.region.shapely(), -TOUCHING_TOLERANCE, join_style="mitre")
        off = np.abs(se2.wrap(np.stack(directions) - zone.heading)).min(axis=0)
        wrong = np.flatnonzero((lengths > IN_PLACE) & (off > zone.tolerance + SLACK))
        lines = shapely.linestrings(np.stack([states[wrong, :2], states[wrong + 1, :2]], axis=1))
        rows = []
        for motion, inside in zip(wrong.tolist(), shapely.intersection(region, lines), strict=True):
            for part in shapely.get_parts(inside):
                if part.length > 0.0:
                    along = np.hypot(*(shapely.get_coordinates(part) - states[motion, :2]).T) / lengths[motion]
                    rows.append((motion, along.min(), min(1.0, along.max())))
        for begin, end in merged(np.array(rows), scale) if rows else ():
            (k, first), (m, last) = scale.motion(begin), scale.motion(end)
            depth = deepest(depths, scale.poses, begin, end)
            name = f"{zone.kind} zone {i}"
            found.append(Collision(scale.length(begin), scale.length(end), name, depth, (k + first, m + last)))
    return found
