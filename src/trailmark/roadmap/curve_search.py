"""Shortest paths over a roadmap of a car's curves, each checked only when the search comes to need it.

As :mod:`trailmark.roadmap.search` does for straight motions, but edges may lead one way only.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from trailmark.collision.curve_motions import curve_free
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import BLOCKED, FREE, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.curves.shortest import MOST_WORDS
from trailmark.curves.words import PIECES
from trailmark.heap import heap_grow, heap_pop, heap_push
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
    start_of: NDArray[np.int64],
    incident: NDArray[np.int64],
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
        start_of: (n + 1,) where each node's edges begin in ``incident``.
        incident: indices into ``edges``: those that lead on from the node. With those that lead to it instead, the
            search goes against the edges.
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
    # An entry stands for an edge and the node that it leads to, edge * n + node; -1 for the start.
    size = heap_push(keys, values, 0, to_go[start], -1)
    while size > 0:
        size = heap_pop(keys, values, size)
        key, entry = keys[size], values[size]
        if key >= limit:
            break
        if entry < 0:
            node, reached = start, 0.0
        else:
            edge, node = entry // n, entry % n
            if done[node]:
                continue
            if status[edge] != FREE:
                if status[edge] != BLOCKED:
                    a, b = configurations[edges[edge, 0]], configurations[edges[edge, 1]]
                    status[edge] = curve_free(grid, field, robot, placed, queue, words, a, b, radius, reverse)
                if status[edge] == BLOCKED:
                    continue
            before = edges[edge, 0] + edges[edge, 1] - node
            reached = best[before] + cost[edge]
            parent[node] = before
        done[node] = True
        best[node] = reached
        if node == goal:
            break
        for k in range(start_of[node], start_of[node + 1]):
            edge = incident[k]
            if status[edge] == BLOCKED:
                continue
            other = edges[edge, 0] + edges[edge, 1] - node
            if done[other] or banned[other]:
                continue
            key = reached + cost[edge] + to_go[other]
            if key < limit:
                if size == len(keys):
                    keys, values = heap_grow(keys, values)
                size = heap_push(keys, values, size, key, edge * n + other)
    if goal < 0 or not done[goal]:
        return np.empty(0, np.int64), done
    length, node = 1, goal
    while node != start:
        node = parent[node]
        length += 1
    path = np.empty(length, np.int64)
    node = goal
    for i in range(length - 1, -1, -1):
        path[i] = node
        node = parent[node]
    return path, done
