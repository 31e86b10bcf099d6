"""PointwiseCurveChecker: one configuration or curve a call, for callers that ask one at a time, such as OMPL."""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, fabs

import numpy as np
from numba import carray  # type: ignore[attr-defined]  # numba does export it

from trailmark.collision import kernels
from trailmark.collision.certify import curve_motion
from trailmark.collision.checker import StateChecker
from trailmark.compiled import njit
from trailmark.curves import Steering
from trailmark.curves.shortest import MOST_WORDS, all_words, as_long, shortest_of
from trailmark.curves.words import PIECES, reversed_word, unit_length, walk
from trailmark.motion.curve import CurveMotion
from trailmark.motion.pointwise import PointwiseChecker, given, pointer, room_at, unpacked
from trailmark.se2 import FloatArray

__all__ = ["TIE", "PointwiseCurveChecker"]

TIE, APART = 1e-8, 1e-6
"""Metres: a curve that differs in length by no more may be another program's; one that differs by more is not."""

MOST_MARKS, LONGEST_ARC, LAST = 32, 2.0, 1.0 - 2.0**-40
"""Rows for a curve's marks; radians from one to the next on an arc; where the last one is instead of at the end."""

Configuration = tuple[float, float, float]


class PointwiseCurveChecker(PointwiseChecker):
    """The answers of a CurveMotion, one at a time and with little overhead.

    Args:
        checker: whose answers these are; kept alive, since the addresses are those of its arrays.
        steering: turning radius, and whether the car reverses; that of the checker's robot if None.

    Raises:
        ConfigurationError: neither ``steering`` nor a turning radius of the robot is given.
    """

    def __init__(self, checker: StateChecker, steering: Steering | None = None) -> None:
        self.steering = CurveMotion(checker, steering).steering
        room = np.empty((MOST_MARKS + 1, 4))
        self._length, self._marks = room[0], room[1:]
        self._room_address: int = room.ctypes.data
        super().__init__(checker)

    def _warm_up(self) -> None:
        super()._warm_up()
        inside = (float(self.checker.world.bounds[0]), float(self.checker.world.bounds[1]), 0.0)
        self.shortest(inside, inside)
        next(self.others(inside, inside, 0.0), None)

    def motion_valid(self, a: Configuration, b: Configuration) -> bool:
        """Return whether the shortest curve from a to b, both known to be valid, is certified free of collision."""
        return self._certified(a, b, 0.0, 0) > 0

    def step_valid(self, ax: float, ay: float, at: float, bx: float, by: float, bt: float) -> bool:
        """Return whether b is valid and the curve from a, known to be valid, to b is certified."""
        return self.valid(bx, by, bt) and self.motion_valid((ax, ay, at), (bx, by, bt))

    def shortest(self, a: Configuration, b: Configuration) -> tuple[float, list[list[float]]] | None:
        """Return length (metres) and marks of the shortest curve from a to b, both valid; None if it is not certified.

        Marks are for those who drive curves of another program's, which may take another one of those that lead to b,
        by rounding or where several are as short. They are rows of fraction of the length, x, y and heading. A curve of
        arcs and straight lines that is as long and passes them is this one: nearly at its end, and either halfway, if
        no other one from a to b is as long, or all along it.
        """
        count = self._certified(a, b, 0.0, 0)
        return (float(self._length[0]), self._marks[:count].tolist()) if count > 0 else None

    def others(self, a: Configuration, b: Configuration, length: float) -> Iterator[list[list[float]]]:
        """Yield the marks of each certified curve from a to b, both valid, ``length`` metres long, but the shortest."""
        number = 1
        while (count := self._certified(a, b, length, number)) >= 0:
            if count > 0:
                yield self._marks[:count].tolist()
            number += 1

    def _certified(self, a: Configuration, b: Configuration, length: float, number: int) -> int:
        """Certify a curve and have its marks written; return what :func:`_curve` does."""
        steering, address = self.steering, self._address
        return int(_curve(address, *a, *b, steering.radius, steering.reverse, length, number, self._room_address))


@njit(cache=True)
def _mark(a: FloatArray, word: FloatArray, radius: float, alone: bool, marks: FloatArray) -> int:
    """Write the marks of a word from a into ``marks``, shape (MOST_MARKS, 4); return how many there are.

    The last one is nearly at the end, where what leads elsewhere is found out. Unless the word is alone in its length,
    there is one at the end of each piece too, on arcs often enough, and in the middle of straight lines: from one mark
    to the next, an arc shorter than half a turn to one side, or a straight line, is the only way to turn as much and to
    get as far.
    """
    total, q = unit_length(word), np.empty(3)
    marks[0, 0], n = 0.5, 1
    if not alone:
        n, before = 0, 0.0
        for k in range(PIECES):
            way = fabs(word[0, k])
            # What is shorter than rounding may end where the next one does.
            if way * radius > kernels.ROUNDING:
                parts = 2 if word[1, k] == 0.0 else max(1, ceil(way / LONGEST_ARC))
                for i in range(1, parts + 1):
                    marks[n, 0] = (before + way * i / parts) / total
                    n += marks[n, 0] < LAST
            before += way
    marks[n, 0] = LAST
    n += 1
    for i in range(n):
        walk(a, word, radius, marks[i, 0] * total * radius, q)
        marks[i, 1:] = q
    return n


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
    length: float,
    number: int,
    room_address: int,
) -> int:
    """Certify one of the curves from a to b: number 0 is the shortest, the others are ``length`` metres long.

    The length of the shortest one is written to the room's first row, the curve's marks to those after it.

    Returns:
        How many marks were written, 0 if the curve is not certified, -1 if there is none of that number nor after it.
    """
    if not (given(ax, ay, at) and given(bx, by, bt)):
        return -1
    grid, field, robot = unpacked(address)
    placed, queue, ends = room_at(address)
    room = carray(pointer(room_address), (MOST_MARKS + 1, 4), np.float64)
    words = np.empty((MOST_WORDS, 2, PIECES))
    ends[0, 0], ends[0, 1], ends[0, 2] = ax, ay, at
    ends[1, 0], ends[1, 1], ends[1, 2] = bx, by, bt
    n, swapped = all_words(ends[0], ends[1], radius, reverse, words)
    best, shortest = shortest_of(words, n)
    chosen = best if number == 0 else as_long(words, n, best, length / radius, TIE / radius, number)
    if chosen < 0:
        return -1
    word = reversed_word(words[chosen]) if swapped else words[chosen]
    if curve_motion(grid, field, robot, placed, queue, ends[0], word, radius) != kernels.FREE:
        return 0
    room[0, 0] = radius * shortest
    alone = number == 0 and as_long(words, n, best, shortest, APART / radius, 1) < 0
    return _mark(ends[0], word, radius, alone, room[1:])
