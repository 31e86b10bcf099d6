"""Roadmap files: what comes back, what is believed of it, what nav2 gets, and that no file does any harm."""

from __future__ import annotations

import io
import json
import math
import pickle
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.oracles import Oracle, motion_states
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import Disc, OneWayZone, Polygon, Rectangle, Robot, StateChecker, World
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.errors import FormatError, OutputError, TrailmarkError
from trailmark.landmarks import free_samples
from trailmark.roadmap import Roadmap, load_roadmap, read_route_graph

Change = Callable[[dict[str, Any]], dict[str, Any]]

SUFFIXES = (".npz", ".graphml")
CAR = Robot.rectangle(1.6, 0.8).steered(1.5)
MOVERS = {**ROBOTS, "car": CAR, "forward car": CAR.steered(1.5, reverse=False)}
WORLD = random_world(7, 30, size=30.0, discs=0.3, holes=0.3)
CHECKERS = {name: StateChecker(WORLD, robot, cell=0.3) for name, robot in MOVERS.items()}
OPEN = StateChecker(World("open", (0, 0, 10, 10)), Robot.rectangle(1, 0.5))


def made(checker: StateChecker, n: int = 80) -> Roadmap:
    roadmap = Roadmap(checker)
    roadmap.add(free_samples(checker, n, random_state=3))
    roadmap.shortest_path(0, n // 2)
    return roadmap


@pytest.fixture(scope="module")
def roadmap() -> Roadmap:
    return made(CHECKERS["L"])


def known(roadmap: Roadmap) -> dict[tuple[int, int], int]:
    """Status of every edge by its nodes, the blocked ones left out, as no graph holds them."""
    pairs = roadmap.edges if roadmap.directed else np.sort(roadmap.edges, axis=1)
    rows = zip(pairs.tolist(), roadmap.status.tolist(), strict=True)
    return {(u, v): status for (u, v), status in rows if status != BLOCKED}


def arrays(roadmap: Roadmap, tmp_path: Path) -> dict[str, Any]:
    """The content of the roadmap's .npz file."""
    roadmap.save(tmp_path / "content.npz")
    with np.load(tmp_path / "content.npz") as file:
        return dict(file)


def problem(path: Path, read: StateChecker | Callable[[Path], object]) -> str:
    """What reading complains of: one line that begins with the file's name."""
    with pytest.raises(FormatError) as caught:
        load_roadmap(path, read) if isinstance(read, StateChecker) else read(path)
    text = str(caught.value)
    assert text.startswith(f"{path}:")
    assert len(text) < len(str(path)) + 400
    return text.removeprefix(f"{path}:").lstrip()


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("name", MOVERS)
def test_round_trip(name: str, suffix: str, tmp_path: Path) -> None:
    roadmap, file = made(CHECKERS[name]), tmp_path / f"roadmap{suffix}"
    roadmap.save(file)
    # A checker of its own, made of equal parts, as in another process.
    again = Roadmap.load(file, StateChecker(WORLD, MOVERS[name], cell=0.2))
    assert np.array_equal(again.configurations, roadmap.configurations)
    assert known(again) == known(roadmap)
    assert set(known(again).values()) == {FREE, UNDECIDED}
    if suffix == ".npz":
        assert all(np.array_equal(again.rows()[i], roadmap.rows()[i]) for i in range(4))
    else:
        read, graph = nx.read_graphml(file, node_type=int), roadmap.graph
        assert type(read) is type(graph)
        for _, attributes in graph.nodes(data=True):
            attributes["x"], attributes["y"], attributes["theta"] = attributes.pop("configuration")
        assert dict(read.nodes(data=True)) == dict(graph.nodes(data=True))
        assert all(read.edges[u, v] == data for u, v, data in graph.edges(data=True))
    for goal in (20, 50):
        found = [each.shortest_path(0, goal).nodes for each in (roadmap, again)]
        assert np.array_equal(found[0], found[1])
    again.add(free_samples(again.checker, 5, random_state=1))
    assert len(again) == len(roadmap) + 5


def variants() -> dict[str, tuple[World, Robot]]:
    """Worlds and robots that differ a little from the first one."""
    square = np.array([[4.0, 4.0], [6.0, 4.0], [6.0, 6.0], [4.0, 6.0]])
    shapes = (Polygon(square), Disc((2.0, 7.0), 0.5))
    robot, steered = Robot.rectangle(0.5, 0.3), Robot.rectangle(0.5, 0.3).steered
    first = World("w", (0.0, 0.0, 10.0, 10.0), shapes)
    corners = np.array([[-1.0, -1.0], [11.0, -1.0], [11.0, 11.0], [-1.0, 11.0]])
    zone = OneWayZone(Polygon(square - 3.0), 0.0, 1.0)
    changes: list[dict[str, Any]] = [{}, {"heading": 3.0}, {"tolerance": 0.5}, {"region": Polygon(square - 2.9)}]
    return {
        "itself": (first, robot),
        "bounds": (replace(first, bounds=(0.0, 0.0, 10.0, 10.5)), robot),
        "polygon": (replace(first, obstacles=(Polygon(square + 1e-9), shapes[1])), robot),
        "disc": (replace(first, obstacles=(shapes[0], Disc((2.0, 7.0), 0.5 + 1e-9))), robot),
        "one less": (replace(first, obstacles=shapes[:1]), robot),
        "boundary": (replace(first, boundary=Polygon(corners)), robot),
        "robot": (first, Robot.rectangle(0.5, 0.3 + 1e-9)),
        "round robot": (first, Robot.disc(0.2)),
        "rounder robot": (first, Robot.disc(0.21)),
        "differential": (first, robot.differential()),
        "car": (first, steered(0.5)),
        "wider car": (first, steered(0.6)),
        "forward car": (first, steered(0.5, reverse=False)),
        **{f"one-way zone {i}": (replace(first, zones=(replace(zone, **c),)), robot) for i, c in enumerate(changes)},
    }


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("origin", ["itself", "one-way zone 0", "forward car"])
def test_certificates_of_another_world_or_robot_are_not_believed(origin: str, suffix: str, tmp_path: Path) -> None:
    checker, file = StateChecker(*variants()[origin]), tmp_path / f"r{suffix}"
    roadmap = made(checker, 40)
    roadmap.certify_all()
    roadmap.save(file)
    free = {pair for pair, status in known(load_roadmap(file, checker)).items() if status == FREE}
    assert free == {pair for pair, status in known(roadmap).items() if status == FREE} != set()
    for world, robot in (variants()[name] for name in variants() if name != origin):
        again = load_roadmap(file, StateChecker(world, robot), drop_invalid=True)
        assert len(again.edges) > 0
        assert set(again.status.tolist()) <= {UNDECIDED, BLOCKED}
        # Checked anew, they are right for the new world; an edge without direction is there once.
        again.certify_all()
        assert len(known(again)) == np.count_nonzero(again.certified)
        q = again.configurations
        ends = q[again.edges[:, 0]], q[again.edges[:, 1]]
        right = again.motion.motions_valid(*ends)
        assert np.array_equal(again.certified, right if again.directed else right & again.motion.reversible(*ends))


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_invalid_nodes_are_refused_or_left_out_if_asked(roadmap: Roadmap, suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"r{suffix}"
    roadmap.save(file)
    block = Rectangle((15.0, 15.0), 12.0, 12.0)
    changed = StateChecker(World("changed", WORLD.bounds, (*WORLD.obstacles, block)), ROBOTS["L"], cell=0.3)
    valid = np.array([changed.valid(q) for q in roadmap.configurations])
    assert 0 < np.count_nonzero(~valid) < len(valid)
    first = ", ".join(f"{v:g}" for v in roadmap.configurations[~valid][0])
    assert problem(file, changed) == (
        "expected nodes that are valid for this robot in this world (drop_invalid leaves the others out), "
        f"got {np.count_nonzero(~valid)} of 80 that are not, the first at ({first})"
    )
    again = load_roadmap(file, changed, drop_invalid=True)
    assert np.array_equal(again.configurations, roadmap.configurations[valid])
    kept = np.flatnonzero(valid)
    expected = {pair for pair in known(roadmap) if valid[list(pair)].all()}
    assert {(int(kept[u]), int(kept[v])) for u, v in known(again)} >= expected
    assert set(again.status.tolist()) == {UNDECIDED}


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".geojson"])
def test_a_file_is_written_whole_or_not_at_all(
    roadmap: Roadmap, suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(OutputError, match=r"the directory .* does not exist"):
        roadmap.save(tmp_path / "none" / f"r{suffix}")
    file = tmp_path / f"r{suffix}"
    file.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OutputError, match="No space left on device"):
        roadmap.save(file)
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def without(name: str) -> Change:
    return lambda content: {key: value for key, value in content.items() if key != name}


def put(name: str, value: Any) -> Change:
    return lambda content: content | {name: np.asarray(value)}


def change(name: str, where: Any, value: Any) -> Change:
    def changed(content: dict[str, Any]) -> dict[str, Any]:
        array = content[name].copy()
        array[where] = array[value] if isinstance(value, slice) else value
        return content | {name: array}

    return changed


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (
            without("edges"),
            "expected arrays configurations, edges, status, fingerprint, checksum, got none named 'edges'",
        ),
        (put("configurations", np.zeros((80, 2))), "configurations: expected shape (n, 3), got (80, 2)"),
        (put("edges", np.zeros((5, 2))), "array 'edges': expected whole numbers, got float64"),
        (put("checksum", 7), "array 'checksum': expected text, got int64"),
        (change("configurations", (5, 1), np.nan), "configurations[5]: expected finite numbers, got ["),
        (change("edges", (2, 1), 80), "edges[2]: expected nodes 0 to 79, got ["),
        (change("edges", 2, [4, 4]), "edges[2]: expected two different nodes, got [4, 4]"),
        (change("edges", slice(6, 7), slice(2, 3)), "edges[6]: expected each pair once, got ["),
        (change("status", 9, 3), "status[9]: expected 0, 1, 2, got 3"),
    ],
)
def test_npz_that_is_no_roadmap(roadmap: Roadmap, damage: Change, said: str, tmp_path: Path) -> None:
    file = tmp_path / "r.npz"
    np.savez(file, **damage(arrays(roadmap, tmp_path)))
    assert said in problem(file, roadmap.checker)


class Trap:
    """Unpickling it writes a file."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.file,)


def test_nothing_is_unpickled(roadmap: Roadmap, tmp_path: Path) -> None:
    sprung, file, content = tmp_path / "sprung", tmp_path / "r.npz", arrays(roadmap, tmp_path)
    for name in content:
        np.savez(file, **(content | {name: np.array([Trap(sprung)], dtype=object)}))
        assert problem(file, roadmap.checker).startswith("not a readable .npz file: Object arrays cannot be loaded")
    file.write_bytes(pickle.dumps(Trap(sprung)))
    problem(file, roadmap.checker)
    assert not sprung.exists()


@pytest.mark.slow
def test_files_that_unpack_to_too_much(tmp_path: Path) -> None:
    file = tmp_path / "r.npz"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("configurations.npy", bytes(2**27 + 1))
    assert file.stat().st_size < 2**18
    assert problem(file, OPEN) == "expected at most 134,217,728 bytes unpacked, got 134,217,729"
    # A header that promises more than there is.
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**15, 3)})
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("configurations.npy", header.getvalue())
    assert problem(file, OPEN).startswith("not a readable .npz file: ")
    # Entities that multiply.
    lines = ['<!ENTITY e0 "aaaaaaaaaa">', *(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))]
    text = f"<!DOCTYPE graphml [{''.join(lines)}]>\n<graphml><graph><desc>&e9;</desc></graph></graphml>"
    (tmp_path / "r.graphml").write_text(text)
    assert problem(tmp_path / "r.graphml", OPEN).startswith("not a readable GraphML file: ")


GRAPH = """<graphml xmlns="http://graphml.graphdrawing.org/xmlns">
<key id="x" for="node" attr.name="x" attr.type="double"/><key id="y" for="node" attr.name="y" attr.type="double"/>
<key id="t" for="node" attr.name="theta" attr.type="{kind}"/>
<key id="c" for="edge" attr.name="certified" attr.type="boolean"/>
<graph edgedefault="undirected">
<node id="0"><data key="x">5</data><data key="y">5</data><data key="t">{theta}</data></node>
<node id="{second}"><data key="x">6</data><data key="y">5</data><data key="t">0</data></node>
{edges}
</graph></graphml>"""
EDGE = '<edge source="0" target="1"><data key="c">true</data></edge>'


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"theta": "nan"}, "node 0: theta: expected a finite number, got nan"),
        ({"theta": "east"}, "not a readable GraphML file: could not convert string to float: 'east'"),
        ({"kind": "long", "theta": "9" * 400}, "node 0: theta: expected a finite number, got 999"),
        ({"edges": '<edge source="0" target="1"/>'}, "edge 0-1: certified: expected true or false, got 'None'"),
        ({"edges": EDGE + EDGE}, "edges[1]: expected each pair once, got [0, 1]"),
        ({"edges": "<edge"}, "not a readable GraphML file: not well-formed"),
    ],
)
def test_graphml_that_is_no_roadmap(parts: dict[str, str], said: str, tmp_path: Path) -> None:
    file, sound = tmp_path / "r.graphml", {"kind": "double", "theta": "0", "second": "1", "edges": EDGE}
    file.write_text(GRAPH.format(**sound))
    assert len(load_roadmap(file, OPEN)) == 2
    file.write_text(GRAPH.format(**(sound | parts)))
    assert problem(file, OPEN).startswith(said)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder, roadmap = tmp_path_factory.mktemp("damaged"), made(CHECKERS["disc"])
    files = {suffix: folder / f"whole{suffix}" for suffix in SUFFIXES}
    for file in files.values():
        roadmap.save(file)
    return files


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=few(100, of=4))
@given(data=st.data())
def test_damaged_files_are_refused_in_one_line(whole: dict[str, Path], suffix: str, data: st.DataObject) -> None:
    content = whole[suffix].read_bytes()
    at = data.draw(st.integers(0, len(content) - 1))
    damaged = content[:at]
    if data.draw(st.booleans()):
        damaged += data.draw(st.binary(min_size=1, max_size=4)) + content[at + 1 :]
    file, checker = whole[suffix].with_stem("damaged"), CHECKERS["disc"]
    file.write_bytes(damaged)
    try:
        roadmap = load_roadmap(file, checker)
    except TrailmarkError:
        problem(file, checker)
        return
    # What is still readable holds no certificate that the checker would not give.
    q, edges = roadmap.configurations, roadmap.edges[roadmap.certified]
    assert checker.motions_valid(q[edges[:, 0]], q[edges[:, 1]]).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "L"])
def test_nav2_gets_certified_edges_both_ways(name: str, tmp_path: Path) -> None:
    roadmap, file = made(CHECKERS[name], 100), tmp_path / "r.geojson"
    assert (roadmap.status == UNDECIDED).any()
    roadmap.save(file)
    document = json.loads(file.read_text())
    assert document["type"] == "FeatureCollection"
    assert all(feature["type"] == "Feature" for feature in document["features"])
    ids = [feature["properties"]["id"] for feature in document["features"]]
    assert len(set(ids)) == len(ids)
    assert all(isinstance(each, int) and 0 <= each < 2**32 for each in ids)
    nodes, clearances, edges = {}, [], {}
    for feature in document["features"]:
        properties, geometry = feature["properties"], feature["geometry"]
        if geometry["type"] == "Point":
            assert properties["frame"] == "map"
            nodes[properties["id"]] = np.array([*geometry["coordinates"], properties["metadata"]["theta"]])
            clearances.append(properties["metadata"]["clearance"])
        else:
            start, end = properties["startid"], properties["endid"]
            assert geometry == {"type": "LineString", "coordinates": [nodes[i][:2].tolist() for i in (start, end)]}
            edges[start, end] = properties["cost"]
    assert all(np.array_equal(q, roadmap.configurations[node]) for node, q in nodes.items())
    oracle = Oracle(WORLD, ROBOTS[name])
    assert clearances == pytest.approx(oracle.clearance(np.array(list(nodes.values()))), abs=1e-6)
    assert len(edges) == len(ids) - len(nodes) == 2 * np.count_nonzero(roadmap.certified)
    assert {tuple(pair) for pair in roadmap.edges[roadmap.certified].tolist()} < set(edges)
    # Only nodes that an edge joins; nav2 would else send robots to dead ends.
    assert {node for pair in edges for node in pair} == set(nodes)
    for (start, end), cost in edges.items():
        a, b = nodes[start], nodes[end]
        turn = abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2]))) if name != "disc" else 0.0
        assert cost == edges[end, start] == pytest.approx(math.dist(a[:2], b[:2]) + 0.5 * turn, abs=1e-9)
    a, b = (np.array([nodes[pair[i]] for pair in edges]) for i in (0, 1))
    assert not oracle.collides(motion_states(a, b, 50).reshape(-1, 3)).any()
    graph = read_route_graph(file)
    assert {pair: graph.edges[pair]["cost"] for pair in graph.edges} == edges
    assert all(graph.nodes[node]["position"] == (q[0], q[1]) for node, q in nodes.items())
    assert all(graph.nodes[node]["metadata"]["theta"] == q[2] for node, q in nodes.items())


def point(node: Any, x: Any = 0.0, y: Any = 0.0, **properties: Any) -> dict[str, Any]:
    geometry = {"type": "Point", "coordinates": [x, y]}
    return {"type": "Feature", "properties": {"id": node, **properties}, "geometry": geometry}


def line(edge: Any, start: Any, end: Any, kind: str = "LineString", **properties: Any) -> dict[str, Any]:
    ids = {"id": edge, "startid": start, "endid": end}
    return {"type": "Feature", "properties": ids | properties, "geometry": {"type": kind, "coordinates": []}}


def written(folder: Path, *features: Any) -> Path:
    file = folder / "graph.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return file


@pytest.mark.parametrize(
    ("features", "said"),
    [
        ([point(1), line(2, 1, 5)], "features[1]: endid: expected the id of a Point feature, got 5"),
        ([point(1), point(1)], "features[1]: expected each node id once, got 1 again"),
        ([point(1)], "expected Point and LineString features, one or more of each, got 1 nodes and 0 edges"),
        ([point(2**32)], "features[0]: id: expected a whole number, 0 to 4294967295, got 4294967296"),
        ([point(1) | {"properties": None}], "features[0]: expected an object 'properties' with an id, got none"),
        ([point(1, "0")], "features[0]: coordinates: expected a finite number, got '0'"),
        ([point(1, 0, 10**400)], "features[0]: coordinates: expected a finite number, got 1000"),
        ([point(1), line(2, 1, 1, cost="low")], "features[1]: cost: expected a finite number, got 'low'"),
    ],
)
def test_files_that_are_no_route_graph(features: list[Any], said: str, tmp_path: Path) -> None:
    assert said in problem(written(tmp_path, *features), read_route_graph)
