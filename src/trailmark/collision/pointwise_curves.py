"""PointwiseCurveChecker: one configuration or curve a call, for callers that ask one at a time, such as OMPL."""

from __future__ import annotations

import numpy as np

from trailmark.collision import kernels
from trailmark.collision.checker import StateChecker
from trailmark.collision.curve_motions import CurveChecker, every_curve_free
from trailmark.collision.pointwise import PointwiseChecker, room_at, unpacked
from trailmark.compiled import njit
from trailmark.curves import Steering
from trailmark.curves.shortest import MOST_WORDS
from trailmark.curves.words import PIECES

__all__ = ["PointwiseCurveChecker"]


class PointwiseCurveChecker(PointwiseChecker):
    """The answers of a CurveChecker, one at a time and with little overhead.

    Where several curves are as short, all of them must be free: the caller may follow another one than trailmark.

    Args:
        checker: whose answers these are; kept alive, since the addresses are those of its arrays.
        steering: turning radius, and whether the car reverses; that of the checker's robot if None.

    Raises:
        ConfigurationError: neither ``steering`` nor a turning radius of the robot is given.
    """

    def __init__(self, checker: StateChecker, steering: Steering | None = None) -> None:
        super().__init__(checker)
        self.steering = CurveChecker(checker, steering).steering

    def motion_valid(self, a: tuple[float, float, float], b: tuple[float, float, float]) -> bool:
        """Return whether the shortest curve from a to b, both known to be valid, is certified free of collision."""
        steering = self.steering
        return bool(_curve(self._address, *a, *b, steering.radius, steering.reverse) == kernels.FREE)

    def step_valid(self, ax: float, ay: float, at: float, bx: float, by: float, bt: float) -> bool:
        """Return whether b is valid and the curve from a, known to be valid, to b is certified."""
        return self.valid(bx, by, bt) and self.motion_valid((ax, ay, at), (bx, by, bt))


@njit(cache=True)
def _curve(
    address: int,
    ax: float,
    ay: float,
    at: float,
    bx: float,
    by: float,
    bt: float,
    radius: float,
    reverse: bool,
) -> int:
    grid, field, robot = unpacked(address)
    placed, queue, ends = room_at(address)
    words = np.empty((MOST_WORDS, 2, PIECES))
    ends[0, 0], ends[0, 1], ends[0, 2] = ax, ay, at
    ends[1, 0], ends[1, 1], ends[1, 2] = bx, by, bt
    return int(every_curve_free(grid, field, robot, placed, queue, words, ends[0], ends[1], radius, reverse))
