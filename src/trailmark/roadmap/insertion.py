"""Insertion: new nodes joined to their nearest neighbours, and new edges between nodes, in a roadmap's store."""

from __future__ import annotations

import math
from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision.certify import BUDGET
from trailmark.jit import njit
from trailmark.motion.base import certified, embedding_radius, new_scratch
from trailmark.nearest import Forest, nearest_in
from trailmark.roadmap.adjacency import find_edges, new_pairs
from trailmark.roadmap.store import EdgeStatus, Store
from trailmark.se2 import FloatArray

__all__ = ["JOINED", "append_edges", "insert_edges", "insert_nodes", "joinable_nodes", "neighbour_count"]


def neighbour_count(n: int) -> int:
    """Return ceil(e·(1 + 1/d)·ln n) with d = 3: the bound of PRM* for n nodes.

    Source: Karaman & Frazzoli, "Sampling-based algorithms for optimal motion planning", IJRR 2011, section 3.3
    (k-nearest PRM*).
    """
    return int(np.ceil(math.e * (1.0 + 1.0 / 3.0) * np.log(max(n, 2))))


def insert_nodes(store: Store, q: se2.FloatArray, neighbours: int | None = None) -> NDArray[np.int64]:
    """Add nodes, shape (n, 3), and edges to their nearest neighbours; return the new nodes.

    Args:
        store: to add them to.
        q: valid configurations.
        neighbours: edges per new node; by default PRM*'s bound.
    """
    first = len(store.nodes.view)
    n = first + len(q)
    store.nodes.append(q)
    if len(q) and n > 1:
        _join_near(store, first, min(n - 1, neighbour_count(n) if neighbours is None else neighbours))
    return np.arange(first, n)


def insert_edges(
    store: Store, pairs: NDArray[np.int64], status: EdgeStatus, lengths: se2.FloatArray | None = None
) -> None:
    """Add those of the edges that do not exist yet; mark those that do as FREE if that is the status.

    Args:
        store: to add them to.
        pairs: (p, 2) nodes; a pair may be given twice.
        status: of the new edges.
        lengths: (p,), metres; computed if None.
    """
    motion = store.motion
    if not motion.directed:
        pairs = np.sort(pairs, axis=1)
        same = motion.reversible(store.nodes.view[pairs[:, 0]], store.nodes.view[pairs[:, 1]])
        pairs, lengths = pairs[same], None if lengths is None else lengths[same]
    arrays = store.arrays()
    existing = find_edges(arrays.outgoing, arrays.older, arrays.edges, pairs)
    if status == EdgeStatus.FREE:
        store.mark_free(existing[existing >= 0])
    missing = np.flatnonzero(existing < 0)
    _, first = np.unique(pairs[missing] @ np.array([len(arrays.outgoing), 1]), return_index=True)
    new = missing[np.sort(first)]
    append_edges(store, pairs[new], np.full(len(new), status, np.uint8), None if lengths is None else lengths[new])


def append_edges(
    store: Store, pairs: NDArray[Any], status: NDArray[np.uint8], lengths: se2.FloatArray | None = None
) -> None:
    """Add edges between nodes, shape (m, 2), none of which exists yet; see :func:`insert_edges`."""
    edges, nodes = np.ascontiguousarray(pairs, dtype=np.int32).reshape(-1, 2), store.nodes.view
    if lengths is None:
        lengths = store.motion.costs(nodes[edges[:, 0]], nodes[edges[:, 1]])
    store.edges.append(edges)
    store.lengths.append(lengths)
    store.status.append(status)


def _join_near(store: Store, first: int, k: int) -> None:
    """Join the nodes from ``first`` on to their k nearest ones, or to the k cheapest of several times as many."""
    nodes, motion = store.nodes.view, store.motion
    near = min(len(nodes) - 1, motion.candidates * k)
    found = store.index().query(se2.embed(nodes[first:], motion.radius), near, first=first)
    if motion.candidates == 1:
        pairs = new_pairs(found, first)
        if not motion.directed:
            pairs = pairs[motion.reversible(nodes[pairs[:, 0]], nodes[pairs[:, 1]])]
        append_edges(store, pairs, motion.motions_by_field(nodes[pairs[:, 0]], nodes[pairs[:, 1]]))
        return
    each = np.broadcast_to(np.arange(first, len(nodes))[:, None], found.shape)
    directions = [(each, found), (found, each)] if motion.directed else [(each, found)]
    chosen, lengths = zip(*(_cheapest(store, a, b, k) for a, b in directions), strict=True)
    insert_edges(store, np.concatenate(chosen), EdgeStatus.UNDECIDED, np.concatenate(lengths))


def _cheapest(
    store: Store, a: NDArray[np.int64], b: NDArray[np.int64], k: int
) -> tuple[NDArray[np.int64], se2.FloatArray]:
    """Return of each row of pairs (n, c) the k that cost least, as rows from, to; and their costs."""
    nodes = store.nodes.view
    costs = store.motion.costs(nodes[a.ravel()], nodes[b.ravel()]).reshape(a.shape)
    chosen = np.argpartition(costs, min(k, a.shape[1]) - 1, axis=1)[:, :k]
    first, second, cheapest = (np.take_along_axis(rows, chosen, 1).ravel() for rows in (a, b, costs))
    return np.column_stack([first, second]), np.asarray(cheapest)


# --- Joining: which nodes of a roadmap a configuration is joined to by certified motions.

JOINED: Any = np.int64(3)
"""Nodes that an end of a query is joined to; of numpy's type, as :data:`trailmark.collision.certify.BUDGET`."""

NOBODY: Any = np.int64(-1)
"""In place of a node's own number, where there is none."""


@njit(nogil=True)
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
    count = nearest_in(forest, point, NOBODY, k, distances, ids)
    scratch, found = new_scratch(kind), 0
    for i in range(count):
        node = configurations[ids[i]]
        if certified(kind, scratch, node, q, BUDGET) if reverse else certified(kind, scratch, q, node, BUDGET):
            ids[found] = ids[i]
            found += 1
            if found == enough:
                break
    return ids[:found]
