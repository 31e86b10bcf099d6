"""RoadmapSnapshot: a roadmap as it is now, made ready for many queries, which change nothing in it.

All that costs time is done once: edges are certified, edges that others stand in for are left out, distances from a
few nodes to all are kept. A query then runs in one compiled call: it joins its ends to their nearest nodes for its own
use only, and searches. Any number of threads may ask at once.

Sources: A* with distances from chosen nodes as lower bounds: Goldberg & Harrelson, "Computing the shortest path: A*
search meets graph theory", SODA 2005; sparse stand-ins: Althöfer, Das, Dobkin, Joseph & Soares, "On sparse spanners of
weighted graphs", DCG 1993.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from math import hypot
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.collision.certify import BUDGET
from trailmark.collision.kernels import FREE
from trailmark.compiled import njit
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.motion.base import certified, cost, least_cost, new_room
from trailmark.nearest import Forest
from trailmark.roadmap.roadmap import Roadmap, require_nodes
from trailmark.roadmap.search import joined
from trailmark.roadmap.spanner import Adjacency, adjacency_of, components_of, distances_from, spanner
from trailmark.se2 import FloatArray

__all__ = ["RoadmapSnapshot", "snapshot_path"]

STRETCH = 1.4
"""An edge is left out if two others lead where it does on a way at most this many times as long."""

BEACONS = 12
"""Nodes whose distances to all others are kept: with the configuration, they fill 60 of a cache line's 64 bytes."""

ASKED = 4
"""Beacons that one query asks: those that say most about its start."""

ENOUGH = 3
"""Nodes that an end is joined to."""

NEAR, WIDER, FARTHEST = 12, 4, 768
"""Nodes near an end that are tried at first; how many times as many whenever that is not enough; and at most."""

FLOATS = 16
"""Of 32 bits in a cache line."""

NOWHERE = np.empty((0, 3))


# What one search writes of a node lies in one row of 64 bytes, since nearly all the time goes into waiting for memory:
# cost from the start; lower bound on the cost to the goal; cost of the motion from the node to the goal, infinite if
# there is none; node before, -1 for the start; number of the search that met the node, its negative once the node is
# done. The last row is the goal's, and holds the number of the search.
BEST, TO_GO, LAST, PARENT, SEEN, NUMBER, COLUMNS = 0, 1, 2, 3, 4, 5, 8


class RoadmapSnapshot:
    """A roadmap's certified edges, ready for queries.

    Args:
        roadmap: edges that nobody has checked yet are checked.
        stretch: how many times as long as a certified edge a way over others may be that stands in for it, >= 1.
        beacons: nodes whose distances to all others are kept.

    Attributes:
        configurations: (n, 3), the nodes.
        links: the edges that are searched.
        distances: (n, b) float32, from the beacons.
        components: (n,) which nodes are joined.
    """

    def __init__(self, roadmap: Roadmap, *, stretch: float = STRETCH, beacons: int = BEACONS) -> None:
        roadmap.certify_all()
        self.checker: StateChecker = roadmap.checker
        self.motion = roadmap.motion
        rows = roadmap.rows()
        free = rows[3] == FREE
        self.configurations, edges, lengths = rows[0].copy(), rows[1][free], rows[2][free]
        n = len(self.configurations)
        if roadmap.directed:
            # Stand-ins and distances from beacons are for edges that lead both ways.
            self.links = adjacency_of(n, edges, lengths, directed=True)
            self.distances, self.components = (
                np.empty((n, 0), np.float32),
                components_of(adjacency_of(n, edges, lengths)),
            )
        else:
            self.links = spanner(n, edges, lengths, stretch)
            self.distances, self.components = distances_from(self.links, beacons)
        self._told = _told(self.configurations, self.distances)
        self._forest: Forest = roadmap.nearest()
        self._idle: list[FloatArray] = []
        if n:
            # What is compiled is loaded before a clock runs.
            self.find_path(self.configurations[0].copy(), self.configurations[-1].copy())

    def __len__(self) -> int:
        return len(self.configurations)

    def find_path(
        self, start: FloatArray, goal: FloatArray, *, closed: FloatArray | None = None, weight: float = 1.0
    ) -> FloatArray | None:
        """Return the states, shape (p, 3), of a path of certified motions, or None if the roadmap knows none.

        Args:
            start: valid, shape (3,).
            goal: valid, shape (3,).
            closed: (c, 3), discs x, y, radius (metres) that hold no node of the path.
            weight: how many times as long as the shortest over the links the path may be, >= 1: sooner, if it may.
        """
        n = len(self)
        with self._scratch() as scratch:
            found: FloatArray = snapshot_path(
                self.motion.kind,
                self.configurations,
                self.links,
                self._told,
                self.components,
                self._forest,
                scratch,
                start,
                goal,
                NOWHERE if closed is None else closed,
                min(n, NEAR),
                min(n, FARTHEST),
                float(weight),
                self.motion.directed,
            )
        return found if len(found) else None

    def between(self, start: int, goal: int) -> FloatArray | None:
        """Return the states, shape (p, 3), of the shortest path over the links from a node to a node, or None.

        Args:
            start: node, 0 to n - 1.
            goal: node.

        Raises:
            ConfigurationError: a node that is not there.
        """
        require_nodes([start, goal], len(self))
        q = self.configurations
        first, last = (np.array([node], dtype=np.int64) for node in (start, goal))
        with self._scratch() as scratch:
            found: FloatArray = _search(
                self.motion.kind, q, self.links, self._told, scratch, q[start], q[goal], NOWHERE, first, last, 1.0
            )
        # The ends are their own neighbours.
        return found[1:-1] if len(found) else None

    @contextmanager
    def _scratch(self) -> Iterator[FloatArray]:
        """Lend what a search writes, to one thread at a time."""
        try:
            scratch = self._idle.pop()
        except IndexError:
            scratch = np.zeros((len(self) + 1, COLUMNS))
        yield scratch
        # After an exception it is not used again.
        self._idle.append(scratch)


@njit(cache=True, nogil=True)
def snapshot_path(
    kind: Any,
    configurations: FloatArray,
    links: Adjacency,
    told: NDArray[np.float32],
    components: NDArray[np.int64],
    forest: Forest,
    scratch: FloatArray,
    start: FloatArray,
    goal: FloatArray,
    closed: FloatArray,
    fewest: int,
    most: int,
    weight: float,
    directed: bool,
) -> FloatArray:
    """Return the states of a short path over the links, its ends joined to their nearest nodes; else (0, 3).

    Args:
        kind: of motion.
        configurations: (n, 3) nodes.
        links: certified edges.
        told: (n, 3 + b or more) float32: what bounds a node's cost to the goal, its configuration and its distances.
        components: (n,) which nodes are joined.
        forest: index over the nodes.
        scratch: (n + 1, COLUMNS), for this thread alone.
        start: valid, shape (3,).
        goal: valid, shape (3,).
        closed: (c, 3) discs that hold no node of the path, nor let the ends be joined directly.
        fewest: nodes near an end that are tried at first.
        most: nodes near an end that are tried before giving up.
        weight: how many times as long as the shortest the way may be, >= 1.
        directed: whether links lead one way only.
    """
    if len(closed) == 0 and certified(kind, new_room(kind), start, goal, BUDGET):
        direct = np.empty((2, 3))
        direct[0], direct[1] = start, goal
        return direct
    k, enough = fewest, ENOUGH
    while True:
        first = joined(kind, configurations, forest, start, k, enough, False)
        last = joined(kind, configurations, forest, goal, k, enough, True)
        together = False
        for i in first:
            for j in last:
                together |= components[i] == components[j]
        if together:
            found = _search(kind, configurations, links, told, scratch, start, goal, closed, first, last, weight)
            # Edges that lead one way only may not lead from one to the other.
            if len(found) or not directed or k == most:
                return found
        if k == most:
            return np.empty((0, 3))
        k, enough = min(most, WIDER * k), most


@njit(cache=True, nogil=True)
def _search(
    kind: Any,
    configurations: FloatArray,
    links: Adjacency,
    told: NDArray[np.float32],
    scratch: FloatArray,
    start: FloatArray,
    goal: FloatArray,
    closed: FloatArray,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    weight: float,
) -> FloatArray:
    """Return the states of a shortest path from the start by one of ``first``, over links, by one of ``last``."""
    n = len(configurations)
    end = scratch[n]
    end[NUMBER] += 1.0
    number = end[NUMBER]
    end[BEST] = np.inf
    room = new_room(kind)
    beacons, low, high = _beacons(kind, configurations, told, start, goal, first, last)
    for v in last:
        row = scratch[v]
        row[BEST] = row[LAST] = np.inf
        row[SEEN] = -number
        if not _within(closed, configurations[v]):
            row[SEEN] = number
            row[TO_GO] = _bound(kind, told, goal, beacons, low, high, v)
            row[LAST] = cost(kind, room, configurations[v], goal)
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    size = 0
    for v in first:
        row = scratch[v]
        if row[SEEN] == -number or _within(closed, configurations[v]):
            continue
        if row[SEEN] != number:
            row[SEEN], row[LAST] = number, np.inf
            row[TO_GO] = _bound(kind, told, goal, beacons, low, high, v)
        row[BEST] = cost(kind, room, start, configurations[v])
        row[PARENT] = -1.0
        if size == len(keys):
            keys, values = heap_grow(keys, values)
        size = heap_push(keys, values, size, row[BEST] + weight * row[TO_GO], v)
    while size > 0:
        size = heap_pop(keys, values, size)
        key, node = keys[size], values[size]
        if key >= end[BEST]:
            break
        row = scratch[node]
        if row[SEEN] == -number:
            continue
        row[SEEN] = -number
        reached = row[BEST]
        if reached + row[LAST] < end[BEST]:
            end[BEST], end[PARENT] = reached + row[LAST], node
        for k in range(links.start[node], links.start[node + 1]):
            other = links.node[k]
            row = scratch[other]
            if row[SEEN] == -number:
                continue
            through = reached + links.length[k]
            if row[SEEN] != number:
                if _within(closed, configurations[other]):
                    row[SEEN] = -number
                    continue
                row[SEEN], row[BEST], row[LAST] = number, np.inf, np.inf
                row[TO_GO] = _bound(kind, told, goal, beacons, low, high, other)
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
        node, length = int(scratch[node, PARENT]), length + 1
    states = np.empty((length, 3))
    states[0], states[length - 1] = start, goal
    node = int(end[PARENT])
    for i in range(length - 2, 0, -1):
        states[i] = configurations[node]
        node = int(scratch[node, PARENT])
    return states


@njit(cache=True, nogil=True)
def _within(discs: FloatArray, q: FloatArray) -> bool:
    for k in range(len(discs)):  # noqa: SIM110  # numba has no any() over a generator
        if hypot(q[0] - discs[k, 0], q[1] - discs[k, 1]) < discs[k, 2]:
            return True
    return False


@njit(cache=True, nogil=True)
def _beacons(
    kind: Any,
    configurations: FloatArray,
    told: NDArray[np.float32],
    start: FloatArray,
    goal: FloatArray,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
    """Return the beacons that tell most about the start, and what bounds the goal's distance from each.

    With nodes g and motions of cost w to the goal: d(v, goal) = min (d(v, g) + w), which is at least
    min (d(b, g) + w) - d(b, v) and at least d(b, v) - max (d(b, g) - w).
    """
    # Columns of ``told``, the first three of which are no beacons.
    room, count = new_room(kind), told.shape[1]
    low, high, tells = np.full(count, np.inf), np.full(count, -np.inf), np.full(count, -1.0)
    for v in last:
        way = cost(kind, room, configurations[v], goal)
        for b in range(3, count):
            low[b] = min(low[b], told[v, b] + way)
            high[b] = max(high[b], told[v, b] - way)
    for b in range(3, count):
        for v in first:
            if told[v, b] < np.inf and low[b] < np.inf and high[b] < np.inf:
                tells[b] = max(tells[b], max(low[b] - told[v, b], told[v, b] - high[b]))
    chosen = np.argsort(-tells)[:ASKED]
    return chosen[tells[chosen] >= 0.0], low, high


@njit(cache=True, nogil=True)
def _bound(
    kind: Any,
    told: NDArray[np.float32],
    goal: FloatArray,
    beacons: NDArray[np.int64],
    low: FloatArray,
    high: FloatArray,
    v: int,
) -> float:
    """Return a lower bound on the cost from a node to the goal over the links, rounded to 24 bits."""
    row = told[v]
    bound = least_cost(kind, row, goal)
    for b in beacons:
        away = row[b]
        if away < np.inf:
            bound = max(bound, max(low[b] - away, away - high[b]))
    return float(bound * (1.0 - 1e-6))


def _told(configurations: FloatArray, distances: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return configurations and distances side by side, each row in one cache line if it fits in."""
    n, columns = len(configurations), -(-(3 + distances.shape[1]) // FLOATS) * FLOATS
    room = np.full((n + 1) * columns, np.inf, np.float32)
    first = -room.ctypes.data % (4 * FLOATS) // 4
    told = room[first : first + n * columns].reshape(n, columns)
    told[:, :3], told[:, 3 : 3 + distances.shape[1]] = configurations, distances
    return told
