from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.trials import THOROUGH, few

from trailmark import Disc, Goal, Moving, Polygon, Query, Rectangle, Robot, World
from trailmark.errors import FormatError, OutputError, TrailmarkError
from trailmark.formats import world_json_schema
from trailmark.formats.yaml_data import parse_yaml
from trailmark.world.world_file import world_fields, world_text
from trailmark.world.zones import CostZone, KeepOutZone, OneWayZone, SpeedZone

# The example of the contract (DESIGN.md section 2), with numbers for its dots.
CONTRACT = """
trailmark: 1
name: office
bounds: [0.0, 0.0, 20.0, 12.0]          # xmin, ymin, xmax, ymax; no part of the robot may leave it
robot: {shape: rectangle, length: 0.6, width: 0.4}
boundary: [[0, 0], [20, 0], [20, 12], [10, 11.5], [0, 12]]
obstacles:
  - {shape: polygon, vertices: [[1, 1], [4, 1], [4, 4], [1, 4]], holes: [[[2, 2], [3, 2], [3, 3]]]}
  - {shape: disc, center: [7, 8], radius: 0.5}
  - {shape: rectangle, center: [9, 3], length: 2.0, width: 1.0, heading: 0.3}
queries:
  - {name: door, start: [1.0, 1.0, 0.0], goal: [18.0, 10.0, 1.57]}
"""

OFFICE = World(
    "office",
    (0.0, 0.0, 20.0, 12.0),
    (
        Polygon(np.array([[1, 1], [4, 1], [4, 4], [1, 4.0]]), (np.array([[2, 2], [3, 2], [3, 3.0]]),)),
        Disc((7.0, 8.0), 0.5),
        Rectangle((9.0, 3.0), 2.0, 1.0, 0.3),
    ),
    Robot.rectangle(0.6, 0.4),
    Polygon(np.array([[0, 0], [20, 0], [20, 12], [10, 11.5], [0, 12.0]])),
    (Query("door", (1.0, 1.0, 0.0), (18.0, 10.0, 1.57)),),
)


def write(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "office.yaml"
    file.write_text(text, encoding="utf-8")
    return file


coordinate = st.floats(-1e6, 1e6, allow_nan=False)
length = st.floats(1e-6, 1e6)
point = st.tuples(coordinate, coordinate)
pose = st.tuples(coordinate, coordinate, st.floats(-9.0, 9.0))


@st.composite
def polygons(draw: st.DrawFn, holes: bool) -> Polygon:
    """Star-shaped about a centre, which makes any radii simple; the hole is a shrunk copy."""
    n = draw(st.integers(3, 9))
    radii = np.array(draw(st.lists(st.floats(0.5, 2.0), min_size=n, max_size=n)))
    angles = 2.0 * math.pi * np.arange(n) / n
    ring = radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    center = np.array(draw(st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))))
    with_hole = holes and draw(st.booleans())
    return Polygon(center + ring, (center + 0.3 * ring,) if with_hole else ())


obstacles = st.one_of(
    st.builds(Disc, point, length),
    st.builds(Rectangle, point, length, length, st.floats(-9.0, 9.0)),
    polygons(holes=True),
)
speed = st.floats(-10.0, 10.0)
motions = st.builds(Moving, st.builds(Rectangle, point, length, length), st.tuples(speed, speed), st.floats(0.1, 60.0))
footprints = st.one_of(
    st.builds(Robot.disc, length),
    st.builds(Robot.rectangle, length, length),
    polygons(holes=False).map(lambda p: Robot.polygon(p.vertices)),
)
robots = st.one_of(
    footprints,
    st.builds(Robot.differential, footprints, st.booleans()),
    st.builds(Robot.steered, footprints, st.floats(1e-9, 1e4), st.booleans()),
)
names = st.text(st.characters(exclude_categories=["Cs"]))


distance, turn = st.floats(0.0, 1e6), st.floats(0.0, 9.0)
goals = st.one_of(
    st.builds(Goal, st.tuples(coordinate, coordinate), position_tolerance=distance, cost=distance),
    st.builds(Goal, pose, position_tolerance=distance, heading_tolerance=turn, cost=distance),
    st.builds(Goal, region=polygons(holes=False), cost=distance),
    st.builds(Goal, region=polygons(holes=False), heading=st.floats(-9.0, 9.0), heading_tolerance=turn),
)


TAKEN = ("", "bounds", "boundary")


@st.composite
def any_world(draw: st.DrawFn) -> World:
    low = draw(point)
    size = draw(st.tuples(length, length))
    ends = draw(st.lists(st.tuples(pose, pose | goals | st.lists(goals, min_size=1, max_size=3)), max_size=3))
    unique = draw(st.lists(names, min_size=len(ends), max_size=len(ends), unique=True))
    shapes = draw(st.lists(obstacles | motions, max_size=5))
    region = polygons(holes=True)
    ids = draw(
        st.none()
        | st.lists(
            names.filter(lambda name: name not in TAKEN), min_size=len(shapes), max_size=len(shapes), unique=True
        )
    )
    return World(
        draw(names),
        (*low, low[0] + size[0], low[1] + size[1]),
        tuple(shapes),  # type: ignore[arg-type]  # a world takes moving ones apart
        draw(st.none() | robots),
        draw(st.none() | polygons(holes=False)),
        tuple(Query(name, *both) for name, both in zip(unique, ends, strict=True)),
        ids=tuple(ids or ()),
        zones=tuple(
            draw(
                st.lists(
                    st.builds(CostZone, region, st.floats(0.1, 1e6))
                    | st.builds(KeepOutZone, region)
                    | st.builds(OneWayZone, region, st.floats(-9.0, 9.0), st.floats(0.0, math.pi))
                    | st.builds(SpeedZone, region, length),
                    max_size=3,
                )
            )
        ),
    )


@pytest.mark.slow
@settings(max_examples=few(THOROUGH, of=80))
@given(any_world())
def test_round_trip_is_exact(world: World) -> None:
    data = parse_yaml(world_text(world), Path("w.yaml"))
    assert isinstance(data, dict)
    again = World(**world_fields(data, Path("w.yaml")))
    assert again == world
    assert world_text(again) == world_text(world)
    # Other readers of YAML see the same.
    plain = yaml.safe_load(world_text(world))
    assert (plain["name"], plain["bounds"]) == (world.name, list(world.bounds))


def test_the_contract_example(tmp_path: Path) -> None:
    assert World.load(write(tmp_path, CONTRACT)) == OFFICE
    (tmp_path / "office.yaml").write_bytes(b"\xef\xbb\xbf" + CONTRACT.replace("\n", "\r\n").encode())
    assert World.load(tmp_path / "office.yaml") == OFFICE
    world = World.load(write(tmp_path, "trailmark: 1\nbounds: [0, 0, 1, 2]\nobstacles:\nqueries: []\n"))
    assert world == World("office", (0.0, 0.0, 1.0, 2.0))
    schema = world_json_schema()
    assert schema["required"] == ["trailmark", "bounds"]
    contract = {"trailmark", "name", "bounds", "robot", "boundary", "obstacles", "queries", "zones"}
    assert set(schema["properties"]) == {*contract, "grid", "not_certified", "risk"}


def test_ids_motions_drives_and_angles_in_degrees(tmp_path: Path) -> None:
    text = (
        "trailmark: 1\nbounds: [0, 0, 9, 9]\nrobot: {shape: disc, radius: 0.3, drive: differential, reverse: true}\n"
        "obstacles:\n  - {shape: disc, center: [1, 1], radius: 0.5, id: pallet-7}\n"
        "  - {shape: rectangle, center: [4, 4], length: 2, width: 1, motion: {velocity: [0.5, 0], until: 4}}\n"
        "  - {shape: rectangle, center: [4, 4], length: 2, width: 1, heading: -45deg}\n"
        "queries: [{name: a, start: [1, 1, 90deg], goal: [2, 2, '180 deg']}]\n"
        "zones: [{kind: one-way, heading: 270deg, tolerance: 30deg, vertices: [[0, 0], [1, 0], [0, 1]]}]\n"
    )
    world = World.load(write(tmp_path, text))
    motion = Moving(Rectangle((4.0, 4.0), 2.0, 1.0), (0.5, 0.0), 4.0)
    assert world.robot == Robot.disc(0.3).differential(reverse=True)
    assert world.ids == ("pallet-7", None, None)
    assert world.moving == (None, motion, None)
    turned = Rectangle((4.0, 4.0), 2.0, 1.0, -math.pi / 4)
    assert world.obstacles == (Disc((1.0, 1.0), 0.5), motion.swept, turned)
    assert world.queries == (Query("a", (1.0, 1.0, math.pi / 2), (2.0, 2.0, math.pi)),)
    assert isinstance(world.zones[0], OneWayZone)
    assert (world.zones[0].heading, world.zones[0].tolerance) == pytest.approx((-math.pi / 2, math.pi / 6))
    saved = world_text(world)
    assert "{shape: disc, center: [1.0, 1.0], radius: 0.5, id: pallet-7}" in saved
    assert World.load(write(tmp_path, saved)) == world


def test_what_cannot_be_written_is_said_and_why_a_map_is_not_certified_is_kept(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="No such file or directory"):
        OFFICE.save(tmp_path / "no" / "out.yaml")
    with pytest.raises(OutputError, match="name"):
        World("\ud800", (0, 0, 1, 1)).save(tmp_path / "out.yaml")
    assert list(tmp_path.iterdir()) == []
    world = World("m", (0.0, 0.0, 1.0, 1.0), not_certified="features: one is taken for the other")
    world.save(tmp_path / "m.yaml")
    assert World.load(tmp_path / "m.yaml") == world


HEAD = "trailmark: 1\nname: office\nbounds: [0, 0, 20, 12]\n"
QUERY = "{name: a, start: [0, 0, 0], goal: [1, 1, 1]}"
DISC = "{shape: disc, center: [1, 2], radius: 1}"


def goal(text: str) -> str:
    return f"queries: [{{name: a, start: [0, 0, 0], goal: {text}}}]"


def disc(radius: str) -> str:
    return f"obstacles: [{DISC}, {{shape: disc, center: [1, 2], radius: {radius}}}]"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        *((disc(radius), "obstacles[1].radius: ") for radius in ("-0.5", "'0.5'", "true", "", "[1]", ".nan", "1e999")),
        ("obstacles: [{shape: disc, center: [1, 2], radus: 1}]", "obstacles[0].radus: unknown key (did you mean 'radi"),
        ("zones: [{kind: cost, factor: 0, vertices: [[0, 0], [1, 0], [0, 1]]}]", "zones[0].factor: "),
        ("zones: [{kind: keepout, vertices: []}]", "zones[0]: "),
        ("zones: [{kind: keep-out, vertices: [[0, 0], [1, 1], [2, 2]]}]", "zones[0]: polygon: "),
        ("zones: 7", "zones: "),
        ("obstacles: [{shape: disk}]", "obstacles[0]: "),
        ("obstacles: {shape: disc}", "obstacles: "),
        (
            "obstacles: [{shape: polygon, vertices: [[0, 0], [1, 1], [1, 0], [0, 1]]}]",
            "polygon: not simple: Self-inters",
        ),
        ("obstacles: [{shape: polygon, vertices: [[0, 0], [1, 1], [1, x]]}]", "obstacles[0].vertices[2][1]: "),
        ("robot: {shape: rectangle, length: 1}", "robot.width: field required"),
        ("robot: {shape: disc, radius: 1, turning_radius: -2.0}", "robot.turning_radius: "),
        ("robot: {shape: disc, radius: 1, reverse: false}", "robot: robot: expected a turning radius with reverse"),
        ("robot: {shape: disc, radius: 1, turning_radus: 5}", "unknown key (did you mean 'turning_radius'?)"),
        ("boundary: [[0, 0], [1, 1], [1, .inf]]", "boundary[2][1]: "),
        ("queries: [{name: a, start: [0, 0], goal: [0, 0, 0]}]", "queries[0].start: "),
        (goal("[1, 2, 90dog]"), "queries[0].goal[2]: "),
        (goal("{}"), "queries[0]: goal: expected a pose or a region, got neither"),
        (goal("{pos: [1, 2]}"), "queries[0].goal.pos: unknown key (did you mean 'pose'?)"),
        (goal("[{pose: [1, 2]}, {region: [[0, 0]]}]"), "queries[0].goal[1].region: "),
        (f"queries: [{QUERY}, {QUERY}]", "queries: expected each name once, got 'a' more than once"),
        ("obstacels: []", "obstacels: unknown key (did you mean 'obstacles'?)"),
        ('"a\\nb": []', r"'a\nb': unknown key"),
        ("x" * 500 + ": []", "unknown key"),
        ("name: x", "expected each key once, got 'name' twice in one mapping"),
        (f"obstacles: [{2 * (DISC[:-1] + ', id: a}, ')}]", "ids: expected each id once, got 'a' more than once"),
        (disc("1, motion: {velocity: [1, 0]}"), "obstacles[1].motion.until: field required"),
        (disc(f"1, estimate: {{mean: {DISC}, covariance: [[1, 0], [0, 1]], frame: r}}"), "obstacles[1].estimate.frame"),
        (disc("[" + 900 * "1, " + "]") + "\nname2: x", "name2: unknown key (did you mean 'name'?) (and 1 more)"),
    ],
)
def test_a_bad_entry_is_told_with_its_place(tmp_path: Path, text: str, problem: str) -> None:
    assert problem in refused(tmp_path, HEAD + text)


def test_another_version_and_bad_bounds(tmp_path: Path) -> None:
    for version in ("2", "true", "", "'1'", "1.0"):
        said = refused(tmp_path, f"trailmark: {version}\nbounds: []")
        assert "trailmark: expected 1 (the schema version), got" in said
    for bounds in ("", "bounds: [0, 0, 1]", "bounds: [0, 0, 1, true]", "bounds: [0, 0, 0, 1]"):
        assert "office.yaml: bounds" in refused(tmp_path, f"trailmark: 1\n{bounds}")


def refused(tmp_path: Path, text: str) -> str:
    file = write(tmp_path, text)
    with pytest.raises(FormatError) as caught:
        World.load(file)
    message = str(caught.value)
    assert message.startswith(str(file))
    return message


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-3, 3) | st.floats() | st.sampled_from(["disc", "polygon", "a"]),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(
                st.sampled_from(
                    ["shape", "radius", "center", "vertices", "holes", "name", "start", "goal", "pose", "length", "x"]
                ),
                inner,
                max_size=4,
            )
        ),
        max_leaves=12,
    ),
    st.sampled_from(["name", "bounds", "robot", "boundary", "obstacles", "queries", "other"]),
)
def test_any_data_gives_a_world_or_an_error_of_ours(value: object, key: str) -> None:
    data = {"trailmark": 1, "bounds": [0, 0, 1, 1], **{key: value}}
    with suppress(TrailmarkError):
        World(**world_fields(data, Path("w.yaml")))
