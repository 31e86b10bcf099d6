"""Reeds-Shepp curves: the shortest ones of a car that turns on circles of one radius and also drives backwards.

Source: Reeds & Shepp, "Optimal paths for a car that goes both forwards and backwards", Pacific Journal of Mathematics
145, 1990. The shortest curve is one of 48 words. Nine formulas give them all (8.1 to 8.4 and 8.7 to 8.11; numbers are
the paper's), by driving in the opposite direction, by swapping left and right, and by reversing the pieces' order.
"""

from __future__ import annotations

from math import acos, asin, atan2, cos, fabs, floor, hypot, pi, sin, sqrt

from trailmark.curves.words import SAME, put
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray

__all__ = ["reeds_shepp_words"]

_SPARE = 1e-3
"""How far (radians, turning radii) a piece may be on the wrong side of 0: it is driven in the other direction then.

That leads to the goal as well, so that no word is lost to rounding, however large the coordinates."""

_LSL, _LSR, _LRL = (1.0, 0.0, 1.0, 0.0, 0.0), (1.0, 0.0, -1.0, 0.0, 0.0), (1.0, -1.0, 1.0, 0.0, 0.0)
_LRLR, _LRSL, _LRSR = (1.0, -1.0, 1.0, -1.0, 0.0), (1.0, -1.0, 0.0, 1.0, 0.0), (1.0, -1.0, 0.0, -1.0, 0.0)
_LRSLR = (1.0, -1.0, 0.0, 1.0, -1.0)


@callee
def _half_turn(angle: float) -> float:
    """Return an angle in [-pi, pi)."""
    return angle - 2.0 * pi * floor((angle + pi) / (2.0 * pi))


@callee
def _outer(first: float, total: float, side: float, spare: float) -> tuple[float, float]:
    """Return the first and the last arc, together ``total``, or their difference if ``side`` is -1.

    One that is below 0 by no more than ``spare``, by which a turn moves the goal no more than rounding does, is left
    out, so that it costs no cusp; the other one makes up for the heading.
    """
    t = _half_turn(first)
    if -spare <= t < 0.0:
        t = 0.0
    v = _half_turn(side * (total - t))
    return (_half_turn(total), 0.0) if -spare <= v < 0.0 else (t, v)


@callee
def _ends(u: float, v: float, xi: float, eta: float, phi: float) -> tuple[float, float]:
    """Return the first and the last arc (tau and omega, 8.5 and 8.6) of the words CCCC with middle arcs u and v."""
    delta = _half_turn(u - v)
    a, b = sin(u) - sin(delta), cos(u) - cos(delta) - 1.0
    t = atan2(eta * a - xi * b, xi * a + eta * b)
    if 2.0 * (cos(delta) - cos(v) - cos(u)) + 3.0 < 0.0:
        t += pi
    tau = _half_turn(t)
    return tau, _half_turn(tau - u + v - phi)


@njit(numbers=True)
def reeds_shepp_words(x: float, y: float, phi: float, same: float, words: FloatArray) -> int:
    """Write the words that lead to (x, y, phi) to ``words``; return how many there are (at least one).

    Args:
        x: ahead of the car, turning radii.
        y: to its left, turning radii.
        phi: heading relative to the car's, radians in (-pi, pi].
        same: turning radii by which rounding may have moved (x, y); words may end as far beside it.
        words: shape (m, 2, 5), m >= 56.
    """
    n = 0
    if fabs(y) < same and fabs(phi) < SAME:
        n = put(words, n, _LSL, (0.0, x, 0.0, 0.0, 0.0), 1.0, 1.0, False)
    sin_phi, cos_phi = sin(phi), cos(phi)
    for order in range(2):
        backward = order == 1
        # Where the pieces in the opposite order would lead to.
        xo = x * cos_phi + y * sin_phi if backward else x
        yo = x * sin_phi - y * cos_phi if backward else y
        for symmetry in range(4):
            flip, mirror = 1.0 - 2.0 * (symmetry & 1), 1.0 - (symmetry & 2)
            xs, ys, ps = flip * xo, mirror * yo, flip * mirror * phi
            s, c = flip * mirror * sin_phi, cos_phi
            # Centre of the goal's left circle, and of its right one, seen from the start's left circle.
            xl, yl, xr, yr = xs - s, ys - 1.0 + c, xs + s, ys - 1.0 - c
            dl, dr = hypot(xl, yl), hypot(xr, yr)
            if not backward:
                n = _same_in_both_orders(xl, yl, dl, xr, yr, dr, ps, same, flip, mirror, words, n)
            if dl <= 4.0:
                # 8.3 and 8.4: C|C|C and C|CC; in the opposite order CC|C.
                u = -2.0 * asin(0.25 * dl)
                t = _half_turn(atan2(yl, xl) + 0.5 * u + pi)
                if t >= -_SPARE:
                    n = put(words, n, _LRL, (t, u, _half_turn(ps - t + u), 0.0, 0.0), flip, mirror, backward)
            if dl >= 2.0:
                # 8.9: C|CSC with equal outer turns.
                r = sqrt(dl * dl - 4.0)
                t = _half_turn(atan2(yl, xl) + atan2(r, -2.0))
                v = _half_turn(ps - 0.5 * pi - t)
                if t >= -_SPARE and r >= 2.0 - _SPARE and v <= _SPARE:
                    n = put(words, n, _LRSL, (t, -0.5 * pi, 2.0 - r, v, 0.0), flip, mirror, backward)
            if dr >= 2.0:
                # 8.10: C|CSC with different outer turns.
                t = atan2(xr, -yr)
                v = _half_turn(t + 0.5 * pi - ps)
                if t >= -_SPARE and v <= _SPARE:
                    n = put(words, n, _LRSR, (t, -0.5 * pi, 2.0 - dr, v, 0.0), flip, mirror, backward)
    return n


@callee
def _same_in_both_orders(
    xl: float,
    yl: float,
    dl: float,
    xr: float,
    yr: float,
    dr: float,
    phi: float,
    same: float,
    flip: float,
    mirror: float,
    words: FloatArray,
    n: int,
) -> int:
    """Write the words of the formulas whose words come in both orders anyway; return how many rows there are now."""
    if dl < same:
        # One circle: how its arc is shared out among the two turns is all the same.
        n = put(words, n, _LSL, (phi, 0.0, 0.0, 0.0, 0.0), flip, mirror, False)
    else:
        # 8.1: CSC with equal turns.
        t, v = _outer(atan2(yl, xl), phi, 1.0, same / dl)
        if t >= -_SPARE and v >= -_SPARE:
            n = put(words, n, _LSL, (t, dl, v, 0.0, 0.0), flip, mirror, False)
    if dr > 2.0 - same:
        # 8.2: CSC with different turns.
        u = sqrt(max(0.0, dr * dr - 4.0))
        t, v = _outer(atan2(yr, xr) + atan2(2.0, u), phi, -1.0, same / dr)
        if t >= -_SPARE and v >= -_SPARE:
            n = put(words, n, _LSR, (t, u, v, 0.0, 0.0), flip, mirror, False)
    if dr <= 2.0:
        # 8.7: CC|CC.
        u = acos(0.5 + 0.25 * dr)
        t, v = _ends(u, -u, xr, yr, phi)
        if t >= -_SPARE and v <= _SPARE:
            n = put(words, n, _LRLR, (t, u, -u, v, 0.0), flip, mirror, False)
    if 4.0 <= dr * dr <= 20.0:
        # 8.8: C|CC|C.
        u = -acos((20.0 - dr * dr) / 16.0)
        t, v = _ends(u, u, xr, yr, phi)
        if t >= -_SPARE and v >= -_SPARE:
            n = put(words, n, _LRLR, (t, u, u, v, 0.0), flip, mirror, False)
    if dr >= sqrt(20.0):
        # 8.11: C|CSC|C.
        u = 4.0 - sqrt(dr * dr - 4.0)
        t = _half_turn(atan2((4.0 - u) * xr - 2.0 * yr, -2.0 * xr + (u - 4.0) * yr))
        v = _half_turn(t - phi)
        if t >= -_SPARE and v >= -_SPARE:
            n = put(words, n, _LRSLR, (t, -0.5 * pi, u, -0.5 * pi, v), flip, mirror, False)
    return n
