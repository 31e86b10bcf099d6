"""Roadmap: configurations joined by motions, as flat arrays for searches and as a networkx graph for people."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.motion import Motion, motion_of
from trailmark.nearest import Forest
from trailmark.roadmap.insertion import append_edges, insert_edges, insert_nodes
from trailmark.roadmap.search import UNBOUNDED, FoundPath, Search, only, search, search_between, without_repetitions
from trailmark.roadmap.store import EdgeStatus, Store, require_nodes
from trailmark.shown import Shown

if TYPE_CHECKING:
    import networkx as nx

__all__ = ["Roadmap"]

NEIGHBOURS = 12
"""Nodes near an end of a query that are tried until enough of them are joined to it."""


class _Content(NamedTuple):
    """The nodes and edges that count, replaced as a whole: a change that is interrupted has not taken place.

    Attributes:
        store: holds them, and more of them while a change is under way.
        nodes: how many count.
        edges: how many count.
        consistent: whether the store's indices cover exactly those; not while a change is under way, nor after one was
            interrupted.
    """

    store: Store
    nodes: int
    edges: int
    consistent: bool


class Roadmap(Shown):
    """Nodes are valid configurations, edges are motions between near ones, each checked at most once.

    Edges of a car that moves forwards only lead from their first node to their second; all others lead both ways.

    Nodes and edges are only ever added, in a time that hardly depends on how many there are already; an exception, at
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
        self._content = _Content(Store(self.motion), 0, 0, consistent=True)

    @classmethod
    def from_arrays(
        cls,
        checker: StateChecker,
        configurations: se2.FloatArray,
        edges: NDArray[np.int32],
        status: NDArray[np.uint8],
        *,
        motion: Motion | None = None,
        lengths: se2.FloatArray | None = None,
    ) -> Self:
        """Return a roadmap for the checker's robot made of given nodes and edges, which are not checked.

        Args:
            checker: decides which motions are certified.
            configurations: (n, 3), valid, headings in (-pi, pi].
            edges: (m, 2), no loops, none twice.
            status: (m,) :class:`trailmark.roadmap.EdgeStatus`.
            motion: what edges are; by default how the checker's robot moves.
            lengths: (m,) metres; computed if None.
        """
        roadmap = cls(checker, motion)
        store = roadmap._begin_change()
        store.nodes.append(np.asarray(configurations, dtype=np.float64))
        pairs = np.asarray(edges).reshape(-1, 2)
        require_nodes(pairs, len(configurations))
        append_edges(store, pairs, np.asarray(status, dtype=np.uint8), lengths)
        roadmap._commit(store)
        return roadmap

    def rows(self) -> tuple[se2.FloatArray, NDArray[np.int32], se2.FloatArray, NDArray[np.uint8]]:
        """Return ``configurations``, ``edges``, ``lengths`` and ``status`` of one moment, whoever adds to them."""
        store, n, m, _ = self._content
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
        """:class:`trailmark.roadmap.EdgeStatus` of each edge, (m,) uint8. Values written to it are stored."""
        return self.rows()[3]

    @property
    def directed(self) -> bool:
        """Whether edges lead one way only."""
        return self.motion.directed

    def save(self, path: str | FilePath, frame: str = "map") -> None:
        """Write the roadmap to a file: see :func:`trailmark.roadmap.files.save_roadmap`."""
        from trailmark.roadmap.files import save_roadmap

        save_roadmap(self, path, frame)

    @classmethod
    def load(cls, path: str | FilePath, checker: StateChecker) -> Roadmap:
        """Read a roadmap from a file: see :func:`trailmark.roadmap.files.load_roadmap`."""
        from trailmark.roadmap.files import load_roadmap

        return load_roadmap(path, checker)

    def __len__(self) -> int:
        return self._content.nodes

    def __repr__(self) -> str:
        status, kind = self.status, type(self.motion).__name__
        counts = ", ".join(f"{np.count_nonzero(status == value)} {value.name.lower()}" for value in EdgeStatus)
        return f"Roadmap({len(self)} nodes, {len(status)} edges ({counts}), {kind})"

    @property
    def certified(self) -> NDArray[np.bool_]:
        """Which edges are certified, shape (m,)."""
        return np.asarray(self.status == EdgeStatus.FREE)

    def add(self, q: se2.FloatArray, *, neighbours: int | None = None) -> NDArray[np.int64]:
        """Add valid configurations, shape (n, 3), and edges to their nearest neighbours; return the new nodes.

        Nearness is Euclidean in the embedding (x, y, R·cos θ, R·sin θ). The clearance field decides at once those of
        the new edges that it can; the others are checked when a search needs them.

        Args:
            q: valid configurations.
            neighbours: edges per new node, >= 1; by default PRM*'s bound (:func:`neighbour_count`).

        Raises:
            ConfigurationError: another shape, values that are not finite, ``neighbours`` below 1.
        """
        rows = np.atleast_2d(se2.configurations(q))
        if neighbours is not None and neighbours < 1:
            raise ConfigurationError(f"neighbours: expected 1 or more, got {neighbours}")
        store = self._begin_change()
        added = insert_nodes(store, rows, neighbours)
        self._commit(store)
        return added

    def add_path(self, states: se2.FloatArray) -> NDArray[np.int64]:
        """Add a path of certified motions, with its motions as edges; return its nodes, from first to last.

        States that are nodes already are not added again; a state given twice in a row counts once.

        Args:
            states: shape (p, 3).

        Raises:
            ConfigurationError: another shape, values that are not finite.
        """
        rows = without_repetitions(np.atleast_2d(se2.configurations(states)))
        along = self._consistent().find(rows)
        new = np.flatnonzero(along < 0)
        store = self._begin_change()
        along[new] = insert_nodes(store, rows[new])
        insert_edges(store, np.column_stack([along[:-1], along[1:]]), EdgeStatus.FREE)
        self._commit(store)
        return along

    def add_tree(self, q: se2.FloatArray, parents: NDArray[np.int64], *, reverse: bool = False) -> NDArray[np.int64]:
        """Add valid configurations, each joined to a node or to another of them; return the new nodes.

        Args:
            q: shape (n, 3).
            parents: (n,): a node, or ``len(self) + i`` for the i-th of ``q``, from which a motion leads to it.
            reverse: whether the motions lead to the parents instead.

        Raises:
            ConfigurationError: another shape, values that are not finite, a node that does not exist.
        """
        rows = np.atleast_2d(se2.configurations(q))
        require_nodes(parents, len(self) + len(rows))
        store = self._begin_change()
        added = insert_nodes(store, rows)
        ends = (added, parents) if reverse else (parents, added)
        insert_edges(store, np.column_stack(ends), EdgeStatus.UNDECIDED)
        self._commit(store)
        return added

    def ends(self, q: se2.FloatArray) -> NDArray[np.int64]:
        """Return the nodes of valid configurations, shape (n, 3); those that are not nodes yet are added."""
        nodes = self._consistent().find(q)
        new = np.flatnonzero(nodes < 0)
        if len(new):
            nodes[new] = self.add(q[new])
        return nodes

    def fresh(self, q: se2.FloatArray, distance: float) -> se2.FloatArray:
        """Return those of the configurations (n, 3) that are more than ``distance`` (metres) from all joined nodes."""
        store, radius = self._consistent(), self.motion.radius
        nearest = store.nearest(q)
        there = np.flatnonzero(nearest >= 0)
        nodes = nearest[there]
        gap = se2.embed(q[there], radius) - se2.embed(store.nodes.view[nodes], radius)
        close = np.zeros(len(q), np.bool_)
        close[there] = (np.sum(gap * gap, axis=1) <= distance * distance) & (store.arrays().outgoing[nodes] >= 0)
        return q[~close]

    def nearest(self) -> Forest:
        """Return an index of its own over the nodes in the embedding that :meth:`add` describes."""
        return self._consistent().index().merged()

    def _begin_change(self) -> Store:
        """Return the store to make a change in; the change takes place when it is committed, in one step."""
        store = self._consistent()
        self._content = self._content._replace(store=store, consistent=False)
        return store

    def _commit(self, store: Store) -> None:
        arrays, index = store.arrays(), store.index()
        store.component_parents()
        self._content = _Content(store, len(index), len(arrays.edges), consistent=True)

    def _consistent(self) -> Store:
        """Return the store, with exactly the nodes and edges that count."""
        content = self._content
        return content.store if content.consistent else content.store.truncated(content.nodes, content.edges)

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

        Undecided edges that the search needs are checked and marked.

        Args:
            start: first node.
            goal: last node.
            to_go: (n,) lower estimates of the cost to the goal; by default :meth:`distances_to` it.
            banned: (n,) nodes not to be used.
            limit: maximum cost of the path, metres.
            seconds: time limit of the search.

        Raises:
            ConfigurationError: a node that does not exist, ``to_go`` or ``banned`` of another length.
        """
        require_nodes([start, goal], len(self))
        if to_go is None:
            to_go = self.distances_to(goal)
        ends = only(start), only(goal)
        return search(self._consistent(), *ends, to_go, banned=banned, limit=limit, seconds=seconds)

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
        neighbours: int = NEIGHBOURS,
    ) -> FoundPath:
        """Return a path between configurations that need not be nodes; nothing is added.

        Args:
            start: valid, shape (3,).
            goal: valid, shape (3,).
            weight: of the cost to go, >= 1: the path is at most so many times as long as the shortest over the nodes,
                and found sooner.
            limit: maximum cost of the path, metres; with a weight, of its weighted estimate.
            budget: maximum number of nodes and undecided edges that leave the queue.
            seconds: time limit of the search.
            checking: whether undecided edges are checked; otherwise they are not used.
            neighbours: nodes near an end that are tried until enough are joined to it.
        """
        # Copies: a path's states are read-only, which numba would take for another type and compile anew for.
        ends, store = (np.array(start), np.array(goal)), self._consistent()
        return search_between(store, *ends, weight, limit, budget, seconds, checking, neighbours)

    def reached(self, node: int, *, reverse: bool = False) -> NDArray[np.bool_]:
        """Return which nodes certified paths lead to from a node, shape (n,).

        Args:
            node: where to start.
            reverse: whether to return the nodes that certified paths lead to this one from instead.

        Raises:
            ConfigurationError: a node that does not exist.
        """
        require_nodes([node], len(self))
        return search(self._consistent(), only(node), only(None), np.zeros(len(self)), reverse=reverse).reached

    def distances_to(self, node: int) -> se2.FloatArray:
        """Return the cost (metres) of the motion from every node to a node, shape (n,), whether or not it is free."""
        require_nodes([node], len(self))
        return self.motion.costs(self.configurations, self.configurations[node])

    def certify_all(self) -> None:
        """Check all undecided edges, in one batch."""
        q, edges, _, status = self.rows()
        undecided = np.flatnonzero(status == EdgeStatus.UNDECIDED)
        free = self.motion.motions_between_valid(q[edges[undecided, 0]], q[edges[undecided, 1]])
        status[undecided] = np.where(free, EdgeStatus.FREE, EdgeStatus.BLOCKED)

    @property
    def graph(self) -> nx.Graph:
        """The roadmap as a networkx graph (a copy): a ``Graph``, or a ``DiGraph`` where edges lead one way only.

        Nodes are numbered 0 to n - 1, with attributes ``configuration`` (x, y, theta) and ``clearance`` (metres).
        Edges have ``length`` (metres), ``certified`` (bool) and ``clearance``: the smaller one of their two nodes'
        (metres). Blocked edges are left out.
        """
        from trailmark.roadmap.graph import graph_of

        return graph_of(self)
