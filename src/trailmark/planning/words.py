"""Another word: a car's curve between two places that is not the shortest, as states whose shortest curves follow it.

The shortest curve may change its direction where a longer one does not.
"""

from __future__ import annotations

from math import ceil, fabs, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import by_type, njit, variant_of
from trailmark.curves.shortest import all_words
from trailmark.curves.words import PIECES, reversed_word, unit_length, walk
from trailmark.motion.base import Scratch
from trailmark.motion.curve import Curve, word_extra
from trailmark.motion.differential import Differential
from trailmark.motion.straight import Straight
from trailmark.motion.translation import Translation
from trailmark.motion.weighted import Weighted
from trailmark.planning.proposals import uniform
from trailmark.se2 import FloatArray

__all__ = ["another_word"]

PASSED_OVER = 0.3
"""Probability that the cheapest word is passed over for the next one: it may collide."""

LONGEST_ARC = 0.5 * pi
"""Radians: an arc up to this is the shortest curve between its ends."""


@by_type
def another_word(kind: Any, scratch: Scratch, a: FloatArray, b: FloatArray, seed: NDArray[np.uint64]) -> FloatArray:
    """Return states from a to b, shape (n, 3), whose motions make up one of a car's cheapest words."""
    raise NotImplementedError


@variant_of(another_word, Straight)
@variant_of(another_word, Differential)
@variant_of(another_word, Translation)
@njit(cache=True)
def _no_word(kind: Any, scratch: Scratch, a: FloatArray, b: FloatArray, seed: NDArray[np.uint64]) -> FloatArray:
    return np.empty((0, 3))


@variant_of(another_word, Weighted)
@njit(cache=True)
def _weighted_word(
    kind: Weighted, scratch: Scratch, a: FloatArray, b: FloatArray, seed: NDArray[np.uint64]
) -> FloatArray:
    return another_word(kind.motion, scratch, a, b, seed)


@variant_of(another_word, Curve)
@njit(cache=True)
def _another_word(kind: Curve, scratch: Scratch, a: FloatArray, b: FloatArray, seed: NDArray[np.uint64]) -> FloatArray:
    words = scratch.words
    # Every other time one of Dubins, driven forwards or backwards all the way.
    one_way = uniform(seed) < 0.5
    if one_way and uniform(seed) < 0.5:
        n, swapped = all_words(b, a, kind.radius, False, words)[0], True
    else:
        n, swapped = all_words(a, b, kind.radius, not one_way, words)
    prices = np.empty(n)
    for k in range(n):
        if swapped:
            words[k] = reversed_word(words[k])
        more = word_extra(words[k], kind.radius, kind.direction_change, kind.reverse_metre, 0.0)[0]
        prices[k] = kind.radius * unit_length(words[k]) + more
    best = int(np.argmin(prices))
    while n > 1 and uniform(seed) < PASSED_OVER:
        prices[best] = np.inf
        best = int(np.argmin(prices))
    word = words[best].copy()
    states = np.empty((1 + 8 * PIECES, 3))
    states[0], count, along = a, 1, 0.0
    for k in range(PIECES):
        parts = ceil(fabs(word[0, k]) / LONGEST_ARC) if word[1, k] != 0.0 else 1
        for _ in range(parts if word[0, k] != 0.0 else 0):
            along += fabs(word[0, k]) / parts
            walk(a, word, kind.radius, kind.radius * along, states[count])
            count += 1
    states[count - 1] = b
    return states[:count]
