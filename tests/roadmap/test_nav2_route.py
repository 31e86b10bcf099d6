"""nav2 route graphs: what is written holds what nav2's loader asks for, what is read is what the file says."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.helpers.oracle import Oracle, motion_states
from tests.helpers.random_worlds import ROBOTS, random_world

from trailmark.collision import StateChecker
from trailmark.collision.kernels import UNDECIDED
from trailmark.errors import FormatError, OutputError
from trailmark.landmarks import free_samples
from trailmark.roadmap import Roadmap, read_route_graph
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World


def point(node: Any, x: Any = 0.0, y: Any = 0.0, **properties: Any) -> dict[str, Any]:
    geometry = {"type": "Point", "coordinates": [x, y]}
    return {"type": "Feature", "properties": {"id": node, **properties}, "geometry": geometry}


def line(edge: Any, start: Any, end: Any, kind: str = "LineString", **properties: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": {"id": edge, "startid": start, "endid": end, **properties},
        "geometry": {"type": kind, "coordinates": []},
    }


def written(folder: Path, *features: Any) -> Path:
    file = folder / "graph.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return file


def problem(file: Path) -> str:
    with pytest.raises(FormatError) as caught:
        read_route_graph(file)
    assert "\n" not in str(caught.value)
    return str(caught.value).removeprefix(f"{file}").lstrip(": ")


# --- written -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "L"])
def test_certified_edges_are_written_both_ways(name: str, tmp_path: Path) -> None:
    world = random_world(2, 40, size=30.0, discs=0.3)
    checker = StateChecker(world, ROBOTS[name])
    roadmap = Roadmap(checker)
    roadmap.add(free_samples(checker, 100, random_state=1))
    assert (roadmap.status == UNDECIDED).any()
    file = tmp_path / "r.geojson"
    roadmap.save(file)
    document = json.loads(file.read_text())
    assert document["type"] == "FeatureCollection"
    assert all(feature["type"] == "Feature" for feature in document["features"])
    features: dict[str, list[Any]] = {"Point": [], "LineString": []}
    for feature in document["features"]:
        features[feature["geometry"]["type"]].append(feature)

    nodes, clearances = {}, []
    oracle = Oracle(world, ROBOTS[name])
    for feature in features["Point"]:
        properties, at = feature["properties"], feature["geometry"]["coordinates"]
        assert properties["frame"] == "map"
        q = np.array([[*at, properties["metadata"]["theta"]]])
        assert np.array_equal(q[0], roadmap.configurations[properties["id"]])
        nodes[properties["id"]] = q[0]
        clearances.append(properties["metadata"]["clearance"])
    assert clearances == pytest.approx(oracle.clearance(np.array(list(nodes.values()))), abs=1e-6)
    edges = {}
    for feature in features["LineString"]:
        properties = feature["properties"]
        start, end = properties["startid"], properties["endid"]
        assert feature["geometry"]["coordinates"] == [nodes[start][:2].tolist(), nodes[end][:2].tolist()]
        edges[start, end] = properties["cost"]
    ids = [feature["properties"]["id"] for feature in document["features"]]
    assert len(set(ids)) == len(ids)
    assert all(isinstance(each, int) and 0 <= each < 2**32 for each in ids)
    assert len(edges) == len(features["LineString"]) == 2 * np.count_nonzero(roadmap.certified)
    assert {tuple(pair) for pair in roadmap.edges[roadmap.certified].tolist()} < set(edges)
    # Only nodes that an edge joins; nav2 would else send robots to dead ends.
    assert {node for pair in edges for node in pair} == set(nodes)
    for (start, end), cost in edges.items():
        assert cost == edges[end, start]
        a, b = nodes[start], nodes[end]
        turn = abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2]))) if name != "disc" else 0.0
        assert cost == pytest.approx(math.dist(a[:2], b[:2]) + 0.5 * turn, abs=1e-9)
    a, b = (np.array([nodes[pair[i]] for pair in edges]) for i in (0, 1))
    assert not oracle.collides(motion_states(a, b, 50).reshape(-1, 3)).any()

    graph = read_route_graph(file)
    assert set(graph.nodes) == set(nodes)
    assert {pair: graph.edges[pair]["cost"] for pair in graph.edges} == edges
    for node, q in nodes.items():
        assert graph.nodes[node]["position"] == (q[0], q[1])
        assert graph.nodes[node]["metadata"]["theta"] == q[2]


def test_no_certified_edge_no_file(tmp_path: Path) -> None:
    world = World("wall", (0, 0, 10, 10), (Rectangle((5, 5), 1, 10),))
    roadmap = Roadmap(StateChecker(world, Robot.disc(0.5)))
    roadmap.add(np.array([[2.0, 5.0, 0.0], [8.0, 5.0, 0.0]]))
    file = tmp_path / "r.geojson"
    with pytest.raises(OutputError, match="the roadmap has no certified edge, nav2 needs one or more"):
        roadmap.save(file)
    assert not file.exists()


# --- read ----------------------------------------------------------------------------------------------------------


def test_depots_route_graph(shared_data: Path) -> None:
    file = shared_data / "nav2" / "depot_graph.geojson"
    graph = read_route_graph(str(file))
    features = json.loads(file.read_text())["features"]
    points = [f for f in features if f["geometry"]["type"] == "Point"]
    lines = [f for f in features if f["geometry"]["type"] != "Point"]
    assert (len(graph.nodes), len(graph.edges)) == (len(points), len(lines)) == (34, 78)
    for feature in points:
        attributes = graph.nodes[feature["properties"]["id"]]
        assert list(attributes["position"]) == feature["geometry"]["coordinates"]
    for feature in lines:
        properties, (a, b) = feature["properties"], feature["geometry"]["coordinates"]
        attributes = graph.edges[properties["startid"], properties["endid"]]
        assert attributes == {"id": properties["id"], "length": pytest.approx(math.dist(a, b))}
        assert list(graph.nodes[properties["startid"]]["position"]) == a


def test_depots_routes_are_free(shared_data: Path) -> None:
    # The published routes keep a small robot out of the map's obstacles, if both are read in the same frame.
    graph = read_route_graph(shared_data / "nav2" / "depot_graph.geojson")
    world = World.load(shared_data / "nav2" / "depot.yaml")
    ends = np.array([[(*graph.nodes[node]["position"], 0.0) for node in edge] for edge in graph.edges])
    assert StateChecker(world, Robot.disc(0.15)).motions_valid(ends[:, 0], ends[:, 1]).all()


def test_all_that_nav2_takes(tmp_path: Path) -> None:
    file = written(
        tmp_path,
        line(7, 1, 2, "MultiLineString", cost=3, metadata={"speed_limit": 0.5}),
        point(1, 0.0, 0.0, frame="odom", metadata={"class": "dock"}, operations=[]),
        point(2.0, 3, 4, other="x"),
        {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": []}},
        {"type": "Feature", "properties": None, "geometry": None},
        line(8, 2, 1, overridable=False),
        point(3, 6, 8) | {"geometry": {"type": "Point", "coordinates": [6, 8, 1.5]}},
    )
    graph = read_route_graph(file)
    assert dict(graph.nodes(data=True)) == {
        1: {"position": (0.0, 0.0), "frame": "odom", "metadata": {"class": "dock"}},
        2: {"position": (3.0, 4.0)},
        3: {"position": (6.0, 8.0)},
    }
    assert {(u, v): data for u, v, data in graph.edges(data=True)} == {
        (1, 2): {"id": 7, "length": 5.0, "cost": 3.0, "metadata": {"speed_limit": 0.5}},
        (2, 1): {"id": 8, "length": 5.0},
    }


@pytest.mark.parametrize(
    ("features", "said"),
    [
        ([point(1), line(2, 1, 5)], "features[1]: endid: expected the id of a Point feature, got 5"),
        ([point(1), line(2, 5, 1)], "features[1]: startid: expected the id of a Point feature, got 5"),
        ([point(1), point(1)], "features[1]: expected each node id once, got 1 again"),
        ([point(1)], "expected Point and LineString features, one or more of each, got 1 nodes and 0 edges"),
        ([], "got 0 nodes and 0 edges"),
        ([3, None, "x"], "got 0 nodes and 0 edges"),
        ([point(-1)], "features[0]: id: expected a whole number from 0 to 4294967295, got '-1'"),
        ([point(2**32)], "features[0]: id: expected a whole number from 0 to 4294967295, got '4294967296'"),
        ([point(1.5)], "got '1.5'"),
        ([point("a\nb")], "got 'a\\nb'"),
        ([point(True)], "got 'True'"),
        ([point(None)], "got 'None'"),
        ([point(1) | {"properties": None}], "features[0]: expected an object 'properties' with an id, got none"),
        ([point(1), line(None, 1, 1)], "got 'None'"),
        ([point(1), line(2, 1, None)], "features[1]: endid: expected a whole number from 0 to 4294967295, got 'None'"),
        ([point(1, "0")], "features[0]: coordinates: expected a finite number, got '0'"),
        ([point(1, 0, 10**400)], "features[0]: coordinates: expected a finite number, got '1000"),
        ([point(1, 0, float("inf"))], "got 'inf'"),
        ([point(1, float("nan"))], "got 'nan'"),
        ([point(1) | {"geometry": {"type": "Point"}}], "features[0]: coordinates: expected [x, y], got None"),
        ([point(1), line(2, 1, 1, cost="low")], "features[1]: cost: expected a finite number, got 'low'"),
    ],
)
def test_files_that_are_no_route_graph(features: list[Any], said: str, tmp_path: Path) -> None:
    assert said in problem(written(tmp_path, *features))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "1: not valid JSON: Expecting value"),
        ('{"features": [\n1,]}', "2: not valid JSON: "),
        ("[]", "expected a GeoJSON FeatureCollection, got no list 'features'"),
        ('{"features": {}}', "got no list 'features'"),
        ("[" * 100_000, "not valid JSON: nested too deeply"),
        (f'{{"features": [{"9" * 5000}]}}', "not valid JSON: nested too deeply or a number too long"),
        ("\0", "not a text file; expected GeoJSON"),
    ],
)
def test_files_that_are_no_json(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "graph.geojson").write_text(text)
    assert said in problem(tmp_path / "graph.geojson")
    assert problem(tmp_path / "none.geojson").startswith("cannot be read: No such file")
