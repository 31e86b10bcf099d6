"""trailmark check: verdict, exit status, JSON, repair, recorded curves, and what it refuses."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark import FormatError, Steering
from trailmark.cli.check import recorded_path
from trailmark.formats.any_path import PathFile, read_any_path
from trailmark.formats.path_files import write_path
from trailmark.trajectories import CurvePath
from trailmark.trajectories import Path as RobotPath

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
        write_path(tmp_path / name, np.array(states, dtype=float))
        return tmp_path / name

    return write


@pytest.mark.slow
def test_a_free_path_and_one_that_collides(shell: Shell, yard: Path, paths: Any) -> None:
    free, through = paths("a.csv", FREE), paths("b.json", THROUGH)
    run = shell("check", yard, free, "--json")
    record = json.loads(run.out)
    assert (run.status, list(record)) == (0, KEYS)
    assert (record["world"], record["free"], record["collisions"]) == ("yard", True, [])
    assert (record["length"], record["cost"]) == (12.0, pytest.approx(12.75))
    assert record["min_clearance"] == pytest.approx(1 - math.hypot(0.4, 0.2), abs=1e-6)  # a corner at the right bound
    assert 0 < record["lower_bound"] <= record["cost"]
    assert record["max_curvature"] == pytest.approx(2 * math.sin(0.75) / 4)
    text = shell("check", yard, free).out
    assert text.startswith("yard: free\n")
    assert "above the lower bound" in text

    run = shell("check", yard, through, "--json")
    record = json.loads(run.out)
    assert (run.status, record["free"], record["min_clearance"]) == (5, False, 0.0)
    (hit,) = record["collisions"]
    assert list(hit) == ["from", "to", "obstacle", "depth"]
    assert (hit["from"], hit["to"]) == pytest.approx((2.6, 5.4), abs=1e-6)
    assert (hit["obstacle"], hit["depth"]) == (0, pytest.approx(1.2, rel=1e-3))
    text = shell("check", yard, through).out
    assert text.startswith("yard: the path collides\n")
    assert "obstacle 0, 1.2" in text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("states", "options", "motion", "why"),
    [
        ([[1, 1, 0], [1, 3, 0]], ["--drive", "differential"], 0, "sideways by 90 degrees"),
        ([[1, 1, 0], [2, 1, 0], [2, 1, 1], [3, 1.5, 1]], ["--drive", "differential"], 2, "sideways by 31 degrees"),
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
    file = paths("a.csv", states)
    run = shell("check", yard, file, *options, "--json")
    record = json.loads(run.out)
    assert (run.status, record["free"], record["lower_bound"]) == (5, True, None)
    (found,) = record["undrivable"]
    assert (found["motion"], found["why"]) == (motion, why)
    text = shell("check", yard, file, *options)
    assert (text.status, text.out.splitlines()[0]) == (5, "yard: free, but not drivable")
    assert f"motion {motion}, {found['begin']:.4f} to {found['end']:.4f} m along: {why}" in text.out
    assert shell("check", yard, file).status == 0  # a robot that moves in every direction


@pytest.mark.slow
@pytest.mark.parametrize("options", [["--drive", "differential"], ["--turning-radius", "0.6", "--forward-only"]])
def test_a_plan_can_be_driven_in_few_digits_too(
    shell: Shell, yard: Path, tmp_path: Path, paths: Any, options: list[str]
) -> None:
    out, settings = tmp_path / "plan.json", tmp_path / "settings.yaml"
    settings.write_text("max_iterations: 1")
    assert shell("plan", yard, *options, "--output", out, "--settings", settings, "--time-limit", 20).status == 0
    run, planned = shell("check", yard, out, *options, "--json"), json.loads(out.read_text())
    record = json.loads(run.out)
    assert (run.status, record["undrivable"]) == (0, [])
    assert record["min_clearance"] <= planned["min_clearance"] + 1e-6
    few = paths("few.csv", read_any_path(out).states.round(3))
    assert json.loads(shell("check", yard, few, *options, "--json").out)["undrivable"] == []
    if "--turning-radius" in options:  # it is checked by its curves
        assert record["cost"] == record["length"] == pytest.approx(planned["length"])
        assert record["max_curvature"] == pytest.approx(1 / 0.6, rel=1e-4)
        assert "too tight for it" in shell("check", yard, out, "--turning-radius", "1.5").out


@pytest.mark.slow
def test_repair_writes_a_free_path_that_keeps_what_was_free(
    shell: Shell, yard: Path, paths: Any, tmp_path: Path
) -> None:
    out, picture = tmp_path / "out.csv", tmp_path / "a.png"
    words = ("check", yard, paths("a.csv", THROUGH), "--repair", out, "--time-limit", "0.3", "--plot", picture)
    assert shell(*words).status == 0
    assert picture.stat().st_size > 10_000
    assert shell("check", yard, out).status == 0
    states = read_any_path(out).states
    assert states[[0, -1]].tolist() == THROUGH
    assert (states[:2, 1] == 3.0).all()  # straight on until near the disc
    assert states[1, 0] > 3.0
    again = tmp_path / "again.csv"
    assert shell("check", yard, out, "--repair", again).status == 0
    assert np.array_equal(read_any_path(again).states, states)


def test_a_start_in_collision_is_not_repaired(shell: Shell, yard: Path, paths: Any, tmp_path: Path) -> None:
    out, words = tmp_path / "out.csv", ("check", yard, paths("a.csv", [[5, 3, 0], [9, 3, 0]]), "--json", "--repair")
    run = shell(*words, out)
    assert (run.status, run.err.count("\n"), out.exists()) == (5, 1, False)
    assert run.err.startswith(f"trailmark: {out}: not written: start (5, 3, 0) is not valid: the robot")
    assert json.loads(run.out)["lower_bound"] is None
    out.write_text("older")
    assert "the older file is kept" in shell(*words, out).err
    assert out.read_text() == "older"


def test_headings_in_degrees_are_warned_of(shell: Shell, yard: Path, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("x,y,yaw\n1,1,0\n2,1,90\n")
    run = shell("check", yard, tmp_path / "a.csv")
    assert "headings of up to 90 are taken as radians; are they in degrees?" in run.err
    assert run.err.count("\n") == 1


FILE = Path("path.json")
CURVES = CurvePath(np.array([[0.0, 0.0, 0.0], [4.0, 3.0, 1.0], [6.0, 1.0, -1.0]]), Steering(1.5, reverse=False))


def test_recorded_curves_are_rebuilt_unless_the_states_are_others() -> None:
    assert recorded_path(PathFile(CURVES.states, 1.0, CURVES.record()), FILE) == CURVES
    # Files of versions that did not write down where the states are.
    record = {key: value for key, value in CURVES.record().items() if key != "places"}
    assert recorded_path(PathFile(CURVES.states, 1.0, record), FILE) == CURVES
    fine = CURVES.refined(lambda a, b: np.hypot(*(b - a)[:, :2].T) < 0.05)
    assert len(fine) > len(CURVES)
    assert isinstance(recorded_path(PathFile(fine.states, 1.0, fine.record()), FILE), CurvePath)
    states = CURVES.states.copy()
    states[3, 0] += 1e-3
    for path in (RobotPath(states), RobotPath(states[:-1])):
        assert recorded_path(PathFile(path.states, 1.0, CURVES.record()), FILE) == path


@pytest.mark.parametrize(
    ("curve", "problem"),
    [
        ({"kind": "spline"}, "curve: kind: expected dubins or reeds-shepp, got 'spline'"),
        ("dubins", "curve: kind: expected"),
        ({"kind": "dubins", "turning_radius": 1e-320, "knots": [[0, 0, 0]]}, "curve: turning radius"),
        ({"kind": "dubins", "turning_radius": 1e300, "knots": [[0, 0, 0]]}, "curve: turning radius"),
        ({"kind": "dubins", "turning_radius": 1}, "curve: path"),
        ({"kind": "dubins", "turning_radius": 1, "knots": [[0, 0]]}, "curve: path: expected shape"),
        ({"kind": "dubins", "turning_radius": 1, "knots": [[0, 0, 0]], "places": "all"}, "curve: path: places"),
    ],
)
def test_curves_that_are_none_are_told_in_one_line(curve: Any, problem: str) -> None:
    with pytest.raises(FormatError) as caught:
        recorded_path(PathFile(CURVES.states, 1.0, curve), FILE)
    assert str(caught.value).startswith(f"path.json: {problem}")
