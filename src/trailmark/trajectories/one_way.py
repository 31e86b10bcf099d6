"""One-way zones along pieces: which directions a piece takes where."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark import se2
from trailmark.trajectories.pieces import Pieces
from trailmark.zones import OneWayZone

__all__ = ["one_way_respected"]

ROUNDING = 1e-9
"""Radians by which a direction may be off those that are allowed."""


def one_way_respected(pieces: Pieces, zones: Iterable[Any]) -> NDArray[np.bool_]:
    """Return which pieces, shape (n,), travel in an allowed direction wherever they may be in a one-way zone.

    Along a piece the direction turns to one side only, so that it stays between those at its ends. A piece may be
    refused although it only comes near a zone.
    """
    n = np.arange(len(pieces.length))
    respected = np.ones(len(n), np.bool_)
    one_way = [zone for zone in zones if isinstance(zone, OneWayZone)]
    if not one_way or len(n) == 0:
        return respected
    begin, _ = pieces.derivatives(n, np.zeros(len(n)))
    end, _ = pieces.derivatives(n, pieces.length)
    travels = np.hypot(*begin[:, :2].T) > ROUNDING
    heading = np.arctan2(begin[:, 1], begin[:, 0])
    turned = np.asarray(se2.wrap(np.arctan2(end[:, 1], end[:, 0]) - heading))
    driven = pieces.direction != 0
    turned[driven] = (pieces.length * (pieces.first[:, 2] + 0.5 * pieces.length * pieces.second[:, 2]))[driven]
    hulls = _hulls(pieces)
    for zone in one_way:
        region = zone.region.shapely()
        within = travels & shapely.intersects(region, hulls) & ~shapely.touches(region, hulls)
        off = np.asarray(se2.wrap(heading - zone.heading))
        farthest = np.maximum(np.abs(off), np.abs(off + turned))
        respected &= ~within | (farthest <= zone.tolerance + ROUNDING)
    return respected


def _hulls(pieces: Pieces) -> NDArray[Any]:
    """Return for each piece a region that holds it: a parabola's control triangle, a disc about a driven piece."""
    n = np.arange(len(pieces.length))
    half = 0.5 * pieces.length
    control = pieces.start[:, :2] + half[:, None] * pieces.first[:, :2]
    corners = np.stack([pieces.start[:, :2], control, pieces.ends()[:, :2]], axis=1)
    hulls = shapely.convex_hull(shapely.multipoints(list(map(shapely.points, corners))))
    # A polygon about a disc: its corners lie on a circle that is larger by 1/cos(pi/8).
    around = shapely.buffer(shapely.points(pieces.states(n, half)[:, :2]), half / np.cos(np.pi / 8.0), quad_segs=2)
    return np.asarray(np.where(pieces.direction != 0, around, hulls))
