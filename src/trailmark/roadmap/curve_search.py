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
from trailmark.heap import heap_pop, heap_push
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
    start: int,
    goal: int,
    to_go: FloatArray,
    banned: NDArray[np.bool_],
    limit: float,
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the nodes of the shortest certified path from start to goal, and which nodes the search reached.

    The path is empty if there is none below ``limit``.

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
        start: first node.
        goal: last node; -1 reaches all that can be reached.
        to_go: (n,) lower estimate of each node's cost to the goal.
        banned: (n,) nodes not to be used.
        limit: longest cost of interest.
    """
    n = len(configurations)
    placed, queue, words = workspace(robot), np.empty((128, 2)), np.empty((MOST_WORDS, 2, PIECES))
    done = np.zeros(n, np.bool_)
    best = np.full(n, np.inf)
    parent = np.full(n, -1, np.int64)
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    size = heap_push(keys, values, 0, to_go[start], -1)
    while size > 0:
        size = heap_pop(keys, values, size)
        entry = values[size]
        if keys[size] >= limit:
            break
        node, reached = start, 0.0
        if entry >= 0:
            edge = entry >> 1
            before, node = edges[edge, entry & 1], edges[edge, 1 - (entry & 1)]
            if done[node]:
                continue
            if status[edge] == UNDECIDED:
                a, b = configurations[edges[edge, 0]], configurations[edges[edge, 1]]
                status[edge] = curve_free(grid, field, robot, placed, queue, words, a, b, radius, reverse)
            if status[edge] != FREE:
                continue
            reached = best[before] + cost[edge]
            parent[node] = before
        done[node] = True
        best[node] = reached
        if node == goal:
            break
        keys, values, size = expand(
            heads[node], reached, following, edges, cost, status, to_go, done, banned, limit, keys, values, size
        )
    return nodes_back(parent, start, goal, done), done
