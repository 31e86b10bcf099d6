"""Gazebo worlds: shapes where their poses put them, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from trailmark import Disc, FormatError, Rectangle
from trailmark.formats.gazebo import read_gazebo_shapes

WORLD = """<sdf version='1.6'><world name='default'>{}
<state world_name='default'><model name='a'><pose>9 9 0 0 0 0</pose></model></state></world></sdf>"""

MODEL = """<model name='{name}'><pose frame=''>{pose}</pose><link name='link'><pose>{link}</pose>
<collision name='c'><pose>{collision}</pose><geometry>{shape}</geometry></collision>
<visual name='v'><geometry><cylinder><radius>7</radius></cylinder></geometry></visual></link></model>"""

CYLINDER = "<cylinder><radius>0.075</radius><length>1</length></cylinder>"
BOX = "<box><size>2 1 0.5</size></box>"


def model(shape: str, pose: str = "0 0 0 0 0 0", link: str = "0 0 0 0 0 0", collision: str = "0 0 0 0 0 0") -> str:
    return MODEL.format(name="m", pose=pose, link=link, collision=collision, shape=shape)


def read(tmp_path: Path, *models: str) -> tuple[object, ...]:
    file = tmp_path / "made.world"
    file.write_text(WORLD.format("".join(models)))
    return read_gazebo_shapes(file)


def test_shapes_stand_where_model_link_and_collision_put_them(tmp_path: Path) -> None:
    turned = f"1 2 0.5 0 0 {math.pi / 2}"
    ground = model("<plane><normal>0 0 1</normal><size>100 100</size></plane>")
    found = read(tmp_path, ground, model(CYLINDER, "-2 3 0 0 0 0"), model(BOX, turned, "3 0 0 0 0 0", "0 0 0 0 0 0.25"))
    assert found[0] == Disc((-2.0, 3.0), 0.075)
    box = found[1]
    assert len(found) == 2
    assert isinstance(box, Rectangle)
    # By hand: 3 m along the model's x, which points along the world's y.
    assert box.center == pytest.approx((1.0, 5.0))
    assert (box.length, box.width, box.heading) == pytest.approx((2.0, 1.0, math.pi / 2 + 0.25))


@pytest.mark.parametrize(
    ("models", "problem"),
    [
        pytest.param([model(CYLINDER, "0 0 0 0.5 0 0")], "expected an upright pose, got roll 0.5", id="leans"),
        pytest.param([model("<mesh><uri>a</uri></mesh>")], "expected a cylinder, box, sphere or plane", id="mesh"),
        pytest.param([model("<cylinder><length>1</length></cylinder>")], "radius: expected 1 finite", id="no-radius"),
        pytest.param([model(BOX, "0 0")], "pose: expected 6 finite numbers, got '0 0'", id="short-pose"),
        pytest.param([model("<sphere><radius>-1</radius></sphere>")], "radius", id="negative"),
    ],
)
def test_what_cannot_be_read_is_told_in_one_line(models: list[str], problem: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=problem):
        read(tmp_path, *models)


def test_other_xml_is_no_world(tmp_path: Path) -> None:
    file = tmp_path / "a.world"
    file.write_text("<svg/>")
    with pytest.raises(FormatError, match="expected <sdf> with a <world>, got <svg>"):
        read_gazebo_shapes(file)
    file.write_text('<!DOCTYPE x [<!ENTITY a "b">]><sdf/>')
    with pytest.raises(FormatError, match="no document type"):
        read_gazebo_shapes(file)
