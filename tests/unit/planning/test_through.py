"""Paths through places on the way, and along graphs drawn by hand."""

from __future__ import annotations

from itertools import pairwise, product
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
import shapely

from trailmark import (
    ConfigurationError,
    Goal,
    KeepOutZone,
    LandmarkPlanner,
    Polygon,
    Rectangle,
    Robot,
    Steering,
    World,
    check_path,
)
from trailmark.planning.result import PlanResult
from trailmark.se2 import transform

ROBOTS = {
    "disc": Robot.disc(0.2),
    "rectangle": Robot.rectangle(0.6, 0.4),
    "differential": Robot.rectangle(0.6, 0.4).differential(),
    "car": Robot.rectangle(0.6, 0.4).steered(0.5),
}
OPEN = World("open", (0.0, 0.0, 20.0, 20.0))


def passed(result: PlanResult, places: list[tuple[float, ...]]) -> list[int]:
    """Return the indices of the states at which a path passes places, in turn."""
    found, states = [0], result.path.states
    for place in places:
        off = np.abs(states[found[-1] :, :2] - place[:2]).max(axis=1)
        found.append(found[-1] + int(np.argmax(off < 1e-9)))
        assert off[found[-1] - found[-2]] < 1e-9, f"{place} is not passed"
    return found[1:]


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_a_path_leads_through_all_places_and_is_certified(name: str, worlds: Path) -> None:
    world, robot = World.load(worlds / "office.yaml"), ROBOTS[name]
    start, places = (1.0, 1.0, 0.0), [(6.5, 1.5), (8.0, 6.0, 0.5), (13.0, 6.5), (18.0, 10.0, 1.57)]
    planner = LandmarkPlanner(world, robot, seed=0)
    result = planner.plan_through(start, places, 8.0)
    assert (result.status, len(result.legs)) == ("solved", 4)
    audit = check_path(world, robot, result.path)
    assert audit.free
    where = passed(result, places)
    assert (result.path.states[where[-1] :, :2] == places[-1][:2]).all()
    for i, heading in ((1, 0.5), (3, 1.57)):  # it may turn there
        there = result.path.states[where[i] :]
        there = there[(there[:, :2] == places[i][:2]).all(axis=1)]
        assert np.abs(there[:, 2] - heading).min() < 1e-9
    assert 0.0 < result.lower_bound <= result.cost
    assert result.cost == pytest.approx(sum(leg.cost or np.inf for leg in result.legs), rel=0.01)
    # No way through the places can be cheaper than the parts each by itself, planned with all headings free.
    ends = [start, *places]
    for a, b, leg in zip(ends, ends[1:], result.legs, strict=False):
        assert leg.cost >= np.hypot(*np.subtract(b[:2], a[:2])) - 1e-9


@pytest.mark.slow
def test_headings_left_free_are_those_of_the_cheapest_chain() -> None:
    """In the open, against all combinations of 72 headings at each of two places, by the curves' own lengths."""
    robot, steering = ROBOTS["car"], Steering(0.5)
    start, places, goal = (3.0, 3.0, 0.0), [(6.0, 4.0), (5.0, 7.0)], (2.0, 6.0, 3.0)
    result = LandmarkPlanner(OPEN, robot, seed=0).plan_through(start, [*places, goal], 3.0)
    angles = np.linspace(-np.pi, np.pi, 72, endpoint=False)
    rows = [np.array([start]), *(np.column_stack([np.tile(p, (72, 1)), angles]) for p in places), np.array([goal])]
    total = np.zeros(1)
    for a, b in pairwise(rows):
        lengths = np.array([float(steering.lengths(p, q)) for p, q in product(a, b)]).reshape(len(a), len(b))
        total = (total[:, None] + lengths).min(axis=0)
    assert result.path.length <= 1.02 * total[0]


def test_of_several_goals_the_cost_counts_and_the_index_is_told() -> None:
    near, far = Goal((10.0, 6.0, 0.0), cost=5.0), Goal((10.0, 8.0, 0.0))
    planner = LandmarkPlanner(OPEN, ROBOTS["disc"], seed=0)
    result = planner.plan_through((5.0, 5.0, 0.0), [(near, far), [near, Goal((15.0, 5.0))]], 2.0)
    assert (result.legs[0].goal.index, result.goal.index) in {(1, 1), (0, 0)}
    lengths = [float(np.hypot(5.0, 3.0)), float(np.hypot(5.0, 3.0))]  # over the farther goal, which costs nothing
    assert result.cost == pytest.approx(sum(lengths), rel=1e-6)
    assert result.lower_bound <= result.cost


def test_the_leg_that_fails_is_named() -> None:
    box = World("box", (0.0, 0.0, 20.0, 10.0), (Rectangle((10.0, 5.0), 1.0, 10.0),))
    planner = LandmarkPlanner(box, ROBOTS["disc"], seed=0)
    result = planner.plan_through((2.0, 2.0, 0.0), [(5.0, 5.0, 0.0), (15.0, 5.0, 0.0), (2.0, 8.0)], 2.0)
    assert (result.status, result.path, len(result.legs)) == ("infeasible", None, 2)
    assert result.reason.startswith("leg 2 of 3, from via point 1 to via point 2: ")
    assert result.to_dict("box")["legs"][1]["status"] == "infeasible"
    with pytest.raises(ConfigurationError, match=r"^via point 1 \(10, 5, 0\) is not valid"):
        planner.plan_through((2.0, 2.0, 0.0), [(10.0, 5.0, 0.0), (2.0, 8.0)], 2.0)


@pytest.mark.parametrize(
    ("goals", "fault"),
    [
        ([], "expected the places to pass in turn, got"),
        (Goal((1.0, 1.0)), "expected the places to pass in turn, got"),
        ([(1.0, 2.0), "kitchen"], "goals: "),
        ([(1.0, 2.0, 3.0, 4.0)], r"expected \[x, y, theta\] or \[x, y\]"),
    ],
)
def test_what_are_no_places_is_refused(goals: object, fault: str) -> None:
    with pytest.raises(ConfigurationError, match=fault):
        LandmarkPlanner(OPEN, ROBOTS["disc"]).plan_through((3.0, 3.0, 0.0), goals)  # type: ignore[arg-type]


def test_either_of_two_opposite_headings_will_do() -> None:
    goals = Goal.bidirectional((10.0, 3.0, 0.0))
    assert goals[1].pose == pytest.approx((10.0, 3.0, np.pi))
    robot = ROBOTS["car"].steered(0.5, reverse=False)
    result = LandmarkPlanner(OPEN, robot, seed=0).plan((15.0, 3.0, np.pi), goals)
    assert result.path.length == pytest.approx(5.0)
    with pytest.raises(ConfigurationError, match="expected a pose x, y, theta with a heading"):
        Goal.bidirectional((10.0, 3.0))


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name == "car")) for name in ROBOTS])
def test_a_start_in_a_keep_out_zone_leaves_it_on_the_first_leg(name: str) -> None:
    zone = shapely.box(7.0, 7.0, 8.0, 8.0)
    world = World.from_geometries(shapely.box(4.0, 3.0, 6.0, 7.0), (0.0, 0.0, 10.0, 10.0), zones=[KeepOutZone(zone)])
    robot, start, places = ROBOTS[name], (7.5, 7.5, 0.3), [(2.0, 2.0), (9.0, 9.0, 1.0)]
    planner = LandmarkPlanner(world, robot, seed=0)
    result = planner.plan_through(start, places, 3.0)
    assert (result.status, [leg.status for leg in result.legs]) == ("solved", ["solved"] * 2)
    assert result.path is not None
    assert check_path(world, robot, result.path).free
    passed(result, places)
    states = result.path.states
    outlines = [Polygon(transform(q, robot.outline.vertices)).shapely() for q in states]
    within = [shapely.intersection(outline, zone).area > 1e-6 for outline in outlines]
    assert within == [i < result.escape for i in range(len(states))]
    assert result.escape > 0
    single = planner.plan(start, places[1], 3.0)
    assert single.escape > 0
    alone = planner.plan_through(start, places[1:], 3.0)
    assert alone.cost is not None
    assert single.cost is not None
    assert alone.cost <= 1.5 * single.cost


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
