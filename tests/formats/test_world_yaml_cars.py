"""Cars in world files: read, written, and refused in one line."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.formats import load_world, world_json_schema
from trailmark.formats.world_yaml import world_from_data, world_text
from trailmark.formats.yaml_data import parse_yaml
from trailmark.world import Robot, World

SHAPES = (
    "shape: rectangle, length: 4.4, width: 1.8",
    "shape: disc, radius: 0.5",
    "shape: polygon, vertices: [[-1, -0.5], [3, -0.5], [3, 0.5], [-1, 0.5]]",
)


def read(tmp_path: Path, robot: str) -> Robot:
    file = tmp_path / "w.yaml"
    file.write_text(f"trailmark: 1\nbounds: [0, 0, 20, 10]\nrobot: {{{robot}}}\n")
    world = load_world(file)
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
def test_round_trip_is_exact(robot: Robot, radius: float, reverse: bool) -> None:
    world = World("w", (0.0, 0.0, 20.0, 10.0), robot=robot.steered(radius, reverse))
    data = parse_yaml(world_text(world), Path("w.yaml"))
    assert isinstance(data, dict)
    again = world_from_data(data, Path("w.yaml"))
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
        world = load_world(file)
        assert world.robot == robot
        world.save(file)
        assert load_world(file).robot == robot


def test_the_json_schema_describes_cars() -> None:
    robot = world_json_schema()["$defs"]["RectangleRobot"]["properties"]
    assert "turning_radius" in robot
    assert {"type": "boolean"} in robot["reverse"]["anyOf"]
    assert robot["drive"]["anyOf"][0]["enum"] == ["omnidirectional", "differential", "car"]
