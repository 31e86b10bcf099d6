"""Measures of a path that the referee accepted: how smooth it is, how sharply it bends, how near it comes."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.benchmark.referee import Referee

__all__ = ["Measures", "measured"]

FloatArray = NDArray[np.float64]

PIECES = 256
"""Parts into which a path is cut at first; those that may hold its least clearance are halved."""

PRECISE, FINEST = 1e-3, 4096
"""Metres by which the least clearance may be found too large; on longer ways their length over this number."""

BENDS = 20
"""Chords of a car's quarter turn."""

WINDOWS = 4
"""Places, for each scale's length, at which the curvature is read."""

LONGEST = 20_000
"""Places at most, on paths of thousands of metres."""


class Measures(NamedTuple):
    """What one path is like.

    Attributes:
        smoothness: how much the direction of travel turns for each metre (radians / metre): the sum of all turns, a
            car's changes of direction as half turns, over the length; 0 is straight. Bench-MR calls it angle over
            length.
        max_curvature: largest turn (radians) from the chord behind a place to the chord ahead of it over a chord's
            length (metres), which is the inscribed radius: a corner has no curvature of its own. A car's changes of
            direction do not count; else its curvature is that of its circles, but for the chords.
        min_clearance: least distance to obstacles, boundary and bounds (metres), too large by PRECISE, or a FINESTth of
            the way, at most.
    """

    smoothness: float
    max_curvature: float
    min_clearance: float


def measured(referee: Referee, path: ArrayLike, scale: float) -> Measures:
    """Return the measures of a path.

    Args:
        referee: of its problem.
        path: states, shape (n, 3), as the referee took them.
        scale: metres over which curvature is read: the robot's inscribed radius.
    """
    states = np.asarray(path, dtype=np.float64)
    points = _line(referee, states, scale)
    steps = np.diff(points, axis=0)
    lengths = np.hypot(*steps.T)
    moved = lengths > 1e-9
    steps, lengths = steps[moved], lengths[moved]
    turns = _turns(steps)
    length = float(lengths.sum())
    smoothness = float(np.abs(turns).sum()) / length if length > 0.0 else 0.0
    places = np.vstack([points[:1], points[1:][moved]])
    if referee.steering is None:
        lines = [places]
    else:  # one for each way between two changes of direction
        cusps = 1 + np.flatnonzero(np.abs(turns) > 0.5 * np.pi)
        lines = [places[a : b + 1] for a, b in pairwise([0, *cusps, len(places) - 1])]
    curvature = max(_curvature(line, scale) for line in lines)
    return Measures(smoothness, curvature, _least_clearance(referee, states))


def _line(referee: Referee, states: FloatArray, scale: float) -> FloatArray:
    """Return the way of the reference point as a line, shape (n, 2); a car's curves as chords."""
    if referee.steering is None or len(states) == 1:
        return states[:, :2]
    step = min(0.5 * np.pi * referee.steering.radius / BENDS, scale / WINDOWS)
    parts = [states[:1]]
    for a, b in pairwise(states):
        n = min(LONGEST, max(1, int(np.ceil(referee.steering.lengths(a, b) / step))))
        parts.append(referee.between(a, b, np.arange(1, n + 1) / n))
    return np.vstack(parts)[:, :2]


def _turns(steps: FloatArray) -> FloatArray:
    """Return the angles from each step, shape (n, 2), to the next one."""
    return _angles(steps[:-1], steps[1:])


def _angles(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)))


def _curvature(points: FloatArray, scale: float) -> float:
    """Return the largest turn between chords of a length, over that length, along a line of different points.

    A line shorter than two chords has shorter ones.
    """
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    scale = min(scale, 0.5 * float(along[-1]))
    if scale <= 0.0:
        return 0.0
    count = min(LONGEST, int(WINDOWS * along[-1] / scale) + 2)
    # At corners too, where the turn is largest.
    places = np.concatenate([np.linspace(scale, along[-1] - scale, count), along[1:-1]])
    places = places[(places >= scale) & (places <= along[-1] - scale)]
    behind, here, ahead = (
        np.column_stack([np.interp(places + shift, along, points[:, i]) for i in (0, 1)])
        for shift in (-scale, 0.0, scale)
    )
    a, b = here - behind, ahead - here
    return float(np.abs(_angles(a, b)).max(initial=0.0)) / scale


def _least_clearance(referee: Referee, states: FloatArray) -> float:
    """Return the least clearance, by halves: from a part's middle, none of the robot moves by more than half a part."""
    least = float(referee.clearance(states).min())
    bounds = np.array([referee.bound(a, b) for a, b in pairwise(states)])
    whole = float(bounds.sum())
    precise = max(PRECISE, whole / FINEST)
    counts = np.where(bounds > 0.0, np.maximum(1, np.ceil(PIECES * bounds / (whole or 1.0))), 0).astype(int)
    # Of each part: its motion, and where on that it begins and how long it is, as shares of the motion.
    motion = np.repeat(np.arange(len(counts)), counts)
    share = 1.0 / counts[motion]
    low = share * np.concatenate([np.arange(n) for n in counts] or [np.empty(0)])
    while len(motion):
        middle, moved = low + 0.5 * share, 0.5 * share * bounds[motion]
        between = [referee.between(states[i], states[i + 1], middle[motion == i]) for i in np.unique(motion)]
        found = referee.clearance(np.vstack(between), least + float(moved.max()))
        least = min(least, float(found.min()))
        open_ = found - moved < least - precise
        motion, low, share = (np.repeat(column[open_], 2) for column in (motion, low, 0.5 * share))
        low[1::2] += share[1::2]
    return least
