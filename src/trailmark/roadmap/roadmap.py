"""Roadmap: configurations joined by motions, as flat arrays for the search and as a networkx graph for people."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.errors import ConfigurationError
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

    Args:
        checker: decides which motions are certified.

    Attributes:
        configurations: (n, 3), the nodes. Read-only.
        edges: (m, 2) int32, the nodes that each edge joins.
        lengths: (m,), cost of each edge in metres, ‖Δxy‖ + 0.5·|Δθ| (a disc robot: ‖Δxy‖).
        status: (m,) uint8: FREE (certified), BLOCKED, UNDECIDED.
    """

    def __init__(self, checker: StateChecker) -> None:
        self.checker = checker
        self.turning = checker.footprint.disc_radius < 0.0
        self.configurations: se2.FloatArray = np.empty((0, 3))
        self.edges: NDArray[np.int32] = np.empty((0, 2), np.int32)
        self.lengths: se2.FloatArray = np.empty(0)
        self.status: NDArray[np.uint8] = np.empty(0, np.uint8)
        self._start_of: NDArray[np.int64] = np.zeros(1, np.int64)
        self._incident: NDArray[np.int64] = np.empty(0, np.int64)

    @classmethod
    def from_arrays(
        cls,
        checker: StateChecker,
        configurations: se2.FloatArray,
        edges: NDArray[np.int32],
        status: NDArray[np.uint8],
    ) -> Roadmap:
        """Return a roadmap made of given nodes and edges, which are not checked.

        Args:
            checker: decides which motions are certified.
            configurations: (n, 3), valid, headings in (-pi, pi].
            edges: (m, 2), no loops, none twice.
            status: (m,), FREE, BLOCKED or UNDECIDED.
        """
        roadmap = cls(checker)
        roadmap.configurations = np.array(configurations, dtype=np.float64, order="C")
        roadmap.edges = np.array(edges, dtype=np.int32, order="C")
        roadmap.status = np.array(status, dtype=np.uint8)
        roadmap.lengths = edge_costs(roadmap.configurations, roadmap.edges, roadmap.turning)
        roadmap._index()
        return roadmap

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
        from scipy.spatial import cKDTree

        first = len(self.configurations)
        nodes = np.vstack([self.configurations, q])
        added = np.arange(first, len(nodes))
        self.configurations = nodes
        if len(added) == 0 or len(nodes) < 2:
            self._index()
            return added
        points = se2.embed(nodes, self.checker.footprint.sweep_radius)
        k = min(len(nodes) - 1, neighbour_count(len(nodes)) if neighbours is None else neighbours)
        found = np.asarray(cKDTree(points).query(points[first:], k + 1)[1])
        pairs = np.column_stack([np.repeat(added, k + 1), found.ravel()])
        pairs = pairs[pairs[:, 0] != pairs[:, 1]]
        # Two new nodes may have chosen each other.
        pairs = np.unique(np.sort(pairs, axis=1), axis=0)
        if self.turning:
            # Exactly half a turn goes counter-clockwise in either direction: its way back is another motion.
            pairs = pairs[np.abs(nodes[pairs[:, 0], 2] - nodes[pairs[:, 1], 2]) != np.pi]
        self._join(pairs, self.checker.motions_by_field(nodes[pairs[:, 0]], nodes[pairs[:, 1]]))
        return added

    def add_path(self, states: se2.FloatArray, first: int, last: int) -> NDArray[np.int64]:
        """Add a path of certified motions between two nodes, with its motions as edges; return the new nodes.

        Args:
            states: shape (p, 3), the first and the last one those of the nodes ``first`` and ``last``.
            first: node that the path begins at.
            last: node that it ends at.
        """
        added = self.add(states[1:-1])
        along = np.concatenate([[first], added, [last]])
        pairs = np.sort(np.column_stack([along[:-1], along[1:]]), axis=1)
        if self.turning:
            pairs = pairs[np.abs(states[:-1, 2] - states[1:, 2]) != np.pi]
        # Neighbours on the path may be joined already: no edge is there twice.
        there, wanted = (np.sort(edges, axis=1) @ np.array([len(self), 1]) for edges in (self.edges, pairs))
        self.status[np.isin(there, wanted)] = FREE
        pairs = pairs[~np.isin(wanted, there)]
        self._join(pairs, np.full(len(pairs), FREE, np.uint8))
        return added

    def _join(self, pairs: NDArray[np.int64], status: NDArray[np.uint8]) -> None:
        """Add edges between nodes, shape (m, 2)."""
        joined = np.ascontiguousarray(pairs, dtype=np.int32)
        self.edges = np.vstack([self.edges, joined])
        self.lengths = np.concatenate([self.lengths, edge_costs(self.configurations, joined, self.turning)])
        self.status = np.concatenate([self.status, status])
        self._index()

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
            to_go: (n,) lower estimates of the cost to the goal; by default the distance, which is exact enough.
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
        nodes, reached = lazy_shortest_path(
            self.checker.grid,
            self.checker.field,
            self.checker.footprint,
            self.configurations,
            self._start_of,
            self._incident,
            self.edges,
            self.lengths,
            self.status,
            int(start),
            int(goal),
            to_go,
            np.zeros(n, np.bool_) if banned is None else banned,
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
        open_edges = np.flatnonzero(self.status == UNDECIDED)
        a, b = self.configurations[self.edges[open_edges, 0]], self.configurations[self.edges[open_edges, 1]]
        self.status[open_edges] = np.where(self.checker.motions_between_valid(a, b), FREE, BLOCKED)

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

    def _index(self) -> None:
        """Sort the edges by node, so that the search finds each node's edges in one place."""
        ends = self.edges.T.ravel()
        order = np.argsort(ends, kind="stable")
        self._incident = (order % max(1, len(self.edges))).astype(np.int64)
        counts = np.bincount(ends, minlength=len(self.configurations))
        self._start_of = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
