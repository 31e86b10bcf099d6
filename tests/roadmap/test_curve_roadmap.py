"""Roadmaps of curves: lengths, directions, certified edges, searches, files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pytest
from tests.helpers.random_worlds import random_world

from trailmark.collision import StateChecker
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.curves import Steering
from trailmark.errors import ConfigurationError, FormatError, OutputError
from trailmark.landmarks import free_samples
from trailmark.motion import CurveMotion
from trailmark.roadmap import Roadmap, load_roadmap
from trailmark.world import Robot

networkx: Any = nx  # whose functions carry no types

WORLD = random_world(7, 40, size=40.0, discs=0.3)
CAR = Robot.rectangle(1.6, 0.8).steered(1.5)
CHECKERS = {reverse: StateChecker(WORLD, CAR.steered(1.5, reverse)) for reverse in (True, False)}


def steering_of(roadmap: Roadmap) -> Steering:
    assert isinstance(roadmap.motion, CurveMotion)
    return roadmap.motion.steering


def made(reverse: bool, n: int = 150) -> Roadmap:
    checker = CHECKERS[reverse]
    roadmap = Roadmap(checker)
    q = free_samples(checker, n, random_state=3)
    roadmap.add(q[: n // 2])
    roadmap.add(q[n // 2 :])
    return roadmap


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [True, False], ids=["reeds-shepp", "dubins"])
def test_edges_are_shortest_curves_to_near_nodes(reverse: bool) -> None:
    roadmap = made(reverse)
    q, edges = roadmap.configurations, roadmap.edges
    assert roadmap.lengths == pytest.approx(steering_of(roadmap).lengths(q[edges[:, 0]], q[edges[:, 1]]))
    pairs = {tuple(pair) for pair in (edges if not reverse else np.sort(edges, axis=1)).tolist()}
    assert len(pairs) == len(edges)
    assert all(a != b for a, b in pairs)
    # Most of each node's five nearest by curve length are among its neighbours.
    lengths = np.array([roadmap.distances_to(i) for i in range(len(q))]).T
    np.fill_diagonal(lengths, np.inf)
    nearest = np.argsort(lengths, axis=1)[:, :5]
    found = [(min(a, b), max(a, b)) in pairs if reverse else (a, b) in pairs for a in range(len(q)) for b in nearest[a]]
    assert np.mean(found) > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [True, False], ids=["reeds-shepp", "dubins"])
def test_paths_are_the_shortest_over_certified_edges(reverse: bool) -> None:
    lazy, eager = made(reverse), made(reverse)
    eager.certify_all()
    assert set(np.unique(eager.status)) == {FREE, BLOCKED}
    motions = CurveMotion(lazy.checker)
    graph: Any = nx.Graph() if reverse else nx.DiGraph()
    for (a, b), length, status in zip(eager.edges.tolist(), eager.lengths, eager.status, strict=True):
        if status == FREE:
            graph.add_edge(a, b, length=length)
    compared = 0
    for goal in range(1, 60):
        nodes = lazy.shortest_path(0, goal).nodes
        if not (graph.has_node(0) and graph.has_node(goal) and goal in networkx.descendants(graph, 0)):
            assert len(nodes) == 0
            continue
        q = lazy.configurations[nodes]
        assert motions.motions_valid(q[:-1], q[1:]).all()
        length = float(np.sum(steering_of(lazy).lengths(q[:-1], q[1:])))
        assert length == pytest.approx(nx.shortest_path_length(graph, 0, goal, weight="length"))
        compared += 1
    assert compared > 20
    reached = np.flatnonzero(lazy.reached(0)).tolist()
    into = np.flatnonzero(lazy.reached(0, reverse=True)).tolist()
    if reverse:
        assert reached == into == sorted(networkx.node_connected_component(graph, 0))
    else:
        assert reached == sorted({0, *networkx.descendants(graph, 0)})
        assert into == sorted({0, *networkx.ancestors(graph, 0)})


def test_the_graph_is_directed_only_where_edges_are() -> None:
    both, forward = made(True), made(False)
    assert type(both.graph) is nx.Graph
    assert type(forward.graph) is nx.DiGraph
    for roadmap in (both, forward):
        roadmap.certify_all()
        graph: Any = roadmap.graph
        assert graph.number_of_nodes() == len(roadmap)
        assert graph.number_of_edges() == np.count_nonzero(roadmap.status == FREE)
        a, b, data = next(iter(graph.edges(data=True)))
        assert data["certified"] is True
        assert data["length"] == pytest.approx(
            steering_of(roadmap).lengths(graph.nodes[a]["configuration"], graph.nodes[b]["configuration"])
        )


def test_paths_and_trees_are_added_once() -> None:
    roadmap = made(True)
    nodes = next(p for p in (roadmap.shortest_path(0, i).nodes for i in range(1, 60)) if len(p) > 3)
    q = roadmap.configurations[nodes]
    before = len(roadmap)
    # All are nodes already, then none but the ends.
    assert roadmap.add_path(q).tolist() == nodes.tolist()
    q[1:-1, 0] += 1e-9
    along_path = roadmap.add_path(q)
    added = along_path[1:-1]
    assert along_path.tolist() == [nodes[0], *range(before, before + len(nodes) - 2), nodes[-1]]
    pairs = np.sort(roadmap.edges, axis=1)
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    along = np.sort(np.column_stack([[nodes[0], *added], [*added, nodes[-1]]]), axis=1)
    for pair in along:
        assert roadmap.status[(pairs == pair).all(axis=1)].tolist() == [FREE]
    forward = made(False)
    near = forward.configurations[:2] + np.array([0.01, 0.0, 0.0])
    hung = forward.add_tree(near, np.array([0, len(forward)]), reverse=True)
    assert {(int(hung[0]), 0), (int(hung[1]), int(hung[0]))} <= {tuple(e) for e in forward.edges.tolist()}


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".npz", ".graphml"])
@pytest.mark.parametrize("reverse", [True, False], ids=["reeds-shepp", "dubins"])
def test_files_give_the_roadmap_back_for_the_same_car_only(tmp_path: Path, suffix: str, reverse: bool) -> None:
    roadmap = made(reverse)
    roadmap.certify_all()
    file = tmp_path / f"roadmap{suffix}"
    roadmap.save(file)
    back = load_roadmap(file, CHECKERS[reverse])
    assert isinstance(back.motion, CurveMotion)
    assert np.array_equal(back.configurations, roadmap.configurations)
    free = {tuple(e) for e in roadmap.edges[roadmap.certified].tolist()}
    assert {tuple(e) for e in back.edges[back.certified].tolist()} == free
    nodes = roadmap.shortest_path(0, 30).nodes
    assert np.array_equal(back.shortest_path(0, 30).nodes, nodes)
    # Another turning radius, another direction of driving, no car at all: nothing is believed.
    others = [CAR.steered(1.6, reverse), CAR.steered(1.5, reverse=False), CAR.steered(None)]
    if not reverse:
        # Edges that lead one way may be there in both directions: that is no roadmap of a car that reverses.
        with pytest.raises(FormatError, match="each pair once"):
            load_roadmap(file, StateChecker(WORLD, CAR))
        others = others[:1]
    for robot in others:
        other = load_roadmap(file, StateChecker(WORLD, robot))
        assert not (other.status == FREE).any()
        assert isinstance(other.motion, CurveMotion) == (robot.turning_radius is not None)


def test_a_route_graph_holds_no_curves(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="curves"):
        made(True, 20).save(tmp_path / "route.geojson")


def test_bad_input() -> None:
    with pytest.raises(ConfigurationError, match="expected steering, or a robot with a turning radius, got neither"):
        CurveMotion(StateChecker(WORLD, Robot.disc(1.0)))
    roadmap = Roadmap(StateChecker(WORLD, Robot.disc(1.0).steered(2.0)))
    assert len(roadmap.add(np.empty((0, 3)))) == 0
    with pytest.raises(ConfigurationError, match="got 3"):
        roadmap.shortest_path(3, 0)
    assert isinstance(roadmap, Roadmap)
    assert UNDECIDED not in roadmap.status
