"""The folder of an exploration: what is written is read back, by other readers too, and nothing foreign is replaced."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image
from tests.helpers.made_exploration import made_exploration

from trailmark import FormatError, OutputError, Roadmap, StateChecker, World
from trailmark.estimation import load_log
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN
from trailmark.exploration.result import FILES, Evaluation, check_folder, load_exploration, save_exploration, summary_of

DATA = [name for name in FILES if not name.startswith("exploration")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("kept") / "run"
    files = save_exploration(made_exploration(), made, {"sensor_range": 3.0})
    assert sorted(files) == sorted(made.iterdir()) == sorted(made / name for name in DATA)
    return made


def test_what_is_kept_is_read_back(folder: Path) -> None:
    result = made_exploration()
    world = World.load(folder / "world.yaml")
    assert world.obstacles == result.world.obstacles
    roadmap = Roadmap.load(folder / "roadmap.npz", StateChecker(world, world.robot))
    assert np.array_equal(roadmap.configurations, result.roadmap.configurations)
    assert roadmap.certified.all()
    assert len(load_log(folder / "log.jsonl").records) == len(result.log.records)
    assert json.loads((folder / "summary.json").read_text()) == summary_of(result)


def test_the_nav2_map_holds_the_cells(folder: Path) -> None:
    known = made_exploration().known
    with Image.open(folder / "map.pgm") as image:
        grey = np.asarray(image)[::-1]
    for state, value in ((UNKNOWN, 205), (FREE, 254), (OCCUPIED, 0)):
        assert np.array_equal(grey == value, known.state == state)
    world = World.load(folder / "map.yaml")
    blocked = shapely.union_all([shape.polygon().shapely() for shape in world.obstacles])
    assert blocked.area == pytest.approx((known.state != FREE).sum() * known.cell**2)
    assert world.bounds == pytest.approx(known.bounds)


def test_the_summary_has_what_the_contract_names() -> None:
    found = summary_of(made_exploration())
    assert {"world", "strategy", "seed", "status", "reason", "seen", "distance", "landmarks", "collisions"} <= set(
        found
    )
    assert set(found["time"]) == {"total", "decision_median", "decision_max"}
    assert (found["seen"], found["collisions"], found["nees"]) == (0.998, 0, 2.9)
    real = summary_of(replace(made_exploration(), evaluation=None))
    assert (real["seen"], real["collisions"], real["nees"]) == (None, None, None)
    exact = summary_of(replace(made_exploration(), evaluation=Evaluation(1.0, 0, np.nan), decisions=np.empty(0)))
    assert exact["nees"] is None
    assert exact["time"] == {"total": 1.5, "decision_median": 0.0, "decision_max": 0.0}
    json.dumps(exact, allow_nan=False)


@pytest.mark.slow
def test_what_going_on_needs_is_read_back(folder: Path) -> None:
    result, saved = made_exploration(), load_exploration(folder)
    assert saved.robot_state == {"truth": [[0.0, 1.0, 1.0, 0.0]]}
    assert saved.options == {"sensor_range": 3.0}
    assert (saved.seconds, saved.decisions.tolist()) == (result.seconds, result.decisions.tolist())
    assert np.array_equal(saved.first_known, result.first_known)
    assert [row.event for row in saved.history] == [row.event for row in result.history]
    assert repr(saved.log.records) == repr(result.log.records)


def test_all_of_it_may_be_written_again(folder: Path) -> None:
    before = {file.name: file.read_bytes() for file in folder.iterdir()}
    save_exploration(made_exploration(), folder, {"sensor_range": 3.0})
    after = {file.name: file.read_bytes() for file in folder.iterdir()}
    assert before.keys() == after.keys()
    assert all(before[name] == after[name] for name in DATA if not name.endswith(".npz"))


def test_a_place_that_can_be_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="expected a folder, got a file"):
        check_folder(tmp_path / "file")
    with pytest.raises(OutputError, match="does not exist"):
        check_folder(tmp_path / "no" / "run")
    with pytest.raises(OutputError, match="cannot be written"):
        check_folder(tmp_path / ("x" * 400))
    with pytest.raises(OutputError, match="cannot be written"):
        check_folder("nul\0")
    check_folder(tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_what_is_no_exploration_is_not_gone_on_with(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="expected a folder that trailmark explore wrote"):
        load_exploration(tmp_path)
    data, log = (folder / "resume.npz").read_bytes(), (folder / "log.jsonl").read_text()
    (tmp_path / "log.jsonl").write_text(log)
    for bad in (b"", b"PK", data[: len(data) // 2], data[:200] + bytes(200) + data[400:]):
        (tmp_path / "resume.npz").write_bytes(bad)
        with pytest.raises(FormatError, match="not a file that trailmark explore wrote"):
            load_exploration(tmp_path)
    (tmp_path / "resume.npz").write_bytes(data)
    (tmp_path / "log.jsonl").write_text("\n".join(log.splitlines()[:-3]))
    with pytest.raises(FormatError, match=r"expected the log\.jsonl that was written with it"):
        load_exploration(tmp_path)
    (tmp_path / "log.jsonl").unlink()
    with pytest.raises(FormatError, match=r"log\.jsonl: cannot be read"):
        load_exploration(tmp_path)
