"""trailmark plan for cars: what is asked of the planner, what is printed, written and drawn, what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.curves import CurvePath, Steering
from trailmark.formats.any_path import read_any_path
from trailmark.world import Robot

Shell = Callable[..., Any]


@pytest.fixture
def cars(yard: Path) -> Path:
    text = yard.read_text()
    yard.write_text(text.replace("width: 0.4}", "width: 0.4, turning_radius: 0.9}"))
    return yard


def test_options_make_the_robot_a_car(shell: Shell, yard: Path, planner: Any) -> None:
    box = Robot.rectangle(0.8, 0.4)
    for words, robot in (
        ([], box),
        (["--turning-radius", "1.5"], box.steered(1.5)),
        (["--turning-radius", "1.5", "--forward-only"], box.steered(1.5, reverse=False)),
        (["--robot", "disc:0.2", "--turning-radius", "2"], Robot.disc(0.2).steered(2.0)),
    ):
        assert shell("plan", yard, *words).status == 0
        assert planner.calls[-1]["robot"] == robot


def test_options_override_the_files_car(shell: Shell, cars: Path, planner: Any) -> None:
    box = Robot.rectangle(0.8, 0.4)
    for words, robot in (
        ([], box.steered(0.9)),
        (["--forward-only"], box.steered(0.9, reverse=False)),
        (["--turning-radius", "1.5"], box.steered(1.5)),
        # Another robot is another robot.
        (["--robot", "disc:0.2"], Robot.disc(0.2)),
    ):
        assert shell("plan", cars, *words).status == 0
        assert planner.calls[-1]["robot"] == robot


def test_a_differential_drive_reverses_as_its_file_and_the_options_say(shell: Shell, yard: Path, planner: Any) -> None:
    text = yard.read_text()
    yard.write_text(text.replace("width: 0.4}", "width: 0.4, drive: differential, reverse: true}"))
    box = Robot.rectangle(0.8, 0.4)
    for words, reverse in (
        ([], True),
        (["--drive", "differential"], True),
        (["--forward-only"], False),
        (["--drive", "differential", "--forward-only"], False),
    ):
        assert shell("plan", yard, *words).status == 0
        assert planner.calls[-1]["robot"] == box.differential(reverse)


@pytest.mark.slow
def test_from_end_to_end(shell: Shell, cars: Path, tmp_path: Path) -> None:
    files, picture = [tmp_path / f"path{suffix}" for suffix in (".json", ".csv", ".path")], tmp_path / "plan.svg"
    for file, drawn in zip(files, [("--plot", picture), (), ()], strict=True):
        run = shell("plan", cars, "--json", "--output", file, *drawn, "--time-limit", "20", "--max-iterations", "1")
        assert run.status == 0
        record = json.loads(run.out)
        curve = record["curve"]
        path = CurvePath(np.array(curve["knots"]), Steering(curve["turning_radius"], curve["kind"] == "reeds-shepp"))
        assert curve["turning_radius"] == 0.9
        assert record["cost"] == record["length"] == path.length
        assert record["lower_bound"] <= record["cost"] + 1e-9
        assert np.array_equal(read_any_path(file).path.states, path.states)
    assert picture.stat().st_size > 10_000


@pytest.mark.slow
def test_the_summary_tells_of_the_curves(shell: Shell, cars: Path) -> None:
    run = shell("plan", cars, "--forward-only", "--time-limit", "20", "--max-iterations", "1")
    assert run.status == 0
    assert "Dubins, turning radius 0.9 m, 0 changes of direction" in run.out


@pytest.mark.slow
def test_costs_of_maneuvers(shell: Shell, worlds: Path) -> None:
    given = ("plan", worlds / "parking.yaml", "--query", "bay", "--turning-radius", "4.5", "--max-iterations", "1")
    run = shell(*given, "--direction-change-cost", "2", "--reverse-cost", "1.2", "--json")
    assert run.status == 0
    record = json.loads(run.out)
    assert record["objective"]["direction_change"] == 2.0
    maneuvers = 2.0 * record["direction_changes"] + 0.2 * record["reverse_length"]
    assert record["cost"] == pytest.approx(record["length"] + maneuvers)
    assert "objective" not in json.loads(shell(*given, "--objective", "length", "--json").out)
    assert "a change of direction 3 m" in shell(*given).out
