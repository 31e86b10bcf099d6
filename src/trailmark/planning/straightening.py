"""Straightening: a path of certified motions without the vertices that it does without."""

from __future__ import annotations

from typing import Any

import numpy as np

from trailmark.collision.certify import BUDGET
from trailmark.compiled import njit
from trailmark.motion.base import certified, new_scratch
from trailmark.se2 import FloatArray

__all__ = ["straighten", "without_needless"]


@njit(cache=True, nogil=True)
def straighten(kind: Any, path: FloatArray) -> FloatArray:
    """Return a path of certified motions with the vertices left out that it does without; shape (m, 3).

    From each vertex as far ahead as a certified motion leads, sought by doubling and halving.
    """
    scratch = new_scratch(kind)
    kept = np.empty_like(path)
    kept[0], m, i, n = path[0], 1, 0, len(path)
    while i < n - 1:
        good, step = i + 1, 2
        bad = n
        while good < n - 1:
            ahead = min(i + step, n - 1)
            if ahead >= bad:
                break
            if not certified(kind, scratch, path[i], path[ahead], BUDGET):
                bad = ahead
                break
            good, step = ahead, 2 * step
        while bad - good > 1:
            middle = (good + bad) // 2
            if middle >= n:
                break
            if certified(kind, scratch, path[i], path[middle], BUDGET):
                good = middle
            else:
                bad = middle
        i = good
        kept[m] = path[i]
        m += 1
    return kept[:m].copy()


@njit(cache=True, nogil=True)
def without_needless(kind: Any, path: FloatArray) -> FloatArray:
    """Return a path of certified motions without vertices whose neighbours a certified motion joins; shape (m, 3).

    None of what is left is needless: what lies beside a vertex left out is looked at again. By the triangle inequality
    the cost rises by no more than rounding.
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
        if certified(kind, scratch, path[a], path[b], BUDGET):
            kept[i] = False
            after[a], before[b] = b, a
            for j in (b, a):
                if not waits[j]:
                    waits[j] = True
                    waiting[size] = j
                    size += 1
    return path[kept]
