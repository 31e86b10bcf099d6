"""Planning on a route graph drawn by hand: free edges alone are driven, in their direction; shapely says which are."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest

from trailmark import ConfigurationError, LandmarkPlanner, Rectangle, Robot, World

WALL = World("wall", (0.0, 0.0, 20.0, 10.0), (Rectangle((10.0, 7.0), 2.0, 6.0),))


def graph_of(places: dict[int, tuple[float, float]], edges: list[tuple[int, int]]) -> nx.DiGraph:
    graph = nx.DiGraph()
    for node, at in places.items():
        graph.add_node(node, position=at)
    for i, (a, b) in enumerate(edges):
        graph.add_edge(a, b, id=100 + i, length=float(np.hypot(*np.subtract(places[b], places[a]))))
    return graph


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
