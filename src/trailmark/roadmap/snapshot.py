"""RoadmapSnapshot: a roadmap as it is now, prepared for many queries, which change nothing in it.

All expensive work is done once: edges are certified, edges that others can replace are left out, and the distances from
a few reference nodes to all others are stored. A query then runs in one compiled call: it joins its ends to their
nearest nodes for its own use only, and searches (:mod:`trailmark.roadmap.alt_search`). Any number of threads may query
at once.

Source of the sparse graph: Althöfer, Das, Dobkin, Joseph & Soares, "On sparse spanners of weighted graphs", DCG 1993.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from trailmark.collision import StateChecker
from trailmark.nearest import Forest
from trailmark.roadmap.alt_search import COLUMNS, alt_path, alt_search, node_table
from trailmark.roadmap.roadmap import Roadmap
from trailmark.roadmap.spanner import adjacency_of, components_of, distances_from, spanner
from trailmark.roadmap.store import EdgeStatus, require_nodes
from trailmark.se2 import FloatArray

__all__ = ["RoadmapSnapshot"]

STRETCH = 1.4
"""An edge is left out if a path over two others is at most this many times as long."""

REFERENCES = 12
"""Nodes whose distances to all others are stored: with the configuration, they fill 60 of a cache line's 64 bytes."""

NEIGHBOURS, MAX_NEIGHBOURS = 12, 768
"""Nodes near an end of a query that are tried at first, and at most."""

NO_DISCS = np.empty((0, 3))


class RoadmapSnapshot:
    """A roadmap's certified edges, ready for queries.

    Args:
        roadmap: its undecided edges are checked.
        stretch: how many times as long as an edge that is left out a path over two others may be, >= 1.
        references: how many nodes have their distances to all others stored.

    Attributes:
        configurations: (n, 3), the nodes.
        links: the edges that are searched.
        distances: (n, r) float32, from the reference nodes, metres.
        components: (n,) number of each node's connected component.
    """

    def __init__(self, roadmap: Roadmap, *, stretch: float = STRETCH, references: int = REFERENCES) -> None:
        roadmap.certify_all()
        self.checker: StateChecker = roadmap.checker
        self.motion = roadmap.motion
        q, all_edges, all_lengths, status = roadmap.rows()
        free = status == EdgeStatus.FREE
        self.configurations, edges, lengths = q.copy(), all_edges[free], all_lengths[free]
        n = len(self.configurations)
        if roadmap.directed:
            # Spanners and distances from reference nodes are for edges that lead both ways.
            self.links = adjacency_of(n, edges, lengths, directed=True)
            self.distances = np.empty((n, 0), np.float32)
            self.components = components_of(adjacency_of(n, edges, lengths))
        else:
            self.links = spanner(n, edges, lengths, stretch)
            self.distances, self.components = distances_from(self.links, references)
        self._table = node_table(self.configurations, self.distances)
        self._forest: Forest = roadmap.nearest()
        self._idle: list[FloatArray] = []
        if n:
            # Compiled code is loaded before a clock runs.
            self.find_path(self.configurations[0].copy(), self.configurations[-1].copy())

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
            closed: (c, 3), discs x, y, radius (metres) that may contain no node of the path.
            weight: of the cost to go, >= 1: the path is at most so many times as long as the shortest over the links,
                and found sooner.
        """
        n = len(self)
        with self._scratch() as scratch:
            found: FloatArray = alt_path(
                self.motion.kind,
                self.configurations,
                self.links,
                self._table,
                self.components,
                self._forest,
                scratch,
                start,
                goal,
                NO_DISCS if closed is None else closed,
                min(n, NEIGHBOURS),
                min(n, MAX_NEIGHBOURS),
                float(weight),
                self.motion.directed,
            )
        return found if len(found) else None

    def between(self, start: int, goal: int) -> FloatArray | None:
        """Return the states, shape (p, 3), of the shortest path over the links from a node to a node, or None.

        Args:
            start: a node, 0 to n - 1.
            goal: a node.

        Raises:
            ConfigurationError: a node that does not exist.
        """
        require_nodes([start, goal], len(self))
        q = self.configurations
        first, last = (np.array([node], dtype=np.int64) for node in (start, goal))
        with self._scratch() as scratch:
            found: FloatArray = alt_search(
                self.motion.kind, q, self.links, self._table, scratch, q[start], q[goal], NO_DISCS, first, last, 1.0
            )
        # Each end is joined to itself, and so comes twice.
        return found[1:-1] if len(found) else None

    @contextmanager
    def _scratch(self) -> Iterator[FloatArray]:
        """Lend the memory that a search writes to one thread at a time."""
        try:
            scratch = self._idle.pop()
        except IndexError:
            scratch = np.zeros((len(self) + 1, COLUMNS))
        yield scratch
        # After an exception it is not used again.
        self._idle.append(scratch)
