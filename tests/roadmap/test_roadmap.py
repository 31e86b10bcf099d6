"""The roadmap: its edges against brute force, its paths against networkx, its certificates against shapely."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from tests.helpers.oracle import Oracle, motion_states
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.trials import few

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.errors import ConfigurationError
from trailmark.landmarks import free_samples
from trailmark.motion import TranslationMotion
from trailmark.roadmap import Roadmap
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]


def checker_for(name: str, seed: int = 1, obstacles: int = 60) -> StateChecker:
    world = random_world(seed, obstacles, size=40.0, radii=(0.3, 3.0), discs=0.3, holes=0.2)
    return StateChecker(world, ROBOTS[name], cell=0.2)


def roadmap_for(name: str, seed: int = 1, n: int = 150, obstacles: int = 60) -> Roadmap:
    roadmap = Roadmap(checker_for(name, seed, obstacles))
    roadmap.add(free_samples(roadmap.checker, n, random_state=seed))
    return roadmap


def cost(a: FloatArray, b: FloatArray, turning: bool = True) -> float:
    """Cost of a motion, in metres, with the turn measured as the angle between two unit vectors."""
    angle = abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2])))
    return math.dist(a[:2], b[:2]) + (0.5 * angle if turning else 0.0)


def certified_graph(roadmap: Roadmap) -> nx.Graph:
    """A networkx graph of all certified edges, weighted by this file's own costs."""
    roadmap.certify_all()
    q, turning = roadmap.configurations, not isinstance(roadmap.motion, TranslationMotion)
    graph = nx.Graph()
    graph.add_nodes_from(range(len(q)))
    for u, v in roadmap.edges[roadmap.certified].tolist():
        graph.add_edge(u, v, weight=cost(q[u], q[v], turning))
    return graph


def way_cost(roadmap: Roadmap, nodes: NDArray[np.int64]) -> float:
    q = roadmap.configurations[nodes]
    return sum(cost(a, b, not isinstance(roadmap.motion, TranslationMotion)) for a, b in pairwise(q))


@pytest.mark.parametrize("name", ROBOTS)
def test_edges_join_nearest_neighbours_once(name: str) -> None:
    checker = checker_for(name)
    roadmap = Roadmap(checker)
    radius = 0.0 if name == "disc" else float(np.hypot(*checker.robot.outline.vertices.T).max())
    first = 0
    for size, neighbours in ((1, None), (5, 3), (0, 3), (60, 7), (40, None), (3, 200)):
        q = free_samples(checker, size, random_state=first)
        added = roadmap.add(q, neighbours=neighbours)
        n = first + size
        assert added.tolist() == list(range(first, n))
        assert len(roadmap) == n
        assert np.array_equal(roadmap.configurations[first:], q)
        pairs = roadmap.edges
        assert (pairs[:, 0] != pairs[:, 1]).all()
        assert len(np.unique(np.sort(pairs, axis=1), axis=0)) == len(pairs)
        assert len(roadmap.lengths) == len(roadmap.status) == len(roadmap.certified) == len(pairs)
        # Brute force: the k nearest of each new node, itself left out.
        at = roadmap.configurations
        points = np.column_stack([at[:, :2], radius * np.cos(at[:, 2]), radius * np.sin(at[:, 2])])
        apart = cdist(points, points)
        np.fill_diagonal(apart, np.inf)
        k = math.ceil(4 / 3 * math.e * math.log(max(n, 2))) if neighbours is None else neighbours
        joined = {frozenset(pair) for pair in pairs.tolist()}
        new = {pair for pair in joined if max(pair) >= first}
        expected = {frozenset((i, int(j))) for i in range(first, n) for j in np.argsort(apart[i])[: min(k, n - 1)]}
        assert new == expected
        first = n
    turning = name != "disc"
    q, pairs = roadmap.configurations, roadmap.edges
    assert roadmap.lengths == pytest.approx([cost(q[u], q[v], turning) for u, v in pairs.tolist()], abs=1e-12)
    assert np.array_equal(roadmap.certified, roadmap.status == FREE)


@pytest.mark.parametrize("name", ["disc", "rectangle"])
def test_a_path_is_joined_edge_by_edge(name: str) -> None:
    roadmap = roadmap_for(name, n=200)
    way = roadmap.shortest_path(0, max(range(200), key=lambda i: len(roadmap.shortest_path(0, i).nodes))).nodes
    states = roadmap.configurations[way]
    # New vertices near and far apart: halfway along every motion, then only some of them.
    middles = 0.5 * (states[:-1, :2] + states[1:, :2])
    for shift, path in enumerate(
        (
            np.insert(states[:, :2], np.arange(1, len(states)), middles, axis=0),
            states[[0, *range(2, len(states) - 1, 3), -1], :2],
        )
    ):
        q = np.column_stack([path + 1e-3 * (shift + 1), np.full(len(path), 0.5)])
        q[[0, -1]] = states[[0, -1]]
        n = len(roadmap)
        along = roadmap.add_path(q)
        assert along.tolist() == [int(way[0]), *range(n, n + len(path) - 2), int(way[-1])]
        assert np.array_equal(roadmap.configurations[along], q)
        pairs = [tuple(sorted(pair)) for pair in roadmap.edges.tolist()]
        assert len(set(pairs)) == len(pairs) == len(roadmap.lengths) == len(roadmap.status)
        status = dict(zip(pairs, roadmap.status.tolist(), strict=True))
        assert {status[min(u, v), max(u, v)] for u, v in pairwise(along.tolist())} == {FREE}
        # Once more, it is there already; a state given twice in a row counts once.
        edges = len(roadmap.edges)
        assert roadmap.add_path(np.repeat(q, 2, axis=0)).tolist() == along.tolist()
        assert (len(roadmap), len(roadmap.edges)) == (n + len(path) - 2, edges)


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_certified_edges_do_not_collide(name: str) -> None:
    roadmap = roadmap_for(name, n=60)
    undecided = np.count_nonzero(roadmap.status == UNDECIDED)
    before = roadmap.status.copy()
    roadmap.certify_all()
    assert not (roadmap.status == UNDECIDED).any()
    assert undecided > 0
    decided = before != UNDECIDED
    assert np.array_equal(roadmap.status[decided], before[decided])
    oracle = Oracle(roadmap.checker.world, roadmap.checker.robot)
    a, b = (roadmap.configurations[roadmap.edges[:, i]] for i in (0, 1))
    hit = np.zeros(len(a), np.bool_)
    hit |= oracle.collides(motion_states(a, b, 40).reshape(-1, 3)).reshape(-1, 40).any(axis=1)
    # Back it is the same way but for half a turn.
    half = np.abs(np.abs(se2.difference(a, b)[:, 2]) - math.pi) < 1e-6
    if half.any():
        hit[half] |= oracle.collides(motion_states(b[half], a[half], 40).reshape(-1, 3)).reshape(-1, 40).any(axis=1)
    assert roadmap.certified.sum() > 100
    assert not hit[roadmap.certified].any()
    # And nearly all that are refused do collide.
    assert hit[roadmap.status == BLOCKED].mean() > 0.9


def test_an_edge_of_half_a_turn_is_not_taken_backwards() -> None:
    # An arm that reaches 2 m ahead of its reference point, above a wall: it can only swing over the top. From 0 to
    # pi that is the way of the motion; from pi to 0 half a turn goes on counter-clockwise, through the wall.
    robot = Robot.polygon([(-0.1, -0.1), (2.0, -0.1), (2.0, 0.1), (-0.1, 0.1)])
    world = World("wall", (0, 0, 10, 10), (Rectangle((5, 2), 10, 0.5),))
    checker = StateChecker(world, robot)
    right, left = (5.0, 3.0, 0.0), (5.0, 3.0, math.pi)
    assert checker.motion_valid(right, left)
    assert not checker.motion_valid(left, right)
    roadmap = Roadmap(checker)
    roadmap.add(np.array([right, left]))
    for start, goal in ((0, 1), (1, 0)):
        nodes = roadmap.shortest_path(start, goal).nodes
        q = roadmap.configurations[nodes]
        assert checker.motions_valid(q[:-1], q[1:]).all()


@pytest.mark.slow
@settings(max_examples=few(25))
@given(seed=st.integers(0, 10_000), name=st.sampled_from(sorted(ROBOTS)), obstacles=st.sampled_from([20, 60, 120]))
def test_shortest_paths_are_networkxs(seed: int, name: str, obstacles: int) -> None:
    roadmap = roadmap_for(name, seed, 120, obstacles)
    n = len(roadmap)
    if n < 10:
        return
    whole = Roadmap.from_arrays(roadmap.checker, roadmap.configurations, roadmap.edges, roadmap.status)
    graph = certified_graph(whole)
    rng = np.random.default_rng(seed)
    for start, goal in rng.integers(0, n, (6, 2)).tolist():
        banned = rng.random(n) < 0.2
        banned[[start, goal]] = False
        left: Any = graph.copy()
        left.remove_nodes_from(np.flatnonzero(banned).tolist())
        for rest, ban in ((graph, None), (left, banned)):
            nodes, reached, _ = roadmap.shortest_path(start, goal, banned=ban)
            joined = set(nx.single_source_dijkstra_path_length(rest, start))
            assert set(np.flatnonzero(reached).tolist()) <= joined
            if goal not in joined:
                assert len(nodes) == 0
                assert set(np.flatnonzero(reached).tolist()) == joined
                continue
            best = nx.dijkstra_path_length(rest, start, goal)
            assert (nodes[0], nodes[-1]) == (start, goal)
            assert all(rest.has_edge(u, v) for u, v in pairwise(nodes.tolist()))
            assert way_cost(roadmap, nodes) == pytest.approx(best, abs=1e-9)
            blind = roadmap.shortest_path(start, goal, banned=ban, to_go=np.zeros(n))
            assert way_cost(roadmap, blind.nodes) == pytest.approx(best, abs=1e-9)
            if start != goal:
                above, below = (roadmap.shortest_path(start, goal, banned=ban, limit=best + d) for d in (1e-6, -1e-6))
                assert way_cost(roadmap, above.nodes) == pytest.approx(best, abs=1e-9)
                assert len(below.nodes) == 0
    # What the search has decided on its way, the batch decides alike.
    checked = roadmap.status != UNDECIDED
    assert np.array_equal(roadmap.status[checked], whole.status[checked])


@pytest.mark.parametrize(("start", "goal"), [(-1, 0), (0, 20), (99, 3)])
def test_nodes_that_are_not_there(start: int, goal: int) -> None:
    roadmap = roadmap_for("disc", n=20)
    wrong = start if not 0 <= start < 20 else goal
    with pytest.raises(ConfigurationError, match=f"node: expected 0 or more, below 20, got {wrong}"):
        roadmap.shortest_path(start, goal)


@pytest.mark.parametrize("name", ["disc", "L"])
def test_distances(name: str) -> None:
    roadmap = roadmap_for(name, n=30)
    q = roadmap.configurations
    assert roadmap.distances_to(4) == pytest.approx([cost(row, q[4], name != "disc") for row in q], abs=1e-12)


@pytest.mark.parametrize("name", ["disc", "rectangle", "star"])
def test_the_networkx_graph_says_all(name: str) -> None:
    roadmap = roadmap_for(name, n=80)
    oracle = Oracle(roadmap.checker.world, roadmap.checker.robot)
    graph = roadmap.graph
    assert type(graph) is nx.Graph
    assert list(graph.nodes) == list(range(80))
    clearance = oracle.clearance(roadmap.configurations)
    for i, attributes in graph.nodes(data=True):
        assert set(attributes) == {"configuration", "clearance"}
        assert attributes["configuration"] == tuple(roadmap.configurations[i].tolist())
        assert attributes["clearance"] == pytest.approx(clearance[i], abs=1e-6)
    status = {frozenset(pair): s for pair, s in zip(roadmap.edges.tolist(), roadmap.status.tolist(), strict=True)}
    assert {frozenset(pair) for pair in graph.edges} == {pair for pair, s in status.items() if s != BLOCKED}
    for u, v, attributes in graph.edges(data=True):
        assert set(attributes) == {"length", "certified", "clearance"}
        q = roadmap.configurations
        assert attributes["length"] == pytest.approx(cost(q[u], q[v], name != "disc"), abs=1e-12)
        assert attributes["certified"] is (status[frozenset((u, v))] == FREE)
        assert attributes["clearance"] == pytest.approx(min(clearance[u], clearance[v]), abs=1e-6)
    # A copy: changing it does not change the roadmap.
    graph.remove_node(0)
    assert len(roadmap) == 80


def test_an_empty_roadmap() -> None:
    roadmap = Roadmap(checker_for("disc"))
    assert (len(roadmap), len(roadmap.graph), len(roadmap.certified)) == (0, 0, 0)
    roadmap.certify_all()
    assert roadmap.add(np.empty((0, 3))).tolist() == []
    assert roadmap.add(np.array([[1.0, 1.0, 0.0]])).tolist() == [0]
    assert roadmap.shortest_path(0, 0).nodes.tolist() == [0]
    assert len(roadmap.edges) == 0
