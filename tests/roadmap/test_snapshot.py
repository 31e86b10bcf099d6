"""Queries on a kept roadmap: shortest paths against networkx over the same links."""

from __future__ import annotations

import math
from itertools import pairwise

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.trials import few

from trailmark.collision import StateChecker
from trailmark.curves import Steering
from trailmark.landmarks import free_samples
from trailmark.motion import TranslationMotion
from trailmark.roadmap import Roadmap
from trailmark.roadmap.snapshot import RoadmapSnapshot
from trailmark.roadmap.spanner import Adjacency

FloatArray = NDArray[np.float64]


def as_graph(n: int, links: Adjacency) -> nx.Graph:
    graph = nx.Graph()
    graph.add_nodes_from(range(n))
    for node in range(n):
        for k in range(links.start[node], links.start[node + 1]):
            graph.add_edge(node, int(links.node[k]), weight=float(links.length[k]))
    return graph


def cost(a: FloatArray, b: FloatArray, turning: bool) -> float:
    angle = abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2])))
    return math.dist(a[:2], b[:2]) + (0.5 * angle if turning else 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [True, False], ids=["reversing", "forwards"])
def test_paths_of_cars_are_networkxs(reverse: bool) -> None:
    world = random_world(11, 25, size=30.0, radii=(0.5, 2.5))
    checker = StateChecker(world, ROBOTS["rectangle"].steered(1.5, reverse), cell=0.2)
    roadmap = Roadmap(checker)
    roadmap.add(free_samples(checker, 200, random_state=3))
    graph, whole = RoadmapSnapshot(roadmap, stretch=1.0), roadmap.graph
    whole.remove_edges_from([(u, v) for u, v, free in whole.edges(data="certified") if not free])
    assert whole.is_directed() != reverse
    steering = Steering(1.5, reverse)
    found = 0
    for i, j in np.random.default_rng(0).integers(0, len(graph), (60, 2)).tolist():
        between = graph.between(i, j)
        try:
            length = nx.dijkstra_path_length(whole, i, j, weight="length")
        except nx.NetworkXNoPath:
            assert between is None
            continue
        assert between is not None
        assert float(np.sum(steering.lengths(between[:-1], between[1:]))) == pytest.approx(length, abs=1e-6)
        found += 1
    assert found > 30
    # From places that are no nodes, in the direction of driving.
    ends = free_samples(checker, 60, random_state=4).reshape(-1, 2, 3)
    joined = 0
    for start, goal in ends:
        states = graph.find_path(start.copy(), goal.copy())
        if states is not None:
            assert np.array_equal(states[[0, -1]], [start, goal])
            along = steering.states(states[:-1], states[1:], np.linspace(0.0, 60.0, 600))
            assert not Oracle(world, checker.robot, 1e-6).collides(along.reshape(-1, 3)).any()
            joined += 1
    assert joined > 15


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
    q, turning = graph.configurations, not isinstance(graph.motion, TranslationMotion)
    whole = as_graph(len(q), graph.links)
    for u, v, data in whole.edges(data=True):
        assert data["weight"] == pytest.approx(cost(q[u], q[v], turning), abs=1e-9)
    rng = np.random.default_rng(seed)
    for i, j in rng.integers(0, len(q), (5, 2)).tolist():
        between = graph.between(i, j)
        if graph.components[i] != graph.components[j]:
            assert between is None
            continue
        assert between is not None
        assert np.array_equal(between[[0, -1]], q[[i, j]])
        assert graph.motion.cost_of(between) == pytest.approx(nx.dijkstra_path_length(whole, i, j), abs=1e-9)
    ends = free_samples(checker, 12, random_state=seed + 1)
    for start, goal in ends[: len(ends) // 2 * 2].reshape(-1, 2, 3):
        closed = np.column_stack([rng.uniform(0.0, 40.0, (2, 2)), rng.uniform(0.0, 5.0, 2)])
        for discs in (None, closed):
            states = graph.find_path(start, goal, closed=discs, weight=weight)
            if states is not None:
                assert np.array_equal(states[[0, -1]], [start, goal])
                assert checker.motions_valid(states[:-1], states[1:]).all()
                assert graph.motion.cost_of(states) == pytest.approx(
                    sum(cost(a, b, turning) for a, b in pairwise(states))
                )
            if discs is None and checker.motion_valid(start, goal):
                assert states is not None
                assert len(states) == 2
                continue
            inside = np.zeros(len(q), dtype=np.bool_)
            for x, y, r in () if discs is None else discs:
                inside |= np.hypot(q[:, 0] - x, q[:, 1] - y) < r
            if states is not None and len(states) > 2:
                assert not any((q[inside] == state).all(axis=1).any() for state in states[1:-1])
            if states is None:
                continue
            # The same search, by Dijkstra: the ends joined to as many of their nearest nodes as the query took.
            rest = whole.copy()
            rest.remove_nodes_from(np.flatnonzero(inside).tolist())
            first, last = states[1], states[-2]
            i, j = (int(np.flatnonzero((q == node).all(axis=1))[0]) for node in (first, last))
            best = nx.dijkstra_path_length(rest, i, j)
            way = cost(start, first, turning) + best + cost(last, goal, turning)
            assert way - 1e-9 <= graph.motion.cost_of(states) <= weight * way + 1e-9


def test_a_query_graph_is_as_the_roadmap_was() -> None:
    checker = StateChecker(random_world(1, 20, size=40.0), ROBOTS["disc"], cell=0.2)
    roadmap = Roadmap(checker)
    q = free_samples(checker, 400, random_state=1)
    roadmap.add(q[:200])
    graph = RoadmapSnapshot(roadmap)
    before = graph.find_path(q[300], q[301])
    roadmap.add(q[200:])
    after = graph.find_path(q[300], q[301])
    assert len(graph) == 200
    assert before is not None
    assert after is not None
    assert np.array_equal(before, after)


def test_an_empty_roadmap_answers_what_needs_no_roadmap() -> None:
    checker = StateChecker(random_world(1, 0, size=40.0), ROBOTS["disc"])
    graph = RoadmapSnapshot(Roadmap(checker))
    states = graph.find_path(np.array([2.0, 2.0, 0.0]), np.array([9.0, 9.0, 0.0]))
    assert states is not None
    assert states.tolist() == [[2.0, 2.0, 0.0], [9.0, 9.0, 0.0]]
    assert (
        graph.find_path(np.array([2.0, 2.0, 0.0]), np.array([9.0, 9.0, 0.0]), closed=np.array([[5.0, 5.0, 1.0]]))
        is None
    )
