"""How deep the robot is along an interval of a path: at most, and where it becomes deeper; nothing is sampled."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trailmark.se2 import FloatArray

__all__ = ["RISE", "deepest", "first_rise"]

RISE = 1e-4
"""Metres by which a robot on its way out may be deeper than it was before."""

LOOKS = 50_000
"""Depths computed at most to see that they never rise: an interval for which that is not enough counts as one."""

SAMPLES, PRECISION, EFFORT = 17, 1e-3, 200
"""Depths of an interval computed at first; share of the largest to which it is known; depths computed at most."""


def deepest(
    depths: Callable[[FloatArray], FloatArray], poses: Callable[[FloatArray], FloatArray], u0: float, u1: float
) -> float:
    """Return the largest depth on an interval of a path, by branch and bound to :data:`PRECISION`.

    Args:
        depths: of configurations (n, 3); changes by no more than what the robot's points move.
        poses: configurations at places on the path's scale (metres), which no point of the robot outruns.
        u0: where the interval begins.
        u1: where it ends.
    """
    places = np.linspace(u0, u1, SAMPLES) if u1 > u0 else np.array([u0])
    found = depths(poses(places))
    while len(places) > 1 and len(places) < EFFORT:
        highest = 0.5 * (found[1:] + found[:-1] + np.diff(places))
        split = np.flatnonzero(highest > (1.0 + PRECISION) * found.max() + 1e-9)
        if len(split) == 0:
            break
        split = split[np.argsort(-highest[split])][: max(1, EFFORT // 8)]
        new = 0.5 * (places[split] + places[split + 1])
        places, found = np.append(places, new), np.append(found, depths(poses(new)))
        order = np.argsort(places, kind="stable")
        places, found = places[order], found[order]
    return float(found.max())


def first_rise(
    depths: Callable[[FloatArray], FloatArray],
    poses: Callable[[FloatArray], FloatArray],
    u0: float,
    u1: float,
    rise: float,
) -> float | None:
    """Return a place on an interval of a path before which depths are proven not to rise; None if that is so for all.

    Proven is that nowhere the depth is larger by more than ``rise`` (metres) than anywhere before. Other arguments are
    those of :func:`deepest`.
    """
    places = np.linspace(u0, u1, SAMPLES) if u1 > u0 else np.array([u0])
    found = depths(poses(places))
    while True:
        least = np.minimum.accumulate(found)
        # Between two places, depths change by no more than the path goes.
        most = 0.5 * (found[1:] + found[:-1] + np.diff(places)) - least[:-1]
        rises = found[1:] - least[:-1] > rise
        split = np.flatnonzero(rises | (most > rise))
        if rises.any() or (len(split) and len(places) > LOOKS):
            return float(places[split[0]])
        if len(split) == 0:
            return None
        new = 0.5 * (places[split] + places[split + 1])
        places, found = np.append(places, new), np.append(found, depths(poses(new)))
        order = np.argsort(places, kind="stable")
        places, found = places[order], found[order]
