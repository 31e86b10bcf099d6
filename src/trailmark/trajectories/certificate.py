"""Certificates of curved pieces: no configuration along them collides, by bounds on how far the robot moves."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.certify import CONTACT
from trailmark.se2 import FloatArray
from trailmark.trajectories.pieces import Pieces
from trailmark.zones import OneWayZone

__all__ = ["CHORD", "certified", "dense_places", "one_way_respected", "row_counts"]

CHORD = 1e-4
"""Metres: largest distance of a point of the robot on a curved piece from where it is on the rows' straight motions."""

MAX_STATES = 4_000
"""Configurations evaluated for one piece; one that needs more is not certified."""


def row_counts(pieces: Pieces, reach: float) -> NDArray[np.intp]:
    """Return into how many straight motions each piece (n,) is cut so that none is off by more than :data:`CHORD`.

    Args:
        pieces: of a path.
        reach: largest distance (metres) of the robot's outline from its reference point.
    """
    # Half of it is left for rounding.
    parts = pieces.length * np.sqrt(pieces.bend(reach) / (4.0 * CHORD))
    return np.maximum(1, np.ceil(parts)).astype(np.intp)


def certified(checker: StateChecker, pieces: Pieces) -> NDArray[np.bool_]:
    """Return which pieces, shape (n,), are certified free of collision, and the straight motions of their rows too.

    Free means that they keep the clearance that the checker's robot is to keep.

    As :mod:`trailmark.collision.certify` does it: a configuration with clearance d certifies the piece for as far as no
    point of the robot moves by more than d. Here :data:`CHORD` is taken off d, so that the straight motions from row to
    row are as free as the curve.
    """
    n = len(pieces.length)
    reach, kept = checker.footprint.sweep_radius, checker.robot.clearance
    piece = np.arange(n)
    # Of a linear or constant derivative, the norm is largest at an end.
    rates = [np.abs(pieces.derivatives(piece, s)[0]) for s in (np.zeros(n), pieces.length)]
    rate = np.maximum(*(np.hypot(*first[:, :2].T) + reach * first[:, 2] for first in rates))
    low, high = np.zeros(n), pieces.length.copy()
    free, used = np.ones(n, np.bool_), np.zeros(n, np.intp)
    while len(piece):
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        need = rate[piece] * half + CHORD + CONTACT
        d = np.asarray(checker.clearance(pieces.states(piece, middle), cap=float(need.max()) + kept)) - kept
        used += np.bincount(piece, minlength=n)
        free[piece[d <= CHORD + CONTACT]] = False
        free[used > MAX_STATES] = False
        left = (d < need) & free[piece]
        piece, low, middle, high = piece[left], low[left], middle[left], high[left]
        part = (d[left] - CHORD - CONTACT) / rate[piece]
        low, high = np.concatenate([low, middle + part]), np.concatenate([middle - part, high])
        piece = np.concatenate([piece, piece])
    return free


def dense_places(pieces: Pieces, count: NDArray[np.intp]) -> tuple[NDArray[np.intp], FloatArray]:
    """Return piece and s of the places where each piece's equal parts begin, shape (m,)."""
    piece = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    return piece, pieces.length[piece] * within / count[piece]


# --- One-way zones along pieces: which directions a piece takes where.

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
