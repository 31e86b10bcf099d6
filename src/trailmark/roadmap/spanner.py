"""Adjacency: certified edges by node, in one place each; a sparse subset of them, and distances over them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import njit
from trailmark.se2 import FloatArray

__all__ = ["Adjacency", "adjacency_of", "components_of", "distances_from", "spanner"]

LARGE_SHARE = 0.02
"""Share of all nodes that a component must have to get a reference node: queries are likely to be in it."""


class Adjacency(NamedTuple):
    """Edges by the node that they leave, as the three arrays of a compressed sparse row matrix.

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
    sources, targets = edges[:, :sides].ravel(), edges[:, ::-1][:, :sides].ravel()
    start = np.concatenate([[0], np.cumsum(np.bincount(sources, minlength=n))]).astype(np.int64)
    order = np.argsort(sources, kind="stable")
    return Adjacency(start, targets[order], np.repeat(lengths, sides)[order])


def spanner(n: int, edges: NDArray[np.int32], lengths: FloatArray, stretch: float) -> Adjacency:
    """Return the links that remain when edges which two shorter ones can replace are left out.

    From the shortest edge to the longest, one is left out if a path over two edges that remain is at most ``stretch``
    times as long: so no distance grows by more than that factor.

    Args:
        n: nodes.
        edges: (m, 2).
        lengths: (m,), metres.
        stretch: >= 1.
    """
    order = np.argsort(lengths, kind="stable")
    remaining = _remaining(adjacency_of(n, edges, lengths), order, edges, lengths, stretch)
    return adjacency_of(n, edges[remaining], lengths[remaining])


@njit(nogil=True)
def _remaining(
    links: Adjacency, order: NDArray[np.int64], edges: NDArray[np.int32], lengths: FloatArray, stretch: float
) -> NDArray[np.bool_]:
    """Return which edges a spanner consists of, shape (m,); the links are overwritten."""
    n = len(links.start) - 1
    remaining = np.zeros(len(edges), np.bool_)
    # Each node's links so far are written to the beginning of its range.
    node, length, end = links.node, links.length, links.start[:-1].copy()
    marked, distance = np.full(n, -1, np.int64), np.empty(n)
    for e in order:
        a, b, limit = edges[e, 0], edges[e, 1], stretch * lengths[e]
        for k in range(links.start[a], end[a]):
            marked[node[k]], distance[node[k]] = e, length[k]
        found = False
        for k in range(links.start[b], end[b]):
            if marked[node[k]] == e and distance[node[k]] + length[k] <= limit:
                found = True
                break
        if not found:
            remaining[e] = True
            node[end[a]], length[end[a]] = b, lengths[e]
            node[end[b]], length[end[b]] = a, lengths[e]
            end[a] += 1
            end[b] += 1
    return remaining


def components_of(links: Adjacency) -> NDArray[np.int64]:
    """Return the number of each node's connected component, shape (n,), counted from 0."""
    from scipy.sparse.csgraph import connected_components

    return np.asarray(connected_components(_matrix(links), directed=False)[1], dtype=np.int64)


def distances_from(links: Adjacency, references: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return distances from reference nodes to all nodes, and the components.

    The first reference node is the one farthest from an arbitrary node, each further one is the farthest from those
    before it.

    Args:
        links: of n nodes.
        references: maximum number of reference nodes.

    Returns:
        (n, r) float32, metres, infinite where no path leads; and the components (:func:`components_of`).
    """
    from scipy.sparse.csgraph import dijkstra

    matrix, components = _matrix(links), components_of(links)
    n = len(components)
    distances = np.full((n, references), np.inf, np.float32)
    if n == 0:
        return distances[:, :0], components
    sizes = np.bincount(components)[components]
    nearest = np.where(sizes >= max(2.0, LARGE_SHARE * n), np.inf, -1.0)
    arbitrary = dijkstra(matrix, indices=[int(np.argmax(sizes))])[0]
    node = int(np.argmax(np.where(np.isfinite(arbitrary), arbitrary, -1.0)))
    count = 0
    while count < references and nearest[node] > 0.0:
        found = dijkstra(matrix, indices=[node])[0]
        distances[:, count] = found
        nearest = np.minimum(nearest, found)
        node, count = int(np.argmax(nearest)), count + 1
    return np.ascontiguousarray(distances[:, :count]), components


def _matrix(links: Adjacency) -> Any:
    """Return links as a matrix of lengths for scipy's graph routines, without a copy."""
    from scipy.sparse import csr_array

    n = len(links.start) - 1
    return csr_array((links.length, links.node, links.start), shape=(n, n))
