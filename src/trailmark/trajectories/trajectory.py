"""Trajectory: a path with a time law, and how a path gets one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.arguments import number_array, one_of
from trailmark.curves import CurvePath
from trailmark.errors import ConfigurationError
from trailmark.path import Path
from trailmark.se2 import FloatArray
from trailmark.trajectories.pieces import Pieces, joined, pieces_of
from trailmark.trajectories.smooth import SmoothPath
from trailmark.trajectories.time_law import Limits, TimeLaw, fastest

__all__ = ["Trajectory", "timed"]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """When a robot is where along a path.

    The configurations are those of the path, and no others. Within each of ``law``'s intervals the path's parameter is
    a quadratic function of time, which :meth:`at` and :meth:`velocity` evaluate.

    Attributes:
        path: that is driven.
        limits: that hold everywhere.
        pieces: of the path.
        law: the time law; without intervals for a path of length 0.
        t: (n,), seconds from 0, where intervals meet.
        q: (n, 3), configurations then: metres, radians in (-pi, pi].
        dq: (n, 3), their derivatives by time, m/s and rad/s; just after t where a turn rate changes at once.
    """

    path: Path
    limits: Limits
    pieces: Pieces = field(repr=False)
    law: TimeLaw = field(repr=False)

    def __repr__(self) -> str:
        return f"Trajectory({len(self.t)} rows, {self.duration:.4g} s, along {self.path!r})"

    @cached_property
    def t(self) -> FloatArray:
        """Seconds from 0, shape (n,)."""
        return np.concatenate([[0.0], np.cumsum(self.law.seconds)])

    @property
    def q(self) -> FloatArray:
        """Configurations at ``t``, shape (n, 3)."""
        return self.at(self.t)

    @property
    def dq(self) -> FloatArray:
        """Velocities at ``t``, shape (n, 3): m/s, m/s, rad/s."""
        return self.velocity(self.t)

    @property
    def duration(self) -> float:
        """Seconds from start to end."""
        return float(self.t[-1])

    def at(self, t: ArrayLike) -> FloatArray:
        """Return the configurations at times (seconds, shape (m,) or a scalar; limited to the duration).

        Returns:
            Shape (m, 3), or (3,) for a scalar; headings in (-pi, pi].
        """
        times = self._times(t)
        if len(self.law.piece) == 0:
            return np.broadcast_to(self.path.states[0], (*times.shape, 3)).copy()
        interval, s, _ = self._places(times.ravel())
        found = self.pieces.states(self.law.piece[interval], s)
        found[:, 2] = se2.wrap(found[:, 2])
        # The path's own ends, without rounding.
        found[times.ravel() <= 0.0], found[times.ravel() >= self.t[-1]] = self.path.states[0], self.path.states[-1]
        return found.reshape(*times.shape, 3)

    def velocity(self, t: ArrayLike) -> FloatArray:
        """Return dx/dt, dy/dt (m/s) and dtheta/dt (rad/s) at times as :meth:`at` takes them, in the same shape."""
        times = self._times(t)
        if len(self.law.piece) == 0:
            return np.zeros((*times.shape, 3))
        interval, s, rate = self._places(times.ravel())
        first, _ = self.pieces.derivatives(self.law.piece[interval], s)
        found = rate[:, None] * first
        found[times.ravel() >= self.t[-1]] = 0.0
        return np.asarray(found.reshape(*times.shape, 3))

    def _times(self, t: ArrayLike) -> FloatArray:
        times = number_array(t, "trajectory: time")
        if np.isnan(times).any():
            raise ConfigurationError("trajectory: time: expected seconds, got NaN")
        return np.clip(times, 0.0, self.t[-1])

    def _places(self, times: FloatArray) -> tuple[Any, FloatArray, FloatArray]:
        """Return the interval at each time, s, and ds/dt."""
        interval = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, len(self.t) - 2)
        after = times - self.t[interval]
        seconds = self.t[interval + 1] - self.t[interval]
        begin, end = np.sqrt(self.law.x[interval]).T
        share = np.clip(after / np.where(seconds > 0.0, seconds, 1.0), 0.0, 1.0)
        rate = begin + share * (end - begin)
        mean = np.where(begin + end > 0.0, begin + end, 1.0)
        part = share * (begin + rate) / mean
        return interval, self.law.begin[interval] + self.law.length[interval] * np.clip(part, 0.0, 1.0), rate


def timed(path: Path, limits: Limits, zones: Iterable[Any] = ()) -> Trajectory:
    """Return the fastest trajectory along a path, from rest to rest.

    The robot stops where the path's direction jumps, and, with a limit on the turn acceleration, where its turn rate
    does; jumps of less than 1e-6 of the speed are taken for rounding. A car stops where it changes direction.

    Args:
        path: of straight motions, a car's curves, or smoothed.
        limits: of the robot.
        zones: of the world (``world.zones``); the speed limits among them hold for the reference point.
    """
    one_of(path, Path, "timed: path:")
    pieces = path.pieces if isinstance(path, SmoothPath) else pieces_of(path)
    if len(pieces.length) == 0:
        return Trajectory(
            path, limits, pieces, TimeLaw(np.zeros(0, np.intp), np.zeros(0), np.zeros(0), np.zeros((0, 2)))
        )
    moving = joined(pieces, isinstance(path, SmoothPath) or limits.max_turn_acceleration is not None)
    # As many rows as the path's, or rows at its states, so that the straight motions between them are as good.
    rows = path.rows if isinstance(path, SmoothPath) else None
    places = path.places if isinstance(path, CurvePath) else None
    return Trajectory(path, limits, pieces, fastest(pieces, moving, limits, zones, rows, places))
