"""Needless vertices of a path: those whose neighbours a certified motion joins at no higher cost."""

from __future__ import annotations

from typing import Any

import numpy as np

from trailmark.compiled import njit
from trailmark.motion.base import Scratch, certified, charged, cost, extra_along, new_scratch, obeys_triangle
from trailmark.se2 import FloatArray

__all__ = ["GAIN", "without_needless"]

GAIN = 1e-7
"""Metres that a change must save at least."""


@njit(cache=True, nogil=True)
def without_needless(kind: Any, path: FloatArray, effort: int) -> FloatArray:
    """Return a path of certified motions without vertices whose neighbours a certified motion joins; shape (m, 3).

    None of what is left is needless: what lies beside a vertex left out is looked at again. The cost rises by no more
    than rounding, mostly by the triangle inequality.

    Args:
        kind: of motion.
        path: shape (n, 3).
        effort: configurations evaluated for one motion at most.
    """
    scratch = new_scratch(kind)
    n = len(path)
    before, after = np.arange(n) - 1, np.arange(n) + 1
    kept, waits = np.ones(n, np.bool_), np.ones(n, np.bool_)
    waiting = np.arange(n)[::-1].copy()
    size = n
    while size > 0:
        size -= 1
        i = waiting[size]
        waits[i] = False
        if i == 0 or i == n - 1 or not kept[i]:
            continue
        a, b = before[i], after[i]
        rows = (max(before[a], 0), a, i, b, min(after[b], n - 1))
        if (charged(kind) or not obeys_triangle(kind)) and _rise(kind, scratch, path, rows) > GAIN:
            continue
        if certified(kind, scratch, path[a], path[b], effort):
            kept[i] = False
            after[a], before[b] = b, a
            for j in (b, a):
                if not waits[j]:
                    waits[j] = True
                    waiting[size] = j
                    size += 1
    return path[kept]


@njit(cache=True)
def _rise(kind: Any, scratch: Scratch, path: FloatArray, rows: tuple[int, int, int, int, int]) -> float:
    """Return what a path costs more, in metres, without the third of five vertices that follow one another."""
    window = np.empty((5, 3))
    for k in range(5):
        window[k] = path[rows[k]]
    rise = -extra_along(kind, scratch, window, 0, 4)
    rise -= cost(kind, scratch, window[1], window[2]) + cost(kind, scratch, window[2], window[3])
    window[2:4] = window[3:]
    return rise + cost(kind, scratch, window[1], window[2]) + extra_along(kind, scratch, window, 0, 3)
