"""trailmark check: verdict, exit status, JSON, repair, and what it refuses."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.formats.any_path import read_any_path
from trailmark.formats.path_files import write_path

Shell = Callable[..., Any]

KEYS = [
    *("world", "free", "collisions", "min_clearance", "min_clearance_at", "length", "rotation", "cost"),
    *("lower_bound", "max_curvature"),
]
FREE = [[1.0, 1.0, 0.0], [9.0, 1.0, 0.0], [9.0, 5.0, 1.5]]
THROUGH = [[1.0, 3.0, 0.0], [9.0, 3.0, 0.0]]


@pytest.fixture
def paths(tmp_path: Path) -> Callable[[str, Any], Path]:
    def write(name: str, states: Any) -> Path:
        write_path(tmp_path / name, states)
        return tmp_path / name

    return write


@pytest.mark.slow
def test_a_free_path(shell: Shell, yard: Path, paths: Any) -> None:
    run = shell("check", yard, paths("a.csv", FREE), "--json")
    record = json.loads(run.out)
    assert run.status == 0
    assert list(record) == KEYS
    assert (record["world"], record["free"], record["collisions"]) == ("yard", True, [])
    assert record["length"] == 12.0
    assert record["cost"] == pytest.approx(12.75)
    assert record["min_clearance"] == pytest.approx(1 - math.hypot(0.4, 0.2), abs=1e-6)  # a corner at the right bound
    assert 0 < record["lower_bound"] <= record["cost"]
    assert record["max_curvature"] == pytest.approx(2 * math.sin(0.75) / 4)
    text = shell("check", yard, paths("a.csv", FREE)).out
    assert text.startswith("yard: free\n")
    assert "above the lower bound" in text


def test_a_path_that_collides(shell: Shell, yard: Path, paths: Any) -> None:
    run = shell("check", yard, paths("a.json", THROUGH), "--json")
    record = json.loads(run.out)
    assert run.status == 5
    (hit,) = record["collisions"]
    assert list(hit) == ["from", "to", "obstacle", "depth"]
    assert (hit["from"], hit["to"]) == pytest.approx((2.6, 5.4), abs=1e-6)
    assert hit["obstacle"] == 0
    assert hit["depth"] == pytest.approx(1.2, rel=1e-3)
    assert (record["free"], record["min_clearance"]) == (False, 0.0)
    text = shell("check", yard, paths("a.json", THROUGH)).out
    assert text.startswith("yard: the path collides\n")
    assert "obstacle 0, 1.2" in text


@pytest.mark.slow
def test_options_override_the_robot(shell: Shell, yard: Path, paths: Any) -> None:
    file = paths("a.path", [[1.0, 1.75, 0.0], [9.0, 1.75, 0.0]])
    assert shell("check", yard, file).status == 0
    assert shell("check", yard, file, "--robot", "disc:0.3").status == 5
    turns = paths("b.path", [[1.0, 1.0, 0.0], [2.0, 1.0, 1.0]])
    assert "it can follow" in shell("check", yard, turns, "--turning-radius", "0.5").out
    assert "too tight for it" in shell("check", yard, turns, "--turning-radius", "1.5").out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("states", "options", "motion", "why"),
    [
        ([[1, 1, 0], [1, 3, 0]], ["--drive", "differential"], 0, "sideways by 90 degrees"),
        ([[1, 1, 0], [2, 1, 0], [2, 1, 1], [3, 1.5, 1]], ["--drive", "differential"], 2, "sideways by 31 degrees"),
        ([[1, 1, 0], [2, 1, 0], [3, 1, 1]], ["--drive", "differential"], 1, "sideways by 29 degrees"),
        ([[2, 1, 0], [1, 1, 0]], ["--drive", "differential", "--forward-only"], 0, "backwards"),
        ([[1, 1, 0], [1, 3, 0]], ["--turning-radius", "1"], 0, "sideways by 90 degrees"),
        ([[1, 1, 0], [2, 2, 1.57]], ["--turning-radius", "2"], 0, "a turn of radius 1 m"),
        ([[1, 1, 0], [2, 1, 0], [2, 1, 1]], ["--turning-radius", "1"], 1, "a turn in place"),
        ([[3, 1, 0], [1, 1, 0]], ["--turning-radius", "1", "--forward-only"], 0, "backwards"),
    ],
)
def test_motions_that_a_drive_cannot_make_are_named(
    shell: Shell, yard: Path, paths: Any, states: Any, options: list[str], motion: int, why: str
) -> None:
    file = paths("a.csv", np.array(states, dtype=float))
    run = shell("check", yard, file, *options, "--json")
    record = json.loads(run.out)
    assert (run.status, record["free"], record["lower_bound"]) == (5, True, None)
    (found,) = record["undrivable"]
    assert (found["motion"], found["why"]) == (motion, why)
    text = shell("check", yard, file, *options)
    assert text.status == 5
    assert text.out.startswith("yard: free, but not drivable\n")
    assert f"motion {motion}, {found['begin']:.4f} to {found['end']:.4f} m along: {why}" in text.out
    assert "%" not in text.out
    assert shell("check", yard, file).status == 0  # a robot that moves in every direction


@pytest.mark.slow
@pytest.mark.parametrize("options", [["--drive", "differential"], ["--turning-radius", "0.6"]])
def test_a_plan_in_few_digits_can_be_driven(shell: Shell, yard: Path, tmp_path: Path, options: list[str]) -> None:
    out = tmp_path / "plan.csv"
    assert shell("plan", yard, *options, "--output", out, "--max-iterations", "1").status == 0
    assert json.loads(shell("check", yard, out, *options, "--json").out)["undrivable"] == []
    write_path(tmp_path / "few.csv", read_any_path(out).states.round(3))
    assert json.loads(shell("check", yard, tmp_path / "few.csv", *options, "--json").out)["undrivable"] == []


@pytest.mark.slow
def test_repair_writes_a_free_path_that_keeps_what_was_free(
    shell: Shell, yard: Path, paths: Any, tmp_path: Path
) -> None:
    out = tmp_path / "out.csv"
    run = shell(
        "check", yard, paths("a.csv", THROUGH), "--repair", out, "--time-limit", "0.3", "--plot", tmp_path / "a.png"
    )
    assert run.status == 0
    assert (tmp_path / "a.png").stat().st_size > 10_000
    assert shell("check", yard, out).status == 0
    states = read_any_path(out).states
    assert states[[0, -1]].tolist() == THROUGH
    assert (states[:2, 1] == 3.0).all()  # straight on until near the disc
    assert states[1, 0] > 3.0
    again = tmp_path / "again.csv"
    assert shell("check", yard, out, "--repair", again).status == 0
    assert np.array_equal(read_any_path(again).states, states)


def test_a_start_in_collision_is_not_repaired(shell: Shell, yard: Path, paths: Any, tmp_path: Path) -> None:
    run = shell("check", yard, paths("a.csv", [[5, 3, 0], [9, 3, 0]]), "--repair", tmp_path / "out.csv", "--json")
    assert run.status == 5
    assert run.err.startswith("trailmark: error: not repaired: start (5, 3, 0) is not valid: the robot")
    assert run.err.count("\n") == 1
    assert json.loads(run.out)["lower_bound"] is None
    assert not (tmp_path / "out.csv").exists()


def test_headings_in_degrees_are_warned_of(shell: Shell, yard: Path, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x,y,yaw\n1,1,0\n2,1,90\n")
    run = shell("check", yard, tmp_path / "a.csv")
    assert "headings of up to 90 are taken as radians; are they in degrees?" in run.err
    assert run.err.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [[], ["--forward-only"]])
def test_a_car_s_plan_is_checked_by_its_curves(shell: Shell, yard: Path, tmp_path: Path, reverse: list[str]) -> None:
    out = tmp_path / "car.json"
    words = ["--turning-radius", "0.6", *reverse]
    assert shell("plan", yard, *words, "--output", out, "--max-iterations", "1").status == 0
    run = shell("check", yard, out, *words, "--json")
    assert run.status == 0
    planned, record = json.loads(out.read_text()), json.loads(run.out)
    assert record["cost"] == record["length"] == pytest.approx(planned["cost"])
    assert record["max_curvature"] == pytest.approx(1 / 0.6, rel=1e-4)
    assert record["min_clearance"] <= planned["min_clearance"] + 1e-6
