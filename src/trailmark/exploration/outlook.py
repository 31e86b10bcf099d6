"""What a strategy chooses from: landmarks to drive to, what may be seen from them, and what it costs to get there."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.se2 import FloatArray

__all__ = ["Outlook", "Strategy"]


class Outlook(NamedTuple):
    """The landmarks from which something new may be seen, n of them, with what is known before one is chosen."""

    here: FloatArray
    """The robot's configuration, shape (3,)."""
    home: FloatArray | None
    """Where the exploration has to end, shape (3,); None where it may end anywhere."""
    landmarks: FloatArray
    """Configurations, shape (n, 3)."""
    costs: FloatArray
    """Of the way from here to each, shape (n,), metres: certified where a path has been planned, else estimated."""
    between: FloatArray
    """Estimated costs of the ways between landmarks, shape (n, n), metres."""
    home_costs: FloatArray
    """Estimated costs of the ways from each landmark home, shape (n,), metres; 0 without a home."""
    areas: FloatArray
    """Unknown area that is expected to be seen from each, shape (n,), square metres (ray casting)."""
    certainty: FloatArray
    """How much the standard deviation of the robot's place is expected to fall at each, shape (n,), metres: loops that
    are closed there; 0 without noise."""
    frontiers: FloatArray
    """Lengths of the frontiers between free and unknown space, shape (m,), metres."""
    sees: NDArray[np.bool_]
    """Which landmark sees which frontier, shape (n, m): from near, or from afar if none does; a short frontier from
    wherever. A landmark that sees from afar alone what others see from near may see none."""
    sensor_range: float
    """Metres."""


Strategy = Callable[[Outlook], int]
"""Returns the index of the landmark to drive to next."""
