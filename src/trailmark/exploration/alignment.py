"""Where a robot stands that detects points of a known map: the pose under which most of them lie on points."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.se2 import FloatArray, difference, transform, wrap

__all__ = ["Alignment", "aligned"]

IntArray = NDArray[np.intp]

NEAREST: Final = 8
"""Detections, at most, of which pairs are tried: near ones are the most precise."""

APART: Final = 0.5, 0.3
"""Metres and radians between two poses that are not the same."""


class Alignment(NamedTuple):
    """A pose, and what speaks for it."""

    pose: FloatArray
    """Shape (3,)."""
    matched: int
    """Detections that lie on points of the map under it."""
    unique: bool
    """Whether fewer do under any pose that is not near it."""


def aligned(
    detected: FloatArray, places: FloatArray, candidates: Sequence[IntArray], tolerance: float
) -> Alignment | None:
    """Return the pose that puts most detections on points of the map; None if none puts two of them there.

    Each pair of detections is laid on each pair of points as far apart: a pose, under which the others are counted.

    Args:
        detected: in the robot's frame, shape (n, 2), metres.
        places: the map's points, shape (m, 2).
        candidates: for each detection, which points it may be: one where it is identified.
        tolerance: metres by which a detection may lie off its point.
    """
    poses = [np.empty((0, 3))]
    for i, j in combinations(np.argsort(np.hypot(*detected.T), kind="stable")[:NEAREST].tolist(), 2):
        a, b = (grid.ravel() for grid in np.meshgrid(candidates[i], candidates[j], indexing="ij"))
        way, ways = detected[j] - detected[i], places[b] - places[a]
        fits = (a != b) & (np.abs(np.hypot(*ways.T) - np.hypot(*way)) <= 2.0 * tolerance)
        theta = np.asarray(wrap(np.arctan2(ways[fits, 1], ways[fits, 0]) - np.arctan2(way[1], way[0])))
        turned = transform(np.column_stack([np.zeros((len(theta), 2)), theta]), 0.5 * (detected[i] + detected[j])[None])
        poses.append(np.column_stack([0.5 * (places[a[fits]] + places[b[fits]]) - turned[:, 0], theta]))
    tried = np.concatenate(poses)
    if not len(tried):
        return None
    counts = np.array([len(_pairs(pose, detected, places, candidates, tolerance)[0]) for pose in tried])
    best = int(counts.argmax())
    if counts[best] < 2:
        return None
    off = np.abs(difference(tried[best], tried))
    others = (np.hypot(off[:, 0], off[:, 1]) > APART[0]) | (off[:, 2] > APART[1])
    pose = tried[best]
    for _ in range(3):
        own, at = _pairs(pose, detected, places, candidates, tolerance)
        pose = _rigid(detected[own], places[at])
    return Alignment(pose, int(counts[best]), not (counts[others] >= counts[best]).any())


def _pairs(
    pose: FloatArray, detected: FloatArray, places: FloatArray, candidates: Sequence[IntArray], tolerance: float
) -> tuple[list[int], list[int]]:
    """Return which detections lie on points under a pose, and on which."""
    own, at = list[int](), list[int]()
    for i, point in enumerate(transform(pose, detected)):
        if len(candidates[i]):
            away = np.hypot(*(places[candidates[i]] - point).T)
            k = int(away.argmin())
            if away[k] <= tolerance and int(candidates[i][k]) not in at:
                own.append(i)
                at.append(int(candidates[i][k]))
    return own, at


def _rigid(points: FloatArray, places: FloatArray) -> FloatArray:
    """Return the pose that moves points nearest to places, both (k, 2), in the sense of least squares."""
    p, q = points - points.mean(axis=0), places - places.mean(axis=0)
    theta = np.arctan2((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum(), (p * q).sum())
    turned = transform(np.array([0.0, 0.0, theta]), points.mean(axis=0)[None])[0]
    return np.append(places.mean(axis=0) - turned, theta)
