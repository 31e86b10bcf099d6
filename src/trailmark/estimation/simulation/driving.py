"""How a robot drives along configurations or waypoints: pieces of motion, and the pose at any time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.checked import Numbers, Positive, checked_arguments
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.motion import Unicycle
from trailmark.se2 import FloatArray

__all__ = ["Drive"]

_SAME = 1e-6
"""Radians and metres: within these a motion counts as an arc, and a place as reached."""

_NOTHING = 1e-9
"""Seconds: a motion that takes no longer is none."""

_ARC = Unicycle(0.0, 0.0)


class _Piece(NamedTuple):
    """A motion of constant velocities: of the robot's own (an arc), or, if ``holonomic``, of x, y and theta."""

    start: FloatArray
    end: FloatArray
    v: float
    omega: float
    duration: float
    holonomic: bool


class Drive:
    """A drive: constant velocities, piece by piece.

    A robot that can move in every direction (``holonomic``) follows the configurations as a planner means them: x and
    y linearly, theta along the shorter arc. A unicycle drives an arc from one configuration to the next where one arc,
    forward or backward, joins them (which includes going straight and turning on the spot); elsewhere it turns on the
    spot, goes straight (backward if that takes less turning), and turns again.

    Args:
        states: configurations x, y, theta, shape (n, 3), n >= 1, each of which is reached; or waypoints x, y, shape
            (n, 2), n >= 2, which a robot of either kind drives to straight ahead, turning on the spot in between.
        speed: metres per second; the robot is as fast as that or as ``turn_rate`` allows.
        turn_rate: radians per second.
        holonomic: whether the robot can move in every direction.

    Attributes:
        times: when the pieces begin, and when the last one ends, shape (k + 1,), seconds from 0.

    Raises:
        EstimationError: other shapes, values that are not finite, speeds that are not positive.
    """

    @checked_arguments(EstimationError)
    def __init__(self, states: Numbers, speed: Positive, turn_rate: Positive, *, holonomic: bool = False) -> None:
        q, headings = _states(states)
        self._speed, self._turn_rate = speed, turn_rate
        self._pieces: list[_Piece] = []
        self._here = self._start = q[0]
        for target in q[1:]:
            if holonomic and headings:
                self._shift(target)
            elif headings:
                self._reach(target)
            else:
                ahead, _ = _seen(self._here, target)
                if np.hypot(*ahead) > _SAME:
                    self._arc(0.0, math.atan2(ahead[1], ahead[0]))
                    self._arc(math.hypot(*ahead), 0.0)
        self.times: FloatArray = np.concatenate([[0.0], np.cumsum([piece.duration for piece in self._pieces])])

    def poses(self, times: ArrayLike) -> FloatArray:
        """Return the poses at these times, shape (m, 3); before the start and after the end the robot stands."""
        t = np.clip(np.asarray(times, dtype=np.float64), 0.0, self.times[-1])
        which = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, max(0, len(self._pieces) - 1))
        poses = np.tile(self._start, (len(t), 1))
        for i in np.unique(which) if self._pieces else ():
            poses[which == i] = _along(self._pieces[i], t[which == i] - self.times[i])
        return poses

    def velocities(self, times: ArrayLike) -> FloatArray:
        """Return v (m/s) and omega (rad/s) at these times, shape (m, 2); 0 where the robot stands."""
        which = np.searchsorted(self.times, np.asarray(times, dtype=np.float64), side="right") - 1
        which[(which < 0) | (which >= len(self._pieces))] = -1
        table = [(piece.v, piece.omega) for piece in self._pieces]
        return np.array([*table, (0.0, 0.0)])[which]

    def _reach(self, target: FloatArray) -> None:
        """Drive to a configuration as a unicycle."""
        ahead, turn = _seen(self._here, target)
        away = math.hypot(*ahead)
        if away <= _SAME:
            self._arc(0.0, turn)
            return
        alpha = math.atan2(ahead[1], ahead[0])
        back = float(se2.wrap(alpha + math.pi))
        for sign, half in ((1.0, alpha), (-1.0, back)):
            # A chord leaves its arc by half of the arc's turn.
            if abs(half) <= math.pi / 2 and abs(se2.wrap(turn - 2.0 * half)) <= _SAME:
                self._arc(sign * away / float(np.sinc(half / math.pi)), 2.0 * half)
                return
        forward, backward = (abs(first) + abs(se2.wrap(turn - first)) for first in (alpha, back))
        sign, first = (1.0, alpha) if forward <= backward else (-1.0, back)
        self._arc(0.0, first)
        self._arc(sign * away, 0.0)
        self._arc(0.0, _seen(self._here, target)[1])

    def _arc(self, length: float, turn: float) -> None:
        self._add(_ARC.f(self._here, (length, turn, 1.0)), length, turn, holonomic=False)

    def _shift(self, target: FloatArray) -> None:
        ahead, turn = _seen(self._here, target)
        self._add(target, math.hypot(*ahead), turn, holonomic=True)

    def _add(self, end: FloatArray, length: float, turn: float, *, holonomic: bool) -> None:
        """Add a motion that is as fast as speed and turning rate allow."""
        duration = max(abs(length) / self._speed, abs(turn) / self._turn_rate)
        if duration > _NOTHING:
            v = 0.0 if holonomic else length / duration
            self._pieces.append(_Piece(self._here, end, v, turn / duration, duration, holonomic))
            self._here = end


def _states(states: ArrayLike) -> tuple[FloatArray, bool]:
    """Return configurations, shape (n, 3), and whether their headings are to be reached."""
    given = np.asarray(states, dtype=np.float64)
    columns = given.shape[1] if given.ndim == 2 else 0
    if columns not in (2, 3) or len(given) < 4 - columns:
        raise EstimationError(f"states: expected shape (n, 3), n >= 1, or (n, 2), n >= 2, got {given.shape}")
    if columns == 3:
        return se2.configurations(given, name="states"), True
    moves = np.diff(given, axis=0)
    moves = moves[np.hypot(moves[:, 0], moves[:, 1]) > _SAME]
    heading = float(np.arctan2(moves[0, 1], moves[0, 0])) if len(moves) else 0.0
    return np.column_stack([given, np.full(len(given), heading)]), False


def _seen(a: FloatArray, b: FloatArray) -> tuple[FloatArray, float]:
    """Return b's place in a's frame, shape (2,), and the turn from a to b."""
    cos, sin, dx, dy = math.cos(a[2]), math.sin(a[2]), b[0] - a[0], b[1] - a[1]
    return np.array([cos * dx + sin * dy, cos * dy - sin * dx]), float(se2.wrap(b[2] - a[2]))


def _along(piece: _Piece, s: FloatArray) -> FloatArray:
    """Return the poses s seconds (m,) into a piece, shape (m, 3)."""
    if piece.holonomic:
        return se2.interpolate(piece.start, piece.end, s / piece.duration)
    return _ARC.f(piece.start, np.column_stack([piece.v * s, piece.omega * s, np.ones(len(s))]))
