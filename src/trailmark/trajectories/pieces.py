"""Pieces: the curves that paths are driven along, each given by a formula, with bounds on them, and their certificates.

A piece is either a parabola in (x, y, theta), of which a straight motion is a special case, or it is driven along the
heading, which changes as a quadratic function of the distance driven: a straight line, an arc, or a clothoid. Every
piece has a parameter s from 0 to its length. On straight and driven pieces s is the reference point's distance in
metres; where it stands still, half of the angle turned, in radians; on other parabolas it has no name of its own.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.certify import CONTACT
from trailmark.curves import CurvePath
from trailmark.motion.one_way import one_ways, straight_allowed
from trailmark.path import Path
from trailmark.se2 import FloatArray

__all__ = [
    "FINER",
    "Pieces",
    "certified",
    "dense_places",
    "joined",
    "one_way_respected",
    "pieces_of",
    "row_counts",
    "straight",
]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(20)
"""Gauss and Legendre's quadrature: exact to rounding for pieces that turn by less than two turns."""

STANDING = 1e-9
"""Metres a radian: a motion that moves the reference point less counts its turning."""

NEGLIGIBLE = 1e-100
"""Length of a motion that is left out: its inverse's square could not be represented."""

SMOOTH = 1e-6
"""Velocities, relative to the speed, and turn rates (radians a metre) that differ by no more count as the same."""

CHORD, FINER = 1e-4, 32
"""Metres: largest distance of a point of the robot on a curved piece from where it is on the rows' straight motions.
Times as many rows that a piece has which comes nearer to obstacles or one-way zones than that."""

MAX_STATES = 4_000
"""Configurations evaluated for one piece; one that needs more is not certified."""


class Pieces(NamedTuple):
    """n pieces of a path, each beginning where the one before ends.

    Attributes:
        start: (n, 3), configurations at s = 0; metres and radians.
        first: (n, 3), derivatives of x, y and theta there; of a driven piece only that of theta counts.
        second: (n, 3), second derivatives, constant; of a driven piece only that of theta counts.
        length: (n,), largest s.
        direction: (n,), 1 driven along the heading, -1 driven backwards, 0 a parabola.
    """

    start: FloatArray
    first: FloatArray
    second: FloatArray
    length: FloatArray
    direction: NDArray[np.int8]

    def take(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Pieces:
        """Return some of the pieces, in the order of ``rows``."""
        return Pieces(*(values[rows] for values in self))  # type: ignore[arg-type]  # each keeps its type

    def states(self, piece: NDArray[np.intp], s: FloatArray) -> FloatArray:
        """Return the configurations, shape (m, 3), at places s (m,) on pieces (m,); headings are not wrapped."""
        start, first, second = self.start[piece], self.first[piece], self.second[piece]
        along = s[:, None]
        q = np.asarray(start + along * (first + 0.5 * along * second))
        driven = self.direction[piece] != 0
        if driven.any():
            part = 0.5 * along[driven] * (1.0 + _NODES)
            heading = start[driven, 2:] + part * (first[driven, 2:] + 0.5 * part * second[driven, 2:])
            step = 0.5 * s[driven] * self.direction[piece][driven]
            q[driven, 0] = start[driven, 0] + step * (np.cos(heading) @ _WEIGHTS)
            q[driven, 1] = start[driven, 1] + step * (np.sin(heading) @ _WEIGHTS)
        return q

    def derivatives(self, piece: NDArray[np.intp], s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the first and second derivatives of x, y, theta by s, each (m, 3), at places s (m,) on pieces (m,)."""
        second = self.second[piece].copy()
        first = self.first[piece] + s[:, None] * second
        direction = self.direction[piece]
        driven = direction != 0
        heading = self.start[piece, 2] + s * (self.first[piece, 2] + 0.5 * s * second[:, 2])
        ahead = direction[:, None] * np.column_stack([np.cos(heading), np.sin(heading)])
        first[driven, :2] = ahead[driven]
        second[driven, :2] = (first[:, 2:] * np.column_stack([-ahead[:, 1], ahead[:, 0]]))[driven]
        return first, second

    def bend(self, reach: float) -> FloatArray:
        """Return an upper bound (n,) on |q''|: the chord of a part of parameter h is off by h²/8 of it at most.

        Args:
            reach: distance (metres) from the reference point for which the turning counts.
        """
        ends = np.abs(self.first[:, 2] + np.stack([np.zeros_like(self.length), self.length]) * self.second[:, 2])
        across = np.where(self.direction != 0, ends.max(axis=0), np.hypot(*self.second[:, :2].T))
        return np.asarray(across + reach * np.abs(self.second[:, 2]))

    def ends(self) -> FloatArray:
        """Return the configurations, shape (n, 3), at which the pieces end; headings are not wrapped."""
        return self.states(np.arange(len(self.length)), self.length)

    def curvature(self) -> FloatArray:
        """Return the largest curvature (1/m, shape (n,)) of the reference point's way on each piece; 0 in place."""
        begin, end = self.first, self.first + self.length[:, None] * self.second
        x, y = self.second[:, 0], self.second[:, 1]
        square = x * x + y * y
        # Where a parabola is slowest.
        s = np.clip(-(begin[:, 0] * x + begin[:, 1] * y) / np.where(square > 0.0, square, 1.0), 0.0, self.length)
        speed = np.hypot(begin[:, 0] + s * x, begin[:, 1] + s * y)
        cross = np.abs(begin[:, 0] * y - begin[:, 1] * x)
        bent = np.divide(cross, speed**3, out=np.zeros_like(cross), where=cross > 0.0)
        return np.where(self.direction != 0, np.maximum(np.abs(begin[:, 2]), np.abs(end[:, 2])), bent)

    def travelled(self) -> FloatArray:
        """Return the distance (metres, shape (n,)) that the reference point travels on each piece."""
        piece = np.repeat(np.arange(len(self.length)), len(_NODES))
        s = (0.5 * self.length[:, None] * (1.0 + _NODES)).ravel()
        # In parts: the speed along a parabola has a minimum, near which quadrature would need many nodes.
        total = np.zeros(len(self.length))
        for part in range(8):
            speed = np.hypot(*self.derivatives(piece, (s + part * self.length[piece]) / 8.0)[0][:, :2].T)
            total += speed.reshape(-1, len(_NODES)) @ _WEIGHTS * self.length / 16.0
        return total

    def turned(self) -> FloatArray:
        """Return Σ |Δθ| (radians, shape (n,)) along each piece."""
        begin, end = self.first[:, 2], self.first[:, 2] + self.length * self.second[:, 2]
        same = begin * end >= 0.0
        change = np.where(self.second[:, 2] == 0.0, 1.0, np.abs(self.second[:, 2]))
        return np.where(same, 0.5 * self.length * np.abs(begin + end), 0.5 * (begin**2 + end**2) / change)


def joined(pieces: Pieces, turn_rate: bool) -> NDArray[np.bool_]:
    """Return at which joints, shape (n - 1,), velocity is continuous: the direction, and the turn rate if asked."""
    n = np.arange(len(pieces.length))
    begin, end = pieces.derivatives(n, np.zeros(len(n)))[0][1:], pieces.derivatives(n, pieces.length)[0][:-1]
    apart = np.abs(end - begin)
    same = (apart[:, :2] <= SMOOTH).all(axis=1)
    # Where the reference point stands still, the velocity is that of the heading.
    turns = turn_rate | (np.abs(begin[:, :2]) + np.abs(end[:, :2]) == 0.0).all(axis=1)
    return np.asarray(same & (~turns | (apart[:, 2] <= SMOOTH * np.maximum(1.0, np.abs(begin[:, 2])))))


def pieces_of(path: Path) -> Pieces:
    """Return the pieces of a path of straight motions, or of a car's curves; motions of length 0 are left out."""
    if isinstance(path, CurvePath):
        return _driven(path)
    return straight(path.states[:-1], se2.difference(path.states[:-1], path.states[1:]))


def straight(start: FloatArray, move: FloatArray, *, keep: bool = False) -> Pieces:
    """Return straight motions, without those of length 0 unless they are to be kept.

    Args:
        start: configurations, shape (n, 3).
        move: changes of x, y and heading, shape (n, 3).
        keep: whether the ones of length 0 stay.
    """
    length, angle = np.hypot(*move[:, :2].T), np.abs(move[:, 2])
    length = np.where(length > STANDING * angle, length, 0.5 * angle)
    used = (length > NEGLIGIBLE) | keep
    first = move[used] / np.maximum(length[used, None], NEGLIGIBLE)
    return Pieces(start[used].copy(), first, np.zeros_like(first), length[used], np.zeros(len(first), np.int8))


def _driven(path: CurvePath) -> Pieces:
    curves, radius = path.curves, path.steering.radius
    rows: list[Pieces] = []
    for knot, sides, lengths in zip(path.knots, curves.sides, curves.signed_lengths, strict=False):
        used = lengths != 0.0
        n = int(used.sum())
        direction = np.sign(lengths[used]).astype(np.int8)
        first = np.zeros((n, 3))
        first[:, 2] = sides[used] * direction / radius
        piece = Pieces(np.repeat(knot[None], n, axis=0), first, np.zeros((n, 3)), np.abs(lengths[used]), direction)
        for i, j in pairwise(range(n)):
            piece.start[j] = piece.take(np.array([i])).ends()[0]
        rows.append(piece)
    if not rows:
        return straight(path.knots[:0], path.knots[:0])
    return Pieces(*map(np.concatenate, zip(*rows, strict=True)))


# --- Certificates: no configuration along pieces collides, none travels against a one-way zone.


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


def one_way_respected(checker: StateChecker, pieces: Pieces, finer: int = FINER) -> NDArray[np.bool_]:
    """Return which pieces, shape (n,), travel as the world's one-way zones allow, by straight motions along them.

    Each may go in any direction between the curve's at its ends: by as much its own one must be farther from those that
    are not allowed.

    Args:
        checker: of the world.
        pieces: of a path.
        finer: times as many of them as there are rows on a curved piece.
    """
    zones, n = one_ways(checker.world.zones), len(pieces.length)
    respected = np.ones(n, np.bool_)
    if len(zones.headings) == 0 or n == 0:
        return respected
    count = row_counts(pieces, checker.footprint.sweep_radius)
    count = np.where(count > 1, finer * count, 1)
    piece, s = dense_places(pieces, count)
    end = s + pieces.length[piece] / count[piece]
    a, b = pieces.states(piece, s), pieces.states(piece, end)
    along = [np.arctan2(v[:, 1], v[:, 0]) for v in (pieces.derivatives(piece, at)[0] for at in (s, end))]
    spread = np.abs(se2.wrap(along[1] - along[0]))
    for i in np.flatnonzero(_near(zones.boxes, a, b)):
        if respected[piece[i]]:
            narrower = zones._replace(tolerances=zones.tolerances - spread[i])
            respected[piece[i]] = straight_allowed(narrower, a[i], b[i])
    return respected


def _near(boxes: FloatArray, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
    """Return which straight motions between states, shape (m, 3), may meet one of some boxes, shape (k, 4)."""
    low, high = np.minimum(a, b)[:, None, :2], np.maximum(a, b)[:, None, :2]
    meets = np.asarray((low <= boxes[:, 2:]) & (high >= boxes[:, :2]))
    return np.asarray(np.any(np.all(meets, axis=2), axis=1))
