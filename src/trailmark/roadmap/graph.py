"""graph_of: a roadmap as a networkx graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

import networkx as nx
import numpy as np

from trailmark.roadmap.store import EdgeStatus

if TYPE_CHECKING:
    from trailmark.roadmap.roadmap import Roadmap

__all__ = ["graph_of"]


def graph_of(roadmap: Roadmap) -> nx.Graph:
    """Return a copy of a roadmap, its blocked edges left out; :attr:`Roadmap.graph` describes the attributes."""
    graph = nx.DiGraph() if roadmap.directed else nx.Graph()
    configurations, edges, lengths, status = roadmap.rows()
    clearances = roadmap.checker.clearance(configurations) if len(configurations) else np.empty(0)
    for i, (q, clearance) in enumerate(zip(configurations.tolist(), clearances.tolist(), strict=True)):
        graph.add_node(i, configuration=tuple(q), clearance=clearance)
    shown = status != EdgeStatus.BLOCKED
    certified, smaller = status[shown] == EdgeStatus.FREE, clearances[edges[shown]].min(axis=1)
    rows = (values.tolist() for values in (edges[shown], lengths[shown], certified, smaller))
    for (u, v), length, free, clearance in zip(*rows, strict=True):
        graph.add_edge(u, v, length=length, certified=free, clearance=clearance)
    return graph
