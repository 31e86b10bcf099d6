"""Words: curves made of at most five pieces, each an arc to the left, an arc to the right, or straight.

A word is an array of shape (2, 5): row 0 holds the pieces' signed lengths in units of the turning radius (negative:
driven backwards), row 1 their sides: 1 left, 0 straight, -1 right. Pieces of length 0 do not count.
"""

from __future__ import annotations

from math import cos, fabs, sin

import numpy as np

from trailmark.heading import turn, wrapped
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = ["PIECES", "SAME", "drive", "put", "reversed_word", "rounding", "seen_from", "unit_length", "walk"]

PIECES = 5
"""Maximum number of pieces of a word."""

SAME = 1e-10
"""Turning radii, and radians, by which a configuration that counts as on a straight line or an arc may lie off it."""

_PLACES = 16 * 2.0**-52
"""Maximum effect of rounding on a place, as a part of the largest coordinate: a few roundings of each end."""


@njit(numbers=True)
def drive(x: float, y: float, theta: float, side: float, length: float, radius: float) -> tuple[float, float, float]:
    """Return where a car is after ``length`` metres (negative: backwards) on one side; the heading is not wrapped.

    The chord of the arc is used, which loses no digits where the arc is short or the radius large.
    """
    half = 0.5 * side * length / radius
    chord = length if fabs(half) < 1e-9 else length * sin(half) / half
    return x + chord * cos(theta + half), y + chord * sin(theta + half), theta + 2.0 * half


@njit(numbers=True)
def walk(a: FloatArray, word: FloatArray, radius: float, along: float, q: FloatArray) -> None:
    """Write the configuration ``along`` metres from a on a word to q, heading in (-pi, pi]; at most its end."""
    x, y, theta = a[0], a[1], a[2]
    left = along / radius
    for k in range(PIECES):
        part = min(fabs(word[0, k]), left)
        left -= part
        signed = part if word[0, k] > 0.0 else -part
        x, y, theta = drive(x, y, theta, word[1, k], signed * radius, radius)
        if left <= 0.0:
            break
    q[0], q[1] = x, y
    q[2] = wrapped(theta)


@njit(numbers=True)
def unit_length(word: FloatArray) -> float:
    """Return a word's length in turning radii."""
    total = 0.0
    for k in range(PIECES):
        total += fabs(word[0, k])
    return total


@callee
def put(
    words: FloatArray,
    n: int,
    sides: tuple[float, float, float, float, float],
    lengths: tuple[float, float, float, float, float],
    flip: float,
    mirror: float,
    backward: bool,
) -> int:
    """Write a word as row n of ``words``, shape (m, 2, 5); return n + 1.

    Args:
        words: the array.
        n: the row.
        sides: of the pieces.
        lengths: signed, in turning radii.
        flip: -1 changes the direction of driving of every piece.
        mirror: -1 swaps left and right.
        backward: whether the pieces come in the opposite order.
    """
    for k in range(PIECES):
        at = PIECES - 1 - k if backward else k
        words[n, 0, at] = flip * lengths[k]
        words[n, 1, at] = mirror * sides[k]
    return n + 1


@njit(numbers=True)
def seen_from(a: FloatArray, b: FloatArray, radius: float) -> tuple[float, float, float]:
    """Return b in a's frame: x and y in turning radii, the heading in (-pi, pi]."""
    dx, dy = (b[0] - a[0]) / radius, (b[1] - a[1]) / radius
    c, s = cos(a[2]), sin(a[2])
    return c * dx + s * dy, c * dy - s * dx, turn(a[2], b[2])


@njit(numbers=True)
def rounding(a: FloatArray, b: FloatArray, radius: float) -> float:
    """Return the turning radii by which rounding may move b, seen from a, off the line or the arc that it is on."""
    largest = max(fabs(a[0]), fabs(a[1]), fabs(b[0]), fabs(b[1]))
    return max(SAME, _PLACES * largest / radius)


@njit
def reversed_word(word: FloatArray) -> FloatArray:
    """Return the word of the same curve in the opposite direction."""
    back = np.empty_like(word)
    for k in range(PIECES):
        back[0, PIECES - 1 - k] = -word[0, k]
        back[1, PIECES - 1 - k] = word[1, k]
    return back
