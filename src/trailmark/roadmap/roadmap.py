"""Roadmap: configurations joined by motions, as flat arrays for the search and as a networkx graph for people."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.clock import Deadline
from trailmark.collision import StateChecker
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.errors import ConfigurationError
from trailmark.motion import Motion, motion_of
from trailmark.nearest import Forest
from trailmark.roadmap.adjacency import find_edges, new_pairs, part_of
from trailmark.roadmap.search import edge_costs, joined, lazy_shortest_path
from trailmark.roadmap.store import Store

if TYPE_CHECKING:
    import networkx as nx

__all__ = ["FoundPath", "Roadmap", "Search", "neighbour_count", "require_nodes"]

NEAR, ENOUGH = 12, 3
"""Nodes near an end of a query that are tried, and how many of them are joined to it."""

UNBOUNDED = 1 << 62
"""A budget without bounds."""

ZERO = np.zeros(1)


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
        taken: nodes and undecided edges that it took from its queue.
    """

    nodes: NDArray[np.int64]
    reached: NDArray[np.bool_]
    taken: int


class FoundPath(NamedTuple):
    """What a roadmap knows of a query.

    Attributes:
        states: (p, 3) of a path of certified motions, ends included; (0, 3) if none was found.
        taken: motions, nodes and undecided edges that were looked at.
        complete: whether a larger budget would have found no more.
    """

    states: se2.FloatArray
    taken: int
    complete: bool


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

    Edges of a car that drives forwards only lead from their first node to their second; all others lead both ways.

    Nodes and edges are only ever added, in time that hardly depends on how many are there already; an exception, at
    whatever place, leaves the roadmap as it was or as it was to become. One thread may change it at a time.

    Args:
        checker: decides which configurations are valid.
        motion: what edges are; by default how the checker's robot moves (:func:`trailmark.motion.motion_of`).

    Attributes:
        checker: as given.
        motion: as given.
    """

    def __init__(self, checker: StateChecker, motion: Motion | None = None) -> None:
        self.checker = checker
        self.motion = motion_of(checker) if motion is None else motion
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
        roadmap._join(store, pairs, np.asarray(status, dtype=np.uint8))
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
        return self.motion.directed

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

    def add_path(self, states: se2.FloatArray) -> NDArray[np.int64]:
        """Add a path of certified motions, with its motions as edges; return its nodes, from first to last.

        States that are nodes already stay the nodes that they are; one given twice in a row counts once.

        Args:
            states: shape (p, 3).

        Raises:
            ConfigurationError: another shape, values that are not finite.
        """
        rows = np.atleast_2d(se2.configurations(states))
        rows = _once(rows)
        along = self._nodes_at(rows)
        new = np.flatnonzero(along < 0)
        store = self._changing()
        along[new] = self._add(store, rows[new])
        self._connect(store, np.column_stack([along[:-1], along[1:]]), FREE)
        self._commit(store)
        return along

    def add_tree(self, q: se2.FloatArray, parents: NDArray[np.int64], *, reverse: bool = False) -> NDArray[np.int64]:
        """Add valid configurations that hang on nodes or on one another; return the new nodes.

        Args:
            q: shape (n, 3).
            parents: (n,): a node, or ``len(self) + i`` for the i-th of ``q``, from which a motion leads to it.
            reverse: whether the motions lead to the parents instead.

        Raises:
            ConfigurationError: another shape, values that are not finite, a node that is not there.
        """
        rows = np.atleast_2d(se2.configurations(q))
        require_nodes(parents, len(self) + len(rows))
        store = self._changing()
        added = self._add(store, rows)
        ends = (added, parents) if reverse else (parents, added)
        self._connect(store, np.column_stack(ends), UNDECIDED)
        self._commit(store)
        return added

    def ends(self, q: se2.FloatArray) -> NDArray[np.int64]:
        """Return the nodes of valid configurations, shape (n, 3), added where they are none yet."""
        nodes = self._nodes_at(q)
        new = np.flatnonzero(nodes < 0)
        if len(new):
            nodes[new] = self.add(q[new])
        return nodes

    def fresh(self, q: se2.FloatArray, apart: float) -> se2.FloatArray:
        """Return those of the configurations (n, 3) that lie more than ``apart`` (metres) from all joined nodes."""
        nodes, near = self.configurations, self._nearest_to(q)
        there = np.flatnonzero(near >= 0)
        gap = se2.embed(q[there], self._radius) - se2.embed(nodes[near[there]], self._radius)
        close = np.zeros(len(q), np.bool_)
        close[there] = (np.sum(gap * gap, axis=1) <= apart * apart) & (self._whole().parts().heads[near[there]] >= 0)
        return q[~close]

    def _nearest_to(self, q: se2.FloatArray) -> NDArray[np.int64]:
        """Return the node nearest to each of the configurations (n, 3), shape (n,); -1 if there is none."""
        return self._whole().index().query(se2.embed(q, self._radius), 1)[:, 0]

    def _nodes_at(self, q: se2.FloatArray) -> NDArray[np.int64]:
        """Return which node each of the configurations (n, 3) is, to the last bit, shape (n,); -1 if none is."""
        nodes, near = self.configurations, self._nearest_to(q)
        there = np.flatnonzero(near >= 0)
        same = (nodes[near[there]] == q[there]).all(axis=1)
        found = np.full(len(q), -1, np.int64)
        found[there[same]] = near[there[same]]
        return found

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
        store.above()
        self._kept = _Kept(store, len(index), len(parts.edges), whole=True)

    def _whole(self) -> Store:
        """Return the store, with exactly the nodes and edges that count."""
        kept = self._kept
        return kept.store if kept.whole else kept.store.remade(kept.nodes, kept.edges)

    @property
    def _radius(self) -> float:
        """R of the embedding, metres."""
        return self.motion.radius

    def _add(self, store: Store, q: se2.FloatArray, neighbours: int | None = None) -> NDArray[np.int64]:
        """Add nodes and edges to their nearest neighbours; return the new nodes."""
        first = len(store.nodes.view)
        n = first + len(q)
        store.nodes.append(q)
        if len(q) and n > 1:
            self._join_near(store, first, min(n - 1, neighbour_count(n) if neighbours is None else neighbours))
        return np.arange(first, n)

    def _join_near(self, store: Store, first: int, k: int) -> None:
        """Join the nodes from ``first`` on to their k nearest ones, or to those of some near ones that cost least."""
        nodes = store.nodes.view
        near = min(len(nodes) - 1, self.motion.candidates * k)
        found = store.index().query(se2.embed(nodes[first:], self._radius), near, first=first)
        if self.motion.candidates == 1:
            pairs = self._reversible(nodes, new_pairs(found, first))
            self._join(store, pairs, self.motion.motions_by_field(nodes[pairs[:, 0]], nodes[pairs[:, 1]]))
            return
        each = np.broadcast_to(np.arange(first, len(nodes))[:, None], found.shape)
        ways = [(each, found), (found, each)] if self.directed else [(each, found)]
        chosen, lengths = zip(*(self._cheapest(nodes, a, b, k) for a, b in ways), strict=True)
        self._connect(store, np.concatenate(chosen), UNDECIDED, np.concatenate(lengths))

    def _cheapest(
        self, q: se2.FloatArray, a: NDArray[np.int64], b: NDArray[np.int64], k: int
    ) -> tuple[NDArray[np.int64], se2.FloatArray]:
        """Return of each row of pairs (n, c) the k that cost least, as rows from, to; and their costs."""
        costs = self.motion.costs(q[a.ravel()], q[b.ravel()]).reshape(a.shape)
        chosen = np.argpartition(costs, min(k, a.shape[1]) - 1, axis=1)[:, :k]
        first, second, cheapest = (np.take_along_axis(rows, chosen, 1).ravel() for rows in (a, b, costs))
        return np.column_stack([first, second]), np.asarray(cheapest)

    def _reversible(self, nodes: se2.FloatArray, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return those of the pairs whose motion is the same in both directions; all if edges lead one way."""
        if self.directed:
            return pairs
        return pairs[self.motion.reversible(nodes[pairs[:, 0]], nodes[pairs[:, 1]])]

    def _connect(
        self, store: Store, pairs: NDArray[np.int64], status: int, lengths: se2.FloatArray | None = None
    ) -> None:
        """Add edges, shape (p, 2), that are not there yet; mark those that are FREE if that is their status."""
        if not self.directed:
            pairs = np.sort(pairs, axis=1)
            same = self.motion.reversible(store.nodes.view[pairs[:, 0]], store.nodes.view[pairs[:, 1]])
            pairs, lengths = pairs[same], None if lengths is None else lengths[same]
        parts = store.parts()
        there = find_edges(parts.heads, parts.following, parts.edges, pairs)
        if status == FREE:
            store.found_free(there[there >= 0])
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
        store.lengths.append(edge_costs(self.motion.kind, store.nodes.view, joined) if lengths is None else lengths)
        store.status.append(status)

    def shortest_path(
        self,
        start: int,
        goal: int,
        *,
        to_go: se2.FloatArray | None = None,
        banned: NDArray[np.bool_] | None = None,
        limit: float = np.inf,
        seconds: float = np.inf,
    ) -> Search:
        """Return the shortest certified path's nodes.

        Edges that the search needs and nobody has checked yet are checked and marked.

        Args:
            start: first node.
            goal: last node.
            to_go: (n,) lower estimates of the cost to the goal; by default :meth:`distances_to` it.
            banned: (n,) nodes not to be used.
            limit: give up above this cost, metres.
            seconds: that the search may take.

        Raises:
            ConfigurationError: a node that is not there, ``to_go`` or ``banned`` of another length.
        """
        require_nodes([start, goal], len(self))
        if to_go is None:
            to_go = self.distances_to(goal)
        return self._search((_one(start), ZERO), (_one(goal), ZERO), to_go, banned=banned, limit=limit, seconds=seconds)

    def find_path(
        self,
        start: se2.FloatArray,
        goal: se2.FloatArray,
        *,
        weight: float = 1.0,
        limit: float = np.inf,
        budget: int = UNBOUNDED,
        seconds: float = np.inf,
        checking: bool = True,
        near: int = NEAR,
    ) -> FoundPath:
        """Return a path between configurations that need not be nodes; nothing is added.

        Args:
            start: valid, shape (3,).
            goal: valid, shape (3,).
            weight: how many times as long as the shortest over the nodes the path may be, >= 1: sooner, if it may.
            limit: longest cost of interest, metres; of a weighted one.
            budget: nodes and undecided edges taken from the queue at most.
            seconds: that the search may take.
            checking: whether edges that nobody has checked yet are checked; else they are not used.
            near: nodes near an end that are tried until enough are joined to it.
        """
        q = self.configurations
        # Copies: a path's states are read-only, which to numba is another type and another compilation.
        start, goal = np.array(start), np.array(goal)
        first, last = self._joined(start, near, reverse=False), self._joined(goal, near, reverse=True)
        tried = 2 * min(len(q), near)
        if len(first[0]) == 0 or len(last[0]) == 0:
            return FoundPath(q[:0], tried, complete=True)
        if not checking and not self._together(first[0], last[0]):
            return FoundPath(q[:0], tried, complete=False)
        to_go = weight * np.hypot(*(q[:, :2] - goal[:2]).T)
        begin = perf_counter()
        found = self._search(first, last, to_go, limit=limit, budget=budget, seconds=seconds, checking=checking)
        ended = found.taken < budget and perf_counter() - begin < seconds
        complete = len(found.nodes) > 0 or (checking and ended)
        states = np.vstack([start, q[found.nodes], goal]) if len(found.nodes) else q[:0]
        # An end may be a node.
        return FoundPath(_once(states), tried + found.taken, complete)

    def _together(self, first: NDArray[np.int64], last: NDArray[np.int64]) -> bool:
        """Return whether edges known to be free, in whatever direction, join a node of both."""
        above = self._whole().above()
        return not {part_of(above, i) for i in first}.isdisjoint(part_of(above, i) for i in last)

    def _joined(self, q: se2.FloatArray, near: int, *, reverse: bool) -> tuple[NDArray[np.int64], se2.FloatArray]:
        """Return some near nodes that certified motions join to a configuration, and what those cost, metres.

        Args:
            q: valid, shape (3,).
            near: how many nodes are tried until enough are joined.
            reverse: whether the motions are to lead to ``q``.
        """
        nodes, forest = self.configurations, self._whole().index().forest()
        found = joined(self.motion.kind, nodes, forest, q, min(len(nodes), near), ENOUGH, reverse)
        return found, self.motion.costs(nodes[found], q) if reverse else self.motion.costs(q, nodes[found])

    def _search(
        self,
        first: tuple[NDArray[np.int64], se2.FloatArray],
        last: tuple[NDArray[np.int64], se2.FloatArray],
        to_go: se2.FloatArray,
        *,
        banned: NDArray[np.bool_] | None = None,
        limit: float = np.inf,
        budget: int = UNBOUNDED,
        seconds: float = np.inf,
        checking: bool = True,
        reverse: bool = False,
    ) -> Search:
        """Search from nodes that may be begun at for a cost, to nodes with a cost from there on."""
        parts = self._whole().parts()
        n = len(parts.heads)
        closed = np.zeros(n, np.bool_) if banned is None else banned
        # Compiled code reads on beyond a shorter array.
        for name, rows in (("to_go", to_go), ("banned", closed)):
            if np.shape(rows) != (n,):
                raise ConfigurationError(f"{name}: shape {np.shape(rows)} given, allowed: ({n},), one for each node")
        found = lazy_shortest_path(
            self.motion.kind,
            parts.configurations,
            parts.into if reverse else parts.heads,
            parts.following,
            parts.edges,
            parts.lengths,
            parts.status,
            *first,
            *last,
            to_go,
            closed,
            float(limit),
            budget,
            Deadline.after(seconds),
            checking,
        )
        return Search(*found)

    def reached(self, node: int, *, reverse: bool = False) -> NDArray[np.bool_]:
        """Return which nodes certified paths lead to from a node, shape (n,).

        Args:
            node: where to start.
            reverse: which nodes certified paths lead from, to this one, instead.

        Raises:
            ConfigurationError: a node that is not there.
        """
        require_nodes([node], len(self))
        nowhere = (np.empty(0, np.int64), np.empty(0))
        return self._search((_one(node), ZERO), nowhere, np.zeros(len(self)), reverse=reverse).reached

    def distances_to(self, node: int) -> se2.FloatArray:
        """Return what a motion from every node to a node would cost, shape (n,), metres."""
        require_nodes([node], len(self))
        return self.motion.costs(self.configurations, self.configurations[node])

    def certify_all(self) -> None:
        """Check every edge that nobody has checked yet, in one batch."""
        q, edges, _, status = self.rows()
        undecided = np.flatnonzero(status == UNDECIDED)
        a, b = q[edges[undecided, 0]], q[edges[undecided, 1]]
        status[undecided] = np.where(self.motion.motions_between_valid(a, b), FREE, BLOCKED)

    @property
    def graph(self) -> nx.Graph:
        """The roadmap as a networkx graph (a copy): a ``Graph``, or a ``DiGraph`` where edges lead one way only.

        Nodes are numbered 0 to n - 1, with attributes ``configuration`` (x, y, theta) and ``clearance`` (metres);
        edges, the blocked ones left out, have ``length`` (metres), ``certified`` (bool) and ``clearance``: the
        smaller one of its ends' (metres).
        """
        import networkx as nx

        graph = nx.DiGraph() if self.directed else nx.Graph()
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


def _once(states: se2.FloatArray) -> se2.FloatArray:
    """Return the states, shape (m, 3), of which one that equals the one before is left out."""
    return states[np.append(True, (states[1:] != states[:-1]).any(axis=1))] if len(states) else states


def _one(node: int) -> NDArray[np.int64]:
    return np.array([node], dtype=np.int64)


def require_nodes(nodes: Any, n: int) -> None:
    """Raise a ConfigurationError unless all nodes are there, of n."""
    given = np.asarray(nodes)
    wrong = given[(given < 0) | (given >= n)]
    if len(wrong):
        raise ConfigurationError(f"node {wrong[0]} given, allowed: 0 to {n - 1}")
