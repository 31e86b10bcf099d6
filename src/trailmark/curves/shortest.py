"""The shortest curve between two configurations, compiled: its word, its length, configurations along it."""

from __future__ import annotations

import numpy as np

from trailmark.compiled import njit
from trailmark.curves.dubins import dubins_words
from trailmark.curves.reeds_shepp import reeds_shepp_words
from trailmark.curves.words import PIECES, reversed_word, seen_from, unit_length, walk
from trailmark.se2 import FloatArray

__all__ = ["curve_length", "curve_lengths", "curve_states", "curve_words", "equally_short", "shortest_word"]

MOST_WORDS = 56
"""Rows that either kind of car asks for at most."""


@njit(cache=True, inline="always")
def _comes_first(a: FloatArray, b: FloatArray) -> bool:
    """Return whether a comes before b in the order of x, then y, then heading, or is equal to it."""
    if a[0] != b[0]:
        return bool(a[0] < b[0])
    return bool(a[1] < b[1] if a[1] != b[1] else a[2] <= b[2])


@njit(cache=True)
def equally_short(
    a: FloatArray, b: FloatArray, radius: float, reverse: bool, slack: float, words: FloatArray
) -> tuple[int, int, bool]:
    """Write the words from a to b into ``words``, shape (MOST_WORDS, 2, 5), the shortest ones first.

    Of a car that reverses, the curve from b to a is that from a to b driven back, to the last bit: it is always
    computed from the one that comes first. Where that is b, the words lead from b to a.

    Args:
        a: from, shape (3,).
        b: to, shape (3,).
        radius: turning radius, metres.
        reverse: whether the car drives backwards too.
        slack: metres by which words may be longer than the shortest.
        words: where to; the rest of it is used up.

    Returns:
        Index of the shortest word, how many are as short up to ``slack`` (rows 0 to that number), and whether they
        lead from b to a.
    """
    swapped = reverse and not _comes_first(a, b)
    x, y, phi = seen_from(b, a, radius) if swapped else seen_from(a, b, radius)
    n = reeds_shepp_words(x, y, phi, words) if reverse else dubins_words(x, y, phi, words)
    best, shortest = 0, np.inf
    for k in range(n):
        length = unit_length(words[k])
        if length < shortest:
            best, shortest = k, length
    if slack <= 0.0:
        return best, 1, swapped
    kept = 0
    for k in range(n):
        if unit_length(words[k]) <= shortest + slack / radius:
            words[kept] = words[k]
            best = kept if k == best else best
            kept += 1
    return best, kept, swapped


@njit(cache=True)
def shortest_word(a: FloatArray, b: FloatArray, radius: float, reverse: bool, words: FloatArray) -> FloatArray:
    """Return the word, shape (2, 5), of the shortest curve from a to b; ``words`` is room, shape (MOST_WORDS, 2, 5)."""
    best, _, swapped = equally_short(a, b, radius, reverse, 0.0, words)
    return reversed_word(words[best]) if swapped else words[best]


@njit(cache=True)
def curve_length(a: FloatArray, b: FloatArray, radius: float, reverse: bool, words: FloatArray) -> float:
    """Return the length (metres) of the shortest curve from a to b; ``words`` is room as above."""
    best, _, _ = equally_short(a, b, radius, reverse, 0.0, words)
    return radius * unit_length(words[best])


@njit(cache=True, nogil=True)
def curve_lengths(a: FloatArray, b: FloatArray, radius: float, reverse: bool) -> FloatArray:
    """Return the lengths (metres, shape (n,)) of the shortest curves from a to b, each of shape (n, 3)."""
    words = np.empty((MOST_WORDS, 2, PIECES))
    result = np.empty(len(a))
    for i in range(len(a)):
        result[i] = curve_length(a[i], b[i], radius, reverse, words)
    return result


@njit(cache=True, nogil=True)
def curve_words(a: FloatArray, b: FloatArray, radius: float, reverse: bool) -> FloatArray:
    """Return the words, shape (n, 2, 5), of the shortest curves from a to b, each of shape (n, 3)."""
    words = np.empty((MOST_WORDS, 2, PIECES))
    result = np.empty((len(a), 2, PIECES))
    for i in range(len(a)):
        result[i] = shortest_word(a[i], b[i], radius, reverse, words)
    return result


@njit(cache=True, nogil=True)
def curve_states(a: FloatArray, words: FloatArray, radius: float, along: FloatArray) -> FloatArray:
    """Return the configurations, shape (n, k, 3), ``along`` (n, k) metres from a (n, 3) on words (n, 2, 5)."""
    result = np.empty((along.shape[0], along.shape[1], 3))
    for i in range(along.shape[0]):
        for k in range(along.shape[1]):
            walk(a[i], words[i], radius, along[i, k], result[i, k])
    return result
