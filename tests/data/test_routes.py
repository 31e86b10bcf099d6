"""The route graph that nav2 ships with its depot."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
import shapely
from tests.helpers.kernels import ready

from trailmark import LandmarkPlanner, Robot, StateChecker, World, check_path
from trailmark.roadmap import read_route_graph
from trailmark.se2 import transform

__all__ = ["ready"]


def swept_collides(world: World, robot: Robot, a: tuple[float, float], b: tuple[float, float]) -> bool:
    """Return whether the footprint, driven along an edge, overlaps an obstacle, or leaves the bounds."""
    theta = np.arctan2(b[1] - a[1], b[0] - a[0])
    places = [np.array([*p, theta]) for p in (a, b)]
    rows = np.vstack([transform(q, robot.outline.vertices) for q in places])
    swept = shapely.MultiPoint(rows).convex_hull  # of a convex footprint that does not turn
    blocked = shapely.union_all([shape.polygon().shapely() for shape in world.obstacles])
    inside = shapely.covers(shapely.box(*world.bounds), swept)
    return shapely.intersection(swept, blocked).area > 1e-9 or not inside


@pytest.mark.slow
@pytest.mark.parametrize("size", [(0.5, 0.3), (0.8, 0.5), (1.4, 1.0)])
def test_on_nav2s_own_graph_the_edges_that_collide_are_named(shared_data: Path, size: tuple[float, float]) -> None:
    world = World.load(shared_data / "nav2" / "depot.yaml")
    graph = read_route_graph(shared_data / "nav2" / "depot_graph.geojson")
    robot = Robot.rectangle(*size).differential()
    at = nx.get_node_attributes(graph, "position")
    expected = {each["id"] for a, b, each in graph.edges(data=True) if swept_collides(world, robot, at[a], at[b])}
    result = LandmarkPlanner(world, robot, seed=0).plan_on_route(graph, (7.0, 7.9, 0.0), (15.8, 8.0, 1.6), 5.0)
    assert set(result.colliding) == expected
    assert check_path(world, robot, result.path).free
    ids = nx.get_edge_attributes(graph, "id")
    assert not {ids[pair] for pair in pairwise(result.nodes)} & expected
    states = result.path.states[:, :2]
    for pair in pairwise(result.nodes):  # the path passes its nodes, in their order
        assert all(np.hypot(*(states - at[node]).T).min() < 1e-9 for node in pair)


def test_depots_route_graph(shared_data: Path) -> None:
    file = shared_data / "nav2" / "depot_graph.geojson"
    graph = read_route_graph(str(file))
    assert (len(graph.nodes), len(graph.edges)) == (34, 78)
    for feature in json.loads(file.read_text())["features"]:
        properties, at = feature["properties"], feature["geometry"]["coordinates"]
        if feature["geometry"]["type"] == "Point":
            assert list(graph.nodes[properties["id"]]["position"]) == at
        else:
            attributes = graph.edges[properties["startid"], properties["endid"]]
            assert attributes == {"id": properties["id"], "length": pytest.approx(math.dist(*at))}
    # The published routes keep a small robot out of the map's obstacles, if both are read in the same frame.
    world = World.load(shared_data / "nav2" / "depot.yaml")
    ends = np.array([[(*graph.nodes[node]["position"], 0.0) for node in edge] for edge in graph.edges])
    assert StateChecker(world, Robot.disc(0.15)).motions_valid(ends[:, 0], ends[:, 1]).all()
