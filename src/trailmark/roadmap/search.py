"""Shortest paths over a roadmap whose edges are checked only when the search comes to need them.

Source: Cohen, Phillips & Likhachev, "Planning single-arm manipulations with n-arm robots", RSS 2014 (Lazy
Weighted A*, here with weight 1): an edge is checked when the search pops it, not when it is put in the queue.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED, motion, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.compiled import njit
from trailmark.heading import turn
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.se2 import ROTATION_WEIGHT, FloatArray

__all__ = ["edge_costs", "expand", "lazy_shortest_path", "nodes_back"]


@njit(cache=True, nogil=True)
def lazy_shortest_path(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
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
        configurations: (n, 3) nodes.
        heads: (n,) newest entry of each node (:mod:`trailmark.roadmap.links`).
        following: (2 m,) next entry of the same node.
        edges: (m, 2) nodes joined.
        cost: (m,) length of each edge.
        status: (m,) FREE, BLOCKED or UNDECIDED; undecided edges that the search needs are checked and marked.
        start: first node.
        goal: last node.
        to_go: (n,) lower estimate of each node's cost to the goal.
        banned: (n,) nodes not to be used.
        limit: longest cost of interest.
    """
    n = len(configurations)
    placed, queue = workspace(robot), np.empty((128, 2))
    done = np.zeros(n, np.bool_)
    best = np.full(n, np.inf)
    parent = np.full(n, -1, np.int64)
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    # What waits is an entry, -1 for the start.
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
                status[edge] = motion(grid, field, robot, placed, queue, a, b, True)
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


@njit(cache=True, nogil=True)
def expand(
    entry: int,
    reached: float,
    following: NDArray[np.int64],
    edges: NDArray[np.int32],
    cost: FloatArray,
    status: NDArray[np.uint8],
    to_go: FloatArray,
    done: NDArray[np.bool_],
    banned: NDArray[np.bool_],
    limit: float,
    keys: FloatArray,
    values: NDArray[np.int64],
    size: int,
) -> tuple[FloatArray, NDArray[np.int64], int]:
    """Put a node's entries, from its newest one on, into the queue; return the queue and its size."""
    while entry >= 0:
        edge = entry >> 1
        if status[edge] != BLOCKED:
            other = edges[edge, 1 - (entry & 1)]
            if not (done[other] or banned[other]):
                key = reached + cost[edge] + to_go[other]
                if key < limit:
                    if size == len(keys):
                        keys, values = heap_grow(keys, values)
                    size = heap_push(keys, values, size, key, entry)
        entry = following[entry]
    return keys, values, size


@njit(cache=True, nogil=True)
def nodes_back(parent: NDArray[np.int64], start: int, goal: int, done: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the nodes from start to goal along the parents; empty if the search did not get there, or had no goal."""
    if goal < 0 or not done[goal]:
        return np.empty(0, np.int64)
    length, node = 1, goal
    while node != start:
        node = parent[node]
        length += 1
    path = np.empty(length, np.int64)
    node = goal
    for i in range(length - 1, -1, -1):
        path[i] = node
        node = parent[node]
    return path


@njit(cache=True)
def edge_costs(configurations: FloatArray, edges: NDArray[np.int32], turning: bool) -> FloatArray:
    """Return ‖Δxy‖ (+ 0.5·|Δθ| if ``turning``) of edges (m, 2), in metres."""
    result = np.empty(len(edges))
    for i in range(len(edges)):
        a, b = configurations[edges[i, 0]], configurations[edges[i, 1]]
        way = np.hypot(b[0] - a[0], b[1] - a[1])
        result[i] = way + ROTATION_WEIGHT * abs(turn(a[2], b[2])) if turning else way
    return result
