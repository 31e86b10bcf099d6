"""No output replaces what a command read."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tests.cli.logs import recorded, write_mrclam
from tests.helpers.made_results import random_results

from trailmark.estimation import save_log
from trailmark.world import World

Shell = Callable[..., Any]

ROBOT = ["--robot", "disc:0.2"]
ENDS = ["--start", "0.5,0.5,0", "--goal", "2.5,1.5,0"]
MESH = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><library_geometries>
<geometry id="g"><mesh><source id="p"><float_array id="a" count="9">{}</float_array><technique_common>
<accessor source="#a" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source><vertices id="v">
<input semantic="POSITION" source="#p"/></vertices><triangles count="1">
<input semantic="VERTEX" source="#v" offset="0"/>
<p>0 1 2</p></triangles></mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node>
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes><scene>
<instance_visual_scene url="#s"/></scene></COLLADA>"""
CFG = """[problem]
robot = {robot}
world = {world}
start.x = 1
start.y = 1
start.theta = 0
goal.x = 8
goal.y = 8
goal.theta = 0
volume.min.x = 0
volume.min.y = 0
volume.max.x = 10
volume.max.y = 10
"""


@pytest.fixture
def nav2(tmp_path: Path) -> Path:
    """A map whose image has a name that pictures have too."""
    Image.fromarray(np.full((20, 30), 254, dtype=np.uint8)).save(tmp_path / "testmap.png")
    file = tmp_path / "testmap.yaml"
    file.write_text("image: testmap.png\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\n")
    return file


def kept(shell: Shell, folder: Path, *words: object) -> str:
    """Run a command that must be refused and change nothing; return what it says."""
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    run = shell(*words)
    assert run.status == 2
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before
    return str(run.problem)


@pytest.mark.parametrize("name", ["testmap.png", "soft.png", "hard.png"])
@pytest.mark.parametrize("command", ["plan", "landmarks", "show"])
def test_a_picture_never_destroys_the_map(
    shell: Shell, nav2: Path, tmp_path: Path, planner: Any, command: str, name: str
) -> None:
    image = tmp_path / "testmap.png"
    (tmp_path / "soft.png").symlink_to(image)
    os.link(image, tmp_path / "hard.png")
    words: list[object] = {
        "plan": ["plan", nav2, *ROBOT, *ENDS],
        "landmarks": ["landmarks", nav2, *ROBOT, "-k", 2, "-n", 50],
        "show": ["worlds", "show", nav2],
    }[command]
    said = kept(shell, tmp_path, *words, "--plot", tmp_path / name)
    assert "same file" in said
    assert planner.calls == []


@pytest.mark.parametrize("name", ["testmap.yaml", "image.yaml"])
def test_convert_keeps_map_and_image(shell: Shell, nav2: Path, tmp_path: Path, name: str) -> None:
    shutil.move(tmp_path / "testmap.png", tmp_path / "image.yaml")  # a map's image may be called anything
    nav2.write_text(nav2.read_text().replace("testmap.png", "image.yaml"))
    kept(shell, tmp_path, "worlds", "convert", nav2, tmp_path / name)
    assert shell("worlds", "convert", nav2, tmp_path / "new.yaml").status == 0
    assert shell("worlds", "convert", nav2, tmp_path / "new.yaml").status == 0
    assert "same file" in kept(shell, tmp_path, "worlds", "convert", tmp_path / "new.yaml", tmp_path / "new.yaml")


def test_convert_keeps_scenarios_and_meshes(shell: Shell, tmp_path: Path) -> None:
    grid = tmp_path / "grid.map"
    grid.write_text("type octile\nheight 2\nwidth 3\nmap\n...\n...\n")
    scenario = tmp_path / "grid.map.scen"
    scenario.write_text("version 1\n0\tgrid.map\t3\t2\t0\t0\t2\t1\t2.4\n")
    (tmp_path / "link.yaml").symlink_to(scenario)
    assert "same file" in kept(shell, tmp_path, "worlds", "convert", grid, tmp_path / "link.yaml")
    assert scenario in World.load(grid).sources
    (tmp_path / "world.yaml").write_text(MESH.format("0 0 0 5 0 0 0 0 5"))
    (tmp_path / "robot.yml").write_text(MESH.format("0 0 0 1 0 0 0 0 1"))
    problem = tmp_path / "problem.cfg"
    problem.write_text(CFG.format(robot="robot.yml", world="world.yaml"))
    for name in ("world.yaml", "robot.yml"):
        assert "same file" in kept(shell, tmp_path, "worlds", "convert", problem, tmp_path / name)
        assert tmp_path / name in World.load(problem).sources


def test_map_keeps_the_log(shell: Shell, tmp_path: Path) -> None:
    log = tmp_path / "drive.yaml"
    save_log(recorded(), log)
    assert "same file" in kept(shell, tmp_path, "map", log, "--output", log)
    folder = tmp_path / "robots"
    write_mrclam(folder)
    for name in list(folder.iterdir()):
        link = tmp_path / f"{name.stem}.yaml"
        link.symlink_to(name)
        kept(shell, tmp_path, "map", f"{folder}:1", "--output", link)
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 5\n")
    kept(shell, tmp_path, "map", bag, "--output", bag / "metadata.yaml")


def test_report_keeps_the_results(shell: Shell, tmp_path: Path) -> None:
    results = random_results(tmp_path / "results.html", ["landmark", "PRM"], problems=1, runs=3)
    kept(shell, tmp_path, "report", results, "--html", results)
    for _ in range(2):
        assert shell("report", results, "--html", tmp_path / "page.html").status == 0


@pytest.mark.slow
def test_benchmark_keeps_worlds_suite_and_databases_of_others(shell: Shell, yard: Path, tmp_path: Path) -> None:
    words = ["benchmark", yard, "-p", "landmark", "--runs", 1]
    assert "same file" in kept(shell, tmp_path, *words, "--output", yard)
    suite = tmp_path / "suite.log"
    suite.write_text("worlds: [yard.yaml]\nplanners: [landmark]\n")
    kept(shell, tmp_path, "benchmark", "--suite", suite, "--output", suite)
    other = tmp_path / "other.db"
    with closing(sqlite3.connect(other)) as db:
        db.execute("CREATE TABLE mine (a)")
        db.commit()
    assert "did not write" in kept(shell, tmp_path, *words, "--output", other)
    notes = tmp_path / "notes.txt"
    notes.write_text("buy milk\n" * 1000)
    assert "no SQLite database" in kept(shell, tmp_path, *words, "--output", notes)
