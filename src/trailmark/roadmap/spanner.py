"""Adjacency: certified edges by node, in one place each; fewer of them, and distances over them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.se2 import FloatArray

__all__ = ["Adjacency", "adjacency_of", "components_of", "distances_from", "spanner"]


class Adjacency(NamedTuple):
    """Edges in both directions, by the node that they lead from.

    Attributes:
        start: (n + 1,) where each node's links begin.
        node: (l,) int32, where each leads to.
        length: (l,) metres.
    """

    start: NDArray[np.int64]
    node: NDArray[np.int32]
    length: FloatArray


def adjacency_of(n: int, edges: NDArray[np.int32], lengths: FloatArray, *, directed: bool = False) -> Adjacency:
    """Return the links of n nodes along edges, shape (m, 2), of lengths (m,); directed ones lead to the second node."""
    sides = 1 if directed else 2
    start = np.concatenate([[0], np.cumsum(np.bincount(edges[:, :sides].ravel(), minlength=n))]).astype(np.int64)
    node, length = np.empty(sides * len(edges), np.int32), np.empty(sides * len(edges))
    _fill(start[:-1].copy(), edges, lengths, sides, node, length)
    return Adjacency(start, node, length)


@njit(cache=True, nogil=True)
def _fill(
    place: NDArray[np.int64],
    edges: NDArray[np.int32],
    lengths: FloatArray,
    sides: int,
    node: NDArray[np.int32],
    length: FloatArray,
) -> None:
    for e in range(len(edges)):
        for side in range(sides):
            a = edges[e, side]
            node[place[a]], length[place[a]] = edges[e, 1 - side], lengths[e]
            place[a] += 1


def spanner(n: int, edges: NDArray[np.int32], lengths: FloatArray, stretch: float) -> Adjacency:
    """Return links of which those are left out that two shorter ones stand in for.

    From the shortest edge to the longest, one is left out if two that are kept lead where it does on a way at most
    ``stretch`` times as long: so no distance grows by more than that factor.

    Args:
        n: nodes.
        edges: (m, 2).
        lengths: (m,), metres.
        stretch: >= 1.
    """
    order = np.argsort(lengths, kind="stable")
    kept = _kept(adjacency_of(n, edges, lengths), order, edges, lengths, stretch)
    return adjacency_of(n, edges[kept], lengths[kept])


@njit(cache=True, nogil=True)
def _kept(
    room: Adjacency, order: NDArray[np.int64], edges: NDArray[np.int32], lengths: FloatArray, stretch: float
) -> NDArray[np.bool_]:
    n = len(room.start) - 1
    kept = np.zeros(len(edges), np.bool_)
    # Each node's links so far, in the room for all.
    node, length, end = room.node, room.length, room.start[:-1].copy()
    marked, way = np.full(n, -1, np.int64), np.empty(n)
    for e in order:
        a, b, most = edges[e, 0], edges[e, 1], stretch * lengths[e]
        for k in range(room.start[a], end[a]):
            marked[node[k]], way[node[k]] = e, length[k]
        found = False
        for k in range(room.start[b], end[b]):
            if marked[node[k]] == e and way[node[k]] + length[k] <= most:
                found = True
                break
        if not found:
            kept[e] = True
            node[end[a]], length[end[a]] = b, lengths[e]
            node[end[b]], length[end[b]] = a, lengths[e]
            end[a] += 1
            end[b] += 1
    return kept


def distances_from(links: Adjacency, beacons: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return distances from some nodes far from one another to all, and which nodes are joined.

    Args:
        links: of n nodes.
        beacons: how many nodes.

    Returns:
        (n, b) float32, metres, b <= ``beacons``, infinite where no way leads; and (n,) the number of each node's
        component, from 0 on.
    """
    n = len(links.start) - 1
    components = components_of(links)
    distances = np.full((n, beacons), np.inf, np.float32)
    if n == 0:
        return distances[:, :0], components
    sizes = np.bincount(components)
    # Only components that queries are likely to be in.
    worth = sizes[components] >= max(2.0, 0.02 * n)
    nearest = np.where(worth, np.inf, -1.0)
    node = int(np.argmax(sizes[components]))
    # From the node farthest from an arbitrary one.
    away = _distances(links, node)
    node = int(np.argmax(np.where(np.isfinite(away), away, -1.0)))
    count = 0
    while count < beacons and nearest[node] > 0.0:
        away = _distances(links, node)
        distances[:, count] = away
        nearest = np.minimum(nearest, away)
        node, count = int(np.argmax(nearest)), count + 1
    return np.ascontiguousarray(distances[:, :count]), components


@njit(cache=True, nogil=True)
def components_of(links: Adjacency) -> NDArray[np.int64]:
    """Return the number of each node's component, shape (n,), from 0 on, of links that lead both ways."""
    n = len(links.start) - 1
    number, waiting = np.full(n, -1, np.int64), np.empty(n, np.int64)
    count = 0
    for first in range(n):
        if number[first] >= 0:
            continue
        number[first] = count
        waiting[0], size = first, 1
        while size > 0:
            size -= 1
            node = waiting[size]
            for k in range(links.start[node], links.start[node + 1]):
                other = links.node[k]
                if number[other] < 0:
                    number[other] = count
                    waiting[size] = other
                    size += 1
        count += 1
    return number


@njit(cache=True, nogil=True)
def _distances(links: Adjacency, source: int) -> FloatArray:
    """Return the distance (metres) from a node to every node, shape (n,) (Dijkstra 1959)."""
    n = len(links.start) - 1
    best = np.full(n, np.inf)
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    best[source] = 0.0
    size = heap_push(keys, values, 0, 0.0, source)
    while size > 0:
        size = heap_pop(keys, values, size)
        reached, node = keys[size], values[size]
        if reached > best[node]:
            continue
        for k in range(links.start[node], links.start[node + 1]):
            other, cost = links.node[k], reached + links.length[k]
            if cost < best[other]:
                best[other] = cost
                if size == len(keys):
                    keys, values = heap_grow(keys, values)
                size = heap_push(keys, values, size, cost, other)
    return best
