"""Store: a roadmap's nodes and edges in arrays that only ever grow, and the indices that find them."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision import kernels
from trailmark.errors import ConfigurationError, TrailmarkError
from trailmark.motion import Motion
from trailmark.nearest import NearestNeighbours
from trailmark.roadmap.adjacency import Rows, link, unite

__all__ = ["EdgeStatus", "SearchArrays", "Store", "require_nodes"]


class EdgeStatus(IntEnum):
    """What is known of an edge: that it collides, that it is certified, or neither, until a search needs it."""

    BLOCKED = kernels.BLOCKED
    FREE = kernels.FREE
    UNDECIDED = kernels.UNDECIDED


class SearchArrays(NamedTuple):
    """The arrays that compiled searches read; their lengths agree.

    Attributes:
        configurations: (n, 3) nodes.
        outgoing: (n,) newest entry of each node (:mod:`trailmark.roadmap.adjacency`) among those that leave it.
        incoming: (n,) newest entry among those that lead to it; the same array if edges lead both ways.
        older: (2 m,) next older entry of the same node.
        edges: (m, 2) nodes joined.
        lengths: (m,) metres.
        status: (m,) :class:`EdgeStatus`.
    """

    configurations: se2.FloatArray
    outgoing: NDArray[np.int64]
    incoming: NDArray[np.int64]
    older: NDArray[np.int64]
    edges: NDArray[np.int32]
    lengths: se2.FloatArray
    status: NDArray[np.uint8]


class Store:
    """Nodes and edges.

    Rows are appended and never changed, except for a status once it is known. Whatever interrupts a change, the rows
    from before it are still there, and :meth:`truncated` rebuilds the indices from them.

    Args:
        motion: what edges are.
    """

    def __init__(self, motion: Motion) -> None:
        self.motion = motion
        self.nodes, self.edges = Rows((3,), np.float64), Rows((2,), np.int32)
        self.lengths, self.status = Rows((), np.float64), Rows((), np.uint8)
        self._index = NearestNeighbours(4)
        self._older, self._outgoing = Rows((), np.int64), Rows((), np.int64)
        self._incoming = Rows((), np.int64) if motion.directed else self._outgoing
        self._parents, self._united = Rows((), np.int64), 0

    def truncated(self, nodes: int, edges: int) -> Store:
        """Return a store of the first nodes and edges of this one, whose memory it shares."""
        store = Store(self.motion)
        store.nodes = self.nodes.first(nodes)
        store.edges, store.lengths, store.status = (
            rows.first(edges) for rows in (self.edges, self.lengths, self.status)
        )
        return store

    def index(self) -> NearestNeighbours:
        """Return the index of all nodes in the embedding."""
        nodes = self.nodes.view
        if len(self._index) < len(nodes):
            self._index.add(se2.embed(nodes[len(self._index) :], self.motion.radius))
        return self._index

    def nearest(self, q: se2.FloatArray) -> NDArray[np.int64]:
        """Return the node nearest to each of the configurations (n, 3), shape (n,); -1 if there is none."""
        return self.index().query(se2.embed(q, self.motion.radius), 1)[:, 0]

    def find(self, q: se2.FloatArray) -> NDArray[np.int64]:
        """Return which node each of the configurations (n, 3) equals exactly, shape (n,); -1 if none does."""
        near = self.nearest(q)
        there = np.flatnonzero(near >= 0)
        same = (self.nodes.view[near[there]] == q[there]).all(axis=1)
        found = np.full(len(q), -1, np.int64)
        found[there[same]] = near[there[same]]
        return found

    def component_parents(self) -> NDArray[np.int64]:
        """Return the union-find forest of the nodes that free edges join (:func:`trailmark.roadmap.adjacency.unite`).

        Edges that were found to be free after they were added count only from the next :meth:`mark_free` on.
        """
        n, edges = len(self.nodes.view), self.edges.view
        self._parents.append(np.arange(len(self._parents.view), n))
        if self._united < len(edges):
            unite(self._parents.view, edges, self.status.view, self._united)
            self._united = len(edges)
        return self._parents.view

    def mark_free(self, edges: NDArray[np.int64]) -> None:
        """Mark edges as certified."""
        self.status.view[edges] = EdgeStatus.FREE
        if len(edges):
            self._united = min(self._united, int(edges.min()))

    def arrays(self) -> SearchArrays:
        """Return the arrays that compiled searches read.

        Raises:
            TrailmarkError: their lengths do not agree: a search would read beyond the end of one of them.
        """
        nodes, edges = self.nodes.view, self.edges.view
        n, m, linked = len(nodes), len(edges), len(self._older.view) // 2
        for newest in (self._outgoing, *([self._incoming] if self.motion.directed else [])):
            newest.append(-1, n - len(newest.view))
        if linked < m:
            self._older.append(-1, 2 * (m - linked))
            link(self._outgoing.view, self._incoming.view, self._older.view, edges, linked)
        arrays = SearchArrays(
            nodes,
            self._outgoing.view,
            self._incoming.view,
            self._older.view,
            edges,
            self.lengths.view,
            self.status.view,
        )
        lengths = [len(rows) for rows in arrays]
        if lengths != [n, n, n, 2 * m, m, m, m]:
            raise TrailmarkError(
                f"roadmap: expected one length and one status for each of {m} edges, got arrays of {lengths} rows"
            )
        return arrays


def require_nodes(nodes: ArrayLike, n: int) -> None:
    """Raise a ConfigurationError unless all nodes exist, of n."""
    numbers = np.asarray(nodes)
    wrong = numbers[(numbers < 0) | (numbers >= n)]
    if len(wrong):
        raise ConfigurationError(f"node: expected 0 or more, below {n}, got {wrong[0]}")
