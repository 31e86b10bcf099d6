"""Adjacency: the edges of each node as linked lists, and arrays that rows are appended to.

An entry 2·edge + direction stands for an edge followed from its first node (direction 0) or from its second (1). Each
node refers to its newest entry, each entry to the next older one of the same node: adding an edge takes the same time
however many there are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.kernels import FREE
from trailmark.jit import njit
from trailmark.nearest import room_for

__all__ = ["Rows", "find_edges", "link", "new_pairs", "root_of", "unite"]


class Rows:
    """An array that rows are appended to, in time proportional to what is appended.

    Args:
        shape: of a row.
        dtype: of its elements.
    """

    def __init__(self, shape: tuple[int, ...], dtype: Any) -> None:
        self._array: NDArray[Any] = np.empty((0, *shape), dtype)
        self._count = 0

    @property
    def view(self) -> NDArray[Any]:
        """The rows that are there; what is written into them stays, until more are appended."""
        return self._array[: self._count]

    def first(self, count: int) -> Rows:
        """Return the first rows, shared with these until more are appended to either."""
        rows = Rows(self._array.shape[1:], self._array.dtype)
        rows._array, rows._count = self._array, count
        return rows

    def append(self, rows: Any, count: int | None = None) -> None:
        """Append rows, or the same row ``count`` times."""
        first = self._count
        last = first + (len(rows) if count is None else count)
        self._array = room_for(self._array, last)
        self._array[first:last] = rows
        self._count = last


@njit(nogil=True)
def link(
    outgoing: NDArray[np.int64],
    incoming: NDArray[np.int64],
    older: NDArray[np.int64],
    edges: NDArray[np.int32],
    first: int,
) -> None:
    """Enter the edges from ``first`` on into the lists of their nodes.

    Args:
        outgoing: (n,) newest entry of each node, -1 for none, among the entries that leave it.
        incoming: the same for the entries that lead to it; the same array if edges lead both ways.
        older: (2 m,) next older entry of the same node, -1 for none.
        edges: (m, 2) nodes joined.
        first: the first edge that is not entered yet.
    """
    for edge in range(first, len(edges)):
        a, b = edges[edge, 0], edges[edge, 1]
        older[2 * edge] = outgoing[a]
        outgoing[a] = 2 * edge
        older[2 * edge + 1] = incoming[b]
        incoming[b] = 2 * edge + 1


@njit(nogil=True)
def find_edges(
    newest: NDArray[np.int64], older: NDArray[np.int64], edges: NDArray[np.int32], pairs: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return which edge leads from the first to the second node of each pair (p, 2), shape (p,); -1 where none does."""
    found = np.full(len(pairs), -1, np.int64)
    for i in range(len(pairs)):
        entry = newest[pairs[i, 0]]
        while entry >= 0:
            if edges[entry >> 1, 1 - (entry & 1)] == pairs[i, 1]:
                found[i] = entry >> 1
                break
            entry = older[entry]
    return found


@njit(nogil=True)
def new_pairs(found: NDArray[np.int64], first: int) -> NDArray[np.int64]:
    """Return the pairs of new nodes and their neighbours, smaller number first, none twice; shape (p, 2).

    Args:
        found: (m, k) neighbours of the nodes ``first``, ``first`` + 1, ...; -1 for none.
        first: the first new node.
    """
    pairs = np.empty((found.size, 2), np.int64)
    count = 0
    for i in range(len(found)):
        node = first + i
        for other in found[i]:
            if other < 0:
                continue
            # Two new nodes may have chosen each other: then the later one says so.
            if other > node and (found[other - first] == node).any():
                continue
            pairs[count, 0], pairs[count, 1] = min(node, other), max(node, other)
            count += 1
    return pairs[:count]


@njit(nogil=True, numbers=True)
def root_of(parents: NDArray[np.int64], node: int) -> int:
    """Return the node that represents a node's component, halving the path to it (union-find: Tarjan 1975)."""
    while parents[node] != node:
        parents[node] = parents[parents[node]]
        node = parents[node]
    return node


@njit(nogil=True)
def unite(parents: NDArray[np.int64], edges: NDArray[np.int32], status: NDArray[np.uint8], first: int) -> None:
    """Unite the components that the free edges from ``first`` on join.

    Args:
        parents: (n,) another node of the same component, or the node itself if it represents the component.
        edges: (m, 2) nodes joined.
        status: (m,) of which only FREE ones join.
        first: the first edge to enter.
    """
    for edge in range(first, len(edges)):
        if status[edge] == FREE:
            a, b = root_of(parents, edges[edge, 0]), root_of(parents, edges[edge, 1])
            parents[max(a, b)] = min(a, b)
