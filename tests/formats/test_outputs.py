from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from trailmark.errors import OutputError
from trailmark.formats.outputs import require_not_an_input, require_replaceable
from trailmark.formats.path_files import SUFFIXES, write_path
from trailmark.plotting import save_world_figure
from trailmark.world import World

NAV2 = "image: yard.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\n"


def picture(file: Path) -> Path:
    Image.fromarray(np.full((20, 30), 254, dtype=np.uint8)).save(file)
    return file


def test_an_input_is_known_by_whatever_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sub").mkdir()
    real = picture(tmp_path / "real.png")
    (tmp_path / "soft.png").symlink_to(real)
    (tmp_path / "dir").symlink_to(tmp_path)
    os.link(real, tmp_path / "hard.png")
    monkeypatch.chdir(tmp_path)
    names = ["real.png", "./real.png", "sub/../real.png", "soft.png", "hard.png", "dir/real.png", str(real)]
    for name in names:
        with pytest.raises(OutputError, match=r"expected another file") as caught:
            require_not_an_input(Path(name), [Path("nowhere"), real])
        assert str(caught.value).startswith(str(Path(name)))
    picture(tmp_path / "other.png")
    for name in ("other.png", "new.png", "sub", "/dev/null"):
        require_not_an_input(Path(name), [real, Path("/dev/null"), Path("x" * 400), Path("nul\0")])


FOREIGN = {
    "map.yaml": NAV2,
    "compose.yml": "# services\nservices:\n  web: {image: x}\n",
    "photo.png": "not by trailmark",
    "drawing.svg": "<svg xmlns='http://www.w3.org/2000/svg'/>",
    "paper.pdf": "%PDF-1.4 something",
    "page.html": "<html>mine</html>",
    "README.md": "# trailmark\n\nMotion planning; `trailmark report` makes tables.\n",
    "settings.json": '{"key": 1}',
    "list.json": "[1, 2]",
    "table.csv": "time,value\n1,2\n",
    "notes.txt": "buy milk\n",
    "rows.path": "1 2 3\n4 5\n",
    "server.log": "12:00 started\n",
    "binary.csv": "\0\1\2",
    "nav2_params.yaml": "bt_navigator:\n  ros__parameters:\n    use_sim_time: True\n",
    "flow.yaml": "# in one line\n{services: {web: {image: x}}}\n",
    "recorded.yaml": "header:\n  frame_id: map\nposes:\n- pose: 1\n",
    "recorded.nav2.json": '{"header": {"stamp": {"sec": 7, "nanosec": 0}, "frame_id": "map"}, "poses": []}',
    "world.yaml": "trailmark: 1\nname: by hand\nbounds: [0, 0, 1, 1]\n",
    "compose.yaml": "services: {}\ntrailmark: {image: x}\n",
    "waypoints.csv": "x,y,theta\n1,2,0\n",
    "measured.csv": "x, y, theta\n1.0, 2.0, 0.0\n",
    "loads.txt": "1.0 2.0 3.50\n",
    "solution.path": "1 2 0.5 \n3 4 0.5 \n",
    "commented.txt": "# mine\n1.0 2.0 3.0\n",
    "unended.txt": "1.0 2.0 3.0",
    "params.yaml": "/**:\n  ros__parameters:\n    use_sim_time: true\n",
    "play.yaml": "- hosts: all\n  tasks: []\n",
    "bom.json": '\ufeff{"a": 1}\n',
    "commented.json": '// x\n{"a": 1}\n',
    "word.json": '"text"',
    "semicolons.csv": "a;b;c\n1;2;3\n",
    "versions.yaml": "project: {}\ntrailmark: 1.5.0\n",
    "places.json": '{"states": ["Bavaria"], "status": "ok"}',
    "long.json": '{"states": ["' + 70_000 * "x" + '"], "meta": {"status": "ok"}}',
    "machine.json": '{"states": ["off", "on"]}',
    "graph.geojson": '{"type": "FeatureCollection", "features": []}',
    "graph.graphml": "<graphml/>",
    "arrays.npz": "PK",
}


@pytest.mark.parametrize("name", FOREIGN)
def test_files_of_others_are_kept(tmp_path: Path, name: str) -> None:
    file = tmp_path / name
    file.write_text(FOREIGN[name])
    with pytest.raises(OutputError, match=r"a file that trailmark did not write is there"):
        require_replaceable(file)
    assert file.read_text() == FOREIGN[name]


@pytest.mark.parametrize("name", ["new.yaml", "empty.json", "folder.yaml"])
def test_nothing_is_in_the_way(tmp_path: Path, name: str) -> None:
    content = {"empty.json": " \n"}
    if name in content:
        (tmp_path / name).write_text(content[name])
    elif name == "folder.yaml":
        (tmp_path / name).mkdir()  # told by whoever writes
    require_replaceable(tmp_path / name)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_own_pictures_are_written_again(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"world{suffix}"
    save_world_figure(file, World("yard", (0.0, 0.0, 3.0, 2.0)))
    require_replaceable(file)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("rows", [1, 4_000])  # the longer file is longer than what is read of it
def test_own_paths_are_written_again(tmp_path: Path, suffix: str, rows: int) -> None:
    file = tmp_path / f"path{suffix}"
    states = np.random.default_rng(0).normal(size=(rows, 3))
    states[:, 0] *= 1e-7
    write_path(file, states)
    require_replaceable(file)
    if suffix == ".json":
        file.write_text(json.dumps({"world": "yard", "status": "timeout", "states": []}))
        require_replaceable(file)
        write_path(file, states, {"states": None, "settings": 70_000 * "x", "cost": 1.0})
        require_replaceable(file)


def test_own_worlds_are_written_again_and_maps_are_not(tmp_path: Path) -> None:
    world = World("yard", (0.0, 0.0, 3.0, 2.0))
    own = tmp_path / "own.yaml"
    world.save(own)
    require_replaceable(own)
    World.load(own).save(own)  # as somebody who edits it does

    picture(tmp_path / "yard.pgm")
    (tmp_path / "map.yaml").write_text(NAV2)
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    loaded = World.load(tmp_path / "map.yaml")
    assert set(loaded.sources) == {tmp_path / "map.yaml", tmp_path / "yard.pgm"}
    for name in ("map.yaml", "yard.pgm"):
        with pytest.raises(OutputError, match="same file as the input"):
            loaded.save(tmp_path / name)
        with pytest.raises(OutputError, match="trailmark did not write"):
            world.save(tmp_path / name)
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_picture_never_replaces_the_map_it_shows(tmp_path: Path) -> None:
    image = picture(tmp_path / "yard.png")
    (tmp_path / "map.yaml").write_text(NAV2.replace("pgm", "png"))
    before = image.read_bytes()
    with pytest.raises(OutputError, match="same file as the input"):
        save_world_figure(image, World.load(tmp_path / "map.yaml"))
    assert image.read_bytes() == before


def test_sources_are_no_part_of_a_world(tmp_path: Path) -> None:
    world = World("yard", (0.0, 0.0, 3.0, 2.0))
    world.save(tmp_path / "yard.yaml")
    again = World.load(tmp_path / "yard.yaml")
    assert again.sources == (tmp_path / "yard.yaml",)
    assert (again, hash(again), repr(again)) == (world, hash(world), repr(world))
