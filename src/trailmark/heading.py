"""Differences of headings, for compiled code: the one definition of which way round is the shorter.

:func:`trailmark.se2.wrap` and :func:`trailmark.se2.difference` compute the same, to the last bit, for numpy arrays.
What certifies a motion and what interpolates it later must never disagree: around half a turn, one would look at one
side of the robot while the other drives along the other.
"""

from __future__ import annotations

from math import pi

import numpy as np

from trailmark.jit import njit

__all__ = ["turn", "wrapped"]


@njit(numbers=True)
def wrapped(angle: float) -> float:
    """Return an angle (radians, finite) brought into (-pi, pi]; one that is there already comes back unchanged."""
    if -pi < angle <= pi:
        return angle
    if not -3.0 * pi < angle <= 3.0 * pi:
        angle -= 2.0 * pi * np.floor((angle + pi) / (2.0 * pi))
    # Exact between pi and 4 pi (Sterbenz), so that it has one sign only; twice where the line above was rounded.
    for _ in range(2):
        if angle > pi:
            angle -= 2.0 * pi
        elif angle <= -pi:
            angle += 2.0 * pi
    return angle


@njit(numbers=True)
def turn(a: float, b: float) -> float:
    """Return the shorter turn from heading a to heading b, radians in (-pi, pi]; exactly half a turn is +pi.

    Args:
        a: radians in [-pi, pi].
        b: radians in [-pi, pi].
    """
    return wrapped(b - a)
