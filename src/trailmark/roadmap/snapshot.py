"""RoadmapSnapshot: a roadmap as it is now, prepared for many queries, which change nothing in it.

All expensive work is done once: edges are certified, edges that others can replace are left out, and the distances from
a few reference nodes to all others are stored. For a reference node r, the triangle inequality bounds the distance from
a node v to the goal g from below by d(r, g) - d(r, v) and by d(r, v) - d(r, g). A query joins its ends to their nearest
nodes for its own use only. Any number of threads may query at once.

Sources: the sparse graph, Althöfer, Das, Dobkin, Joseph & Soares, "On sparse spanners of weighted graphs", DCG 1993;
the bounds (ALT), Goldberg & Harrelson, "Computing the shortest path: A* search meets graph theory", SODA 2005, where
the reference nodes are called landmarks.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.jit import njit
from trailmark.motion.base import least_cost
from trailmark.roadmap.roadmap import EdgeStatus, Roadmap
from trailmark.roadmap.search import (
    JOINED,
    EndNodes,
    Graph,
    Links,
    join,
    links_of,
    only,
    require_nodes,
    search,
    tree_of,
)
from trailmark.se2 import FloatArray

__all__ = ["RoadmapSnapshot"]

STRETCH = 1.4
"""An edge is left out if a path over two others is at most this many times as long."""

REFERENCES, ACTIVE = 12, 4
"""Nodes whose distances to all others are stored; those of them that one query uses, with the largest bounds for it."""

LARGE_SHARE = 0.02
"""Share of all nodes that a component must have to get a reference node: queries are likely to be in it."""

NEIGHBOURS = (12, 48, 192, 768)
"""Nodes near an end of a query that are tried: more where those before join the ends to no common component."""


class RoadmapSnapshot:
    """A roadmap's certified edges, ready for queries.

    Args:
        roadmap: its undecided edges are checked.
        stretch: how many times as long as an edge that is left out a path over two others may be, >= 1.
        references: how many nodes have their distances to all others stored.

    Attributes:
        configurations: (n, 3), the nodes.
        links: the edges that are searched.
        distances: (r, n) float32, from the reference nodes, metres.
        components: (n,) number of each node's connected component.
    """

    def __init__(self, roadmap: Roadmap, *, stretch: float = STRETCH, references: int = REFERENCES) -> None:
        roadmap.certify_all()
        self.checker: StateChecker = roadmap.checker
        self.motion = roadmap.motion
        q, edges, lengths, status = roadmap.rows()
        kept = np.flatnonzero(status == EdgeStatus.FREE)
        # Spanners and distances from reference nodes are for edges that lead both ways.
        if not roadmap.directed:
            order = np.argsort(lengths[kept], kind="stable")
            links = links_of(len(q), edges[kept], lengths[kept], False)
            kept = kept[_spanner(links, order, edges[kept], lengths[kept], stretch)]
        self.links = links_of(len(q), edges[kept], lengths[kept], roadmap.directed)
        self.distances, self.components = _distances(self.links, 0 if roadmap.directed else references)
        self.configurations = q
        self._graph = Graph(self.motion, q, edges[kept], status[kept], self.links, tree_of(q, self.motion.radius))
        if len(q):
            # Compiled code is loaded before a clock runs.
            self.find_path(q[0], q[-1])

    def __len__(self) -> int:
        return len(self.configurations)

    def __repr__(self) -> str:
        parts = len(np.unique(self.components))
        return f"RoadmapSnapshot({len(self)} nodes, {len(self.links.node)} links, {parts} components)"

    def find_path(
        self, start: FloatArray, goal: FloatArray, *, closed: FloatArray | None = None, weight: float = 1.0
    ) -> FloatArray | None:
        """Return the states, shape (p, 3), of a path of certified motions, or None if the roadmap knows none.

        Args:
            start: valid, shape (3,).
            goal: valid, shape (3,).
            closed: (c, 3), discs x, y, radius (metres) that may contain no node of the path; with any, start and goal
                are not joined directly.
            weight: of the cost to go, >= 1: the path is at most so many times as long as the shortest over the links,
                and found sooner.
        """
        ends, banned = np.array([start, goal]), None
        if closed is not None and len(closed):
            gaps = np.hypot(*(self.configurations[:, None, :2] - closed[:, :2]).transpose(2, 0, 1))
            banned = (gaps < closed[:, 2]).any(axis=1)
        elif self.motion.direct_is_best and self.motion.motions_between_valid(ends[:1], ends[1:])[0]:
            return ends
        for tried in NEIGHBOURS:
            enough = JOINED if tried == NEIGHBOURS[0] else tried
            first, last = (join(self._graph, q, tried, enough, reverse=i == 1) for i, q in enumerate(ends))
            if set(self.components[first.nodes].tolist()) & set(self.components[last.nodes].tolist()):
                nodes = self._shortest(first, last, ends[1], weight, banned)
                if len(nodes):
                    return np.vstack([ends[:1], self.configurations[nodes], ends[1:]])
                # Links that lead one way only may still not lead from one end to the other.
                if not self.motion.directed:
                    return None
            if tried >= len(self):
                return None
        return None

    def between(self, start: int, goal: int) -> FloatArray | None:
        """Return the states, shape (p, 3), of the shortest path over the links from a node to a node, or None.

        Args:
            start: a node, 0 to n - 1.
            goal: a node.

        Raises:
            ConfigurationError: a node that does not exist.
        """
        require_nodes([start, goal], len(self))
        nodes = self._shortest(only(start), only(goal), self.configurations[goal], 1.0, None)
        return self.configurations[nodes] if len(nodes) else None

    def _shortest(
        self, first: EndNodes, last: EndNodes, goal: FloatArray, weight: float, banned: NDArray[np.bool_] | None
    ) -> NDArray[np.int64]:
        """Return the nodes of a shortest path from one of the first to one of the last; none if there is none."""
        if banned is not None:
            first, last = (
                EndNodes(end.nodes[~banned[end.nodes]], end.costs[~banned[end.nodes]]) for end in (first, last)
            )
        if not (len(first.nodes) and len(last.nodes)):
            return np.empty(0, np.int64)
        return search(self._graph, first, last, weight * self._to_go(first, last, goal), banned=banned).nodes

    def _to_go(self, first: EndNodes, last: EndNodes, goal: FloatArray) -> FloatArray:
        """Return a lower bound (metres) on the cost from each node to the goal over the links, shape (n,).

        With nodes g and motions of cost w to the goal, d(v, goal) = min (d(v, g) + w). For a reference node r that is
        at least min (d(r, g) + w) - d(r, v), and at least d(r, v) - max (d(r, g) - w).
        """
        bound = _least_costs(self.motion.kind, self.configurations, goal)
        final, begin = self.distances[:, last.nodes], self.distances[:, first.nodes]
        low, high = (final + last.costs).min(axis=1), (final - last.costs).max(axis=1)
        # Not all nodes are reached from all reference nodes.
        known = np.isfinite(begin) & (np.isfinite(low) & np.isfinite(high))[:, None]
        with np.errstate(invalid="ignore"):
            gains = np.maximum(low[:, None] - begin, begin - high[:, None])
        gain = np.where(known, gains, -1.0).max(axis=1)
        for r in np.argsort(-gain, kind="stable")[:ACTIVE]:
            if gain[r] > 0.0:
                distance = self.distances[r]
                np.maximum(bound, np.maximum(np.float32(low[r]) - distance, distance - np.float32(high[r])), out=bound)
        # These are rounded to 24 bits.
        return bound * (1.0 - 1e-6)


@njit(nogil=True)
def _least_costs(kind: Any, q: FloatArray, goal: FloatArray) -> FloatArray:
    found = np.empty(len(q))
    for i in range(len(q)):
        found[i] = least_cost(kind, q[i], goal)
    return found


@njit(nogil=True)
def _spanner(
    links: Links, order: NDArray[np.int64], edges: NDArray[np.int32], lengths: FloatArray, stretch: float
) -> NDArray[np.bool_]:
    """Return which edges remain, shape (m,), when those that two shorter ones can replace are left out.

    In their order, from the shortest to the longest, one is left out if a path over two edges that remain is at most
    ``stretch`` times as long: so no distance grows by more than that factor. The links are overwritten.
    """
    n = len(links.start) - 1
    remaining = np.zeros(len(edges), np.bool_)
    # Each node's links so far are written to the beginning of its range.
    node, length, end = links.node, links.length, links.start[:-1].copy()
    marked, distance = np.full(n, -1, np.int64), np.empty(n)
    for e in order:
        a, b, limit = edges[e, 0], edges[e, 1], stretch * lengths[e]
        for k in range(links.start[a], end[a]):
            marked[node[k]], distance[node[k]] = e, length[k]
        found = False
        for k in range(links.start[b], end[b]):
            if marked[node[k]] == e and distance[node[k]] + length[k] <= limit:
                found = True
                break
        if not found:
            remaining[e] = True
            node[end[a]], length[end[a]] = b, lengths[e]
            node[end[b]], length[end[b]] = a, lengths[e]
            end[a] += 1
            end[b] += 1
    return remaining


def _distances(links: Links, references: int) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return the distances from reference nodes to all nodes, shape (r, n), and each node's component, shape (n,).

    The first reference node is the one farthest from an arbitrary node, each further one is the farthest from those
    before it. Where no path leads, distances are infinite.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components, dijkstra

    n = len(links.start) - 1
    if n == 0:
        return np.empty((0, 0), np.float32), np.empty(0, np.int64)
    matrix = csr_array((links.length, links.node, links.start), shape=(n, n))
    components = connected_components(matrix, directed=False)[1]
    sizes = np.bincount(components)[components]
    nearest = np.where(sizes >= max(2.0, LARGE_SHARE * n), np.inf, -1.0)
    found: list[NDArray[np.float32]] = []
    distance = dijkstra(matrix, indices=[int(np.argmax(sizes))])[0]
    node = int(np.argmax(np.where(np.isfinite(distance), distance, -1.0)))
    while len(found) < references and nearest[node] > 0.0:
        distance = dijkstra(matrix, indices=[node])[0]
        found.append(distance.astype(np.float32))
        nearest = np.minimum(nearest, distance)
        node = int(np.argmax(nearest))
    return np.array(found, dtype=np.float32).reshape(-1, n), components.astype(np.int64)
