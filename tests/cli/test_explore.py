"""``trailmark explore``: its options, what it writes, and how it ends; the loop itself is tested apart."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.helpers.made_exploration import ROOMS, made_exploration

from trailmark.exploration import Explorer
from trailmark.exploration.result import FILES, Status, load_exploration, summary_of

Shell = Callable[..., Any]


class FakeExplorer:
    """Stands in for Explorer: notes what it is asked, and returns an exploration made by hand."""

    calls: list[dict[str, Any]]
    status: Status = "complete"
    ended = None

    def __init__(self, world: Any, robot: Any, sensor: Any, **options: Any) -> None:
        type(self).calls.append({"world": world, "robot": robot, "sensor": sensor, **options})

    def run(self, on_progress: Any) -> Any:
        result = made_exploration()
        history = (*result.history[::90], result.history[-1])  # few frames are drawn sooner
        for row in history:
            on_progress(row)
        return replace(result, status=self.status, history=history)


@pytest.fixture
def explorer(monkeypatch: pytest.MonkeyPatch) -> type[FakeExplorer]:
    fake = type("Fake", (FakeExplorer,), {"calls": []})
    monkeypatch.setattr("trailmark.exploration.explorer.Explorer", fake)
    return fake


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the three pictures out, which take longer than all else, where they are not what is tested."""
    monkeypatch.setattr("trailmark.cli.explore._draw", lambda result, folder: None)


UNDRAWN = sorted(name for name in FILES if Path(name).stem != "exploration")
"""What is written but pictures and the page."""


@pytest.fixture
def rooms(tmp_path: Path) -> Path:
    ROOMS.save(tmp_path / "rooms.yaml")
    return tmp_path / "rooms.yaml"


START = ("--start", "1,1,0")


@pytest.mark.slow
def test_everything_is_written(shell: Shell, rooms: Path, tmp_path: Path, explorer: type[FakeExplorer]) -> None:
    status: Status
    for status, ends in (("interrupted", 130), ("complete", 0)):  # the second time each file is written again
        explorer.status = status
        run = shell("explore", rooms, *START, "--output", tmp_path / "run")
        assert (run.status, run.err) == (ends, "trailmark: error: interrupted\n" if ends else "")
        assert sorted(file.name for file in (tmp_path / "run").iterdir()) == sorted(FILES)
        assert f"rooms: {status}" in run.out
    for said in (
        "rooms: complete",
        "99.80% of the visible area seen, 0 collisions, NEES 2.90",
        "8.77 m",
        "4 driven to",
    ):
        assert said in run.out
    assert str(tmp_path / "run") in run.out


@pytest.mark.usefixtures("undrawn")
def test_the_world_that_is_explored_is_not_replaced(
    shell: Shell, rooms: Path, tmp_path: Path, explorer: type[FakeExplorer]
) -> None:
    shell("explore", rooms, *START, "--output", tmp_path / "run")
    before = (tmp_path / "run" / "world.yaml").read_bytes()
    run = shell("explore", tmp_path / "run" / "world.yaml", *START, "--output", tmp_path / "run")
    assert (run.status, len(explorer.calls)) == (2, 1)
    assert "is the same file as the input" in run.problem
    assert (tmp_path / "run" / "world.yaml").read_bytes() == before


@pytest.mark.usefixtures("undrawn")
def test_json_is_the_summary(shell: Shell, rooms: Path, tmp_path: Path, explorer: type[FakeExplorer]) -> None:
    run = shell("explore", rooms, *START, "--output", tmp_path / "run", "--json")
    assert (run.status, run.err) == (0, "")
    assert json.loads(run.out) == json.loads((tmp_path / "run" / "summary.json").read_text())
    assert json.loads(run.out) == summary_of(made_exploration())


@pytest.mark.usefixtures("undrawn")
def test_options_reach_the_explorer(shell: Shell, rooms: Path, tmp_path: Path, explorer: type[FakeExplorer]) -> None:
    words = ["--robot", "disc:0.2", "--sensor-range", "2.5", "--strategy", "gain-per-cost", "--confidence", "0.99"]
    words += ["--noise", "0.5", "--seed", "7", "--time-limit", "60", "--max-distance", "9", "--return-home"]
    shell("explore", rooms, "--start", "1,1,90deg", *words, "--output", tmp_path / "run")
    shell("explore", "office", "--sensor", "detections", "--output", tmp_path / "other")
    first, second = explorer.calls
    assert first["robot"].describe() == "disc 0.2 m"
    assert (type(first["sensor"]).__name__, first["sensor"].max_range) == ("Scanner", 2.5)
    assert first["start"] == pytest.approx((1.0, 1.0, 1.5707963))
    assert (first["strategy"], first["seed"], first["noise"], first["resumed"]) == ("gain-per-cost", 7, 0.5, None)
    settings = first["settings"]
    assert (settings.confidence, settings.time_limit, settings.distance_limit) == (0.99, 60.0, 9.0)
    assert settings.return_home
    assert (type(second["sensor"]).__name__, second["sensor"].max_range) == ("Detector", 4.0)
    assert second["start"] == second["world"].queries[0].start
    assert (second["strategy"], second["seed"], second["noise"]) == ("tour", 0, 1.0)
    assert not second["settings"].return_home


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("status", "exit_status"), [("time", 0), ("distance", 0), ("stuck", 3), ("silent", 3)])
def test_how_it_ended_is_the_exit_status(
    shell: Shell, rooms: Path, tmp_path: Path, explorer: type[FakeExplorer], status: Status, exit_status: int
) -> None:
    explorer.status = status
    run = shell("explore", rooms, *START, "--output", tmp_path / "run", "--json")
    assert run.status == exit_status
    assert json.loads(run.out)["status"] == status


@pytest.mark.usefixtures("undrawn")
def test_an_interruption_keeps_all_and_is_gone_on_with(
    shell: Shell, rooms: Path, tmp_path: Path, explorer: type[FakeExplorer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    explorer.status = "interrupted"
    run = shell("explore", "rooms.yaml", *START, "--seed", "5", "--sensor-range", "3", "--output", "run")
    assert run.status == 130
    assert run.err == "trailmark: error: interrupted\n"
    assert "rooms: interrupted" in run.out
    assert sorted(file.name for file in (tmp_path / "run").iterdir()) == UNDRAWN

    explorer.status = "complete"
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")  # the world is found all the same
    run = shell("explore", "--resume", "../run", "--strategy", "nearest-frontier")
    assert (run.status, run.err) == (0, "")
    before, after = explorer.calls
    for name in ("robot", "sensor", "start", "seed", "noise"):
        assert after[name] == before[name]
    assert after["strategy"] == "nearest-frontier"
    assert after["resumed"].history[-1].distance == made_exploration().history[-1].distance
    assert load_exploration("../run").options["strategy"] == "nearest-frontier"


SMALL = """\
trailmark: 1
name: small
bounds: [0.0, 0.0, 3.2, 2.4]
robot: {shape: disc, radius: 0.25}
obstacles:
  - {shape: rectangle, center: [1.6, 0.6], length: 0.2, width: 1.2}
queries:
  - {name: across, start: [0.7, 0.7, 0.0], goal: [2.5, 0.7, 0.0]}
"""


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("number", "impatient"), [(signal.SIGINT, False), (signal.SIGTERM, True)])
def test_ctrl_c_in_the_middle_and_on_to_the_end(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, impatient: bool
) -> None:
    file, folder, step, steps = tmp_path / "small.yaml", tmp_path / "run", Explorer.step, list[float]()
    file.write_text(SMALL)

    def interrupted(explorer: Explorer) -> Any:
        progress = step(explorer)
        steps.append(progress.time)
        if len(steps) == 8:
            os.kill(os.getpid(), number)
        return progress

    monkeypatch.setattr(Explorer, "step", interrupted)
    if impatient:  # pressed again while the final map is built

        def again(explorer: Explorer) -> Any:
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(Explorer, "result", again)
            run = shell("explore", file, "--sensor-range", "2", "--output", folder)
        assert sorted(kept.name for kept in folder.iterdir()) == ["log.jsonl", "resume.npz"]
    else:
        run = shell("explore", file, "--sensor-range", "2", "--output", folder)
        assert sorted(kept.name for kept in folder.iterdir()) == UNDRAWN
        assert json.loads((folder / "summary.json").read_text())["status"] == "interrupted"
    assert run.status == 130
    assert run.err.endswith("trailmark: error: interrupted\n")
    first = load_exploration(folder)
    assert len(first.history) == 8

    run = shell("explore", "--resume", folder, "--json")
    assert run.status == 0
    summary, second = json.loads(run.out), load_exploration(folder)
    assert summary["status"] == "complete"
    assert summary["collisions"] == 0
    assert summary["seen"] > 0.95  # with noise it keeps away from walls, behind which 3 % of so small a world may lie
    assert len(second.history) > len(first.history)
    assert [row.time for row in second.history[: len(first.history)]] == [row.time for row in first.history]
    assert second.history[-1].distance > first.history[-1].distance
    assert len(second.log.records) > len(first.log.records)
    assert (second.first_known <= first.first_known).all()


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_whatever_goes_wrong_what_was_mapped_is_kept(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, folder, step = tmp_path / "small.yaml", tmp_path / "run", Explorer.step
    file.write_text(SMALL)

    def fails(explorer: Explorer) -> Any:
        if len(explorer.history) == 8:
            raise RuntimeError("the sensor's driver")
        return step(explorer)

    with monkeypatch.context() as patch:
        patch.setattr(Explorer, "step", fails)
        with pytest.raises(RuntimeError, match="the sensor's driver"):
            shell("explore", file, "--sensor-range", "2", "--output", folder)
    assert sorted(kept.name for kept in folder.iterdir()) == ["log.jsonl", "resume.npz"]
    assert len(load_exploration(folder).history) == 8
    run = shell("explore", "--resume", folder, "--json")
    assert run.status == 0
    assert json.loads(run.out)["status"] == "complete"
