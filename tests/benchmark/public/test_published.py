"""Sets as they are published: which files count, what becomes of them, and what is left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public import PUBLIC
from trailmark.errors import FormatError
from trailmark.world import Robot, World

MAP = "type octile\nheight 3\nwidth 4\nmap\n....\n.@@.\n....\n"
SCEN = "version 1\n0\ttiny.map\t4\t3\t0\t0\t3\t2\t5\n7\ttiny.map\t4\t3\t3\t0\t0\t2\t5\n"


def worlds(name: str, folder: Path, count: int | None = None) -> list[World]:
    suite = PUBLIC[name]
    return list(suite.worlds(folder, suite.find(folder), count, None))


def test_movingai_with_maps_and_scenarios_in_folders_of_their_own(tmp_path: Path) -> None:
    for folder in ("maps", "scens"):
        (tmp_path / folder).mkdir()
    (tmp_path / "maps" / "tiny.map").write_text(MAP)
    (tmp_path / "scens" / "tiny.map.scen").write_text(SCEN)
    (tmp_path / "scens" / "gone.map.scen").write_text(SCEN)
    (world,) = worlds("movingai", tmp_path)
    assert [query.name for query in world.queries] == ["bucket-0-row-0", "bucket-7-row-1"]
    assert [(query.start, query.goal) for query in world.queries] == [
        ((0.5, 2.5, 0.0), (3.5, 0.5, 0.0)),
        ((3.5, 2.5, 0.0), (0.5, 0.5, 0.0)),
    ]
    assert world.robot == Robot.disc(0.4)
    (line,) = PUBLIC["movingai"].find(tmp_path).left_out
    assert line.endswith(f"gone.map.scen: no gone.map in {tmp_path}")
    (tmp_path / "maps" / "tiny.map").write_text(MAP.replace("height 3", "height 2").removesuffix("....\n"))
    with pytest.raises(SuiteError, match=r"expected rows for tiny\.map, 4 x 2 cells"):
        worlds("movingai", tmp_path)


def test_omplapp_leaves_out_what_is_not_planned_for(tmp_path: Path) -> None:
    (tmp_path / "space.cfg").write_text("[problem]\nstart.theta = 0\nstart.z = 1\n")
    (tmp_path / "car.cfg").write_text("[problem]\nstart.theta = 0\ncontrol = kinematic_car\n")
    found = PUBLIC["omplapp"].find(tmp_path)
    assert list(found.problems) == []
    assert [line.rpartition(": ")[2] for line in found.left_out] == [
        "a problem for planners with controls",
        "a problem in space",
    ]


@pytest.mark.slow
def test_barn_is_the_challenge(shared_data: Path) -> None:
    first, *_ = worlds("barn", shared_data / "barn")
    assert first.name == "barn-world_0"
    (query,) = first.queries
    assert (query.start, query.goal) == ((-2.0, 3.0, 1.57), (-2.0, 13.0, 1.57))
    # Each cylinder once, though the file's recorded state names them again.
    assert len(first.obstacles) == 209
    assert {obstacle.radius for obstacle in first.obstacles} == {0.075}  # type: ignore[union-attr]  # all are discs


def test_pictures_are_read_with_the_lower_left_pixel_first(tmp_path: Path) -> None:
    folder = tmp_path / "forest" / "test"
    folder.mkdir(parents=True)
    pixels = np.full((201, 201), 255, dtype=np.uint8)
    pixels[190:195, 10:20] = 0  # near the picture's lower left corner
    pixels[0:5, 0:5] = 127  # below half
    pixels[0:5, 10:15] = 128
    Image.fromarray(pixels).save(folder / "9.png")
    (world,) = worlds("families", tmp_path)
    assert world.name == "forest-test-9"
    blocked = shapely.union_all([shape.polygon().shapely() for shape in world.obstacles])
    wanted = shapely.union_all([shapely.box(10, 6, 20, 11), shapely.box(0, 196, 5, 201)])
    assert blocked.symmetric_difference(wanted).area == pytest.approx(0.0)
    assert (world.queries[0].start, world.queries[0].goal) == ((0.5, 0.5, 0.0), (200.5, 200.5, 0.0))
    Image.fromarray(pixels[:100]).save(folder / "9.png")
    with pytest.raises(FormatError, match="expected 201 x 201 pixels, got 201 x 100"):
        worlds("families", tmp_path)
