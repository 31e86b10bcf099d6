"""Roadmap: configurations joined by motions, as flat arrays for searches and as a networkx graph for people."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path as FilePath
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision import StateChecker, kernels
from trailmark.errors import ConfigurationError
from trailmark.motion import Motion, motion_of
from trailmark.roadmap.search import (
    UNBOUNDED,
    EndNodes,
    FoundPath,
    Graph,
    Search,
    join,
    links_of,
    only,
    require_nodes,
    search,
    tree_of,
    without_repetitions,
)
from trailmark.se2 import FloatArray
from trailmark.shown import Shown

if TYPE_CHECKING:
    import networkx as nx

__all__ = ["EdgeStatus", "Roadmap", "neighbour_count"]

NEIGHBOURS = 12
"""Nodes near an end of a query that are tried until enough of them are joined to it."""


class EdgeStatus(IntEnum):
    """What is known of an edge: that it collides, that it is certified, or neither, until a search needs it."""

    BLOCKED = kernels.BLOCKED
    FREE = kernels.FREE
    UNDECIDED = kernels.UNDECIDED


class _Content(NamedTuple):
    """Nodes and edges, replaced as a whole: a change that is interrupted has not taken place."""

    configurations: FloatArray
    edges: NDArray[np.int32]
    lengths: FloatArray
    status: NDArray[np.uint8]


EMPTY = _Content(np.empty((0, 3)), np.empty((0, 2), np.int32), np.empty(0), np.empty(0, np.uint8))


def neighbour_count(n: int) -> int:
    """Return ceil(e·(1 + 1/d)·ln n) with d = 3: the bound of PRM* for n nodes.

    Source: Karaman & Frazzoli, "Sampling-based algorithms for optimal motion planning", IJRR 2011, section 3.3
    (k-nearest PRM*).
    """
    return int(np.ceil(math.e * (1.0 + 1.0 / 3.0) * np.log(max(n, 2))))


class Roadmap(Shown):
    """Nodes are valid configurations, edges are motions between near ones, each checked at most once.

    Edges of a car that moves forwards only lead from their first node to their second; all others lead both ways.

    Nodes and edges are only ever added; an exception, at whatever place, leaves the roadmap as it was or as it was to
    become. One thread may change it at a time.

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
        self._content = EMPTY
        # What was made from parts of a content, each with the part that it was made from.
        self._made: dict[str, tuple[object, Any]] = {}

    @classmethod
    def from_arrays(
        cls,
        checker: StateChecker,
        configurations: FloatArray,
        edges: NDArray[np.int32],
        status: NDArray[np.uint8],
        *,
        motion: Motion | None = None,
        lengths: FloatArray | None = None,
    ) -> Self:
        """Return a roadmap for the checker's robot made of given nodes and edges, which are not checked.

        Args:
            checker: decides which motions are certified.
            configurations: (n, 3), valid, headings in (-pi, pi].
            edges: (m, 2), no loops, none twice.
            status: (m,) :class:`trailmark.roadmap.EdgeStatus`.
            motion: what edges are; by default how the checker's robot moves.
            lengths: (m,) metres; computed if None.

        Raises:
            ConfigurationError: an edge of a node that does not exist, other numbers of edges, statuses and lengths.
        """
        roadmap = cls(checker, motion)
        q = np.array(configurations, dtype=np.float64).reshape(-1, 3)
        pairs = np.array(edges, dtype=np.int32).reshape(-1, 2)
        require_nodes(pairs, len(q))
        if lengths is None:
            lengths = roadmap.motion.costs(q[pairs[:, 0]], q[pairs[:, 1]])
        for name, rows in (("status", status), ("lengths", lengths)):
            if np.shape(rows) != (len(pairs),):
                raise ConfigurationError(f"{name}: expected one for each of {len(pairs)} edges, got {np.shape(rows)}")
        roadmap._content = _Content(q, pairs, np.array(lengths), np.array(status, dtype=np.uint8))
        return roadmap

    def rows(self) -> tuple[FloatArray, NDArray[np.int32], FloatArray, NDArray[np.uint8]]:
        """Return ``configurations``, ``edges``, ``lengths`` and ``status`` of one moment, whoever adds to them."""
        return self._content

    @property
    def configurations(self) -> FloatArray:
        """The nodes, (n, 3). Read-only."""
        return self._content.configurations

    @property
    def edges(self) -> NDArray[np.int32]:
        """The nodes that each edge joins, (m, 2) int32; of a car's, the nodes that it leads from and to. Read-only."""
        return self._content.edges

    @property
    def lengths(self) -> FloatArray:
        """Cost of each edge in metres, (m,): ‖Δxy‖ + 0.5·|Δθ|, a disc robot's ‖Δxy‖, a car's curve's length."""
        return self._content.lengths

    @property
    def status(self) -> NDArray[np.uint8]:
        """:class:`trailmark.roadmap.EdgeStatus` of each edge, (m,) uint8. Values written to it are stored."""
        return self._content.status

    @property
    def certified(self) -> NDArray[np.bool_]:
        """Which edges are certified, shape (m,)."""
        return np.asarray(self.status == EdgeStatus.FREE)

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

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_made": {}}

    def __len__(self) -> int:
        return len(self.configurations)

    def __repr__(self) -> str:
        status, kind = self.status, type(self.motion).__name__
        counts = ", ".join(f"{np.count_nonzero(status == value)} {value.name.lower()}" for value in EdgeStatus)
        return f"Roadmap({len(self)} nodes, {len(status)} edges ({counts}), {kind})"

    @property
    def graph(self) -> nx.Graph:
        """The roadmap as a networkx graph (a copy): a ``Graph``, or a ``DiGraph`` where edges lead one way only.

        Nodes are numbered 0 to n - 1, with attributes ``configuration`` (x, y, theta) and ``clearance`` (metres).
        Edges have ``length`` (metres), ``certified`` (bool) and ``clearance``: the smaller one of their two nodes'
        (metres). Blocked edges are left out.
        """
        import networkx as nx

        graph = nx.DiGraph() if self.directed else nx.Graph()
        configurations, edges, lengths, status = self.rows()
        clearances = self.checker.clearance(configurations) if len(configurations) else np.empty(0)
        for i, (q, clearance) in enumerate(zip(configurations.tolist(), clearances.tolist(), strict=True)):
            graph.add_node(i, configuration=tuple(q), clearance=clearance)
        shown = status != EdgeStatus.BLOCKED
        certified, smaller = status[shown] == EdgeStatus.FREE, clearances[edges[shown]].min(axis=1)
        rows = (values.tolist() for values in (edges[shown], lengths[shown], certified, smaller))
        for (u, v), length, free, clearance in zip(*rows, strict=True):
            graph.add_edge(u, v, length=length, certified=free, clearance=clearance)
        return graph

    # --- Changes: each makes a new content, and puts it in the old one's place in one step.

    def add(self, q: FloatArray, *, neighbours: int | None = None) -> NDArray[np.int64]:
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
        first = len(self)
        self._content = self._with_nodes(rows, neighbours)
        return np.arange(first, first + len(rows))

    def add_path(self, states: FloatArray) -> NDArray[np.int64]:
        """Add a path of certified motions, with its motions as edges; return its nodes, from first to last.

        States that are nodes already are not added again; a state given twice in a row counts once.

        Args:
            states: shape (p, 3).

        Raises:
            ConfigurationError: another shape, values that are not finite.
        """
        rows = without_repetitions(np.atleast_2d(se2.configurations(states)))
        along = self._find(rows)
        new = np.flatnonzero(along < 0)
        along[new] = len(self) + np.arange(len(new))
        content = self._with_nodes(rows[new])
        self._content = self._with_edges(content, along[:-1], along[1:], EdgeStatus.FREE)
        return along

    def add_tree(self, q: FloatArray, parents: NDArray[np.int64], *, reverse: bool = False) -> NDArray[np.int64]:
        """Add valid configurations, each joined to a node or to another of them; return the new nodes.

        Args:
            q: shape (n, 3).
            parents: (n,): a node, or ``len(self) + i`` for the i-th of ``q``, from which a motion leads to it.
            reverse: whether the motions lead to the parents instead.

        Raises:
            ConfigurationError: another shape, values that are not finite, a node that does not exist.
        """
        rows, first = np.atleast_2d(se2.configurations(q)), len(self)
        require_nodes(parents, first + len(rows))
        added = np.arange(first, first + len(rows))
        ends = (added, parents) if reverse else (parents, added)
        self._content = self._with_edges(self._with_nodes(rows), ends[0], ends[1], EdgeStatus.UNDECIDED)
        return added

    def ends(self, q: FloatArray) -> NDArray[np.int64]:
        """Return the nodes of valid configurations, shape (n, 3); those that are not nodes yet are added."""
        nodes = self._find(q)
        new = np.flatnonzero(nodes < 0)
        if len(new):
            nodes[new] = self.add(q[new])
        return nodes

    def certify_all(self) -> None:
        """Check all undecided edges, in one batch."""
        q, edges, _, status = self.rows()
        undecided = np.flatnonzero(status == EdgeStatus.UNDECIDED)
        free = self.motion.motions_between_valid(q[edges[undecided, 0]], q[edges[undecided, 1]])
        status[undecided] = np.where(free, EdgeStatus.FREE, EdgeStatus.BLOCKED)

    def _with_nodes(self, rows: FloatArray, neighbours: int | None = None) -> _Content:
        """Return the content with more nodes, joined to their nearest ones or the cheapest of several times as many."""
        content, motion, first = self._content, self.motion, len(self)
        q = np.concatenate([content.configurations, rows])
        n = len(q)
        k = min(n - 1, neighbour_count(n) if neighbours is None else neighbours)
        content = content._replace(configurations=q)
        if not len(rows) or k < 1:
            return content
        tree, count = self._tree(q), min(n - 1, motion.candidates * k)
        found = tree.query(tree.data[first:], np.arange(1, count + 2))[1]
        # Nearest to a node is the node itself, or others at the same place.
        itself = found == np.arange(first, n)[:, None]
        itself[~itself.any(axis=1), -1] = True
        near = found[~itself].reshape(-1, count)
        own = np.broadcast_to(np.arange(first, n)[:, None], near.shape)
        pairs = []
        for a, b in [(own, near), (near, own)] if motion.directed else [(own, near)]:
            if count > k:
                costs = motion.costs(q[a.ravel()], q[b.ravel()]).reshape(a.shape)
                cheapest = np.argpartition(costs, k - 1, axis=1)[:, :k]
                a, b = (np.take_along_axis(nodes, cheapest, axis=1) for nodes in (a, b))
            pairs.append((a.ravel(), b.ravel()))
        first, second = np.concatenate(pairs, axis=1)
        return self._with_edges(content, first, second, None, old=False)

    def _with_edges(
        self,
        content: _Content,
        a: NDArray[np.int64],
        b: NDArray[np.int64],
        status: EdgeStatus | None,
        *,
        old: bool = True,
    ) -> _Content:
        """Return a content with edges from nodes a to nodes b of a status; None for what the field knows.

        Those that exist already are marked if the status is FREE; there are none if not ``old``.
        """
        q, edges, lengths, known = content
        wanted = np.unique(self._keys(a, b, len(q)))
        if old:
            keys = self._keys(edges[:, 0], edges[:, 1], len(q))
            there = np.isin(keys, wanted)
            if status == EdgeStatus.FREE:
                known[there] = EdgeStatus.FREE
            wanted = np.setdiff1d(wanted, keys[there])
        a, b = np.divmod(wanted, len(q))
        if not self.directed:
            # An edge stands for motions both ways.
            same = self.motion.reversible(q[a], q[b])
            a, b = a[same], b[same]
        new = self.motion.motions_by_field(q[a], q[b]) if status is None else np.full(len(a), status, np.uint8)
        return _Content(
            q,
            np.concatenate([edges, np.column_stack([a, b]).astype(np.int32)]),
            np.concatenate([lengths, self.motion.costs(q[a], q[b])]),
            np.concatenate([known, new]),
        )

    def _keys(self, a: NDArray[Any], b: NDArray[Any], n: int) -> NDArray[np.int64]:
        """Return a number for each pair of n nodes, the same in both directions if edges have none."""
        low, high = (a, b) if self.directed else (np.minimum(a, b), np.maximum(a, b))
        return np.asarray(low.astype(np.int64) * n + high)

    # --- Searches.

    def fresh(self, q: FloatArray, distance: float) -> FloatArray:
        """Return those of the configurations (n, 3) that are more than ``distance`` (metres) from all joined nodes."""
        nodes, edges, _, _ = self._content
        if len(nodes) == 0:
            return q
        gap, nearest = self._tree(nodes).query(se2.embed(q, self.motion.radius))
        joined = np.zeros(len(nodes), np.bool_)
        joined[edges] = True
        return np.asarray(q[(gap > distance) | ~joined[nearest]])

    def shortest_path(
        self,
        start: int,
        goal: int,
        *,
        to_go: FloatArray | None = None,
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
        return search(self._graph(), only(start), only(goal), to_go, banned=banned, limit=limit, seconds=seconds)

    def find_path(
        self,
        start: FloatArray,
        goal: FloatArray,
        *,
        goal_costs: ArrayLike | None = None,
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
            goal: valid, shape (3,); or several of them, shape (k, 3), of which the path may end at any.
            goal_costs: (k,) metres that count for ending at each, >= 0; by default 0.
            weight: of the cost to go, >= 1: the path is at most so many times as long as the shortest over the nodes,
                and found sooner.
            limit: maximum cost of the path, metres; with a weight, of its weighted estimate.
            budget: maximum number of nodes and undecided edges that leave the queue.
            seconds: time limit of the search.
            checking: whether undecided edges are checked; otherwise they are not used.
            neighbours: nodes near an end that are tried until enough are joined to it.
        """
        graph, goals, begin = self._graph(), np.atleast_2d(goal), perf_counter()
        q, arrival = graph.configurations, np.zeros(len(goals)) if goal_costs is None else np.asarray(goal_costs)
        first, last = join(graph, start, neighbours), [join(graph, end, neighbours, reverse=True) for end in goals]
        which = np.repeat(np.arange(len(goals)), [len(end.nodes) for end in last])
        nodes, costs = (np.concatenate(rows) for rows in zip(*last, strict=True))
        ends = EndNodes(nodes, costs + arrival[which])
        tried = (1 + len(goals)) * min(len(q), neighbours)
        if len(first.nodes) == 0 or len(nodes) == 0:
            return FoundPath(q[:0], tried, complete=True)
        gaps = np.hypot(q[:, :1] - goals[:, 0], q[:, 1:2] - goals[:, 1])
        to_go = weight * (gaps + arrival).min(axis=1)
        found = search(graph, first, ends, to_go, limit=limit, budget=budget, seconds=seconds, checking=checking)
        if len(found.nodes) == 0:
            ended = found.expanded < budget and perf_counter() - begin < seconds
            return FoundPath(q[:0], tried + found.expanded, complete=checking and ended)
        best = which[np.argmin(np.where(nodes == found.nodes[-1], ends.costs, np.inf))]
        # An end may be a node.
        states = without_repetitions(np.vstack([start, q[found.nodes], goals[best]]))
        return FoundPath(states, tried + found.expanded, complete=True)

    def reached(self, node: int, *, reverse: bool = False) -> NDArray[np.bool_]:
        """Return which nodes certified paths lead to from a node, shape (n,).

        Args:
            node: where to start.
            reverse: whether to return the nodes that certified paths lead to this one from instead.

        Raises:
            ConfigurationError: a node that does not exist.
        """
        require_nodes([node], len(self))
        return search(self._graph(reverse and self.directed), only(node), only(None), np.zeros(len(self))).reached

    def distances_to(self, node: int) -> FloatArray:
        """Return the cost (metres) of the motion from every node to a node, shape (n,), whether or not it is free."""
        require_nodes([node], len(self))
        return self.motion.costs(self.configurations, self.configurations[node])

    def _find(self, q: FloatArray) -> NDArray[np.int64]:
        """Return which node each of the configurations (n, 3) equals exactly, shape (n,); -1 if none does."""
        nodes = self.configurations
        if len(nodes) == 0:
            return np.full(len(q), -1)
        nearest = self._tree(nodes).query(se2.embed(q, self.motion.radius))[1]
        return np.where((nodes[nearest] == q).all(axis=1), nearest, -1)

    def _graph(self, reverse: bool = False) -> Graph:
        """Return what searches read; made anew after a change."""
        content = self._content
        q, edges, lengths, status = content

        def links() -> Any:
            along = np.ascontiguousarray(edges[:, ::-1]) if reverse else edges
            return links_of(len(q), along, lengths, self.directed)

        made = self._cached("back" if reverse else "forth", content, links)
        return Graph(self.motion, q, edges, status, made, self._tree(q))

    def _tree(self, q: FloatArray) -> Any:
        return self._cached("tree", q, lambda: tree_of(q, self.motion.radius))

    def _cached(self, name: str, of: object, make: Callable[[], Any]) -> Any:
        held = self._made.get(name)
        if held is None or held[0] is not of:
            self._made[name] = held = of, make()
        return held[1]
