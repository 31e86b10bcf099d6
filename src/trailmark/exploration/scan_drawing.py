"""Drawing a map of scans: of those that lie apart, and of the last ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.logs.records import Scan
from trailmark.exploration.known_map import KnownMap
from trailmark.se2 import FloatArray, difference

__all__ = ["DENSE", "apart", "draw"]

SPACING: Final = 0.25, 0.3
"""Metres and radians between scans by which a map is drawn anew, or from the log: in between little else is seen."""

DENSE: Final = 0.25
"""Times SPACING, where cells are divided: of smaller ones each scan shows fewer."""

RECENT: Final = 10
"""Scans that are drawn in any case: what has vanished since is gone."""


def apart(poses: FloatArray, spacing: float = 1.0) -> NDArray[np.bool_]:
    """Return which scans lie so many times SPACING apart from the ones before, and the last ones, shape (m,).

    Args:
        poses: of the scans, shape (m, 3).
        spacing: times SPACING.
    """
    chosen, last = np.zeros(len(poses), np.bool_), 0
    for i, pose in enumerate(poses):
        off = np.abs(difference(poses[last], pose))
        if i == 0 or np.hypot(off[0], off[1]) > spacing * SPACING[0] or off[2] > spacing * SPACING[1]:
            chosen[i], last = True, i
    chosen[-RECENT:] = True
    return chosen


def draw(
    known: KnownMap,
    scans: Sequence[Scan],
    poses: FloatArray,
    max_range: float,
    spacing: float = 1.0,
    stopped: Callable[[], bool] = bool,
) -> KnownMap:
    """Enter the scans that lie apart in a map, and return it.

    Args:
        known: the map, in which nothing is known.
        scans: in the order of time.
        poses: of the robot when they were taken, shape (m, 3).
        max_range: metres; what was met farther away shows free space up to there.
        spacing: times SPACING.
        stopped: asked between scans whether to end early.
    """
    for i in np.flatnonzero(apart(poses, spacing)).tolist():
        if stopped():
            break
        known.add_scan(scans[i], poses[i], max_range)
    return known
