"""CurveRoadmap: configurations joined by a car's shortest curves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.curve_motions import CurveChecker
from trailmark.collision.kernels import BLOCKED, UNDECIDED
from trailmark.curves import Steering
from trailmark.roadmap.curve_search import lazy_shortest_curves
from trailmark.roadmap.roadmap import ENOUGH, Roadmap, require_nodes
from trailmark.roadmap.store import Parts, Store

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

    Raises:
        ConfigurationError: neither ``steering`` nor a turning radius of the robot is given.
    """

    def __init__(self, checker: StateChecker, steering: Steering | None = None) -> None:
        self._motions = CurveChecker(checker, steering)
        self.steering = self._motions.steering
        super().__init__(checker)

    @property
    def directed(self) -> bool:
        """Whether edges lead one way only."""
        return not self.steering.reverse

    def _join_near(self, store: Store, first: int, k: int) -> None:
        """Join new nodes to and from those with the shortest curves among their nearest ones.

        Nearest in the embedding (x, y, ρ·cos θ, ρ·sin θ), since turning by an angle takes about as much way as driving
        it round.
        """
        nodes = store.nodes.view
        near = min(len(nodes) - 1, CANDIDATES * k)
        found = store.index().query(se2.embed(nodes[first:], self._radius), near, first=first)
        each = np.broadcast_to(np.arange(first, len(nodes))[:, None], found.shape)
        ways = [(each, found), (found, each)] if self.directed else [(each, found)]
        pairs, lengths = zip(*(self._shortest(nodes, a, b, k) for a, b in ways), strict=True)
        self._connect(store, np.concatenate(pairs), UNDECIDED, np.concatenate(lengths))

    @property
    def _radius(self) -> float:
        return self.steering.radius

    def add_tree(self, q: se2.FloatArray, parents: NDArray[np.int64], *, into: bool = False) -> NDArray[np.int64]:
        """Add valid configurations that hang on nodes or on one another; return the new nodes.

        Args:
            q: shape (n, 3).
            parents: (n,): a node, or ``len(self) + i`` for the i-th of ``q``, from which a curve leads to it.
            into: whether the curves lead to the parents instead.

        Raises:
            ConfigurationError: another shape, values that are not finite, a node that is not there.
        """
        rows = np.atleast_2d(se2.configurations(q))
        require_nodes(parents, len(self) + len(rows))
        store = self._changing()
        added = self._add(store, rows)
        ends = (added, parents) if into else (parents, added)
        self._connect(store, np.column_stack(ends), UNDECIDED)
        self._commit(store)
        return added

    def reached(self, node: int, *, against: bool = False) -> NDArray[np.bool_]:
        """Return which nodes certified paths lead to from a node, shape (n,).

        Args:
            node: where to start.
            against: which nodes certified paths lead from, to this one, instead.

        Raises:
            ConfigurationError: a node that is not there.
        """
        require_nodes([node], len(self))
        first, nowhere = (np.array([node], dtype=np.int64), np.zeros(1)), (np.empty(0, np.int64), np.empty(0))
        return self._search(first, nowhere, np.zeros(len(self)), against=against).reached

    def distances_to(self, node: int) -> se2.FloatArray:
        """Return the length (metres) of the shortest curve from every node to a node, shape (n,)."""
        require_nodes([node], len(self))
        return np.asarray(self.steering.lengths(self.configurations, self.configurations[node]))

    def _motions_valid(self, a: se2.FloatArray, b: se2.FloatArray) -> NDArray[np.bool_]:
        return self._motions.motions_between_valid(a, b)

    def _lengths_of(self, q: se2.FloatArray, edges: NDArray[np.int32]) -> se2.FloatArray:
        return np.asarray(self.steering.lengths(q[edges[:, 0]], q[edges[:, 1]]))

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

    def _shortest(
        self, q: se2.FloatArray, a: NDArray[np.int64], b: NDArray[np.int64], k: int
    ) -> tuple[NDArray[np.int64], se2.FloatArray]:
        """Return of each row of pairs (n, c) the k with the shortest curves, as rows from, to; and their lengths."""
        lengths = np.asarray(self.steering.lengths(q[a.ravel()], q[b.ravel()])).reshape(a.shape)
        chosen = np.argpartition(lengths, min(k, a.shape[1]) - 1, axis=1)[:, :k]
        first, second, ways = (np.take_along_axis(rows, chosen, 1).ravel() for rows in (a, b, lengths))
        return np.column_stack([first, second]), np.asarray(ways)

    def _as_kept(self, edges: NDArray[Any]) -> NDArray[Any]:
        return edges if self.directed else np.sort(edges, axis=1)

    def _connect(
        self, store: Store, pairs: NDArray[np.int64], status: int, lengths: se2.FloatArray | None = None
    ) -> None:
        self._add_missing(store, self._as_kept(pairs), status, lengths)

    def _joined(self, q: se2.FloatArray, near: int, *, into: bool) -> tuple[NDArray[np.int64], se2.FloatArray]:
        nodes, store = self.configurations, self._whole()
        found = store.index().query(se2.embed(q[None], self._radius), near)[0]
        found, joined = found[found >= 0], []
        for some in np.split(found, range(ENOUGH, len(found), ENOUGH)):
            there, here = nodes[some], np.broadcast_to(q, (len(some), 3)).copy()
            joined += some[self._motions_valid(*((there, here) if into else (here, there)))].tolist()
            if len(joined) >= ENOUGH:
                break
        found, here = np.array(joined, dtype=np.int64), np.broadcast_to(q, (len(joined), 3)).copy()
        return found, np.asarray(self.steering.lengths(*((nodes[found], here) if into else (here, nodes[found]))))

    def _searched(self, parts: Parts, against: bool, *arguments: Any) -> Any:
        checker = self.checker
        return lazy_shortest_curves(
            checker.grid,
            checker.field,
            checker.footprint,
            self.steering.radius,
            self.steering.reverse,
            parts.configurations,
            parts.into if against else parts.heads,
            parts.following,
            parts.edges,
            parts.lengths,
            parts.status,
            *arguments,
        )
