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
from tests.helpers.oracles import Oracle, motion_states
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import ConfigurationError, Rectangle, Roadmap, Robot, StateChecker, World, se2
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.landmarks import free_samples
from trailmark.motion import TranslationMotion
from trailmark.roadmap.snapshot import RoadmapSnapshot

networkx: Any = nx  # whose functions carry no types

FloatArray = NDArray[np.float64]

CAR = Robot.rectangle(1.6, 0.8).steered(1.5)
MOVERS = {**ROBOTS, "car": CAR, "forward car": CAR.steered(1.5, reverse=False)}


def checker_for(name: str, seed: int = 1, obstacles: int = 60) -> StateChecker:
    world = random_world(seed, obstacles, size=40.0, radii=(0.3, 3.0), discs=0.3, holes=0.2)
    return StateChecker(world, MOVERS[name], cell=0.2)


def roadmap_for(name: str, seed: int = 1, n: int = 150, obstacles: int = 60) -> Roadmap:
    roadmap = Roadmap(checker_for(name, seed, obstacles))
    q = free_samples(roadmap.checker, n, random_state=seed)
    roadmap.add(q[: n // 2])
    roadmap.add(q[n // 2 :])
    return roadmap


def cost(roadmap: Roadmap, a: FloatArray, b: FloatArray) -> float:
    """Cost of a motion, in metres, with the turn measured as the angle between two unit vectors."""
    if isinstance(roadmap.checker.robot.turning_radius, float):
        return float(roadmap.motion.steering.lengths(a, b))  # type: ignore[attr-defined]  # a car's
    angle = abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2])))
    return math.dist(a[:2], b[:2]) + (0.0 if isinstance(roadmap.motion, TranslationMotion) else 0.5 * angle)


def certified_graph(roadmap: Roadmap) -> Any:
    """A networkx graph of all certified edges, weighted by this file's own costs."""
    roadmap.certify_all()
    q = roadmap.configurations
    graph: Any = nx.DiGraph() if roadmap.directed else nx.Graph()
    graph.add_nodes_from(range(len(q)))
    for u, v in roadmap.edges[roadmap.certified].tolist():
        graph.add_edge(u, v, weight=cost(roadmap, q[u], q[v]))
    return graph


def way_cost(roadmap: Roadmap, nodes: NDArray[np.int64]) -> float:
    return sum(cost(roadmap, a, b) for a, b in pairwise(roadmap.configurations[nodes]))


@pytest.mark.parametrize("name", ROBOTS)
def test_edges_join_nearest_neighbours_once(name: str) -> None:
    checker = checker_for(name)
    roadmap = Roadmap(checker)
    radius = 0.0 if name == "disc" else float(np.hypot(*checker.robot.outline.vertices.T).max())
    first = 0
    for size, neighbours in ((1, None), (5, 3), (0, 3), (60, 7), (40, None), (3, 200)):
        q = free_samples(checker, size, random_state=first)
        n = first + size
        assert roadmap.add(q, neighbours=neighbours).tolist() == list(range(first, n))
        assert np.array_equal(roadmap.configurations[first:], q)
        pairs = roadmap.edges
        assert (pairs[:, 0] != pairs[:, 1]).all()
        assert len(np.unique(np.sort(pairs, axis=1), axis=0)) == len(pairs) == len(roadmap.lengths)
        # Brute force: the k nearest of each new node, itself left out.
        at = roadmap.configurations
        points = np.column_stack([at[:, :2], radius * np.cos(at[:, 2]), radius * np.sin(at[:, 2])])
        apart = cdist(points, points)
        np.fill_diagonal(apart, np.inf)
        k = math.ceil(4 / 3 * math.e * math.log(max(n, 2))) if neighbours is None else neighbours
        new = {frozenset(pair) for pair in pairs.tolist() if max(pair) >= first}
        assert new == {frozenset((i, int(j))) for i in range(first, n) for j in np.argsort(apart[i])[: min(k, n - 1)]}
        first = n
    q = roadmap.configurations
    assert roadmap.lengths == pytest.approx([cost(roadmap, q[u], q[v]) for u, v in roadmap.edges.tolist()], abs=1e-12)
    assert roadmap.distances_to(4) == pytest.approx([cost(roadmap, row, q[4]) for row in q], abs=1e-12)


@pytest.mark.parametrize("name", ["disc", "rectangle", "car"])
def test_a_path_is_joined_edge_by_edge_and_once(name: str) -> None:
    roadmap = roadmap_for(name)
    way = max((roadmap.shortest_path(0, i).nodes for i in range(len(roadmap))), key=len)
    states = roadmap.configurations[way]
    assert roadmap.add_path(states).tolist() == way.tolist()
    inner = states[1:-1] + np.array([1e-9, 0.0, 0.0])  # all but the ends are new
    q, n = np.vstack([states[:1], inner, states[-1:]]), len(roadmap)
    along = roadmap.add_path(q)
    assert along.tolist() == [int(way[0]), *range(n, n + len(inner)), int(way[-1])]
    assert np.array_equal(roadmap.configurations[along], q)
    pairs = [tuple(sorted(pair)) for pair in roadmap.edges.tolist()]
    assert len(set(pairs)) == len(pairs) == len(roadmap.lengths) == len(roadmap.status)
    status = dict(zip(pairs, roadmap.status.tolist(), strict=True))
    assert {status[min(u, v), max(u, v)] for u, v in pairwise(along.tolist())} == {FREE}
    # Once more, it is there already; a state given twice in a row counts once.
    assert roadmap.add_path(np.repeat(q, 2, axis=0)).tolist() == along.tolist()
    assert (len(roadmap), len(roadmap.edges)) == (n + len(inner), len(pairs))
    assert roadmap.ends(np.vstack([q[:1], q[:1] + 1e-9])).tolist() == [along[0], len(roadmap) - 1]


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_certified_edges_do_not_collide(name: str) -> None:
    roadmap = roadmap_for(name, n=60)
    before = roadmap.status.copy()
    roadmap.certify_all()
    assert (before == UNDECIDED).any()
    assert not (roadmap.status == UNDECIDED).any()
    assert np.array_equal(roadmap.status[before != UNDECIDED], before[before != UNDECIDED])
    oracle = Oracle(roadmap.checker.world, roadmap.checker.robot)
    a, b = (roadmap.configurations[roadmap.edges[:, i]] for i in (0, 1))
    hit = np.asarray(oracle.collides(motion_states(a, b, 40).reshape(-1, 3)).reshape(-1, 40).any(axis=1))
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
        q = roadmap.configurations[roadmap.shortest_path(start, goal).nodes]
        assert checker.motions_valid(q[:-1], q[1:]).all()


@pytest.mark.slow
@settings(max_examples=few(25))
@given(seed=st.integers(0, 10_000), name=st.sampled_from(sorted(MOVERS)), obstacles=st.sampled_from([20, 60, 120]))
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
        left = graph.copy()
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
        assert set(np.flatnonzero(roadmap.reached(start)).tolist()) == {start, *networkx.descendants(graph, start)}
        into = np.flatnonzero(roadmap.reached(start, reverse=True)).tolist()
        assert set(into) == {start, *networkx.ancestors(graph, start)}
    # What the search has decided on its way, the batch decides alike.
    checked = roadmap.status != UNDECIDED
    assert np.array_equal(roadmap.status[checked], whole.status[checked])


def test_arrays_that_do_not_agree_are_told_in_one_line() -> None:
    roadmap = roadmap_for("rectangle", n=20)
    checker, (q, edges, lengths, status) = roadmap.checker, roadmap.rows()
    for said, call in (
        (r"to_go: expected shape \(20,\), .* got \(19,\)", lambda: roadmap.shortest_path(0, 1, to_go=np.zeros(19))),
        ("banned: expected shape", lambda: roadmap.shortest_path(0, 1, banned=np.zeros(21, np.bool_))),
        ("node: expected 0 or more, below 20, got 20", lambda: roadmap.distances_to(20)),
        ("node: expected 0 or more, below 20, got -1", lambda: roadmap.shortest_path(-1, 0)),
        ("below 20, got 99", lambda: roadmap.shortest_path(3, 99)),
        ("got -1", lambda: RoadmapSnapshot(roadmap).between(-1, 0)),
        ("neighbours: expected 1 or more, got 0", lambda: roadmap.add(q[:1], neighbours=0)),
        ("got 20", lambda: Roadmap.from_arrays(checker, q, np.array([[0, 20]], np.int32), status[:1])),
        ("status: expected one for each of", lambda: Roadmap.from_arrays(checker, q, edges, status[:-1])),
        ("lengths: exp", lambda: Roadmap.from_arrays(checker, q, edges, status, lengths=lengths[:-1])),
    ):
        with pytest.raises(ConfigurationError, match=said):
            call()
