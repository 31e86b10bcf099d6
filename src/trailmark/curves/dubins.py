"""Dubins curves: the shortest ones of a car that turns on circles of one radius and drives forwards only.

Source: Dubins, "On curves of minimal length with a constraint on average curvature, and with prescribed initial and
terminal positions and tangents", American Journal of Mathematics 79, 1957: the shortest curve is one of six words,
CSC (LSL, RSR, LSR, RSL) or CCC with a middle arc longer than half a turn (LRL, RLR). Unlike those of cars that
reverse, lengths are not continuous: a goal beside the car costs whole circles.

So where rounding alone sets the goal aside, it must not cost a circle: an arc that is short of 0 by so little that it
moves the goal by no more than rounding does is left out.
"""

from __future__ import annotations

from math import asin, atan2, cos, fabs, floor, hypot, pi, sin, sqrt

from trailmark.curves.words import SAME, put
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = ["dubins_words"]

_CSC_SAME, _CSC_OTHER, _CCC = (1.0, 0.0, 1.0, 0.0, 0.0), (1.0, 0.0, -1.0, 0.0, 0.0), (1.0, -1.0, 1.0, 0.0, 0.0)


@callee
def _turn(angle: float, spare: float) -> float:
    """Return an angle in [0, 2 pi), one that is no farther than ``spare`` below a full turn as 0."""
    turn = angle - 2.0 * pi * floor(angle / (2.0 * pi))
    return 0.0 if turn >= 2.0 * pi - spare else turn


@callee
def _outer(first: float, total: float, side: float, spare: float) -> tuple[float, float]:
    """Return the first and the last arc, together ``total``, or their difference if ``side`` is -1.

    Leaving out up to ``spare`` of the first arc turns all that follows about its centre; the last arc makes up for the
    heading. Where nothing is left of the last one, the first makes up for it.
    """
    t = _turn(first, spare)
    v = _turn(side * (total - t), spare)
    return (t, v) if v > 0.0 else (_turn(total, SAME), 0.0)


@njit(numbers=True)
def dubins_words(x: float, y: float, phi: float, same: float, words: FloatArray) -> int:
    """Write the words that lead to (x, y, phi) to ``words``; return how many there are (at least one).

    Args:
        x: ahead of the car, turning radii.
        y: to its left, turning radii.
        phi: heading relative to the car's, radians in (-pi, pi].
        same: turning radii by which rounding may have moved (x, y); words may end as far beside it.
        words: shape (m, 2, 5), m >= 9.
    """
    n = 0
    if fabs(y) < same and fabs(phi) < SAME and x > -same:
        # Straight; the turns that rounding asks for must not become full circles.
        n = put(words, n, _CSC_SAME, (0.0, max(x, 0.0), 0.0, 0.0, 0.0), 1.0, 1.0, False)
    for k in range(2):
        mirror = 1.0 - 2.0 * k
        ym, pm = mirror * y, mirror * phi
        s, c = sin(pm), cos(pm)
        # Centres of the left circles at the start (0, 1) and at the goal; of the right one at the goal.
        dx, dy = x - s, ym - 1.0 + c
        ex, ey = x + s, ym - 1.0 - c
        d, e = hypot(dx, dy), hypot(ex, ey)
        # The angle by which a turn about the start's centre moves the goal's by ``same`` at most.
        spare = same / max(d, same)
        if d < same:
            # One circle: how its arc is shared out among the two turns is all the same.
            n = put(words, n, _CSC_SAME, (_turn(pm, SAME), 0.0, 0.0, 0.0, 0.0), 1.0, mirror, False)
        else:
            t, v = _outer(atan2(dy, dx), pm, 1.0, spare)
            n = put(words, n, _CSC_SAME, (t, d, v, 0.0, 0.0), 1.0, mirror, False)
        if e > 2.0 - same:
            u = sqrt(max(0.0, e * e - 4.0))
            t, v = _outer(atan2(ey, ex) + atan2(2.0, u), pm, -1.0, same / e)
            n = put(words, n, _CSC_OTHER, (t, u, v, 0.0, 0.0), 1.0, mirror, False)
        if d <= 4.0:
            # The middle circle touches both others; its shorter arc, driven backwards, would be 2 asin(d / 4).
            middle = 2.0 * asin(0.25 * d)
            t, v = _outer(atan2(dy, dx) - 0.5 * middle + pi, pm - middle, 1.0, spare)
            n = put(words, n, _CCC, (t, 2.0 * pi - middle, v, 0.0, 0.0), 1.0, mirror, False)
    return n
