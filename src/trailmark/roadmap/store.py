"""Store: a roadmap's nodes and edges in arrays that only ever grow, and what finds them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision.kernels import FREE
from trailmark.errors import TrailmarkError
from trailmark.nearest import NearestNeighbours
from trailmark.roadmap.adjacency import Rows, link, merge

__all__ = ["Parts", "Store"]


class Parts(NamedTuple):
    """The arrays that compiled searches take, of lengths that agree.

    Attributes:
        configurations: (n, 3) nodes.
        heads: (n,) newest entry of each node (:mod:`trailmark.roadmap.adjacency`), of those that lead on from it.
        into: (n,) newest entry of those that lead to it; ``heads`` itself if edges lead both ways.
        following: (2 m,) next older entry of the same node.
        edges: (m, 2) nodes joined.
        lengths: (m,) metres.
        status: (m,) FREE, BLOCKED or UNDECIDED.
    """

    configurations: se2.FloatArray
    heads: NDArray[np.int64]
    into: NDArray[np.int64]
    following: NDArray[np.int64]
    edges: NDArray[np.int32]
    lengths: se2.FloatArray
    status: NDArray[np.uint8]


class Store:
    """Nodes and edges.

    Rows are appended, never changed (but for a status, once it is known), so that those of before are there whatever
    cuts a change short; index and links are then made anew from them (:meth:`remade`).

    Args:
        radius: R of the index's embedding (x, y, R·cos θ, R·sin θ), metres.
        directed: whether edges lead one way only.
    """

    def __init__(self, radius: float, directed: bool) -> None:
        self.radius, self.directed = radius, directed
        self.nodes, self.edges = Rows((3,), np.float64), Rows((2,), np.int32)
        self.lengths, self.status = Rows((), np.float64), Rows((), np.uint8)
        self._index = NearestNeighbours(4)
        self._following, self._heads = Rows((), np.int64), Rows((), np.int64)
        self._into = Rows((), np.int64) if directed else self._heads
        self._above, self._merged = Rows((), np.int64), 0

    def remade(self, nodes: int, edges: int) -> Store:
        """Return a store of the first nodes and edges of this one, which it shares."""
        store = Store(self.radius, self.directed)
        store.nodes = self.nodes.first(nodes)
        store.edges, store.lengths, store.status = (
            rows.first(edges) for rows in (self.edges, self.lengths, self.status)
        )
        return store

    def index(self) -> NearestNeighbours:
        """Return the index of all nodes in the embedding."""
        nodes = self.nodes.view
        if len(self._index) < len(nodes):
            self._index.add(se2.embed(nodes[len(self._index) :], self.radius))
        return self._index

    def above(self) -> NDArray[np.int64]:
        """Return the parts that edges known to be free make up (:func:`trailmark.roadmap.adjacency.merge`).

        Edges that were found to be free after they were added count from the next change on that tells so.
        """
        n, edges = len(self.nodes.view), self.edges.view
        known = len(self._above.view)
        self._above.append(np.arange(known, n))
        if self._merged < len(edges):
            merge(self._above.view, edges, self.status.view, self._merged)
            self._merged = len(edges)
        return self._above.view

    def found_free(self, edges: NDArray[np.int64]) -> None:
        """Mark edges as certified."""
        self.status.view[edges] = FREE
        if len(edges):
            self._merged = min(self._merged, int(edges.min()))

    def parts(self) -> Parts:
        """Return the arrays that compiled searches take.

        Raises:
            TrailmarkError: their lengths do not agree, which no search may be given.
        """
        nodes, edges = self.nodes.view, self.edges.view
        n, m, linked = len(nodes), len(edges), len(self._following.view) // 2
        for heads in (self._heads, *([self._into] if self.directed else [])):
            heads.append(-1, n - len(heads.view))
        if linked < m:
            self._following.append(-1, 2 * (m - linked))
            link(self._heads.view, self._into.view, self._following.view, edges, linked)
        parts = Parts(
            nodes, self._heads.view, self._into.view, self._following.view, edges, self.lengths.view, self.status.view
        )
        lengths = [len(rows) for rows in parts]
        if lengths != [n, n, n, 2 * m, m, m, m]:
            raise TrailmarkError(f"roadmap: {n} nodes and {m} edges, but arrays of {lengths} rows given")
        return parts
