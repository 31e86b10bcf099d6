"""CurveMarks: places on a car's certified curves, by which another program's curves are recognised.

A program that moves along curves of its own may take another one than trailmark's of those that lead to the same place,
by rounding or where several are as short. A mark is a row of a fraction of the length, x, y and heading. A curve of
arcs and straight lines that is as long as a marked one and passes its marks is the same curve: nearly at its end, and
either halfway, if no other one is as long, or all along it.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, fabs

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import kernels
from trailmark.collision.certify import BUDGET, curve_motion
from trailmark.curves.shortest import all_words, as_long, shortest_of
from trailmark.curves.words import PIECES, reversed_word, unit_length, walk
from trailmark.errors import ConfigurationError
from trailmark.jit import array_callee, njit
from trailmark.motion.pointwise import (
    Configuration,
    Packed,
    PointwiseChecker,
    is_configuration,
    scratch_of,
    unpacked,
)
from trailmark.se2 import FloatArray

__all__ = ["TIE", "CurveMarks"]

TIE, DISTINCT = 1e-8, 1e-6
"""Metres: a curve whose length differs by no more than TIE may be another program's; one that differs by more than
DISTINCT is not."""

MAX_MARKS, LONGEST_ARC, LAST = 32, 2.0, 1.0 - 2.0**-40
"""Rows for a curve's marks; radians on an arc from one to the next; fraction of the last one, just before the end."""


class CurveMarks:
    """Certified curves between two configurations, as marks.

    Args:
        single: certifies the curves of its steering.

    Attributes:
        single: as given.
        steering: its steering.

    Raises:
        ConfigurationError: a checker without steering.
    """

    def __init__(self, single: PointwiseChecker) -> None:
        if single.steering is None:
            raise ConfigurationError("curve marks: expected a checker with steering, got one of straight motions")
        self.single, self.steering = single, single.steering
        rows = np.empty((MAX_MARKS + 1, 4))
        self._rows, self._length, self._marks = rows, rows[0], rows[1:]
        inside = (float(single.checker.world.bounds[0]), float(single.checker.world.bounds[1]), 0.0)
        # Compiled or loaded now, before a planner's clock runs.
        self.shortest(inside, inside)

    def shortest(self, a: Configuration, b: Configuration) -> tuple[float, list[list[float]]] | None:
        """Return length (metres) and marks of the shortest curve from a to b, both valid; None if not certified."""
        count = self._certify(a, b, 0.0, 0)
        return (float(self._length[0]), self._marks[:count].tolist()) if count > 0 else None

    def others(self, a: Configuration, b: Configuration, length: float) -> Iterator[list[list[float]]]:
        """Yield the marks of each other certified curve from a to b, both valid, that is ``length`` metres long."""
        number = 1
        while (count := self._certify(a, b, length, number)) >= 0:
            if count > 0:
                yield self._marks[:count].tolist()
            number += 1

    def _certify(self, a: Configuration, b: Configuration, length: float, number: int) -> int:
        """Certify a curve and write its marks; return what :func:`_marked_curve` does."""
        # Held meanwhile: the checker may be updated in another thread.
        steering, packed = self.steering, self.single.packed
        return int(_marked_curve(*packed.arrays, *a, *b, steering.radius, steering.reverse, length, number, self._rows))


@array_callee
def _mark(a: FloatArray, word: FloatArray, radius: float, alone: bool, marks: FloatArray) -> int:
    """Write the marks of a word from a into ``marks``, shape (MAX_MARKS, 4); return how many there are.

    The last one is nearly at the end, which curves that lead elsewhere do not pass. If another word is as long, each
    piece has a mark at its end too, a straight line one in its middle, and a long arc several: from one mark to the
    next, an arc shorter than half a turn to one side, or a straight line, is the only curve with the same turn and
    distance.
    """
    total, q = unit_length(word), np.empty(3)
    marks[0, 0], n = 0.5, 1
    if not alone:
        n, before = 0, 0.0
        for k in range(PIECES):
            length = fabs(word[0, k])
            # A piece shorter than rounding may end where the next one does.
            if length * radius > kernels.ROUNDING:
                parts = 2 if word[1, k] == 0.0 else max(1, ceil(length / LONGEST_ARC))
                for i in range(1, parts + 1):
                    marks[n, 0] = (before + length * i / parts) / total
                    n += marks[n, 0] < LAST
            before += length
    marks[n, 0] = LAST
    n += 1
    for i in range(n):
        walk(a, word, radius, marks[i, 0] * total * radius, q)
        marks[i, 1:] = q
    return n


@njit
def _marked_curve(
    floats: FloatArray,
    integers: NDArray[np.int32],
    distance: NDArray[np.float32],
    places: NDArray[np.int64],
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
    rows: FloatArray,
) -> int:
    """Certify one of the curves from a to b: number 0 is the shortest, the others are ``length`` metres long.

    The length of the shortest one is written to the first of the ``rows``, the curve's marks to the next ones.

    Returns:
        How many marks were written, 0 if the curve is not certified, -1 if there is no curve of that number.
    """
    if not (is_configuration(ax, ay, at) and is_configuration(bx, by, bt)):
        return -1
    packed = Packed(floats, integers, distance, places)
    (grid, field, robot), (scratch, ends) = unpacked(packed), scratch_of(packed)
    words = scratch.words
    ends[0, 0], ends[0, 1], ends[0, 2] = ax, ay, at
    ends[1, 0], ends[1, 1], ends[1, 2] = bx, by, bt
    n, swapped = all_words(ends[0], ends[1], radius, reverse, words)
    best, shortest = shortest_of(words, n)
    chosen = best if number == 0 else as_long(words, n, best, length / radius, TIE / radius, number)
    if chosen < 0:
        return -1
    word = reversed_word(words[chosen]) if swapped else words[chosen]
    if curve_motion(grid, field, robot, scratch.placed, scratch.queue, ends[0], word, radius, BUDGET) != kernels.FREE:
        return 0
    rows[0, 0] = radius * shortest
    alone = number == 0 and as_long(words, n, best, shortest, DISTINCT / radius, 1) < 0
    return _mark(ends[0], word, radius, alone, rows[1:])
