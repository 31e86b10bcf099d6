"""Joining: which nodes of a roadmap a configuration is joined to by certified motions."""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.certify import BUDGET
from trailmark.compiled import njit
from trailmark.motion.base import certified, embedding_radius, new_scratch
from trailmark.nearest import Forest, nearest_in
from trailmark.se2 import FloatArray

__all__ = ["JOINED", "joinable_nodes"]

JOINED = 3
"""Nodes that an end of a query is joined to."""


@njit(cache=True, nogil=True)
def joinable_nodes(
    kind: Any,
    configurations: FloatArray,
    forest: Forest,
    q: FloatArray,
    k: int,
    enough: int,
    reverse: bool,
) -> NDArray[np.int64]:
    """Return those of the k nodes nearest to q that certified motions join to it, at most ``enough`` of them.

    Args:
        kind: of motion.
        configurations: (n, 3) nodes.
        forest: index over the nodes in the embedding.
        q: valid, shape (3,).
        k: maximum number of nodes that are tried.
        enough: maximum number of nodes that are joined.
        reverse: whether the motions lead to q instead of from it.
    """
    radius = embedding_radius(kind)
    point = np.array([q[0], q[1], radius * cos(q[2]), radius * sin(q[2])])
    distances, ids = np.empty(k), np.empty(k, np.int64)
    count = nearest_in(forest, point, -1, k, distances, ids)
    scratch, found = new_scratch(kind), 0
    for i in range(count):
        node = configurations[ids[i]]
        if certified(kind, scratch, node, q, BUDGET) if reverse else certified(kind, scratch, q, node, BUDGET):
            ids[found] = ids[i]
            found += 1
            if found == enough:
                break
    return ids[:found]
