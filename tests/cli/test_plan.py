"""trailmark plan, with a planner that answers at once: what is asked of it, and what becomes of its answers."""

from __future__ import annotations

import json
import math
import signal
from collections.abc import Callable
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.curves import CurvePath, Steering
from trailmark.formats.any_path import read_any_path
from trailmark.goals import Goal
from trailmark.planning import PlannerSettings
from trailmark.world import Robot

Shell = Callable[..., Any]


def test_defaults_are_the_files(shell: Shell, yard: Path, planner: Any) -> None:
    assert shell("plan", yard).status == 0
    (call,) = planner.calls
    assert call["world"].name == "yard"
    assert call["robot"] == Robot.rectangle(0.8, 0.4)
    assert call["start"] == (1.0, 1.0, 0.0)
    assert call["goal"] == (9.0, 5.0, 1.5)
    assert (call["seed"], call["landmarks"], call["time_limit"]) == (0, None, 1.0)


def test_settings_come_from_a_file_and_go_into_the_record(
    shell: Shell, yard: Path, planner: Any, tmp_path: Path
) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text("patience: 3\n")
    record = json.loads(shell("plan", yard, "--settings", file, "--json").out)
    assert planner.calls[0]["settings"] == PlannerSettings(patience=3)
    assert record["settings"] == PlannerSettings(patience=3).to_dict()
    file.write_text("patient: 3\n")
    run = shell("plan", yard, "--settings", file)
    assert run.status == 2
    assert "expected one of" in run.err
    assert run.err.count("\n") == 1
    # No output takes the file's place.
    same = tmp_path / "settings.json"
    same.write_text('{"patience": 3}')
    assert shell("plan", yard, "--settings", same, "--output", same).status == 2
    assert same.read_text() == '{"patience": 3}'


def test_options_override_the_file(shell: Shell, yard: Path, planner: Any) -> None:
    words = ["--robot", "disc:0.2", "--query", "back", "--seed", 7, "--landmarks", 50, "--time-limit", "2.5"]
    assert shell("plan", yard, *words).status == 0
    (call,) = planner.calls
    assert call["robot"] == Robot.disc(0.2)
    assert call["start"] == (9.0, 5.0, 1.5)
    assert (call["seed"], call["landmarks"], call["time_limit"]) == (7, 50, 2.5)


@pytest.mark.parametrize("joint", [True, False])
def test_ends_may_begin_with_a_minus(shell: Shell, yard: Path, planner: Any, joint: bool) -> None:
    words = ["--start=1,2,-0.5", "--goal=-1,-2,0"] if joint else ["--start", "1,2,-0.5", "--goal", "-1,-2,0"]
    assert shell("plan", *words, yard).status == 0
    assert planner.calls[0]["start"] == (1.0, 2.0, -0.5)
    assert planner.calls[0]["goal"] == (-1.0, -2.0, 0.0)


@pytest.mark.parametrize(
    ("words", "goals"),
    [
        (["--goal", "-1,-2"], (Goal((-1.0, -2.0)),)),
        (["--goal", "4,1,90deg", "--goal", "-1,2"], (Goal((4.0, 1.0, pi / 2)), Goal((-1.0, 2.0)))),
        (["--goal", "4,1", "--goal-tolerance", "0.2"], (Goal((4.0, 1.0), position_tolerance=0.2),)),
        (["--goal", "4,1,1", "--goal-tolerance", "0.2,0.1"], (Goal((4.0, 1.0, 1.0), 0.2, 0.1),)),
        (["--goal", "4,1,1", "--goal-tolerance", "0,180deg"], (Goal((4.0, 1.0, 1.0), 0.0, pi),)),
        (
            ["--goal", "4,1,1", "--goal", "5,1", "--goal-tolerance", "0.2,0.1"],
            (Goal((4.0, 1.0, 1.0), 0.2, 0.1), Goal((5.0, 1.0), 0.2)),
        ),
    ],
)
def test_goals_without_a_heading_near_a_pose_or_several(
    shell: Shell, yard: Path, planner: Any, words: list[str], goals: tuple[Goal, ...]
) -> None:
    assert shell("plan", yard, "--start", "1,1,0", *words).status == 0
    assert planner.calls[0]["goal"] == goals


def test_a_querys_goals_are_the_worlds_and_may_get_a_tolerance(shell: Shell, yard: Path, planner: Any) -> None:
    goals = "[{pose: [9.0, 5.0]}, {region: [[8, 1], [9, 1], [9, 2]], cost: 1}]"
    with yard.open("a") as file:
        file.write(f"  - {{name: anywhere, start: [1.0, 1.0, 0.0], goal: {goals}}}\n")
    run = shell("plan", yard, "--query", "anywhere", "--goal-tolerance", "1")
    assert run.status == 2
    assert "expected --goal, for query 'anywhere'" in run.problem
    assert shell("plan", yard, "--query", "anywhere").status == 0
    assert shell("plan", yard, "--goal-tolerance", "0.1").status == 0
    first, second = planner.calls
    assert first["goal"] == (Goal((9.0, 5.0)), Goal(region=[(8, 1), (9, 1), (9, 2)], cost=1.0))
    assert second["goal"] == (Goal((9.0, 5.0, 1.5), position_tolerance=0.1),)


@pytest.mark.slow
@pytest.mark.parametrize(("status", "code"), [("solved", 0), ("timeout", 3), ("infeasible", 4)])
def test_json_is_one_object_and_nothing_else(
    shell: Shell, yard: Path, planner: Any, tmp_path: Path, status: str, code: int
) -> None:
    planner.status = status
    file, picture = tmp_path / "path.json", tmp_path / "path.png"
    run = shell("plan", yard, "--json", "--output", file, "--plot", picture)
    assert run.status == code
    assert run.err == ""
    record = json.loads(run.out)
    assert record["status"] == status
    assert record["world"] == "yard"
    assert record["query"] == "across"
    assert 0.0 < record["time"]["load"] < record["time"]["total"]
    assert json.loads(file.read_text()) == record
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("suffix", [".csv", ".path", ".txt"])
def test_paths_are_written_as_rows(shell: Shell, yard: Path, planner: Any, tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"path{suffix}"
    assert shell("plan", yard, "--output", file).status == 0
    lines = file.read_text().splitlines()
    rows = [[float(word) for word in line.replace(",", " ").split()] for line in lines if line[0] != "x"]
    assert rows == [[1.0, 1.0, 0.0], [5.0, 1.0, 0.5], [9.0, 5.0, 1.5]]


@pytest.mark.parametrize("suffix", [".csv", ".path", ".txt"])
def test_without_a_path_there_are_no_rows_to_write(
    shell: Shell, yard: Path, planner: Any, tmp_path: Path, suffix: str
) -> None:
    planner.status = "timeout"
    run = shell("plan", yard, "--output", tmp_path / f"path{suffix}")
    assert run.status == 3
    assert "written" not in run.out
    assert list(tmp_path.iterdir()) == [yard]
    assert run.err.splitlines() == [f"trailmark: {tmp_path / f'path{suffix}'}: not written: there is no path"]
    planner.status = "solved"
    assert shell("plan", yard, "--output", tmp_path / f"path{suffix}").status == 0
    planner.status = "timeout"
    run = shell("plan", yard, "--output", tmp_path / f"path{suffix}")
    assert (run.status, len(run.err.splitlines())) == (3, 1)
    assert "the older file is kept" in run.err


@pytest.mark.slow
def test_the_picture_shows_the_layers_that_are_named(shell: Shell, yard: Path, planner: Any, tmp_path: Path) -> None:
    for name, words in (("all", []), ("few", ["--layers", "obstacles,path"])):
        assert shell("plan", yard, "--plot", tmp_path / f"{name}.svg", *words).status == 0
    drawn = {name: (tmp_path / f"{name}.svg").read_text(encoding="utf-8") for name in ("all", "few")}
    assert {name: "hatch" in text or "url(#h" in text for name, text in drawn.items()} == {"all": True, "few": False}
    assert len(drawn["few"]) < len(drawn["all"])


def test_an_interrupt_is_one_line_and_leaves_the_old_file(
    shell: Shell, yard: Path, planner: Any, tmp_path: Path
) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    planner.action = staticmethod(interrupt)
    old = '{"states": [], "cost": null}'
    (tmp_path / "path.json").write_text(old)
    run = shell("plan", yard, "--output", tmp_path / "path.json", "--plot", tmp_path / "path.png")
    assert run.status == 130
    assert run.problem == "interrupted"
    assert (tmp_path / "path.json").read_text() == old
    assert sorted(file.name for file in tmp_path.iterdir()) == ["path.json", "yard.yaml"]


@pytest.mark.parametrize("status", ["solved", "timeout"])
def test_ctrl_c_ends_planning_and_keeps_the_best_path(
    shell: Shell, yard: Path, planner: Any, tmp_path: Path, status: str
) -> None:
    def press() -> None:
        assert not planner.stop()
        signal.raise_signal(signal.SIGINT)
        assert planner.stop()

    planner.action, planner.status = staticmethod(press), status
    run = shell("plan", yard, "--output", tmp_path / "path.json", "--json")
    assert (run.status, run.err) == (130, "trailmark: error: interrupted\n")
    record = json.loads(run.out)
    assert (record["status"], record["reason"] == "") == (status, status == "solved")
    assert json.loads((tmp_path / "path.json").read_text()) == record


def test_programming_errors_keep_their_traceback(shell: Shell, yard: Path, planner: Any) -> None:
    def fail() -> None:
        raise ZeroDivisionError("a bug")

    planner.action = staticmethod(fail)
    with pytest.raises(ZeroDivisionError, match="a bug"):
        shell("plan", yard)


def test_an_option_in_degrees_is_warned_of_once(shell: Shell, yard: Path, planner: Any) -> None:
    run = shell("plan", yard, "--start", "1,1,0", "--goal", "9,5,90", "--goal-tolerance", "0.1")
    assert run.err.count("\n") == run.err.count("taken as radians") == 1


STATES = [[1.0, 1.0, 0.0], [5.0, 1.0, 0.5], [9.0, 5.0, 1.5]]
PARAMETERS = "global_costmap:\n  global_costmap:\n    ros__parameters: {robot_radius: 0.22}\n"


@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".nav2.json", ".geojson"])
def test_a_path_for_others_comes_back(shell: Shell, yard: Path, tmp_path: Path, planner: Any, suffix: str) -> None:
    file = tmp_path / f"path{suffix}"
    for frame in ("map", "odom"):  # the second one replaces the first
        assert shell("plan", yard, "--output", file, "--frame-id", frame).status == 0
        assert f'"{frame}"' in file.read_text()
        np.testing.assert_allclose(read_any_path(file).states, STATES, atol=1e-15)
    planner.status = "timeout"
    before = file.read_text()
    assert shell("plan", yard, "--output", file).status == 3
    assert file.read_text() == before, "what is no path replaces none"


@pytest.mark.parametrize(
    ("text", "robot"),
    [
        ("[[0.3, 0.2], [0.3, -0.2], [-0.3, 0]]", Robot.polygon([[0.3, 0.2], [0.3, -0.2], [-0.3, 0.0]])),
        ("robot_radius:0.22", Robot.disc(0.22)),
        ("PARAMETERS", Robot.disc(0.22)),
    ],
)
def test_robots_as_nav2_has_them(
    shell: Shell, yard: Path, tmp_path: Path, planner: Any, text: str, robot: Robot
) -> None:
    (tmp_path / "nav2_params.yaml").write_text(PARAMETERS)
    given = str(tmp_path / "nav2_params.yaml") if text == "PARAMETERS" else text
    assert shell("plan", yard, "--robot", given).status == 0
    assert planner.calls[0]["robot"] == robot


def test_headings_in_degrees(shell: Shell, yard: Path, planner: Any) -> None:
    run = shell("plan", yard, "--start", "1,1,-90deg", "--goal", "9,5,450 deg", "--json")
    assert (run.status, run.err) == (0, "")
    assert planner.calls[0]["start"] == (1.0, 1.0, -math.pi / 2)
    assert json.loads(run.out)["states"][0][2] == -math.pi / 2


@pytest.mark.slow
def test_an_objective_is_planned_for_and_told(shell: Shell, yard: Path) -> None:
    words = ("plan", yard, "--objective", "clearance", "--gap", "0.5", "--time-limit", "20")
    run = shell(*words, "--json")
    assert run.status == 0
    record = json.loads(run.out)
    assert record["objective"]["clearance"] == 5.0
    assert record["lower_bound"] <= record["cost"]
    assert record["cost"] > record["length"]
    assert "clearance 5" in shell(*words).out


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
        assert np.array_equal(read_any_path(file).states, path.states)
    assert picture.stat().st_size > 10_000


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
