"""Planning on a route graph drawn by hand: free edges alone are driven, in their direction; shapely says which are."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
import shapely

from trailmark import ConfigurationError, LandmarkPlanner, Rectangle, Robot, World, check_path
from trailmark.roadmap import read_route_graph
from trailmark.se2 import transform

WALL = World("wall", (0.0, 0.0, 20.0, 10.0), (Rectangle((10.0, 7.0), 2.0, 6.0),))


def graph_of(places: dict[int, tuple[float, float]], edges: list[tuple[int, int]]) -> nx.DiGraph:
    graph = nx.DiGraph()
    for node, at in places.items():
        graph.add_node(node, position=at)
    for i, (a, b) in enumerate(edges):
        graph.add_edge(a, b, id=100 + i, length=float(np.hypot(*np.subtract(places[b], places[a]))))
    return graph


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
    assert result.path is not None
    assert check_path(world, robot, result.path).free
    ids = nx.get_edge_attributes(graph, "id")
    assert not {ids[pair] for pair in pairwise(result.nodes)} & expected
    states = result.path.states[:, :2]
    for pair in pairwise(result.nodes):  # the path passes its nodes, in their order
        assert all(np.hypot(*(states - at[node]).T).min() < 1e-9 for node in pair)


@pytest.mark.parametrize(
    "robot", [Robot.disc(0.3), Robot.rectangle(0.8, 0.4), Robot.rectangle(0.8, 0.4).differential()]
)
def test_the_cheapest_free_way_is_taken(robot: Robot) -> None:
    places = {1: (3.0, 5.0), 2: (17.0, 5.0), 3: (3.0, 2.0), 4: (17.0, 2.0), 5: (17.0, 9.0)}
    graph = graph_of(places, [(1, 2), (1, 3), (3, 4), (4, 2), (4, 5), (2, 1)])
    planner = LandmarkPlanner(WALL, robot, seed=0)
    result = planner.plan_on_route(graph, (2.0, 5.0, 0.0), (18.0, 5.0, 0.0))
    assert (result.status, result.nodes, result.colliding) == ("solved", (1, 3, 4, 2), (100, 105))
    assert result.cost == pytest.approx(planner.plan_on_route(graph, (2.0, 5.0, 0.0), (18.0, 5.0, 0.0)).cost)
    assert result.to_dict("wall")["route"] == {"nodes": [1, 3, 4, 2], "colliding": [100, 105]}
    back = planner.plan_on_route(graph, (18.0, 5.0, 0.0), (2.0, 5.0, 0.0))
    assert (back.status, back.path) == ("timeout", None)
    assert back.reason == "no free edges lead from start to goal"


def test_an_end_with_no_motion_to_the_graph_is_planned_to() -> None:
    graph = graph_of({1: (13.0, 8.0), 2: (17.0, 8.0)}, [(1, 2)])
    result = LandmarkPlanner(WALL, Robot.disc(0.3), seed=0).plan_on_route(graph, (7.0, 8.0, 0.0), (18.0, 8.0, 0.0))
    assert (result.status, result.nodes) == ("solved", (1, 2))


def test_a_car_and_an_empty_graph_are_refused_in_one_line() -> None:
    graph = graph_of({1: (3.0, 5.0), 2: (3.0, 2.0)}, [(1, 2)])
    car = LandmarkPlanner(WALL, Robot.rectangle(0.8, 0.4).steered(1.0), seed=0)
    with pytest.raises(ConfigurationError, match="expected a robot that turns in place, got rectangle"):
        car.plan_on_route(graph, (2.0, 5.0, 0.0), (3.0, 2.0, 0.0))
    with pytest.raises(ConfigurationError, match="expected one edge or more, got none"):
        LandmarkPlanner(WALL, Robot.disc(0.3)).plan_on_route(nx.DiGraph(), (2.0, 5.0, 0.0), (3.0, 2.0, 0.0))


def test_what_is_no_route_graph_is_refused_in_one_line() -> None:
    planner, ends = LandmarkPlanner(WALL, Robot.disc(0.3)), ((2.0, 5.0, 0.0), (3.0, 2.0, 0.0))
    lone = nx.DiGraph([(1, 2)])
    nowhere = graph_of({1: (3.0, 5.0), 2: (3.0, 2.0)}, [(1, 2)])
    nowhere.nodes[2]["position"] = (3.0, float("nan"))
    for given, fault in (
        (None, "expected DiGraph, got None"),
        ("graph.geojson", "expected DiGraph, got 'graph.geojson'"),
        (nx.Graph([(1, 2)]), "expected DiGraph, got"),
        (lone, "node 1: position: expected"),
        (nowhere, "node 2: position: expected"),
    ):
        with pytest.raises(ConfigurationError, match=f"^route graph: {fault}") as caught:
            planner.plan_on_route(given, *ends)
        assert "\n" not in str(caught.value)


def test_a_graph_made_by_hand_needs_positions_alone() -> None:
    graph = nx.MultiDiGraph()
    graph.add_node("a", position=[3, 5])
    graph.add_node("b", position=(3.0, 2.0))
    graph.add_edges_from([("a", "a"), ("a", "b")])
    result = LandmarkPlanner(WALL, Robot.disc(0.3), seed=0).plan_on_route(graph, (2.0, 5.0, 0.0), (3.0, 1.5, 0.0))
    assert result.status == "solved"
    assert list(map(str, result.nodes)) == ["a", "b"]
