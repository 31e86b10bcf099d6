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
from trailmark.nearest import Forest
from trailmark.roadmap.links import find_edges, new_pairs
from trailmark.roadmap.search import edge_costs, lazy_shortest_path
from trailmark.roadmap.store import Store

if TYPE_CHECKING:
    import networkx as nx

__all__ = ["Roadmap", "Search", "neighbour_count", "of_each", "require_nodes"]


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


class _Kept(NamedTuple):
    """What a roadmap is made of, replaced as a whole: a change that is cut short has not taken place.

    Attributes:
        store: holds the nodes and edges, and while a change is under way more of them.
        nodes: how many count.
        edges: how many count.
        whole: whether index and links are made of exactly those; not while a change is under way, or was cut short.
    """

    store: Store
    nodes: int
    edges: int
    whole: bool


class Roadmap:
    """Nodes are valid configurations, edges are motions between near ones, each checked at most once.

    Nodes and edges are only ever added, in time that hardly depends on how many are there already; an exception, at
    whatever place, leaves the roadmap as it was or as it was to become. One thread may change it at a time.

    Args:
        checker: decides which motions are certified.
    """

    def __init__(self, checker: StateChecker) -> None:
        self.checker = checker
        self.turning = checker.footprint.disc_radius < 0.0
        self._kept = _Kept(Store(self._radius, self.directed), 0, 0, whole=True)

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
        store = roadmap._changing()
        store.nodes.append(np.asarray(configurations, dtype=np.float64))
        pairs = np.asarray(edges).reshape(-1, 2)
        require_nodes(pairs, len(configurations))
        roadmap._join(store, roadmap._as_kept(pairs), np.asarray(status, dtype=np.uint8))
        roadmap._commit(store)
        return roadmap

    def rows(self) -> tuple[se2.FloatArray, NDArray[np.int32], se2.FloatArray, NDArray[np.uint8]]:
        """Return ``configurations``, ``edges``, ``lengths`` and ``status`` of one moment, whoever adds to them."""
        store, n, m, _ = self._kept
        return store.nodes.view[:n], store.edges.view[:m], store.lengths.view[:m], store.status.view[:m]

    @property
    def configurations(self) -> se2.FloatArray:
        """The nodes, (n, 3). Read-only."""
        return self.rows()[0]

    @property
    def edges(self) -> NDArray[np.int32]:
        """The nodes that each edge joins, (m, 2) int32; of a car's, the nodes that it leads from and to. Read-only."""
        return self.rows()[1]

    @property
    def lengths(self) -> se2.FloatArray:
        """Cost of each edge in metres, (m,): ‖Δxy‖ + 0.5·|Δθ|, a disc robot's ‖Δxy‖, a car's curve's length."""
        return self.rows()[2]

    @property
    def status(self) -> NDArray[np.uint8]:
        """FREE (certified), BLOCKED or UNDECIDED for each edge, (m,) uint8. What is written into it stays."""
        return self.rows()[3]

    @property
    def directed(self) -> bool:
        """Whether edges lead one way only."""
        return False

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
        return self._kept.nodes

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
            neighbours: edges per new node, >= 1; by default PRM*'s bound (:func:`neighbour_count`).

        Raises:
            ConfigurationError: another shape, values that are not finite, ``neighbours`` below 1.
        """
        rows = np.atleast_2d(se2.configurations(q))
        if neighbours is not None and neighbours < 1:
            raise ConfigurationError(f"neighbours: {neighbours} given, allowed: 1 or more")
        store = self._changing()
        added = self._add(store, rows, neighbours)
        self._commit(store)
        return added

    def add_path(self, states: se2.FloatArray, first: int, last: int) -> NDArray[np.int64]:
        """Add a path of certified motions between two nodes, with its motions as edges; return the new nodes.

        Args:
            states: shape (p, 3), the first and the last one those of the nodes ``first`` and ``last``.
            first: node that the path begins at.
            last: node that it ends at.

        Raises:
            ConfigurationError: another shape, values that are not finite, a node that is not there.
        """
        inner = np.atleast_2d(se2.configurations(states))[1:-1]
        require_nodes([first, last], len(self))
        store = self._changing()
        added = self._add(store, inner)
        along = np.concatenate([[first], added, [last]]).astype(np.int64)
        self._connect(store, np.column_stack([along[:-1], along[1:]]), FREE)
        self._commit(store)
        return added

    def nearest(self) -> Forest:
        """Return an index of its own over the nodes in the embedding that :meth:`add` describes."""
        return self._whole().index().merged()

    def _changing(self) -> Store:
        """Return what a change is made in; it takes place once it is committed, in one step."""
        store = self._whole()
        self._kept = self._kept._replace(store=store, whole=False)
        return store

    def _commit(self, store: Store) -> None:
        parts, index = store.parts(), store.index()
        self._kept = _Kept(store, len(index), len(parts.edges), whole=True)

    def _whole(self) -> Store:
        """Return the store, with exactly the nodes and edges that count."""
        kept = self._kept
        return kept.store if kept.whole else kept.store.remade(kept.nodes, kept.edges)

    @property
    def _radius(self) -> float:
        """R of the embedding, metres."""
        return self.checker.footprint.sweep_radius

    def _add(self, store: Store, q: se2.FloatArray, neighbours: int | None = None) -> NDArray[np.int64]:
        """Add nodes and edges to their nearest neighbours; return the new nodes."""
        first = len(store.nodes.view)
        n = first + len(q)
        store.nodes.append(q)
        if len(q) and n > 1:
            self._join_near(store, first, min(n - 1, neighbour_count(n) if neighbours is None else neighbours))
        return np.arange(first, n)

    def _join_near(self, store: Store, first: int, k: int) -> None:
        """Join the nodes from ``first`` on to their k nearest ones."""
        nodes = store.nodes.view
        pairs = new_pairs(store.index().query(se2.embed(nodes[first:], self._radius), k, first=first), first)
        pairs = self._both_ways(nodes, pairs)
        self._join(store, pairs, self.checker.motions_by_field(nodes[pairs[:, 0]], nodes[pairs[:, 1]]))

    def _both_ways(self, nodes: se2.FloatArray, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return those of the pairs whose motion is the same in both directions."""
        if not self.turning:
            return pairs
        heading = nodes[:, 2]
        # Exactly half a turn goes counter-clockwise in either direction: its way back is another motion.
        return np.asarray(pairs[np.abs(heading[pairs[:, 0]] - heading[pairs[:, 1]]) != np.pi])

    def _as_kept(self, edges: NDArray[Any]) -> NDArray[Any]:
        """Return edges, shape (m, 2), from the node that they are kept from."""
        return edges

    def _lengths_of(self, nodes: se2.FloatArray, edges: NDArray[np.int32]) -> se2.FloatArray:
        return np.asarray(edge_costs(nodes, edges, self.turning))

    def _connect(
        self, store: Store, pairs: NDArray[np.int64], status: int, lengths: se2.FloatArray | None = None
    ) -> None:
        """Add edges, shape (p, 2), that are not there yet; mark those that are FREE if that is their status."""
        pairs = self._both_ways(store.nodes.view, np.sort(pairs, axis=1))
        self._add_missing(store, pairs, status, lengths)

    def _add_missing(self, store: Store, pairs: NDArray[np.int64], status: int, lengths: se2.FloatArray | None) -> None:
        parts = store.parts()
        there = find_edges(parts.heads, parts.following, parts.edges, pairs)
        if status == FREE:
            parts.status[there[there >= 0]] = FREE
        missing = np.flatnonzero(there < 0)
        # A pair may be given twice.
        _, first = np.unique(pairs[missing] @ np.array([len(parts.heads), 1]), return_index=True)
        new = missing[np.sort(first)]
        self._join(store, pairs[new], np.full(len(new), status, np.uint8), None if lengths is None else lengths[new])

    def _join(
        self, store: Store, pairs: NDArray[Any], status: NDArray[np.uint8], lengths: se2.FloatArray | None = None
    ) -> None:
        """Add edges between nodes, shape (m, 2), that are not there yet."""
        joined = np.ascontiguousarray(pairs, dtype=np.int32).reshape(-1, 2)
        store.edges.append(joined)
        store.lengths.append(self._lengths_of(store.nodes.view, joined) if lengths is None else lengths)
        store.status.append(status)

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
            ConfigurationError: a node that is not there, ``to_go`` or ``banned`` of another length.
        """
        require_nodes([start, goal], len(self))
        if to_go is None:
            to_go = self.distances_to(goal)
        return self._search(start, goal, to_go, banned, limit)

    def _search(
        self, start: int, goal: int, to_go: se2.FloatArray, banned: NDArray[np.bool_] | None, limit: float
    ) -> Search:
        checker, parts = self.checker, self._whole().parts()
        nodes, reached = lazy_shortest_path(
            checker.grid,
            checker.field,
            checker.footprint,
            parts.configurations,
            parts.heads,
            parts.following,
            parts.edges,
            parts.lengths,
            parts.status,
            int(start),
            int(goal),
            *of_each(len(parts.heads), to_go, banned),
            float(limit),
        )
        return Search(nodes, reached)

    def distances_to(self, node: int) -> se2.FloatArray:
        """Return every node's straight distance to a node, shape (n,), in the metric of ``lengths``."""
        require_nodes([node], len(self))
        target = self.configurations[node]
        if self.turning:
            return np.asarray(se2.distance(self.configurations, target))
        return np.asarray(np.hypot(*(self.configurations[:, :2] - target[:2]).T))

    def certify_all(self) -> None:
        """Check every edge that nobody has checked yet, in one batch."""
        q, edges, _, status = self.rows()
        undecided = np.flatnonzero(status == UNDECIDED)
        a, b = q[edges[undecided, 0]], q[edges[undecided, 1]]
        status[undecided] = np.where(self._motions_valid(a, b), FREE, BLOCKED)

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
        configurations, edges, lengths, status = self.rows()
        clearance = np.asarray(self.checker.clearance(configurations)) if len(configurations) else np.empty(0)
        for i, (q, room) in enumerate(zip(configurations.tolist(), clearance.tolist(), strict=True)):
            graph.add_node(i, configuration=tuple(q), clearance=room)
        kept = status != BLOCKED
        rows = zip(edges[kept].tolist(), lengths[kept].tolist(), (status[kept] == FREE).tolist(), strict=True)
        for (u, v), length, certified in rows:
            room = min(clearance[u], clearance[v])
            graph.add_edge(u, v, length=length, certified=certified, clearance=float(room))
        return graph


def of_each(
    n: int, to_go: se2.FloatArray, banned: NDArray[np.bool_] | None
) -> tuple[se2.FloatArray, NDArray[np.bool_]]:
    """Return what a search takes of each node, (n,) each: compiled code reads on beyond a shorter array."""
    closed = np.zeros(n, np.bool_) if banned is None else banned
    for name, rows in (("to_go", to_go), ("banned", closed)):
        if np.shape(rows) != (n,):
            raise ConfigurationError(f"{name}: shape {np.shape(rows)} given, allowed: ({n},), one for each node")
    return to_go, closed


def require_nodes(nodes: Any, n: int) -> None:
    """Raise a ConfigurationError unless all nodes are there, of n."""
    given = np.asarray(nodes)
    wrong = given[(given < 0) | (given >= n)]
    if len(wrong):
        raise ConfigurationError(f"node {wrong[0]} given, allowed: 0 to {n - 1}")
