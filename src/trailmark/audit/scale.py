"""Scale: places along a path, in metres that no point of the robot outruns."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.se2 import FloatArray

__all__ = ["Scale"]

MIN_RADIUS = 5e-7
"""Metres: smallest R, so that places along a turn in place are apart for a disc too, of which no point moves."""


class Scale:
    """A path's scale: ‖Δxy‖ + R·|Δθ| from state to state, R the robot's largest distance from its reference point.

    Args:
        states: of the path, shape (n, 3), n >= 2.
        radius: R in metres; at least :data:`MIN_RADIUS` is used.
    """

    def __init__(self, states: FloatArray, radius: float) -> None:
        self.states = states
        self._ends = np.concatenate(
            [[0.0], np.cumsum(se2.motion_bound(states[:-1], states[1:], max(radius, MIN_RADIUS)))]
        )
        steps = np.hypot(*np.diff(states[:, :2], axis=0).T)
        self._lengths = np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def total(self) -> float:
        """Metres of the whole path on the scale."""
        return float(self._ends[-1])

    def place(self, motion: ArrayLike, share: ArrayLike) -> FloatArray:
        """Return places on the scale of shares of motions."""
        i = np.asarray(motion, dtype=np.intp)
        return np.asarray(self._ends[i] + np.asarray(share) * (self._ends[i + 1] - self._ends[i]))

    def length(self, place: float) -> float:
        """Return metres along the path's xy curve."""
        i, share = self.motion(place)
        return float(self._lengths[i] + share * (self._lengths[i + 1] - self._lengths[i]))

    def motion(self, place: float) -> tuple[int, float]:
        """Return the motion that a place lies on, and the share of it."""
        i = int(np.clip(np.searchsorted(self._ends, place, side="right") - 1, 0, len(self._ends) - 2))
        span = self._ends[i + 1] - self._ends[i]
        return i, float(np.clip((place - self._ends[i]) / span, 0.0, 1.0)) if span > 0.0 else 0.0

    def poses(self, places: ArrayLike) -> FloatArray:
        """Return the configurations at places (n,), shape (n, 3)."""
        where = np.atleast_1d(places)
        motions = np.clip(np.searchsorted(self._ends, where, side="right") - 1, 0, len(self._ends) - 2)
        span = self._ends[motions + 1] - self._ends[motions]
        shares = np.clip((where - self._ends[motions]) / np.where(span > 0.0, span, 1.0), 0.0, 1.0)
        return se2.interpolate(self.states[motions], self.states[motions + 1], shares)

    def interval(self, motions: tuple[float, float]) -> tuple[float, float]:
        """Return the places of two numbers of motions, as :attr:`trailmark.audit.result.Collision.motions` has them."""
        first = np.clip(np.floor(motions), 0, len(self._ends) - 2)
        begin, end = self.place(first, np.asarray(motions) - first)
        return float(begin), float(end)

    def part(self, begin: float, end: float) -> FloatArray:
        """Return the states of the path between two places, both included, shape (n, 3), n >= 2."""
        first, last = self.motion(begin)[0], self.motion(end)[0]
        a, b = self.poses([begin, end])
        return np.concatenate([a[None], self.states[first + 1 : last + 1], b[None]])
