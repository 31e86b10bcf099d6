"""What coming back to where the robot was does for its pose: loops that are closed there."""

from __future__ import annotations

import numpy as np

from trailmark.se2 import FloatArray

__all__ = ["expected_falls", "places_of"]


def expected_falls(places: FloatArray, visited: FloatArray, sigmas: FloatArray, within: float) -> FloatArray:
    """Return by how much the standard deviation of the robot's place is expected to fall at places, metres, shape (n,).

    Where it sees again what it saw before, its place is as sure as it was then, for readings are matched to each other.
    Elsewhere nothing falls.

    Source: active loop closing: Stachniss, Hähnel & Burgard, "Exploration with active loop-closing for FastSLAM",
    IROS 2004.

    Args:
        places: x, y, shape (n, 2).
        visited: where it was, x, y, in the order of time, the last where it is, shape (m, 2).
        sigmas: standard deviations of these, in the world, metres, shape (m,).
        within: metres up to which the same things are seen.
    """
    if len(visited) == 0:
        return np.zeros(len(places))
    apart = np.hypot(places[:, None, 0] - visited[None, :, 0], places[:, None, 1] - visited[None, :, 1])
    surest = np.where(apart <= within, sigmas[None, :], np.inf).min(axis=1)
    return np.asarray(np.maximum(sigmas[-1] - surest, 0.0))


def places_of(trajectory: FloatArray, covariances: FloatArray) -> FloatArray:
    """Return where the robot was and how sure that is: x, y and the largest standard deviation, metres, shape (n, 3).

    Args:
        trajectory: rows t, x, y, theta, shape (n, 4).
        covariances: of its poses, shape (n, 3, 3).
    """
    largest = np.linalg.eigvalsh(covariances[:, :2, :2])[:, -1]
    return np.column_stack([trajectory[:, 1:3], np.sqrt(np.maximum(largest, 0.0))])
