"""Roadmap files: what comes back, what is believed of it, and that no file does any harm."""

from __future__ import annotations

import io
import pickle
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.trials import few

from trailmark.collision import StateChecker
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.errors import FormatError, OutputError, TrailmarkError
from trailmark.landmarks import free_samples
from trailmark.roadmap import Roadmap, load_roadmap
from trailmark.roadmap.files import fingerprint
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import Robot, World
from trailmark.zones import OneWayZone

Change = Callable[[dict[str, Any]], dict[str, Any]]

SUFFIXES = (".npz", ".graphml")
CHECKERS = {
    name: StateChecker(random_world(7, 30, size=30.0, discs=0.3, holes=0.3), robot, cell=0.3)
    for name, robot in ROBOTS.items()
}


@pytest.fixture(scope="module")
def roadmaps() -> dict[str, Roadmap]:
    found = {}
    for name, checker in CHECKERS.items():
        found[name] = roadmap = Roadmap(checker)
        roadmap.add(free_samples(checker, 80, random_state=3))
        roadmap.shortest_path(0, 50)
    return found


@pytest.fixture(scope="module")
def roadmap(roadmaps: dict[str, Roadmap]) -> Roadmap:
    return roadmaps["L"]


def known(roadmap: Roadmap) -> dict[tuple[int, int], int]:
    """Status of every edge by its nodes, the blocked ones left out, as no graph holds them."""
    rows = zip(np.sort(roadmap.edges, axis=1).tolist(), roadmap.status.tolist(), strict=True)
    return {(u, v): status for (u, v), status in rows if status != BLOCKED}


def arrays(roadmap: Roadmap, tmp_path: Path) -> dict[str, Any]:
    """The content of the roadmap's .npz file."""
    roadmap.save(tmp_path / "content.npz")
    with np.load(tmp_path / "content.npz") as file:
        return dict(file)


def problem(path: Path, checker: StateChecker) -> str:
    """What loading complains of: one line that begins with the file's name."""
    with pytest.raises(FormatError) as caught:
        load_roadmap(path, checker)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(f"{path}: ")
    assert len(text) < len(str(path)) + 400
    return text.removeprefix(f"{path}: ")


# --- there and back ------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("name", ROBOTS)
def test_round_trip(roadmaps: dict[str, Roadmap], name: str, suffix: str, tmp_path: Path) -> None:
    roadmap = roadmaps[name]
    file = tmp_path / f"roadmap{suffix}"
    roadmap.save(file)
    # A checker of its own, made of equal parts, as in another process.
    again = Roadmap.load(file, StateChecker(CHECKERS[name].world, ROBOTS[name], cell=0.2))
    assert np.array_equal(again.configurations, roadmap.configurations)
    assert known(again) == known(roadmap)
    assert set(known(again).values()) == {FREE, UNDECIDED}
    if suffix == ".npz":
        assert np.array_equal(again.edges, roadmap.edges)
        assert np.array_equal(again.status, roadmap.status)
        assert np.array_equal(again.lengths, roadmap.lengths)
    for goal in (20, 50):
        found = [each.shortest_path(0, goal).nodes for each in (roadmap, again)]
        assert np.array_equal(found[0], found[1])
    again.add(free_samples(again.checker, 5, random_state=1))
    assert len(again) == len(roadmap) + 5


@pytest.mark.slow
def test_graphml_is_what_networkx_reads(roadmap: Roadmap, tmp_path: Path) -> None:
    roadmap.save(tmp_path / "r.graphml")
    graph = nx.read_graphml(tmp_path / "r.graphml", node_type=int)
    expected = roadmap.graph
    assert type(graph) is nx.Graph
    assert list(graph.nodes) == list(expected.nodes)
    for node, attributes in graph.nodes(data=True):
        assert set(attributes) == {"x", "y", "theta", "clearance"}
        assert (attributes["x"], attributes["y"], attributes["theta"]) == expected.nodes[node]["configuration"]
        assert attributes["clearance"] == expected.nodes[node]["clearance"]
    assert {frozenset(edge) for edge in graph.edges} == {frozenset(edge) for edge in expected.edges}
    for u, v, attributes in graph.edges(data=True):
        assert attributes == expected.edges[u, v]


# --- what is believed ----------------------------------------------------------------------------------------------


def variants() -> dict[str, tuple[World, Robot]]:
    """Worlds and robots that differ a little from the first one."""
    square = np.array([[4.0, 4.0], [6.0, 4.0], [6.0, 6.0], [4.0, 6.0]])
    shapes = (Polygon(square), Disc((2.0, 7.0), 0.5))
    robot = Robot.rectangle(0.5, 0.3)
    bounds = (0.0, 0.0, 10.0, 10.0)
    corners = np.array([[-1.0, -1.0], [11.0, -1.0], [11.0, 11.0], [-1.0, 11.0]])
    return {
        "itself": (World("w", bounds, shapes), robot),
        "bounds": (World("w", (0.0, 0.0, 10.0, 10.5), shapes), robot),
        "polygon": (World("w", bounds, (Polygon(square + 1e-9), shapes[1])), robot),
        "disc": (World("w", bounds, (shapes[0], Disc((2.0, 7.0), 0.5 + 1e-9))), robot),
        "one less": (World("w", bounds, shapes[:1]), robot),
        "boundary": (World("w", bounds, shapes, boundary=Polygon(corners)), robot),
        "robot": (World("w", bounds, shapes), Robot.rectangle(0.5, 0.3 + 1e-9)),
        "round robot": (World("w", bounds, shapes), Robot.disc(0.2)),
        "rounder robot": (World("w", bounds, shapes), Robot.disc(0.21)),
        "one-way zone": (World("w", bounds, shapes, zones=(OneWayZone(Polygon(square - 3.0), 0.0, 1.0),)), robot),
        "another heading": (World("w", bounds, shapes, zones=(OneWayZone(Polygon(square - 3.0), 3.0, 1.0),)), robot),
        "another tolerance": (World("w", bounds, shapes, zones=(OneWayZone(Polygon(square - 3.0), 0.0, 0.5),)), robot),
        "another place": (World("w", bounds, shapes, zones=(OneWayZone(Polygon(square - 2.9), 0.0, 1.0),)), robot),
    }


def test_the_fingerprint_tells_worlds_and_robots_apart() -> None:
    prints = {name: fingerprint(StateChecker(world, robot)) for name, (world, robot) in variants().items()}
    assert len(set(prints.values())) == len(prints)
    world, robot = variants()["itself"]
    # What decides no collision does not count: name, queries, the grid's cells.
    other = World("another", world.bounds, world.obstacles, robot)
    assert fingerprint(StateChecker(other, cell=0.5)) == prints["itself"]
    as_polygon = Robot.polygon(robot.outline.vertices)
    assert fingerprint(StateChecker(world, as_polygon)) == prints["itself"]


@pytest.mark.parametrize(
    ("name", "suffix"),
    [("bounds", ".graphml"), ("robot", ".graphml"), *((name, ".npz") for name in variants() if name != "itself")],
)
def test_certificates_of_another_world_are_not_believed(name: str, suffix: str, tmp_path: Path) -> None:
    checker = StateChecker(*variants()["itself"])
    roadmap = Roadmap(checker)
    roadmap.add(free_samples(checker, 40, random_state=1))
    roadmap.certify_all()
    roadmap.save(tmp_path / f"r{suffix}")
    other = StateChecker(*variants()[name])
    again = load_roadmap(tmp_path / f"r{suffix}", other, drop_invalid=True)
    assert len(again.edges) > 0
    assert set(again.status.tolist()) <= {UNDECIDED, BLOCKED}
    if suffix == ".graphml":
        assert set(again.status.tolist()) == {UNDECIDED}
    # Checked anew, they are right for the new world.
    again.certify_all()
    q = again.configurations
    expected = again.motion.motions_valid(q[again.edges[:, 0]], q[again.edges[:, 1]])
    assert np.array_equal(again.certified, expected)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_invalid_nodes_are_refused_or_left_out_if_asked(roadmap: Roadmap, suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"r{suffix}"
    roadmap.save(file)
    world = CHECKERS["L"].world
    block = Rectangle((15.0, 15.0), 12.0, 12.0)
    changed = StateChecker(World("changed", world.bounds, (*world.obstacles, block)), ROBOTS["L"], cell=0.3)
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


@pytest.mark.slow
def test_an_edited_file_is_checked_anew(roadmap: Roadmap, tmp_path: Path) -> None:
    content = arrays(roadmap, tmp_path)
    edited = {key: value.copy() for key, value in content.items()}
    edited["configurations"][3, 2] += 1e-6
    believed = {key: value.copy() for key, value in content.items()}
    believed["status"][:] = FREE
    for changed in (edited, believed, content | {"checksum": np.array("")}, content | {"fingerprint": np.array("x")}):
        np.savez(tmp_path / "r.npz", **changed)
        assert set(load_roadmap(tmp_path / "r.npz", roadmap.checker).status.tolist()) == {UNDECIDED}
    np.savez(tmp_path / "r.npz", **content)
    assert np.array_equal(load_roadmap(tmp_path / "r.npz", roadmap.checker).status, roadmap.status)

    roadmap.save(tmp_path / "r.graphml")
    text = (tmp_path / "r.graphml").read_text()
    assert ">False<" in text
    (tmp_path / "r.graphml").write_text(text.replace(">False<", ">True<", 1))
    assert set(load_roadmap(tmp_path / "r.graphml", roadmap.checker).status.tolist()) == {UNDECIDED}


def test_a_graph_drawn_by_hand_is_taken(tmp_path: Path) -> None:
    graph = nx.Graph()
    graph.add_node(7, x=1, y=2.0, theta=4.0, label="dock")
    graph.add_node(3, x=3.0, y=4.0, theta=0.5)
    graph.add_edge(7, 3, certified=True, colour="red")
    nx.write_graphml(graph, tmp_path / "r.graphml")
    checker = StateChecker(World("open", (0, 0, 10, 10)), Robot.rectangle(1, 0.5))
    roadmap = load_roadmap(tmp_path / "r.graphml", checker)
    # Numbered in the order of their ids; headings brought into (-pi, pi].
    assert roadmap.configurations == pytest.approx(np.array([[3.0, 4.0, 0.5], [1.0, 2.0, 4.0 - 2 * np.pi]]))
    assert roadmap.status.tolist() == [UNDECIDED]
    assert roadmap.shortest_path(0, 1).nodes.tolist() == [0, 1]


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    "robot", [Robot.disc(0.2), Robot.rectangle(0.5, 0.3), Robot.rectangle(0.5, 0.3).differential()]
)
def test_a_world_with_a_one_way_zone_keeps_its_edges(robot: Robot, suffix: str, tmp_path: Path) -> None:
    zone = shapely.box(4.0, 0.0, 6.0, 10.0)
    world = World(
        "w", (0, 0, 10, 10), (Disc((5, 5), 1),), zones=(OneWayZone(Polygon(zone.exterior.coords[:-1]), 0.0, 0.8),)
    )
    checker = StateChecker(world, robot)
    roadmap = Roadmap(checker)
    roadmap.add(free_samples(checker, 40, random_state=1))
    roadmap.certify_all()
    roadmap.save(tmp_path / f"r{suffix}")
    again = load_roadmap(tmp_path / f"r{suffix}", checker)
    free = {tuple(edge) for edge in roadmap.edges[roadmap.certified].tolist()}
    assert {tuple(edge) for edge in again.edges[again.certified].tolist()} == free
    crossing = [edge for edge in free if shapely.LineString(again.configurations[list(edge), :2]).crosses(zone)]
    assert len(crossing) > 10
    for u, v in crossing:
        assert again.configurations[u, 0] < again.configurations[v, 0]
    # Without the zone, in a world that these certificates were not made for, they are not believed.
    assert not load_roadmap(tmp_path / f"r{suffix}", StateChecker(replace(world, zones=()), robot)).certified.any()


def test_half_a_turn_is_left_out(tmp_path: Path) -> None:
    checker = StateChecker(World("open", (0, 0, 10, 10)), Robot.rectangle(1, 0.5))
    q = np.array([[3.0, 4.0, 0.0], [4.0, 4.0, np.pi], [5.0, 4.0, 3.0]])
    both = np.array([[0, 1], [1, 2]], dtype=np.int32)
    Roadmap.from_arrays(checker, q, both, np.array([FREE, FREE], np.uint8)).save(tmp_path / "r.npz")
    assert load_roadmap(tmp_path / "r.npz", checker).status.tolist() == [BLOCKED, FREE]


# --- what is refused -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["r.txt", "r", "r.npz.gz", "r.geojson"])
def test_suffixes(roadmap: Roadmap, name: str, tmp_path: Path) -> None:
    file = tmp_path / name
    if name != "r.geojson":
        with pytest.raises(OutputError, match=r"expected \.geojson, \.graphml, \.npz, got '"):
            roadmap.save(file)
        assert not file.exists()
    said = problem(file, roadmap.checker)
    assert said.startswith(f"expected suffix .graphml or .npz, got {file.suffix!r}")
    assert ("read_route_graph" in said) == (name == "r.geojson")


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".geojson"])
def test_paths_that_cannot_be_written(roadmap: Roadmap, suffix: str, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"the directory .* does not exist"):
        roadmap.save(tmp_path / "none" / f"r{suffix}")
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(OutputError, match="is a directory"):
        roadmap.save(tmp_path / f"folder{suffix}")


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".geojson"])
def test_a_file_is_written_whole_or_not_at_all(
    roadmap: Roadmap, suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / f"r{suffix}"
    file.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OutputError, match="No space left on device"):
        roadmap.save(file)
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_and_foreign_files(roadmap: Roadmap, suffix: str, tmp_path: Path) -> None:
    assert problem(tmp_path / f"none{suffix}", roadmap.checker).startswith("cannot be read: No such file")
    (tmp_path / f"folder{suffix}").mkdir()
    assert problem(tmp_path / f"folder{suffix}", roadmap.checker).startswith("cannot be read: Is a directory")
    file = tmp_path / f"r{suffix}"
    for content in (b"", b"hello", b"PK\x03\x04", b"\x93NUMPY", b"<graphml/>", b"<graphml><graph/>", b"\xff" * 99):
        file.write_bytes(content)
        assert problem(file, roadmap.checker).startswith(f"not a readable {'.npz' if suffix == '.npz' else 'GraphML'}")


def without(name: str) -> Change:
    return lambda content: {key: value for key, value in content.items() if key != name}


def put(name: str, value: Any) -> Change:
    return lambda content: content | {name: np.asarray(value)}


def change(name: str, where: Any, value: Any) -> Change:
    def changed(content: dict[str, Any]) -> dict[str, Any]:
        array = content[name].copy()
        array[where] = value
        return content | {name: array}

    return changed


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (
            without("edges"),
            "expected arrays configurations, edges, status, fingerprint, checksum, got none named 'edges'",
        ),
        (without("configurations"), "got none named 'configurations'"),
        (without("status"), "got none named 'status'"),
        (without("fingerprint"), "got none named 'fingerprint'"),
        (put("configurations", np.zeros((80, 2))), "configurations: expected shape (n, 3), got (80, 2)"),
        (put("configurations", np.zeros(3)), "got (3,)"),
        (put("configurations", [["a"]]), "array 'configurations': expected numbers, got <U1"),
        (put("configurations", np.zeros((4, 3), complex)), "got complex128"),
        (put("edges", np.zeros((5, 2))), "array 'edges': expected whole numbers, got float64"),
        (put("edges", np.zeros((5, 3), int)), "edges: expected shape (m, 2), got (5, 3)"),
        (put("status", np.zeros(5, int)), ", one for each edge, got (5,)"),
        (put("status", 1), "got ()"),
        (put("checksum", 7), "array 'checksum': expected text, got int64"),
        (change("configurations", (5, 1), np.nan), "configurations[5]: expected finite numbers, got ["),
        (change("configurations", (5, 1), -np.inf), "configurations[5]: expected finite numbers, got ["),
        (change("configurations", (5, 1), 1e300), "got 1 of 80 that are not"),
        (change("edges", (2, 1), 80), "edges[2]: expected nodes 0 to 79, got ["),
        (change("edges", (2, 0), -1), "edges[2]: expected nodes 0 to 79, got [-1, "),
        (change("edges", 2, [4, 4]), "edges[2]: expected two different nodes, got [4, 4]"),
        (change("status", 9, 3), "status[9]: expected 0, 1, 2, got 3"),
    ],
)
def test_npz_that_is_no_roadmap(roadmap: Roadmap, damage: Change, said: str, tmp_path: Path) -> None:
    file = tmp_path / "r.npz"
    np.savez(file, **damage(arrays(roadmap, tmp_path)))
    assert said in problem(file, roadmap.checker)


def test_an_edge_given_twice(roadmap: Roadmap, tmp_path: Path) -> None:
    content = arrays(roadmap, tmp_path)
    edges = content["edges"].copy()
    edges[6] = edges[2][::-1]
    np.savez(tmp_path / "r.npz", **(content | {"edges": edges}))
    assert problem(tmp_path / "r.npz", roadmap.checker).startswith(
        f"edges[6]: expected each pair once, got {edges[6].tolist()}"
    )


class Trap:
    """Unpickling it writes a file."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.file,)


def test_nothing_is_unpickled(roadmap: Roadmap, tmp_path: Path) -> None:
    sprung, file = tmp_path / "sprung", tmp_path / "r.npz"
    content = arrays(roadmap, tmp_path)
    for name in content:
        np.savez(file, **(content | {name: np.array([Trap(sprung)], dtype=object)}))
        assert problem(file, roadmap.checker).startswith("not a readable .npz file: Object arrays cannot be loaded")
    file.write_bytes(pickle.dumps(Trap(sprung)))
    problem(file, roadmap.checker)
    assert not sprung.exists()


@pytest.mark.slow
def test_archives_that_unpack_to_too_much(roadmap: Roadmap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "r.npz"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("configurations.npy", bytes(2**27 + 1))
    assert file.stat().st_size < 2**18
    assert problem(file, roadmap.checker) == "expected at most 134,217,728 bytes unpacked, got 134,217,729"
    # A header that promises more than there is.
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**15, 3)})
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("configurations.npy", header.getvalue())
    assert problem(file, roadmap.checker).startswith("not a readable .npz file: ")


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
        ({"theta": "nan"}, "configurations[0]: expected finite numbers, got [5.0, 5.0, nan]"),
        ({"theta": "inf"}, "configurations[0]: expected finite numbers, got [5.0, 5.0, inf]"),
        ({"theta": "east"}, "not a readable GraphML file: could not convert string to float: 'east'"),
        ({"kind": "string", "theta": "1"}, "node 0: theta: expected a finite number, got '1'"),
        ({"kind": "boolean", "theta": "true"}, "node 0: theta: expected a finite number, got 'True'"),
        ({"kind": "long", "theta": "9" * 400}, f"node 0: theta: expected a finite number, got '{'9' * 60}'"),
        ({"second": "one"}, "not a readable GraphML file: invalid literal for int()"),
        ({"edges": '<edge source="0" target="1"/>'}, "edge 0-1: certified: expected true or false, got 'None'"),
        ({"edges": '<edge source="0" target="2"/>'}, "node 2: x: expected a finite number, got 'None'"),
        ({"edges": EDGE + EDGE}, "edges[1]: expected each pair once, got [0, 1]"),
        ({"edges": EDGE.replace('"1"', '"0"')}, "edges[0]: expected two different nodes, got [0, 0]"),
        ({"edges": "<edge"}, "not a readable GraphML file: not well-formed"),
    ],
)
def test_graphml_that_is_no_roadmap(parts: dict[str, str], said: str, tmp_path: Path) -> None:
    checker = StateChecker(World("open", (0, 0, 10, 10)), Robot.rectangle(1, 0.5))
    file = tmp_path / "r.graphml"
    sound = {"kind": "double", "theta": "0", "second": "1", "edges": EDGE}
    file.write_text(GRAPH.format(**sound))
    assert len(load_roadmap(file, checker)) == 2
    file.write_text(GRAPH.format(**(sound | parts)))
    assert problem(file, checker).startswith(said)


@pytest.mark.slow
def test_entities_do_not_multiply(tmp_path: Path) -> None:
    lines = ['<!ENTITY e0 "aaaaaaaaaa">', *(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))]
    text = f"<!DOCTYPE graphml [{''.join(lines)}]>\n<graphml><graph><desc>&e9;</desc></graph></graphml>"
    (tmp_path / "r.graphml").write_text(text)
    assert problem(tmp_path / "r.graphml", CHECKERS["L"]).startswith("not a readable GraphML file: ")


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=few(100, of=4))
@given(data=st.data())
def test_damaged_files_are_refused_in_one_line(suffix: str, data: st.DataObject) -> None:
    whole = WHOLE[suffix]
    at = data.draw(st.integers(0, len(whole) - 1))
    if data.draw(st.booleans()):
        damaged = whole[:at] + data.draw(st.binary(min_size=1, max_size=4)) + whole[at + 1 :]
    else:
        damaged = whole[:at]
    file = FOLDER / f"damaged{suffix}"
    file.write_bytes(damaged)
    try:
        roadmap = load_roadmap(file, CHECKERS["disc"])
    except TrailmarkError:
        problem(file, CHECKERS["disc"])
        return
    # What is still readable holds no certificate that the checker would not give.
    q, edges = roadmap.configurations, roadmap.edges[roadmap.certified]
    assert CHECKERS["disc"].motions_valid(q[edges[:, 0]], q[edges[:, 1]]).all()


@pytest.fixture(scope="module", autouse=True)
def _damaged(tmp_path_factory: pytest.TempPathFactory, roadmaps: dict[str, Roadmap]) -> None:
    global FOLDER
    FOLDER = tmp_path_factory.mktemp("damaged")
    for suffix in SUFFIXES:
        roadmaps["disc"].save(FOLDER / f"whole{suffix}")
        WHOLE[suffix] = (FOLDER / f"whole{suffix}").read_bytes()


FOLDER: Path
WHOLE: dict[str, bytes] = {}
