"""Roadmap: configurations joined by motions, as flat arrays for the search and as a networkx graph for people."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.errors import ConfigurationError
from trailmark.nearest import Forest, NearestNeighbours
from trailmark.roadmap.links import Rows, find_edges, link, new_pairs
from trailmark.roadmap.search import edge_costs, lazy_shortest_path

if TYPE_CHECKING:
    import networkx as nx

__all__ = ["Roadmap", "Search", "neighbour_count"]


def neighbour_count(n: int) -> int:
    """Return ceil(e·(1 + 1/d)·ln n) with d = 3: the bound of PRM* for n nodes.

    Source: Karaman & Frazzoli, "Sampling-based algorithms for optimal motion planning", IJRR 2011, section 3.3
    (k-nearest PRM*).
    """
    return int(np.ceil(math.e * (1.0 + 1.0 / 3.0) * np.log(max(n, 2))))


class Search(NamedTuple):
    """What a search found.

    Attributes:
        nodes: (p,) the path's nodes from start to goal; empty if there is none.
        reached: (n,) bool, the nodes reached by certified motions from the start; without a path and a limit,
            all that can be reached.
    """

    nodes: NDArray[np.int64]
    reached: NDArray[np.bool_]


class Roadmap:
    """Nodes are valid configurations, edges are motions between near ones, each checked at most once.

    Nodes and edges are only ever added, in time that hardly depends on how many are there already.

    Args:
        checker: decides which motions are certified.
    """

    def __init__(self, checker: StateChecker) -> None:
        self.checker = checker
        self.turning = checker.footprint.disc_radius < 0.0
        self._nodes, self._edges = Rows((3,), np.float64), Rows((2,), np.int32)
        self._lengths, self._status = Rows((), np.float64), Rows((), np.uint8)
        self._index = NearestNeighbours(4)
        self._following, self._heads = Rows((), np.int64), Rows((), np.int64)
        self._into = self._heads

    @classmethod
    def from_arrays(
        cls,
        checker: StateChecker,
        configurations: se2.FloatArray,
        edges: NDArray[np.int32],
        status: NDArray[np.uint8],
    ) -> Self:
        """Return a roadmap for the checker's robot made of given nodes and edges, which are not checked.

        Args:
            checker: decides which motions are certified.
            configurations: (n, 3), valid, headings in (-pi, pi].
            edges: (m, 2), no loops, none twice.
            status: (m,), FREE, BLOCKED or UNDECIDED.
        """
        roadmap = cls(checker)
        roadmap._append(np.asarray(configurations, dtype=np.float64))
        roadmap._join(roadmap._as_kept(np.asarray(edges)), np.asarray(status, dtype=np.uint8))
        return roadmap

    @property
    def configurations(self) -> se2.FloatArray:
        """The nodes, (n, 3). Read-only."""
        return self._nodes.view

    @property
    def edges(self) -> NDArray[np.int32]:
        """The nodes that each edge joins, (m, 2) int32; of a car's, the nodes that it leads from and to. Read-only."""
        return self._edges.view

    @property
    def lengths(self) -> se2.FloatArray:
        """Cost of each edge in metres, (m,): ‖Δxy‖ + 0.5·|Δθ|, a disc robot's ‖Δxy‖, a car's curve's length."""
        return self._lengths.view

    @property
    def status(self) -> NDArray[np.uint8]:
        """FREE (certified), BLOCKED or UNDECIDED for each edge, (m,) uint8. What is written into it stays."""
        return self._status.view

    def save(self, path: str | FilePath) -> None:
        """Write the roadmap to a file: see :func:`trailmark.roadmap.files.save_roadmap`."""
        from trailmark.roadmap.files import save_roadmap

        save_roadmap(self, path)

    @classmethod
    def load(cls, path: str | FilePath, checker: StateChecker) -> Roadmap:
        """Read a roadmap from a file: see :func:`trailmark.roadmap.files.load_roadmap`."""
        from trailmark.roadmap.files import load_roadmap

        return load_roadmap(path, checker)

    def __len__(self) -> int:
        return len(self.configurations)

    @property
    def certified(self) -> NDArray[np.bool_]:
        """Which edges are certified, shape (m,)."""
        return np.asarray(self.status == FREE)

    def add(self, q: se2.FloatArray, *, neighbours: int | None = None) -> NDArray[np.int64]:
        """Add valid configurations, shape (n, 3), and edges to their nearest neighbours; return the new nodes.

        Nearness is Euclidean in the embedding (x, y, R·cos θ, R·sin θ). What the clearance field can prove of the
        new edges is decided at once, the rest when a search needs it.

        Args:
            q: valid configurations.
            neighbours: edges per new node; by default PRM*'s bound (:func:`neighbour_count`).
        """
        added = self._append(q)
        n = len(self)
        if len(added) and n > 1:
            self._join_near(added, min(n - 1, neighbour_count(n) if neighbours is None else neighbours))
        return added

    def add_path(self, states: se2.FloatArray, first: int, last: int) -> NDArray[np.int64]:
        """Add a path of certified motions between two nodes, with its motions as edges; return the new nodes.

        Args:
            states: shape (p, 3), the first and the last one those of the nodes ``first`` and ``last``.
            first: node that the path begins at.
            last: node that it ends at.
        """
        added = self.add(states[1:-1])
        along = np.concatenate([[first], added, [last]]).astype(np.int64)
        self._connect(np.column_stack([along[:-1], along[1:]]), FREE)
        return added

    def nearest(self) -> Forest:
        """Return an index of its own over the nodes in the embedding that :meth:`add` describes."""
        return self._index.merged()

    @property
    def _radius(self) -> float:
        """R of the embedding, metres."""
        return self.checker.footprint.sweep_radius

    def _join_near(self, added: NDArray[np.int64], k: int) -> None:
        """Join new nodes to their k nearest ones."""
        first, nodes = int(added[0]), self.configurations
        pairs = new_pairs(self._index.query(se2.embed(nodes[first:], self._radius), k, first=first), first)
        pairs = self._both_ways(pairs)
        self._join(pairs, self.checker.motions_by_field(nodes[pairs[:, 0]], nodes[pairs[:, 1]]))

    def _both_ways(self, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return those of the pairs whose motion is the same in both directions."""
        if not self.turning:
            return pairs
        heading = self.configurations[:, 2]
        # Exactly half a turn goes counter-clockwise in either direction: its way back is another motion.
        return np.asarray(pairs[np.abs(heading[pairs[:, 0]] - heading[pairs[:, 1]]) != np.pi])

    def _as_kept(self, edges: NDArray[Any]) -> NDArray[Any]:
        """Return edges, shape (m, 2), from the node that they are kept from."""
        return edges

    def _lengths_of(self, edges: NDArray[np.int32]) -> se2.FloatArray:
        return np.asarray(edge_costs(self.configurations, edges, self.turning))

    def _connect(self, pairs: NDArray[np.int64], status: int, lengths: se2.FloatArray | None = None) -> None:
        """Add edges, shape (p, 2), that are not there yet; mark those that are FREE if that is their status."""
        pairs = self._both_ways(np.sort(pairs, axis=1))
        self._add_missing(pairs, status, lengths)

    def _add_missing(self, pairs: NDArray[np.int64], status: int, lengths: se2.FloatArray | None) -> None:
        there = find_edges(self._heads.view, self._following.view, self.edges, pairs)
        if status == FREE:
            self.status[there[there >= 0]] = FREE
        missing = np.flatnonzero(there < 0)
        # A pair may be given twice.
        _, first = np.unique(pairs[missing] @ np.array([len(self), 1]), return_index=True)
        new = missing[np.sort(first)]
        self._join(pairs[new], np.full(len(new), status, np.uint8), None if lengths is None else lengths[new])

    def _append(self, q: se2.FloatArray) -> NDArray[np.int64]:
        """Add nodes without edges; return them."""
        added = np.arange(len(self), len(self) + len(q))
        self._nodes.append(q)
        self._index.add(se2.embed(self.configurations[added[0] :] if len(q) else q, self._radius))
        self._heads.append(-1, len(q))
        if self._into is not self._heads:
            self._into.append(-1, len(q))
        return added

    def _join(self, pairs: NDArray[Any], status: NDArray[np.uint8], lengths: se2.FloatArray | None = None) -> None:
        """Add edges between nodes, shape (m, 2), that are not there yet."""
        first, joined = len(self.edges), np.ascontiguousarray(pairs, dtype=np.int32).reshape(-1, 2)
        self._lengths.append(self._lengths_of(joined) if lengths is None else lengths)
        self._status.append(status)
        self._following.append(-1, 2 * len(joined))
        # Last, so that whoever reads meanwhile finds all that belongs to an edge.
        self._edges.append(joined)
        link(self._heads.view, self._into.view, self._following.view, self.edges, first)

    def shortest_path(
        self,
        start: int,
        goal: int,
        *,
        to_go: se2.FloatArray | None = None,
        banned: NDArray[np.bool_] | None = None,
        limit: float = np.inf,
    ) -> Search:
        """Return the shortest certified path's nodes.

        Edges that the search needs and nobody has checked yet are checked and marked.

        Args:
            start: first node.
            goal: last node.
            to_go: (n,) lower estimates of the cost to the goal; by default :meth:`distances_to` it.
            banned: (n,) nodes not to be used.
            limit: give up above this cost, metres.

        Raises:
            ConfigurationError: a node that is not there.
        """
        n = len(self.configurations)
        for node in (start, goal):
            if not 0 <= node < n:
                raise ConfigurationError(f"node {node} given, allowed: 0 to {n - 1}")
        if to_go is None:
            to_go = self.distances_to(goal)
        return self._search(start, goal, to_go, banned, limit)

    def _search(
        self, start: int, goal: int, to_go: se2.FloatArray, banned: NDArray[np.bool_] | None, limit: float
    ) -> Search:
        checker = self.checker
        nodes, reached = lazy_shortest_path(
            checker.grid,
            checker.field,
            checker.footprint,
            self.configurations,
            self._heads.view,
            self._following.view,
            self.edges,
            self.lengths,
            self.status,
            int(start),
            int(goal),
            to_go,
            np.zeros(len(self), np.bool_) if banned is None else banned,
            float(limit),
        )
        return Search(nodes, reached)

    def distances_to(self, node: int) -> se2.FloatArray:
        """Return every node's straight distance to a node, shape (n,), in the metric of ``lengths``."""
        target = self.configurations[node]
        if self.turning:
            return np.asarray(se2.distance(self.configurations, target))
        return np.asarray(np.hypot(*(self.configurations[:, :2] - target[:2]).T))

    def certify_all(self) -> None:
        """Check every edge that nobody has checked yet, in one batch."""
        undecided = np.flatnonzero(self.status == UNDECIDED)
        a, b = self.configurations[self.edges[undecided, 0]], self.configurations[self.edges[undecided, 1]]
        self.status[undecided] = np.where(self._motions_valid(a, b), FREE, BLOCKED)

    def _motions_valid(self, a: se2.FloatArray, b: se2.FloatArray) -> NDArray[np.bool_]:
        return self.checker.motions_between_valid(a, b)

    @property
    def graph(self) -> nx.Graph:
        """The roadmap as a networkx graph (a copy).

        Nodes are numbered 0 to n - 1, with attributes ``configuration`` (x, y, theta) and ``clearance`` (metres);
        edges, the blocked ones left out, have ``length`` (metres), ``certified`` (bool) and ``clearance``: the
        smaller one of its ends' (metres).
        """
        import networkx as nx

        graph = nx.Graph()
        clearance = np.asarray(self.checker.clearance(self.configurations)) if len(self) else np.empty(0)
        for i, (q, room) in enumerate(zip(self.configurations.tolist(), clearance.tolist(), strict=True)):
            graph.add_node(i, configuration=tuple(q), clearance=room)
        kept = self.status != BLOCKED
        rows = zip(self.edges[kept].tolist(), self.lengths[kept].tolist(), self.certified[kept].tolist(), strict=True)
        for (u, v), length, certified in rows:
            room = min(clearance[u], clearance[v])
            graph.add_edge(u, v, length=length, certified=certified, clearance=float(room))
        return graph
