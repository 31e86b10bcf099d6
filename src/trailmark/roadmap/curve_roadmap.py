"""CurveRoadmap: configurations joined by a car's shortest curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.curve_motions import CurveChecker
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.curves import Steering
from trailmark.errors import ConfigurationError
from trailmark.roadmap.curve_search import lazy_shortest_curves
from trailmark.roadmap.roadmap import Roadmap, Search, neighbour_count

if TYPE_CHECKING:
    import networkx as nx

__all__ = ["CurveRoadmap"]

CANDIDATES = 3
"""Times as many nodes near in the embedding as neighbours are wanted: those with the shortest curves are taken."""

DRAWN = 12
"""Straight lines that a curve is drawn as."""


class CurveRoadmap(Roadmap):
    """Nodes are valid configurations, edges are shortest curves between near ones, each checked at most once.

    Edges lead from their first node to their second; of a car that reverses, also back: the graph is then undirected.

    Args:
        checker: decides which configurations are valid.
        steering: turning radius, and whether the car reverses; that of the checker's robot if None.

    Attributes:
        steering: what was given.
        configurations: (n, 3), the nodes. Read-only.
        edges: (m, 2) int32, the nodes that each edge leads from and to.
        lengths: (m,), length of each edge's curve, metres.
        status: (m,) uint8: FREE (certified), BLOCKED, UNDECIDED.

    Raises:
        ConfigurationError: neither ``steering`` nor a turning radius of the robot is given.
    """

    def __init__(self, checker: StateChecker, steering: Steering | None = None) -> None:
        self._motions = CurveChecker(checker, steering)
        self.steering = self._motions.steering
        super().__init__(checker)
        self._into_start, self._into = self._start_of, self._incident

    @classmethod
    def from_arrays(
        cls,
        checker: StateChecker,
        configurations: se2.FloatArray,
        edges: NDArray[np.int32],
        status: NDArray[np.uint8],
    ) -> CurveRoadmap:
        """Return a roadmap for the checker's robot made of given nodes and edges, which are not checked.

        Args:
            checker: decides which configurations are valid.
            configurations: (n, 3), valid, headings in (-pi, pi].
            edges: (m, 2), no loops, none twice.
            status: (m,), FREE, BLOCKED or UNDECIDED.
        """
        roadmap = cls(checker)
        q = roadmap.configurations = np.array(configurations, dtype=np.float64, order="C")
        joined = np.array(edges if roadmap.directed else np.sort(edges, axis=1), dtype=np.int32, order="C")
        roadmap.edges, roadmap.status = joined, np.array(status, dtype=np.uint8)
        roadmap.lengths = np.asarray(roadmap.steering.lengths(q[joined[:, 0]], q[joined[:, 1]]))
        roadmap._index()
        return roadmap

    @property
    def directed(self) -> bool:
        """Whether edges lead one way only."""
        return not self.steering.reverse

    def add(self, q: se2.FloatArray, *, neighbours: int | None = None) -> NDArray[np.int64]:
        """Add valid configurations, shape (n, 3), and edges to (and from) their neighbours; return the new nodes.

        Neighbours are those with the shortest curves among the nodes that are nearest in the embedding
        (x, y, ρ·cos θ, ρ·sin θ), since turning by an angle takes about as much way as driving it round.

        Args:
            q: valid configurations.
            neighbours: edges per new node and direction; by default PRM*'s bound (:func:`neighbour_count`).
        """
        from scipy.spatial import cKDTree

        first = len(self.configurations)
        nodes = np.vstack([self.configurations, q])
        added = np.arange(first, len(nodes))
        self.configurations = nodes
        if len(added) == 0 or len(nodes) < 2:
            self._index()
            return added
        points = se2.embed(nodes, self.steering.radius)
        k = min(len(nodes) - 1, neighbour_count(len(nodes)) if neighbours is None else neighbours)
        near = min(len(nodes), CANDIDATES * k + 1)
        found = np.asarray(cKDTree(points).query(points[first:], near)[1])
        each = np.broadcast_to(added[:, None], found.shape)
        ways = [(each, found), (found, each)] if self.directed else [(each, found)]
        pairs, lengths = zip(*(self._shortest(a, b, k) for a, b in ways), strict=True)
        self._connect(np.concatenate(pairs), UNDECIDED, np.concatenate(lengths))
        return added

    def add_path(self, states: se2.FloatArray, first: int, last: int) -> NDArray[np.int64]:
        """Add a path of certified curves between two nodes, with its curves as edges; return the new nodes.

        Args:
            states: knots, shape (p, 3), the first and the last one those of the nodes ``first`` and ``last``.
            first: node that the path begins at.
            last: node that it ends at.
        """
        added = self.add(states[1:-1])
        along = np.concatenate([[first], added, [last]])
        self._connect(np.column_stack([along[:-1], along[1:]]), FREE)
        return added

    def add_tree(self, q: se2.FloatArray, parents: NDArray[np.int64], *, into: bool = False) -> NDArray[np.int64]:
        """Add valid configurations that hang on nodes or on one another; return the new nodes.

        Args:
            q: shape (n, 3).
            parents: (n,): a node, or ``len(self) + i`` for the i-th of ``q``, from which a curve leads to it.
            into: whether the curves lead to the parents instead.
        """
        added = self.add(q)
        ends = (added, parents) if into else (parents, added)
        self._connect(np.column_stack(ends), UNDECIDED)
        return added

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
            to_go: (n,) lower estimates of the cost to the goal; by default the lengths of the shortest curves.
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

    def reached(self, node: int, *, against: bool = False) -> NDArray[np.bool_]:
        """Return which nodes certified paths lead to from a node, shape (n,).

        Args:
            node: where to start.
            against: which nodes certified paths lead from, to this one, instead.
        """
        return self._search(node, -1, np.zeros(len(self)), None, np.inf, against).reached

    def distances_to(self, node: int) -> se2.FloatArray:
        """Return the length (metres) of the shortest curve from every node to a node, shape (n,)."""
        return np.asarray(self.steering.lengths(self.configurations, self.configurations[node]))

    def certify_all(self) -> None:
        """Check every edge that nobody has checked yet, in one batch."""
        undecided = np.flatnonzero(self.status == UNDECIDED)
        a, b = self.configurations[self.edges[undecided, 0]], self.configurations[self.edges[undecided, 1]]
        self.status[undecided] = np.where(self._motions.motions_between_valid(a, b), FREE, BLOCKED)

    def drawn(self, edges: NDArray[np.bool_]) -> se2.FloatArray:
        """Return straight lines, shape (l, 2, 2), metres, that show the curves of the chosen edges, (m,)."""
        chosen = self.edges[edges]
        if len(chosen) == 0:
            return np.empty((0, 2, 2))
        share = np.linspace(0.0, 1.0, DRAWN + 1)
        a, b = self.configurations[chosen[:, 0]], self.configurations[chosen[:, 1]]
        xy = self.steering.states(a, b, self.lengths[edges][:, None] * share)[..., :2]
        return np.stack([xy[:, :-1], xy[:, 1:]], axis=2).reshape(-1, 2, 2)

    @property
    def graph(self) -> nx.Graph:
        """The roadmap as a networkx graph (a copy): a ``Graph``, or a ``DiGraph`` where edges lead one way only.

        Attributes are those of :attr:`Roadmap.graph`; ``length`` is that of the curve.
        """
        import networkx as nx

        undirected = super().graph
        if not self.directed:
            return undirected
        graph = nx.DiGraph()
        graph.add_nodes_from(undirected.nodes(data=True))
        kept = self.status != BLOCKED
        rows = zip(self.edges[kept].tolist(), self.lengths[kept].tolist(), self.certified[kept].tolist(), strict=True)
        for (u, v), length, certified in rows:
            room = undirected.edges[u, v]["clearance"]
            graph.add_edge(u, v, length=length, certified=certified, clearance=room)
        return graph

    def _shortest(self, a: NDArray[np.int64], b: NDArray[np.int64], k: int) -> tuple[NDArray[np.int64], se2.FloatArray]:
        """Return of each row of pairs (n, c) the k with the shortest curves, as rows from, to; and their lengths."""
        q = self.configurations
        lengths = np.asarray(self.steering.lengths(q[a.ravel()], q[b.ravel()])).reshape(a.shape)
        lengths[a == b] = np.inf
        chosen = np.argpartition(lengths, min(k, a.shape[1]) - 1, axis=1)[:, :k]
        first, second, ways = (np.take_along_axis(rows, chosen, 1).ravel() for rows in (a, b, lengths))
        other = first != second
        return np.column_stack([first[other], second[other]]), np.asarray(ways[other])

    def _connect(self, pairs: NDArray[np.int64], status: int, lengths: se2.FloatArray | None = None) -> None:
        """Add edges, shape (m, 2), that are not there yet; mark the given ones FREE if that is their status."""
        if not self.directed:
            pairs = np.sort(pairs, axis=1)
        n = max(1, len(self))
        there, wanted = (np.asarray(e, dtype=np.int64) @ np.array([n, 1]) for e in (self.edges, pairs))
        if status == FREE:
            self.status[np.isin(there, wanted)] = FREE
        wanted, first = np.unique(wanted, return_index=True)
        new = first[~np.isin(wanted, there)]
        q, fresh = self.configurations, pairs[new]
        ways = self.steering.lengths(q[fresh[:, 0]], q[fresh[:, 1]]) if lengths is None else lengths[new]
        self.edges = np.vstack([self.edges, fresh.astype(np.int32)])
        self.lengths = np.concatenate([self.lengths, ways])
        self.status = np.concatenate([self.status, np.full(len(new), status, np.uint8)])
        self._index()

    def _search(
        self,
        start: int,
        goal: int,
        to_go: se2.FloatArray,
        banned: NDArray[np.bool_] | None,
        limit: float,
        against: bool = False,
    ) -> Search:
        checker = self.checker
        nodes, reached = lazy_shortest_curves(
            checker.grid,
            checker.field,
            checker.footprint,
            self.steering.radius,
            self.steering.reverse,
            self.configurations,
            self._into_start if against else self._start_of,
            self._into if against else self._incident,
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

    def _index(self) -> None:
        """Sort the edges by node, so that the search finds those that lead on from it, or to it, in one place."""
        if not self.directed:
            super()._index()
            self._into_start, self._into = self._start_of, self._incident
            return
        for column, names in ((0, ("_start_of", "_incident")), (1, ("_into_start", "_into"))):
            ends = self.edges[:, column]
            counts = np.bincount(ends, minlength=len(self))
            setattr(self, names[0], np.concatenate([[0], np.cumsum(counts)]).astype(np.int64))
            setattr(self, names[1], np.argsort(ends, kind="stable").astype(np.int64))
