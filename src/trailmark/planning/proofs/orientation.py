"""On which side of a line a point lies, without rounding.

Source: Shewchuk, "Adaptive precision floating-point arithmetic and fast robust geometric predicates", Discrete &
Computational Geometry 18, 1997.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit

__all__ = ["ROUNDED", "orientation", "orientations"]

ROUNDED = 3.3306690738754716e-16
"""Share of its two products' sizes that a determinant may be wrong by: Shewchuk's bound A, (3 + 16 eps) eps."""

SPLITTER = 134217729.0
"""2^27 + 1: cuts a double into two halves whose products are exact."""


@njit(cache=True)
def orientation(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return a value above 0 if c lies left of the line from a to b, below 0 if right, 0 if it lies on it: exactly."""
    left, right = (ax - cx) * (by - cy), (ay - cy) * (bx - cx)
    det = left - right
    # Products of different signs, or with a factor of 0, have a sum of the right sign.
    if (left >= 0.0) != (right > 0.0) or left == 0.0 or right == 0.0:
        return det
    if abs(det) > ROUNDED * (abs(left) + abs(right)):
        return det
    return _exactly(ax, ay, bx, by, cx, cy)


@njit(cache=True)
def orientations(points: NDArray[np.float64], triples: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the orientation of each triple (m, 3) of points (v, 2), shape (m,); only its sign means something."""
    found = np.empty(len(triples))
    for k in range(len(triples)):
        a, b, c = points[triples[k, 0]], points[triples[k, 1]], points[triples[k, 2]]
        found[k] = orientation(a[0], a[1], b[0], b[1], c[0], c[1])
    return found


@njit(cache=True)
def _exactly(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the determinant's largest part: six products, each as a sum of two doubles, added up exactly."""
    # The parts, from the smallest to the largest; they do not overlap.
    parts, n = np.zeros(12), 0
    factors = ((ax, by), (-ax, cy), (-cx, by), (-ay, bx), (ay, cx), (cy, bx))
    for u, v in factors:
        product = u * v
        big = SPLITTER * u
        u1 = big - (big - u)
        u2 = u - u1
        big = SPLITTER * v
        v1 = big - (big - v)
        v2 = v - v1
        rest = u2 * v2 - (((product - u1 * v1) - u2 * v1) - u1 * v2)
        for term in (rest, product):
            total = term
            for i in range(n):
                part = parts[i]
                added = total + part
                virtual = added - total
                parts[i] = (total - (added - virtual)) + (part - virtual)
                total = added
            parts[n] = total
            n += 1
    for i in range(n - 1, -1, -1):
        if parts[i] != 0.0:
            return float(parts[i])
    return 0.0
