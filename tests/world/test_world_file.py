from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.trials import THOROUGH, few

from trailmark.errors import FormatError, OutputError, TrailmarkError, WorldError
from trailmark.formats import world_json_schema
from trailmark.formats.yaml_data import parse_yaml
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import Query, Robot, World
from trailmark.world.goals import Goal
from trailmark.world.moving import Moving
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


def zone(kind: str, vertices: str = "[[0, 0], [1, 0], [0, 1]]") -> str:
    return f"zones: [{{kind: {kind}, vertices: {vertices}}}]"


def write(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "office.yaml"
    file.write_text(text, encoding="utf-8")
    return file


def test_the_contract_example(tmp_path: Path) -> None:
    assert World.load(write(tmp_path, CONTRACT)) == OFFICE


def test_defaults(tmp_path: Path) -> None:
    world = World.load(write(tmp_path, "trailmark: 1\nbounds: [0, 0, 1, 2]\nobstacles:\nqueries: []\n"))
    assert world == World("office", (0.0, 0.0, 1.0, 2.0))


def test_windows_line_ends_and_byte_order_mark(tmp_path: Path) -> None:
    file = tmp_path / "office.yaml"
    file.write_bytes(b"\xef\xbb\xbf" + CONTRACT.replace("\n", "\r\n").encode())
    assert World.load(file) == OFFICE


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
robots = st.one_of(
    st.builds(Robot.disc, length),
    st.builds(Robot.rectangle, length, length),
    polygons(holes=False).map(lambda p: Robot.polygon(p.vertices)),
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


@pytest.mark.slow
@settings(max_examples=few(THOROUGH, of=120))
@given(any_world())
def test_other_yaml_readers_see_the_same(world: World) -> None:
    data = yaml.safe_load(world_text(world))
    assert data["name"] == world.name
    assert data["bounds"] == list(world.bounds)
    for i, (entry, shape) in enumerate(zip(data.get("obstacles", []), world.obstacles, strict=True)):
        if isinstance(shape, Disc):
            name = {"id": world.ids[i]} if world.ids else {}
            assert entry == {"shape": "disc", "center": list(shape.center), "radius": shape.radius} | name


def test_obstacles_may_have_ids_and_move(tmp_path: Path) -> None:
    text = (
        "trailmark: 1\nbounds: [0, 0, 9, 9]\nobstacles:\n"
        "  - {shape: disc, center: [1, 1], radius: 0.5, id: pallet-7}\n"
        "  - {shape: rectangle, center: [4, 4], length: 2, width: 1, motion: {velocity: [0.5, 0], until: 4}}\n"
    )
    world = World.load(write(tmp_path, text))
    motion = Moving(Rectangle((4.0, 4.0), 2.0, 1.0), (0.5, 0.0), 4.0)
    assert world.ids == ("pallet-7", None)
    assert world.moving == (None, motion)
    assert world.obstacles == (Disc((1.0, 1.0), 0.5), motion.swept)
    saved = world_text(world)
    assert "{shape: disc, center: [1.0, 1.0], radius: 0.5, id: pallet-7}" in saved
    assert "length: 2.0, width: 1.0, motion: {velocity: [0.5, 0.0], until: 4.0}}" in saved
    assert World.load(write(tmp_path, saved)) == world


def test_a_name_that_utf8_cannot_hold(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="name"):
        World("\ud800", (0, 0, 1, 1)).save(tmp_path / "out.yaml")
    assert list(tmp_path.iterdir()) == []


def test_angles_may_be_in_degrees(tmp_path: Path) -> None:
    text = (
        "trailmark: 1\nbounds: [0, 0, 9, 9]\n"
        "obstacles: [{shape: rectangle, center: [4, 4], length: 2, width: 1, heading: -45deg}]\n"
        "queries: [{name: a, start: [1, 1, 90deg], goal: [2, 2, '180 deg']}]\n"
        "zones: [{kind: one-way, heading: 270deg, tolerance: 30deg, vertices: [[0, 0], [1, 0], [0, 1]]}]\n"
    )
    world = World.load(write(tmp_path, text))
    assert world.obstacles == (Rectangle((4.0, 4.0), 2.0, 1.0, -math.pi / 4),)
    assert world.queries == (Query("a", (1.0, 1.0, math.pi / 2), (2.0, 2.0, math.pi)),)
    zone = world.zones[0]
    assert isinstance(zone, OneWayZone)
    assert (zone.heading, zone.tolerance) == pytest.approx((-math.pi / 2, math.pi / 6))


def test_saving_to_a_missing_directory(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="No such file or directory"):
        OFFICE.save(tmp_path / "no" / "out.yaml")


HEAD = "trailmark: 1\nname: office\nbounds: [0, 0, 20, 12]\n"
RING = "[[0, 0], [9, 0], [0, 9]]"
QUERY = "{name: a, start: [0, 0, 0], goal: [1, 1, 1]}"
DISC = "{shape: disc, center: [1, 2], radius: 1}"


def goal(text: str) -> str:
    return f"queries: [{{name: a, start: [0, 0, 0], goal: {text}}}]"


def disc(radius: str) -> str:
    return f"obstacles: [{DISC}, {{shape: disc, center: [1, 2], radius: {radius}}}]"


def polygon(points: str) -> str:
    return f"obstacles: [{{shape: polygon, vertices: {points}}}]"


def robot(fields: str) -> str:
    return f"robot: {{shape: disc, radius: 1, {fields}}}"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        *((disc(radius), "obstacles[1].radius: ") for radius in ("-0.5", "0", "'0.5'", "true", "nan", "", "[1]")),
        *((disc(radius), "obstacles[1].radius: ") for radius in (".nan", "-.inf", "1e999")),
        ("obstacles: [{shape: disc, center: [1, 2], radus: 1}]", "obstacles[0].radus: unknown key (did you mean 'radi"),
        (zone("cost, factor: 0"), "zones[0].factor: "),
        (zone("cost"), "zones[0].factor: field required"),
        (zone("one-way, heading: 0, tolerance: 4"), "zones[0].tolerance: "),
        (zone("one-way, heading: up, tolerance: 1"), "zones[0].heading: "),
        (zone("speed, limit: -1"), "zones[0].limit: "),
        (zone("keep-out, factor: 2"), "zones[0].factor: unknown key"),
        (zone("keepout"), "zones[0]: "),
        (zone("keep-out", "[[0, 0], [1, 1], [2, 2]]"), "zones[0]: polygon: "),
        (zone("keep-out", "[[0, 0], [1, 1]]"), "zones[0].vertices: "),
        ("zones: [{vertices: []}]", "zones[0]: "),
        ("zones: [7]", "zones[0]: "),
        ("zones: 7", "zones: "),
        ("obstacles: [{shape: disk}]", "obstacles[0]: "),
        ("obstacles: [{radius: 1}]", "obstacles[0]: "),
        ("obstacles: [5]", "obstacles[0]: "),
        ("obstacles: {shape: disc}", "obstacles: "),
        (polygon("[[0, 0], [1, 1], [1, 0], [0, 1]]"), "obstacles[0]: polygon: not simple: Self-intersection"),
        (polygon("[[0, 0], [1, 1], [2, 2]]"), "obstacles[0]: polygon: "),
        (polygon("[[0, 0], [1, 1]]"), "obstacles[0].vertices: "),
        (polygon("[[0, 0], [1, 1], [1]]"), "obstacles[0].vertices[2]: "),
        (polygon("[[0, 0], [1, 1], 7]"), "obstacles[0].vertices[2]: "),
        (polygon("[[0, 0], [1, 1], [1, x]]"), "obstacles[0].vertices[2][1]: "),
        (polygon(RING + ", holes: [[[1, 1], [2, 2]]]"), "obstacles[0].holes[0]: "),
        (polygon(RING + ", holes: [[[1, 1], [2, 2], 3]]"), "obstacles[0].holes[0][2]: "),
        (polygon(RING + ", holes: [[[15, 5], [16, 5], [15, 6]]]"), "obstacles[0]: polygon: not simple: Hole lies"),
        ("robot: 7", "robot: "),
        ("robot: {shape: disc, radius: -1}", "robot.radius: "),
        ("robot: {shape: rectangle, length: 1}", "robot.width: field required"),
        ("robot: {shape: polygon, vertices: [[0, 0], [1, 1], [1, 0], [0, 1]]}", "robot: polygon: not simple"),
        (robot("center: [0, 0]"), "robot.center: unknown key"),
        *((robot(f"turning_radius: {m}"), "robot.turning_radius: ") for m in ("0", "-2.0", ".inf", ".nan", "'5'")),
        (
            robot("turning_radius: 1.0e+9"),
            "robot: robot: turning_radius: expected a finite number above 0 and at most 10000",
        ),
        (robot("reverse: 1"), "robot.reverse: "),
        (robot("reverse: false"), "robot: robot: expected a turning radius with reverse False, got none"),
        (robot("turning_radus: 5"), "robot.turning_radus: unknown key (did you mean 'turning_radius'?)"),
        ("boundary: [[0, 0], [1, 1], [1, 0], [0, 1]]", "boundary: polygon: not simple"),
        ("boundary: [[0, 0], [1, 1], [1, .inf]]", "boundary[2][1]: "),
        ("queries: [{name: 1, start: [0, 0, 0], goal: [0, 0, 0]}]", "queries[0].name: "),
        ("queries: [{name: a, start: [0, 0], goal: [0, 0, 0]}]", "queries[0].start: "),
        ("queries: [{nam: a, start: [0, 0, 0], goal: [0, 0, 0]}]", "queries[0].nam: unknown key"),
        *((goal(text), "queries[0].goal: ") for text in ("7", "[]", "[1, 2]")),
        (goal("[1, 2, x]"), "queries[0].goal[2]: "),
        (goal("[1, 2, 90dog]"), "queries[0].goal[2]: "),
        (goal("{}"), "queries[0]: goal: expected a pose or a region, got neither"),
        (goal("{pos: [1, 2]}"), "queries[0].goal.pos: unknown key (did you mean 'pose'?)"),
        (goal("{pose: [1]}"), "queries[0].goal.pose: "),
        (goal("{pose: [1, .nan]}"), "queries[0].goal.pose[1]: "),
        (goal("{pose: [1, 2, 3], cost: -1}"), "queries[0]: goal: cost: "),
        (goal("{pose: [1, 2, 3], position_tolerance: -1}"), "queries[0].goal.position_tolerance: "),
        (goal("[{pose: [1, 2]}, 7]"), "queries[0].goal[1]: "),
        (goal("[{pose: [1, 2]}, {region: [[0, 0]]}]"), "queries[0].goal[1].region: "),
        (goal("{region: [[0, 0], [1, 1], [2, 2]]}"), "queries[0]: goal: region: polygon: "),
        (goal("{region: [[0, 0], [1, 1], [2, x]]}"), "queries[0].goal.region[2][1]: "),
        (f"queries: [{QUERY}, {QUERY}]", "queries: expected each name once, got 'a' more than once"),
        ("obstacels: []", "obstacels: unknown key (did you mean 'obstacles'?)"),
        ('"a\\nb": []', r"'a\nb': unknown key"),
        ("x" * 500 + ": []", "unknown key"),
        ("name: x", "expected each key once, got 'name' twice in one mapping"),
        (disc("1, id: 7"), "obstacles[1].id: "),
        (disc("1, id: ''"), "obstacles[1].id: "),
        (f"obstacles: [{2 * (DISC[:-1] + ', id: a}, ')}]", "ids: expected each id once, got 'a' more than once"),
        (disc("1, motion: 3"), "obstacles[1].motion: "),
        (disc("1, motion: {velocity: [1], until: 2}"), "obstacles[1].motion.velocity: "),
        (disc("1, motion: {velocity: [1, 0]}"), "obstacles[1].motion.until: field required"),
        (disc("1, motion: {velocity: [1e9, 0], until: 9}"), "obstacles[1]: moving: the region swept: polygon: "),
        (disc(f"1, estimate: {{mean: {DISC}, covariance: [[1, 0], [0, 1]], frame: r}}"), "obstacles[1].estimate.frame"),
    ],
)
def test_a_bad_entry_is_told_with_its_place(tmp_path: Path, text: str, problem: str) -> None:
    message = refused(tmp_path, HEAD + text)
    assert problem in message


@pytest.mark.parametrize("version", ["2", "true", "", "'1'", "1.0"])
def test_another_version(tmp_path: Path, version: str) -> None:
    assert "trailmark: expected 1 (the schema version), got" in refused(tmp_path, f"trailmark: {version}\nbounds: []")


@pytest.mark.parametrize("bounds", ["", "bounds: [0, 0, 1]", "bounds: [0, 0, 1, true]", "bounds: [0, 0, 0, 1]"])
def test_bad_bounds(tmp_path: Path, bounds: str) -> None:
    assert "office.yaml: bounds" in refused(tmp_path, f"trailmark: 1\n{bounds}")


def test_a_message_has_the_value_cut_short_and_how_many_more_there_are(tmp_path: Path) -> None:
    message = refused(tmp_path, HEAD + disc("[" + 900 * "1, " + "]") + "\nname2: x\nzones: 7")
    assert message.endswith("name2: unknown key (did you mean 'name'?) (and 2 more)")
    message = refused(tmp_path, HEAD + disc("[" + 900 * "1, " + "]"))
    assert message.endswith("obstacles[1].radius: input should be a valid number, got [1, 1, 1, 1, 1, ...]")


def refused(tmp_path: Path, text: str) -> str:
    file = write(tmp_path, text)
    with pytest.raises(FormatError) as caught:
        World.load(file)
    message = str(caught.value)
    assert message.startswith(str(file))
    assert "\n" not in message
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
def test_any_data_gives_a_world_or_one_line(value: object, key: str) -> None:
    data = {"trailmark": 1, "bounds": [0, 0, 1, 1], **{key: value}}
    message = "a world"
    try:
        World(**world_fields(data, Path("w.yaml")))
    except TrailmarkError as error:
        message = str(error)
    assert len(message.splitlines()) == 1
    assert len(message) < 1000


def test_json_schema_describes_the_contract() -> None:
    schema = world_json_schema()
    json.dumps(schema)
    assert schema["title"] == "trailmark world"
    assert schema["additionalProperties"] is False
    contract = {"trailmark", "name", "bounds", "robot", "boundary", "obstacles", "queries"}
    assert set(schema["properties"]) == {*contract, "grid", "not_certified", "risk", "zones"}
    assert schema["required"] == ["trailmark", "bounds"]
    disc_schema = schema["$defs"]["DiscObstacle"]
    assert disc_schema["properties"]["radius"]["exclusiveMinimum"] == 0.0
    assert disc_schema["properties"]["radius"]["description"] == "a finite number above 0 (metres)"
    assert set(disc_schema["required"]) == {"shape", "center", "radius"}


def test_why_a_map_is_not_certified_is_kept(tmp_path: Path) -> None:
    world = World("m", (0.0, 0.0, 1.0, 1.0), not_certified="features: one is taken for the other")
    world.save(tmp_path / "m.yaml")
    assert World.load(tmp_path / "m.yaml") == world
    with pytest.raises(WorldError, match="not_certified"):
        replace(world, not_certified=1)  # type: ignore[arg-type]  # a mistake


SHAPES = (
    "shape: rectangle, length: 4.4, width: 1.8",
    "shape: disc, radius: 0.5",
    "shape: polygon, vertices: [[-1, -0.5], [3, -0.5], [3, 0.5], [-1, 0.5]]",
)


def read(tmp_path: Path, robot: str) -> Robot:
    file = tmp_path / "w.yaml"
    file.write_text(f"trailmark: 1\nbounds: [0, 0, 20, 10]\nrobot: {{{robot}}}\n")
    world = World.load(file)
    assert world.robot is not None
    return world.robot


@pytest.mark.parametrize("shape", SHAPES)
def test_every_shape_may_be_a_car(tmp_path: Path, shape: str) -> None:
    plain = read(tmp_path, shape)
    assert plain.turning_radius is None
    assert read(tmp_path, f"{shape}, turning_radius: 5") == plain.steered(5.0)
    assert read(tmp_path, f"{shape}, turning_radius: 2.5, reverse: true") == plain.steered(2.5)
    assert read(tmp_path, f"{shape}, turning_radius: 2.5, reverse: false") == plain.steered(2.5, reverse=False)
    assert read(tmp_path, f"{shape}, reverse: true") == plain


@given(
    st.sampled_from([Robot.disc(0.4), Robot.rectangle(3, 1), Robot.polygon([(0, 0), (2, 0), (0, 1)])]),
    st.floats(1e-9, 1e4),
    st.booleans(),
)
def test_round_trip_is_exact_world_yaml_cars(robot: Robot, radius: float, reverse: bool) -> None:
    world = World("w", (0.0, 0.0, 20.0, 10.0), robot=robot.steered(radius, reverse))
    data = parse_yaml(world_text(world), Path("w.yaml"))
    assert isinstance(data, dict)
    again = World(**world_fields(data, Path("w.yaml")))
    assert again == world


def test_a_robot_without_turning_radius_is_written_as_before() -> None:
    text = world_text(World("w", (0.0, 0.0, 20.0, 10.0), robot=Robot.disc(0.4)))
    assert "robot: {shape: disc, radius: 0.4}\n" in text
    car = world_text(World("w", (0.0, 0.0, 20.0, 10.0), robot=Robot.disc(0.4).steered(2.0)))
    assert "robot: {shape: disc, radius: 0.4, turning_radius: 2.0}\n" in car


def test_differential_drives_are_read_and_written(tmp_path: Path) -> None:
    for text, robot in (
        ("drive: differential", Robot.disc(0.3).differential()),
        ("drive: differential, reverse: true", Robot.disc(0.3).differential(reverse=True)),
        ("drive: car, turning_radius: 2", Robot.disc(0.3).steered(2.0)),
        ("drive: omnidirectional", Robot.disc(0.3)),
    ):
        file = tmp_path / "world.yaml"
        file.write_text(f"trailmark: 1\nname: a\nbounds: [0, 0, 9, 9]\nrobot: {{shape: disc, radius: 0.3, {text}}}\n")
        world = World.load(file)
        assert world.robot == robot
        world.save(file)
        assert World.load(file).robot == robot


def test_the_json_schema_describes_cars() -> None:
    robot = world_json_schema()["$defs"]["RectangleRobot"]["properties"]
    assert "turning_radius" in robot
    assert {"type": "boolean"} in robot["reverse"]["anyOf"]
    assert robot["drive"]["anyOf"][0]["enum"] == ["omnidirectional", "differential", "car"]
