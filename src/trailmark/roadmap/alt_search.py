"""A* over a roadmap snapshot, with lower bounds from the distances of a few reference nodes (ALT).

For a reference node r, the triangle inequality bounds the distance from a node v to the goal g from below by
d(r, g) - d(r, v) and by d(r, v) - d(r, g).

Source: Goldberg & Harrelson, "Computing the shortest path: A* search meets graph theory", SODA 2005, where the
reference nodes are called landmarks.
"""

from __future__ import annotations

from math import hypot
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.certify import BUDGET
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.jit import array_callee, callee, njit
from trailmark.motion.base import certified, cost, least_cost, new_scratch, obeys_triangle
from trailmark.nearest import Forest
from trailmark.roadmap.insertion import JOINED, joinable_nodes
from trailmark.roadmap.spanner import Adjacency
from trailmark.se2 import FloatArray

__all__ = ["COLUMNS", "alt_path", "alt_search", "node_table"]

ACTIVE = 4
"""Reference nodes that one query uses: those with the largest bounds for its start."""

AHEAD: Any = np.bool_(False)
BACK: Any = np.bool_(True)
"""Whether motions lead to an end; of numpy's type, as :data:`trailmark.collision.certify.BUDGET`."""

GROWTH = 4
"""How many times as many nodes near an end are tried when the ends could not be joined to one component."""

FLOATS = 16
"""Of 32 bits in a cache line."""

# All that a search writes for a node is in one row of 64 bytes, since nearly all its time goes into waiting for memory:
# cost from the start; lower bound on the cost to the goal; cost of the motion from the node to the goal, infinite if
# there is none; node before, -1 for the start; number of the search that reached the node, negative once the node is
# expanded. The last row is the goal's, and holds the number of the search.
BEST, TO_GO, LAST, PARENT, SEEN, NUMBER, COLUMNS = 0, 1, 2, 3, 4, 5, 8


@njit(nogil=True)
def alt_path(
    kind: Any,
    configurations: FloatArray,
    links: Adjacency,
    table: NDArray[np.float32],
    components: NDArray[np.int64],
    forest: Forest,
    rows: FloatArray,
    start: FloatArray,
    goal: FloatArray,
    closed: FloatArray,
    neighbours: int,
    max_neighbours: int,
    weight: float,
    directed: bool,
) -> FloatArray:
    """Return the states of a short path over the links, its ends joined to their nearest nodes; else (0, 3).

    Args:
        kind: of motion.
        configurations: (n, 3) nodes.
        links: certified edges.
        table: (n, 3 + r or more) float32: :func:`node_table`.
        components: (n,) number of each node's connected component.
        forest: index over the nodes.
        rows: (n + 1, COLUMNS), memory for this thread alone.
        start: valid, shape (3,).
        goal: valid, shape (3,).
        closed: (c, 3) discs that may contain no node of the path; with any, the ends are not joined directly.
        neighbours: nodes near an end that are tried at first.
        max_neighbours: nodes near an end that are tried before giving up.
        weight: of the lower bound, >= 1.
        directed: whether links lead one way only.
    """
    if len(closed) == 0 and obeys_triangle(kind) and certified(kind, new_scratch(kind), start, goal, BUDGET):
        direct = np.empty((2, 3))
        direct[0], direct[1] = start, goal
        return direct
    k, enough = neighbours, JOINED
    while True:
        first = joinable_nodes(kind, configurations, forest, start, k, enough, AHEAD)
        last = joinable_nodes(kind, configurations, forest, goal, k, enough, BACK)
        together = False
        for i in first:
            for j in last:
                together |= components[i] == components[j]
        if together:
            found = alt_search(kind, configurations, links, table, rows, start, goal, closed, first, last, weight)
            # Links that lead one way only may still not lead from one end to the other.
            if len(found) or not directed or k == max_neighbours:
                return found
        if k == max_neighbours:
            return np.empty((0, 3))
        k, enough = min(max_neighbours, GROWTH * k), max_neighbours


@njit(nogil=True)
def alt_search(
    kind: Any,
    configurations: FloatArray,
    links: Adjacency,
    table: NDArray[np.float32],
    rows: FloatArray,
    start: FloatArray,
    goal: FloatArray,
    closed: FloatArray,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    weight: float,
) -> FloatArray:
    """Return the states of a shortest path from the start over one of ``first``, links and one of ``last`` to the goal.

    The arguments are those of :func:`alt_path`.
    """
    n = len(configurations)
    end = rows[n]
    end[NUMBER] += 1.0
    number = end[NUMBER]
    end[BEST] = np.inf
    scratch = new_scratch(kind)
    active, low, high = _active_references(kind, configurations, table, goal, first, last)
    for v in last:
        row = rows[v]
        row[BEST] = row[LAST] = np.inf
        row[SEEN] = -number
        if not _within(closed, configurations[v]):
            row[SEEN] = number
            row[TO_GO] = _bound(kind, table, goal, active, low, high, v)
            row[LAST] = cost(kind, scratch, configurations[v], goal)
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    size = 0
    for v in first:
        row = rows[v]
        if row[SEEN] == -number or _within(closed, configurations[v]):
            continue
        if row[SEEN] != number:
            row[SEEN], row[LAST] = number, np.inf
            row[TO_GO] = _bound(kind, table, goal, active, low, high, v)
        row[BEST] = cost(kind, scratch, start, configurations[v])
        row[PARENT] = -1.0
        if size == len(keys):
            keys, values = heap_grow(keys, values)
        size = heap_push(keys, values, size, row[BEST] + weight * row[TO_GO], v)
    while size > 0:
        size = heap_pop(keys, values, size)
        key, node = keys[size], values[size]
        if key >= end[BEST]:
            break
        row = rows[node]
        if row[SEEN] == -number:
            continue
        row[SEEN] = -number
        reached = row[BEST]
        if reached + row[LAST] < end[BEST]:
            end[BEST], end[PARENT] = reached + row[LAST], node
        for k in range(links.start[node], links.start[node + 1]):
            other = links.node[k]
            row = rows[other]
            if row[SEEN] == -number:
                continue
            through = reached + links.length[k]
            if row[SEEN] != number:
                if _within(closed, configurations[other]):
                    row[SEEN] = -number
                    continue
                row[SEEN], row[BEST], row[LAST] = number, np.inf, np.inf
                row[TO_GO] = _bound(kind, table, goal, active, low, high, other)
            if through < row[BEST]:
                row[BEST], row[PARENT] = through, node
                key = through + weight * row[TO_GO]
                if key < end[BEST]:
                    if size == len(keys):
                        keys, values = heap_grow(keys, values)
                    size = heap_push(keys, values, size, key, other)
    if end[BEST] == np.inf:
        return np.empty((0, 3))
    length, node = 2, int(end[PARENT])
    while node >= 0:
        node, length = int(rows[node, PARENT]), length + 1
    states = np.empty((length, 3))
    states[0], states[length - 1] = start, goal
    node = int(end[PARENT])
    for i in range(length - 2, 0, -1):
        states[i] = configurations[node]
        node = int(rows[node, PARENT])
    return states


@callee
def _within(discs: FloatArray, q: FloatArray) -> bool:
    """Return whether a configuration lies in one of the discs (x, y, radius)."""
    for k in range(len(discs)):  # noqa: SIM110  # numba has no any() over a generator
        if hypot(q[0] - discs[k, 0], q[1] - discs[k, 1]) < discs[k, 2]:
            return True
    return False


@array_callee
def _active_references(
    kind: Any,
    configurations: FloatArray,
    table: NDArray[np.float32],
    goal: FloatArray,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Return the reference nodes with the largest bounds for the start, and two bounds on each one's goal distance.

    With nodes g and motions of cost w to the goal, d(v, goal) = min (d(v, g) + w). For a reference node r that is at
    least min (d(r, g) + w) - d(r, v), and at least d(r, v) - max (d(r, g) - w).
    """
    # By column of the table, the first three of which are the configuration.
    scratch, count = new_scratch(kind), table.shape[1]
    low, high, bounds = np.full(count, np.inf), np.full(count, -np.inf), np.full(count, -1.0)
    for v in last:
        final = cost(kind, scratch, configurations[v], goal)
        for r in range(3, count):
            low[r] = min(low[r], table[v, r] + final)
            high[r] = max(high[r], table[v, r] - final)
    for r in range(3, count):
        for v in first:
            if table[v, r] < np.inf and low[r] < np.inf and high[r] < np.inf:
                bounds[r] = max(bounds[r], max(low[r] - table[v, r], table[v, r] - high[r]))
    active, found = np.empty(ACTIVE, np.int64), 0
    while found < ACTIVE:
        r = int(np.argmax(bounds))
        if bounds[r] < 0.0:
            break
        active[found], bounds[r] = r, -1.0
        found += 1
    return active[:found], low, high


@callee
def _bound(
    kind: Any,
    table: NDArray[np.float32],
    goal: FloatArray,
    active: NDArray[np.int64],
    low: FloatArray,
    high: FloatArray,
    v: int,
) -> float:
    """Return a lower bound on the cost from a node to the goal over the links, rounded to 24 bits."""
    row = table[v]
    bound = least_cost(kind, row, goal)
    for r in active:
        distance = row[r]
        if distance < np.inf:
            bound = max(bound, max(low[r] - distance, distance - high[r]))
    return float(bound * (1.0 - 1e-6))


def node_table(configurations: FloatArray, distances: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return configurations and distances side by side, each node's row in one cache line if it fits in."""
    n, columns = len(configurations), -(-(3 + distances.shape[1]) // FLOATS) * FLOATS
    memory = np.full((n + 1) * columns, np.inf, np.float32)
    first = -memory.ctypes.data % (4 * FLOATS) // 4
    table = memory[first : first + n * columns].reshape(n, columns)
    table[:, :3], table[:, 3 : 3 + distances.shape[1]] = configurations, distances
    return table
