"""Shortest paths over a roadmap of a car's curves, each checked only when the search comes to need it.

As :mod:`trailmark.roadmap.search` does for straight motions, but edges may lead one way only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.curve_motions import curve_free
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import FREE, UNDECIDED, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.compiled import njit
from trailmark.curves.shortest import MOST_WORDS
from trailmark.curves.words import PIECES
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.roadmap.search import expand, nodes_back
from trailmark.se2 import FloatArray

__all__ = ["lazy_shortest_curves"]


@njit(cache=True, nogil=True)
def lazy_shortest_curves(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    radius: float,
    reverse: bool,
    configurations: FloatArray,
    heads: NDArray[np.int64],
    following: NDArray[np.int64],
    edges: NDArray[np.int32],
    cost: FloatArray,
    status: NDArray[np.uint8],
    first: NDArray[np.int64],
    before: FloatArray,
    last: NDArray[np.int64],
    behind: FloatArray,
    to_go: FloatArray,
    banned: NDArray[np.bool_],
    limit: float,
    budget: int,
    checking: bool,
) -> tuple[NDArray[np.int64], NDArray[np.bool_], int]:
    """Return the nodes of the shortest certified path, which nodes the search reached, and what it took.

    The path is empty if there is none below ``limit``, or the budget is used up.

    Args:
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint.
        radius: turning radius, metres.
        reverse: whether the car drives backwards too.
        configurations: (n, 3) nodes.
        heads: (n,) newest entry of each node: of those that lead on from it; or of those that lead to it, then the
            search goes against the edges.
        following: (2 m,) next entry of the same node.
        edges: (m, 2) from, to.
        cost: (m,) length of each edge.
        status: (m,) FREE, BLOCKED or UNDECIDED; undecided edges that the search needs are checked and marked.
        first: (f,) nodes that the path may begin at.
        before: (f,) what it costs to be there.
        last: (l,) nodes that it may end at; none reaches all that can be reached.
        behind: (l,) what it costs from there on.
        to_go: (n,) lower estimate of what is left from each node, ``behind`` included.
        banned: (n,) nodes not to be used.
        limit: longest cost of interest.
        budget: nodes and undecided edges taken from the queue at most.
        checking: whether undecided edges are checked; else only what is known to be free is used.
    """
    n = len(configurations)
    placed, queue, words = workspace(robot), np.empty((128, 2)), np.empty((MOST_WORDS, 2, PIECES))
    done = np.zeros(n, np.bool_)
    best, parent = np.full(n, np.inf), np.full(n, -1, np.int64)
    left = np.full(n, np.inf)
    for i in range(len(last)):
        left[last[i]] = min(left[last[i]], behind[i])
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    # What waits is an entry, or -1 - i for the i-th of ``first``.
    size = 0
    for i in range(len(first)):
        if size == len(keys):
            keys, values = heap_grow(keys, values)
        size = heap_push(keys, values, size, before[i] + to_go[first[i]], -1 - i)
    end, total, taken = -1, limit, 0
    while size > 0 and taken < budget:
        size = heap_pop(keys, values, size)
        entry = values[size]
        if keys[size] >= total:
            break
        node, reached, back = 0, 0.0, -1
        if entry < 0:
            node, reached = first[-1 - entry], before[-1 - entry]
            if done[node]:
                continue
        else:
            edge = entry >> 1
            back, node = edges[edge, entry & 1], edges[edge, 1 - (entry & 1)]
            if done[node]:
                continue
            if status[edge] == UNDECIDED:
                taken += 1
                a, b = configurations[edges[edge, 0]], configurations[edges[edge, 1]]
                status[edge] = curve_free(grid, field, robot, placed, queue, words, a, b, radius, reverse)
            if status[edge] != FREE:
                continue
            reached = best[back] + cost[edge]
        taken += 1
        parent[node], done[node], best[node] = back, True, reached
        if reached + left[node] < total:
            end, total = node, reached + left[node]
        keys, values, size = expand(
            heads[node],
            reached,
            following,
            edges,
            cost,
            status,
            to_go,
            done,
            banned,
            total,
            checking,
            keys,
            values,
            size,
        )
    return nodes_back(parent, end), done, taken
