"""Shortest paths over a roadmap whose edges are checked only when the search comes to need them.

Source: Cohen, Phillips & Likhachev, "Planning single-arm manipulations with n-arm robots", RSS 2014 (Lazy
Weighted A*, here with weight 1): an edge is checked when the search pops it, not when it is put in the queue.
"""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.clock import CLOCK_EVERY, Deadline, now
from trailmark.collision.certify import BUDGET
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.compiled import njit
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.motion.base import certified, cost, embedding_radius, new_room
from trailmark.nearest import Forest, nearest_in
from trailmark.se2 import FloatArray

__all__ = ["edge_costs", "expand", "joined", "lazy_shortest_path", "nodes_back"]


@njit(cache=True, nogil=True)
def lazy_shortest_path(
    kind: Any,
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
    deadline: Deadline,
    checking: bool,
) -> tuple[NDArray[np.int64], NDArray[np.bool_], int]:
    """Return the nodes of the shortest certified path, which nodes the search reached, and what it took.

    The path is empty if there is none below ``limit``, or the budget or the time is used up.

    Args:
        kind: of motion that edges are (:mod:`trailmark.motion.base`).
        configurations: (n, 3) nodes.
        heads: (n,) newest entry of each node (:mod:`trailmark.roadmap.adjacency`): of those that lead on from it; or of
            those that lead to it, then the search goes against the edges.
        following: (2 m,) next entry of the same node.
        edges: (m, 2) nodes joined; of directed edges from, to.
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
        deadline: ends the search too.
        checking: whether undecided edges are checked; else only what is known to be free is used.
    """
    n = len(configurations)
    room = new_room(kind)
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
    end, total, taken, steps = -1, limit, 0, 0
    while size > 0 and taken < budget:
        steps += 1
        if steps % CLOCK_EVERY == 0 and now(deadline.kind) >= deadline.seconds:
            break
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
                status[edge] = FREE if certified(kind, room, a, b, BUDGET) else BLOCKED
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
    checking: bool,
    keys: FloatArray,
    values: NDArray[np.int64],
    size: int,
) -> tuple[FloatArray, NDArray[np.int64], int]:
    """Put a node's entries, from its newest one on, into the queue; return the queue and its size."""
    while entry >= 0:
        edge = entry >> 1
        if status[edge] == FREE or (checking and status[edge] != BLOCKED):
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
def nodes_back(parent: NDArray[np.int64], end: int) -> NDArray[np.int64]:
    """Return the nodes along the parents up to ``end``, from the first on; none for -1."""
    length, node = 0, end
    while node >= 0:
        node, length = parent[node], length + 1
    path = np.empty(length, np.int64)
    node = end
    for i in range(length - 1, -1, -1):
        path[i] = node
        node = parent[node]
    return path


@njit(cache=True)
def edge_costs(kind: Any, configurations: FloatArray, edges: NDArray[np.int32]) -> FloatArray:
    """Return the costs (metres, shape (m,)) of edges (m, 2)."""
    room, result = new_room(kind), np.empty(len(edges))
    for i in range(len(edges)):
        result[i] = cost(kind, room, configurations[edges[i, 0]], configurations[edges[i, 1]])
    return result


@njit(cache=True, nogil=True)
def joined(
    kind: Any,
    configurations: FloatArray,
    forest: Forest,
    q: FloatArray,
    k: int,
    enough: int,
    reverse: bool,
) -> NDArray[np.int64]:
    """Return which of the k nodes nearest to q certified motions join to it, the first ``enough`` of them.

    Args:
        kind: of motion.
        configurations: (n, 3) nodes.
        forest: index over the nodes in the embedding.
        q: valid, shape (3,).
        k: nodes that are tried at most.
        enough: nodes joined at most.
        reverse: whether the motions lead to q, not away from it.
    """
    radius = embedding_radius(kind)
    point = np.array([q[0], q[1], radius * cos(q[2]), radius * sin(q[2])])
    distances, ids = np.empty(k), np.empty(k, np.int64)
    count = nearest_in(forest, point, -1, k, distances, ids)
    room, found = new_room(kind), 0
    for i in range(count):
        node = configurations[ids[i]]
        if certified(kind, room, node, q, BUDGET) if reverse else certified(kind, room, q, node, BUDGET):
            ids[found] = ids[i]
            found += 1
            if found == enough:
                break
    return ids[:found]
