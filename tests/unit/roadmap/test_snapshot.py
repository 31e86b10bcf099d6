"""Queries on a kept roadmap: shortest paths against networkx over the same links, free by shapely."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import Roadmap, StateChecker
from trailmark.landmarks import free_samples
from trailmark.roadmap.snapshot import RoadmapSnapshot


def as_graph(graph: RoadmapSnapshot) -> nx.DiGraph:
    """The snapshot's links, weighted by their motions' costs."""
    q, links = graph.configurations, graph.links
    sources = np.repeat(np.arange(len(q)), np.diff(links.start))
    costs = graph.motion.costs(q[sources], q[links.node])
    assert links.length == pytest.approx(costs, abs=1e-9)
    whole = nx.DiGraph()
    whole.add_nodes_from(range(len(q)))
    whole.add_weighted_edges_from(zip(sources.tolist(), links.node.tolist(), costs.tolist(), strict=True))
    return whole


@pytest.mark.slow
@settings(max_examples=few(6))
@given(
    seed=st.integers(0, 10_000),
    name=st.sampled_from(["disc", "rectangle", "L"]),
    obstacles=st.sampled_from([20, 80]),
    stretch=st.sampled_from([1.0, 1.2]),
    weight=st.sampled_from([1.0, 1.2]),
)
def test_ways_are_networkxs(seed: int, name: str, obstacles: int, stretch: float, weight: float) -> None:
    world = random_world(seed, obstacles, size=40.0, radii=(0.3, 3.0), discs=0.3)
    checker = StateChecker(world, ROBOTS[name], cell=0.2)
    roadmap = Roadmap(checker)
    roadmap.add(free_samples(checker, 150, random_state=seed), neighbours=8)
    if len(roadmap) < 100:
        return
    graph = RoadmapSnapshot(roadmap, stretch=stretch)
    q, whole, costs = graph.configurations, as_graph(graph), graph.motion.cost_of
    rng = np.random.default_rng(seed)
    for i, j in rng.integers(0, len(q), (5, 2)).tolist():
        between = graph.between(i, j)
        assert (between is not None) == (graph.components[i] == graph.components[j])
        if between is not None:
            assert np.array_equal(between[[0, -1]], q[[i, j]])
            assert costs(between) == pytest.approx(nx.dijkstra_path_length(whole, i, j), abs=1e-9)
    ends = free_samples(checker, 12, random_state=seed + 1)
    for start, goal in ends[: len(ends) // 2 * 2].reshape(-1, 2, 3):
        closed = np.column_stack([rng.uniform(0.0, 40.0, (2, 2)), rng.uniform(0.0, 5.0, 2)])
        for discs in (None, closed):
            states = graph.find_path(start, goal, closed=discs, weight=weight)
            direct = discs is None and checker.motion_valid(start, goal)
            assert not direct or (states is not None and len(states) == 2)
            if states is None:
                continue
            assert np.array_equal(states[[0, -1]], [start, goal])
            assert checker.motions_valid(states[:-1], states[1:]).all()
            if direct:
                continue
            inside = np.zeros(len(q), dtype=np.bool_)
            for x, y, r in () if discs is None else discs:
                inside |= np.hypot(q[:, 0] - x, q[:, 1] - y) < r
            assert not any((q[inside] == state).all(axis=1).any() for state in states[1:-1])
            # The same search, by Dijkstra, between the nodes that its ends were joined to.
            rest = whole.copy()
            rest.remove_nodes_from(np.flatnonzero(inside).tolist())
            i, j = (int(np.flatnonzero((q == node).all(axis=1))[0]) for node in states[[1, -2]])
            way = costs(states[:2]) + nx.dijkstra_path_length(rest, i, j) + costs(states[-2:])
            assert way - 1e-9 <= costs(states) <= weight * way + 1e-9


def test_an_empty_roadmap_answers_what_needs_no_roadmap() -> None:
    graph = RoadmapSnapshot(Roadmap(StateChecker(random_world(1, 0, size=40.0), ROBOTS["disc"])))
    ends = np.array([[2.0, 2.0, 0.0], [9.0, 9.0, 0.0]])
    states = graph.find_path(*ends)
    assert states is not None
    assert np.array_equal(states, ends)
    assert graph.find_path(*ends, closed=np.array([[5.0, 5.0, 1.0]])) is None
