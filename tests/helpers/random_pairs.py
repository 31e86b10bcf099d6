"""Pairs of places that no straight motion joins."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark import LandmarkPlanner
from trailmark.landmarks import free_samples

__all__ = ["random_pairs"]

FloatArray = NDArray[np.float64]


def random_pairs(planner: LandmarkPlanner, n: int, seed: int) -> FloatArray:
    """Return n starts and goals, shape (n, 2, 3), that the relaxed problem may join, and no straight motion does."""
    pairs, have, rng = [np.empty((0, 2, 3))], 0, np.random.default_rng(seed)
    relaxation = planner.relaxation
    while have < n:
        q = free_samples(planner.checker, 4 * (n - have) + 64, random_state=rng)
        reached = relaxation.component(q[0])
        q = q[reached[relaxation.cells(relaxation.disc_centers(q))]]
        q = q[: len(q) // 2 * 2].reshape(-1, 2, 3)
        found = q[~planner.checker.motions_between_valid(q[:, 0], q[:, 1])]
        pairs.append(found)
        have += len(found)
    return np.concatenate(pairs)[:n]
