"""Which nodes and edges of a roadmap a changed obstacle may touch."""

from __future__ import annotations

from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit
from trailmark.se2 import FloatArray

__all__ = ["edges_near", "few_boxes", "nodes_near"]

MANY = 32
"""Boxes from which on some that lie together are taken for one: each is compared with every edge."""

SLACK = 1e-6
"""Metres, and share of a length, by which distances may be wrong; counted as near."""


def few_boxes(boxes: FloatArray) -> FloatArray:
    """Return about :data:`MANY` boxes at most that hold all of some boxes, shape (b, 4), xmin, ymin, xmax, ymax."""
    if len(boxes) <= MANY:
        return boxes
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    place = np.floor(sqrt(MANY) * (boxes[:, :2] - low) / np.maximum(high - low, 1e-9))
    group = np.unique(place, axis=0, return_inverse=True)[1].ravel()
    found = np.tile([np.inf, np.inf, -np.inf, -np.inf], (int(group.max()) + 1, 1))
    np.minimum.at(found[:, :2], group, boxes[:, :2])
    np.maximum.at(found[:, 2:], group, boxes[:, 2:])
    return found


@njit(cache=True)
def _distance(x: float, y: float, box: FloatArray) -> float:
    """Return the distance (metres) of a point from a box xmin, ymin, xmax, ymax; 0 inside it."""
    return hypot(max(box[0] - x, 0.0, x - box[2]), max(box[1] - y, 0.0, y - box[3]))


@njit(cache=True, nogil=True)
def nodes_near(q: FloatArray, reach: float, boxes: FloatArray) -> NDArray[np.bool_]:
    """Return in which configurations, shape (n, 3), the robot may touch one of the boxes, shape (n,).

    Args:
        q: shape (n, 3).
        reach: metres from the reference point to the robot's farthest point.
        boxes: (b, 4), xmin, ymin, xmax, ymax, metres.
    """
    found = np.zeros(len(q), np.bool_)
    for i in range(len(q)):
        for box in boxes:
            if _distance(q[i, 0], q[i, 1], box) <= reach + SLACK * (1.0 + reach):
                found[i] = True
                break
    return found


@njit(cache=True, nogil=True)
def edges_near(
    q: FloatArray,
    edges: NDArray[np.int32],
    lengths: FloatArray,
    reach: float,
    boxes: FloatArray,
    among: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Return along which edges the robot may touch one of the boxes, shape (m,).

    A motion of cost c moves the reference point by at most c metres, whatever kind of motion it is: where it is at
    distance d of a box, its ends' distances from it add up to at most c + 2·d.

    Args:
        q: nodes, shape (n, 3).
        edges: nodes joined, shape (m, 2).
        lengths: their costs, metres, shape (m,).
        reach: metres from the reference point to the robot's farthest point.
        boxes: (b, 4), xmin, ymin, xmax, ymax, metres.
        among: edges that are asked about, shape (m,).
    """
    found = np.zeros(len(edges), np.bool_)
    distance = np.empty(len(q))
    for box in boxes:
        for i in range(len(q)):
            distance[i] = _distance(q[i, 0], q[i, 1], box)
        for i in range(len(edges)):
            if among[i] and not found[i]:
                most = lengths[i] + 2.0 * reach
                found[i] = distance[edges[i, 0]] + distance[edges[i, 1]] <= most + SLACK * (1.0 + most)
    return found
