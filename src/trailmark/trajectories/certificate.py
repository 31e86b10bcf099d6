"""Certificates of curved pieces: no configuration along them collides, by bounds on how far the robot moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.collision.certify import CONTACT
from trailmark.se2 import FloatArray
from trailmark.trajectories.pieces import Pieces

__all__ = ["CHORD", "certified", "dense_places", "row_counts"]

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
