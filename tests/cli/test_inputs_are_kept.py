"""No output replaces what a command read, by whatever name."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tests.helpers.logs import recorded, write_mrclam
from tests.helpers.made_results import random_results

from trailmark.estimation import save_log
from trailmark.world import Query, World

Shell = Callable[..., Any]

ROBOT = "--robot disc:0.2"
NAV2 = "image: {}\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\n"
MESH = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><library_geometries>
<geometry id="g"><mesh><source id="p"><float_array id="a" count="9">{}</float_array><technique_common>
<accessor source="#a" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source><vertices id="v">
<input semantic="POSITION" source="#p"/></vertices><triangles count="1">
<input semantic="VERTEX" source="#v" offset="0"/>
<p>0 1 2</p></triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes><scene>
<instance_visual_scene url="#s"/></scene></COLLADA>"""
CFG = "[problem]\nrobot = robot.yml\nworld = mesh.yaml\n" + "".join(
    f"{name} = {value}\n"
    for name, value in (
        *(("start.x", 1), ("start.y", 1), ("start.theta", 0), ("goal.x", 8), ("goal.y", 8), ("goal.theta", 0)),
        *(("volume.min.x", 0), ("volume.min.y", 0), ("volume.max.x", 10), ("volume.max.y", 10)),
    )
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of inputs, whose names outputs may have too."""
    monkeypatch.chdir(tmp_path)
    image = Image.fromarray(np.full((20, 30), 254, dtype=np.uint8))
    image.save(tmp_path / "map.png")
    image.save(tmp_path / "image.yaml", "PNG")  # a map's image may be called anything
    (tmp_path / "soft.png").symlink_to(tmp_path / "map.png")
    os.link(tmp_path / "map.png", tmp_path / "hard.png")
    (tmp_path / "map.yaml").write_text(NAV2.format("map.png"))
    (tmp_path / "other.yaml").write_text(NAV2.format("image.yaml"))
    query = Query("along", (0.5, 1.0, 0.0), (2.5, 1.0, 0.0))
    World("own", (0.0, 0.0, 3.0, 2.0), queries=(query,)).save(tmp_path / "own.yaml")
    (tmp_path / "grid.map").write_text("type octile\nheight 2\nwidth 3\nmap\n...\n...\n")
    (tmp_path / "grid.map.scen").write_text("version 1\n0\tgrid.map\t3\t2\t0\t0\t2\t1\t2.4\n")
    (tmp_path / "scen.yaml").symlink_to(tmp_path / "grid.map.scen")
    (tmp_path / "mesh.yaml").write_text(MESH.format("0 0 0 5 0 0 0 0 5"))
    (tmp_path / "robot.yml").write_text(MESH.format("0 0 0 1 0 0 0 0 1"))
    (tmp_path / "problem.cfg").write_text(CFG)
    save_log(recorded(), tmp_path / "drive.yaml")
    write_mrclam(tmp_path / "robots")
    for file in list((tmp_path / "robots").iterdir()):
        (tmp_path / f"{file.stem}.yaml").symlink_to(file)
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 5\n")
    random_results(tmp_path / "results.html", ["landmark", "PRM"], problems=1, runs=3)
    (tmp_path / "suite.log").write_text("worlds: [own.yaml]\nplanners: [landmark]\n")
    with closing(sqlite3.connect(tmp_path / "mine.db")) as db:
        db.execute("CREATE TABLE mine (a)")
        db.commit()
    (tmp_path / "notes.txt").write_text("buy milk\n" * 1000)
    return tmp_path


SAME = "same file"
CASES = [
    *((f"plan map.yaml {ROBOT} --start 0.5,0.5,0 --goal 2,1,0 --plot {x}.png", SAME) for x in ("map", "soft", "hard")),
    (f"landmarks map.yaml {ROBOT} -k 2 -n 50 --plot hard.png", SAME),
    ("worlds show map.yaml --plot soft.png", SAME),
    ("worlds convert other.yaml other.yaml", SAME),
    ("worlds convert other.yaml image.yaml", SAME),
    ("worlds convert own.yaml own.yaml", SAME),
    ("worlds convert grid.map scen.yaml", SAME),
    ("worlds convert problem.cfg mesh.yaml", SAME),
    ("worlds convert problem.cfg robot.yml", SAME),
    ("map drive.yaml --output drive.yaml", SAME),
    *((f"map robots:1 --output {name}.yaml", SAME) for name in ("Robot1_Odometry", "Robot1_Measurement", "Barcodes")),
    ("map bag --output bag/metadata.yaml", SAME),
    ("report results.html --html results.html", SAME),
    (f"benchmark own.yaml {ROBOT} -p landmark --output own.yaml", SAME),
    (f"benchmark --suite suite.log {ROBOT} --output suite.log", SAME),
    (f"benchmark own.yaml {ROBOT} -p landmark --output mine.db", "did not write"),
    (f"benchmark own.yaml {ROBOT} -p landmark --output notes.txt", "no SQLite database"),
]


def test_what_was_read_is_not_replaced(shell: Shell, folder: Path, planner: Any) -> None:
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    for words, said in CASES:
        run = shell(*words.split())
        assert (run.status, said in run.problem) == (2, True), words
        assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before, words
    assert planner.calls == []
    for words in ("worlds convert other.yaml new.yaml", "report results.html --html page.html"):
        for _ in range(2):  # what was written is written again
            assert shell(*words.split()).status == 0
