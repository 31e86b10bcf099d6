"""The shortest curve between two configurations, compiled: its word, its length, configurations along it."""

from __future__ import annotations

from math import fabs

import numpy as np

from trailmark.curves.dubins import dubins_words
from trailmark.curves.reeds_shepp import reeds_shepp_words
from trailmark.curves.words import PIECES, reversed_word, rounding, seen_from, unit_length, walk
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = [
    "all_words",
    "as_long",
    "curve_length",
    "curve_lengths",
    "curve_states",
    "curve_words",
    "shortest_of",
    "shortest_word",
]

MAX_WORDS = 56
"""Maximum number of words of either kind of car."""


@callee
def _comes_first(a: FloatArray, b: FloatArray) -> bool:
    """Return whether a comes before b in the order of x, then y, then heading, or is equal to it."""
    if a[0] != b[0]:
        return bool(a[0] < b[0])
    return bool(a[1] < b[1] if a[1] != b[1] else a[2] <= b[2])


@njit(numbers=True)
def all_words(a: FloatArray, b: FloatArray, radius: float, reverse: bool, words: FloatArray) -> tuple[int, bool]:
    """Write all words from a to b to ``words``; return how many there are, and whether they lead from b to a.

    For a car that reverses, the curve from b to a is exactly that from a to b in the opposite direction: both are
    computed from the one of a and b that comes first in the order of x, y, heading. If that is b, the words lead from b
    to a.
    """
    swapped = reverse and not _comes_first(a, b)
    x, y, phi = seen_from(b, a, radius) if swapped else seen_from(a, b, radius)
    same = rounding(a, b, radius)
    n = reeds_shepp_words(x, y, phi, same, words) if reverse else dubins_words(x, y, phi, same, words)
    return n, swapped


@callee
def shortest_of(words: FloatArray, n: int) -> tuple[int, float]:
    """Return which of the first n words is the shortest, the first of those that are, and its length in radii."""
    best, shortest = 0, np.inf
    for k in range(n):
        length = unit_length(words[k])
        if length < shortest:
            best, shortest = k, length
    return best, shortest


@njit
def shortest_word(a: FloatArray, b: FloatArray, radius: float, reverse: bool, words: FloatArray) -> FloatArray:
    """Return the word, shape (2, 5), of the shortest curve from a to b.

    Args:
        a: from, shape (3,).
        b: to, shape (3,).
        radius: turning radius, metres.
        reverse: whether the car drives backwards too.
        words: memory, shape (MAX_WORDS, 2, 5).
    """
    n, swapped = all_words(a, b, radius, reverse, words)
    best, _ = shortest_of(words, n)
    return reversed_word(words[best]) if swapped else words[best]


@callee
def as_long(words: FloatArray, n: int, best: int, length: float, slack: float, number: int) -> int:
    """Return which of the first n words, but ``best``, is the ``number``-th of that length (radii), -1 if none is."""
    for k in range(n):
        if k != best and fabs(unit_length(words[k]) - length) <= slack:
            number -= 1
            if number == 0:
                return k
    return -1


@callee
def curve_length(a: FloatArray, b: FloatArray, radius: float, reverse: bool, words: FloatArray) -> float:
    """Return the length (metres) of the shortest curve from a to b; ``words`` is memory as above."""
    n, _ = all_words(a, b, radius, reverse, words)
    return radius * shortest_of(words, n)[1]


@njit(nogil=True)
def curve_lengths(a: FloatArray, b: FloatArray, radius: float, reverse: bool) -> FloatArray:
    """Return the lengths (metres, shape (n,)) of the shortest curves from a to b, each of shape (n, 3)."""
    words = np.empty((MAX_WORDS, 2, PIECES))
    result = np.empty(len(a))
    for i in range(len(a)):
        result[i] = curve_length(a[i], b[i], radius, reverse, words)
    return result


@njit(nogil=True)
def curve_words(a: FloatArray, b: FloatArray, radius: float, reverse: bool) -> FloatArray:
    """Return the words, shape (n, 2, 5), of the shortest curves from a to b, each of shape (n, 3)."""
    words = np.empty((MAX_WORDS, 2, PIECES))
    result = np.empty((len(a), 2, PIECES))
    for i in range(len(a)):
        result[i] = shortest_word(a[i], b[i], radius, reverse, words)
    return result


@njit(nogil=True)
def curve_states(a: FloatArray, words: FloatArray, radius: float, along: FloatArray) -> FloatArray:
    """Return the configurations, shape (n, k, 3), ``along`` (n, k) metres from a (n, 3) on words (n, 2, 5)."""
    result = np.empty((along.shape[0], along.shape[1], 3))
    for i in range(along.shape[0]):
        for k in range(along.shape[1]):
            walk(a[i], words[i], radius, along[i, k], result[i, k])
    return result
