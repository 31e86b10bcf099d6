"""sparse_path: a certified path with fewer vertices, for programs that process it further.

Around corners, shortest paths are polylines of many short motions, none of which can be left out. OMPL's path
simplifier halves every motion of a path in each of its rounds and removes vertices at random; where it removes fewer
than it adds, the path doubles from round to round, and one of its steps (``collapseCloseVertices``) takes a time that
grows with the third power of that: it does not return.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import hypot

import numpy as np

from trailmark import se2
from trailmark.collision.certify import BUDGET
from trailmark.heading import turn, wrapped
from trailmark.motion import StraightMotion
from trailmark.motion.pointwise import PointwiseChecker
from trailmark.planning.shortening import without_needless

__all__ = ["sparse_path"]

Configuration = tuple[float, float, float]

SLACK = 1e-4
"""Share of its cost that a path may get longer by."""

SHARES = tuple(2.0**-k for k in range(14, -1, -2) for _ in range(3))
"""Rounds, by the part of the slack that one corner may take: neighbours are joined three times in each size."""

MAX_CHECKS = 1000
"""Corners checked at most, so that a path is ready for OMPL within milliseconds."""


def sparse_path(single: PointwiseChecker, states: se2.FloatArray) -> se2.FloatArray:
    """Return a certified path with the same ends and fewer vertices, longer by SLACK of its cost at most.

    Vertices that are not needed are left out; two neighbours become one, best where the motions before and after them
    meet if they are extended: a corner instead of an arc.

    Args:
        single: certifies the motions.
        states: shape (n, 3), joined by certified motions.

    Returns:
        Shape (m, 3), m <= n.
    """
    rows = np.array(states, dtype=np.float64, order="C")
    if len(rows) > 2:
        rows = np.asarray(without_needless(StraightMotion(single.checker).kind, rows, BUDGET))
    # Plain numbers: numpy takes ten times as long for single ones.
    path: list[Configuration] = [(x, y, theta) for x, y, theta in rows.tolist()]
    slack, checks = SLACK * float(np.sum(se2.distance(rows[:-1], rows[1:]))), 0
    left, refused = slack, set()
    # What costs least first: one corner must not use up what makes many.
    for share in SHARES:
        i = 1
        while i + 2 < len(path) and checks < MAX_CHECKS:
            p, a, b, q = path[i - 1 : i + 3]
            old = _cost(p, a) + _cost(a, b) + _cost(b, q)
            for one in _replacements(p, a, b, q):
                longer = _cost(p, one) + _cost(one, q) - old
                if longer <= min(left, share * slack) and (p, one, q) not in refused:
                    checks += 1
                    if single.step_valid(*p, *one) and single.motion_valid(one, q):
                        path[i : i + 2] = [one]
                        left -= max(0.0, longer)
                        break
                    refused.add((p, one, q))
            i += 1
    return np.array(path)


def _difference(a: Configuration, b: Configuration) -> Configuration:
    return b[0] - a[0], b[1] - a[1], turn(a[2], b[2])


def _cost(a: Configuration, b: Configuration) -> float:
    return hypot(b[0] - a[0], b[1] - a[1]) + se2.ROTATION_WEIGHT * abs(turn(a[2], b[2]))


def _dot(a: Configuration, b: Configuration) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _replacements(p: Configuration, a: Configuration, b: Configuration, q: Configuration) -> Iterator[Configuration]:
    """Yield configurations that may stand for both a and b between p and q."""
    there, back, between = _difference(p, a), _difference(q, b), _difference(a, b)
    # Where the lines from p through a and from q through b come nearest to one another, in x, y and heading.
    tt, tb, bb, t, k = (
        _dot(there, there),
        _dot(there, back),
        _dot(back, back),
        _dot(there, between),
        _dot(back, between),
    )
    parallel = tt * bb - tb * tb
    if parallel > 1e-12 * tt * bb:
        on, off = (t * bb - k * tb) / parallel, (t * tb - k * tt) / parallel
        if on >= 0.0 and off >= 0.0:
            x, y, theta = (a[i] + 0.5 * (on * there[i] + between[i] + off * back[i]) for i in range(3))
            yield x, y, wrapped(theta)
    yield a
    yield b
