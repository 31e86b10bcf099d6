# ruff: noqa: N806 # the names are those of the literature: G, S
"""Covariances of a map by itself: without the errors of where its frame lies, which move all of it at once.

A map's frame is that of the first pose, so that an error of the first heading turns everything. Within the map nothing
is wrong by that. Baarda's S-transformation (Baarda 1973, S-transformations and criterion matrices) removes it: of all
frames the one that the features themselves define, in which their covariance has the least trace.
"""

from __future__ import annotations

import numpy as np

from trailmark.se2 import FloatArray

__all__ = ["gauge_free", "relative_covariance"]


def relative_covariance(points: FloatArray, joint: FloatArray) -> FloatArray:
    """Return the covariance of points relative to all of them, shape (2m, 2m).

    The errors that are left are those after the best rigid alignment with the true points, to first order.

    Args:
        points: shape (m, 2), metres.
        joint: covariance of x₁, y₁, x₂, y₂, … in any frame, shape (2m, 2m).
    """
    S = gauge_free(points)
    return np.asarray(S @ joint @ S.T)


def gauge_free(points: FloatArray) -> FloatArray:
    """Return the matrix, shape (2m, 2m), that takes off errors x₁, y₁, x₂, … what a rigid motion explains."""
    away = points - points.mean(axis=0)
    G = np.zeros((2 * len(points), 3))
    G[0::2, 0] = G[1::2, 1] = 1.0
    G[0::2, 2], G[1::2, 2] = -away[:, 1], away[:, 0]
    return np.asarray(np.eye(len(G)) - G @ np.linalg.pinv(G))
