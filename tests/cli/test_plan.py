"""trailmark plan: what is asked of the planner (one that answers at once), and what becomes of its answers."""

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
import typer

from trailmark import CurvePath, Disc, Goal, Objective, PlannerSettings, Robot, StateChecker, Steering, World, se2
from trailmark.cli import app
from trailmark.cli.plan_files import with_step
from trailmark.formats.any_path import read_any_path

Shell = Callable[..., Any]

STATES = [[1.0, 1.0, 0.0], [5.0, 1.0, 0.5], [9.0, 5.0, 1.5]]
SUFFIXES = [".csv", ".path", ".txt", ".yaml", ".yml", ".nav2.json", ".geojson"]
"""Of paths that are no record."""


@pytest.fixture
def one_round(tmp_path: Path) -> tuple[str, ...]:
    """Options for real plans that do not depend on how fast the machine is."""
    (tmp_path / "settings").mkdir()
    file = tmp_path / "settings" / "one_round.yaml"
    file.write_text("max_iterations: 1")
    return ("--settings", str(file), "--time-limit", "20")


def test_plan_has_no_more_options_than_a_person_can_read(shell: Shell) -> None:
    (command,) = (found for name, found in typer.main.get_command(app).commands.items() if name == "plan")  # type: ignore[attr-defined]
    assert sum(parameter.param_type_name == "option" for parameter in command.params) <= 30
    headings = [line for line in shell("plan", "--help").out.splitlines() if line and line[0] != " "]
    assert headings[1:] == ["Arguments:", "Options:", "Query:", "World:", "Robot:", "Objective:", "Limits:", "Output:"]


def test_the_planner_is_asked_what_file_and_options_say(shell: Shell, yard: Path, planner: Any) -> None:
    assert shell("plan", yard).status == 0
    words = ["--robot", "disc:0.2", "--query", "back", "--seed", 7, "--landmarks", 50, "--time-limit", "2.5"]
    assert shell("plan", yard, *words, "--clearance", "0.1", "--relax").status == 0
    settings = yard.with_name("settings.yaml")
    settings.write_text("patience: 3\ngap: 1e-2\nmax_iterations: 5\nframe_id: odom\n")
    asked = ("plan", yard, "--settings", settings, "--json", "--output", yard.with_name("a.geojson"))
    record = json.loads(shell(*asked).out)
    given = ({key: value for key, value in call.items() if key != "world"} for call in planner.calls)
    defaults = {"robot": Robot.rectangle(0.8, 0.4), "start": (1.0, 1.0, 0.0), "goal": (9.0, 5.0, 1.5), "seed": 0}
    defaults |= {"landmarks": None, "clearance": None, "relax": False, "settings": PlannerSettings()}
    defaults |= {"objective": Objective(), "time_limit": 1.0, "escape": False}
    second = {"robot": Robot.disc(0.2), "start": (9.0, 5.0, 1.5), "goal": (1.0, 1.0, 0.0), "seed": 7, "landmarks": 50}
    second |= {"time_limit": 2.5, "clearance": 0.1, "relax": True}
    chosen = PlannerSettings(patience=3)
    third = {"settings": chosen, "gap": 0.01, "max_iterations": 5}
    assert list(given) == [defaults, defaults | second, defaults | third]
    assert record["settings"] == chosen.to_dict()
    assert '"odom"' in yard.with_name("a.geojson").read_text()


@pytest.mark.parametrize(
    ("words", "start", "goals"),
    [
        (["--start=1,2,-0.5", "--goal=-1,-2,0"], (1.0, 2.0, -0.5), (-1.0, -2.0, 0.0)),
        (["--start", "1,2,-0.5", "--goal", "-1,-2,0"], (1.0, 2.0, -0.5), (-1.0, -2.0, 0.0)),
        (["--start", "1,1,-90deg", "--goal", "9,5,450 deg"], (1.0, 1.0, -pi / 2), (9.0, 5.0, pi / 2)),
        (["--start", "1,1,0", "--goal", "-1,-2"], (1.0, 1.0, 0.0), (Goal((-1.0, -2.0)),)),
        (
            ["--start", "1,1,0", "--goal", "4,1,90deg", "--goal", "5,1", "--goal-tolerance", "0.2,0.1"],
            (1.0, 1.0, 0.0),
            (Goal((4.0, 1.0, pi / 2), 0.2, 0.1), Goal((5.0, 1.0), 0.2)),
        ),
        (["--goal-tolerance", "0.1"], (1.0, 1.0, 0.0), (Goal((9.0, 5.0, 1.5), position_tolerance=0.1),)),
        (["--query", "anywhere"], (1.0, 1.0, 0.0), (Goal((9.0, 5.0)), Goal(region=[(8, 1), (9, 1), (9, 2)], cost=1.0))),
    ],
)
def test_ends(shell: Shell, yard: Path, planner: Any, words: list[str], start: Any, goals: Any) -> None:
    regions = "[{pose: [9.0, 5.0]}, {region: [[8, 1], [9, 1], [9, 2]], cost: 1}]"
    with yard.open("a") as file:
        file.write(f"  - {{name: anywhere, start: [1.0, 1.0, 0.0], goal: {regions}}}\n")
    run = shell("plan", *words, yard)
    assert (run.status, run.err) == (0, "")
    assert planner.calls[0]["start"] == pytest.approx(start)
    assert planner.calls[0]["goal"] == (goals if isinstance(goals[0], Goal) else pytest.approx(goals))
    refused = shell("plan", yard, "--query", "anywhere", "--goal-tolerance", "1")
    assert (refused.status, "expected --goal, for query 'anywhere'" in refused.problem) == (2, True)


def test_an_option_in_degrees_is_warned_of_once(shell: Shell, yard: Path, planner: Any) -> None:
    run = shell("plan", yard, "--start", "1,1,0", "--goal", "9,5,90", "--goal-tolerance", "0.1")
    assert run.err.count("\n") == run.err.count("taken as radians") == 1


BOX = Robot.rectangle(0.8, 0.4)
CAR, DIFFERENTIAL = "width: 0.4, turning_radius: 0.9}", "width: 0.4, drive: differential, reverse: true}"
PARAMETERS = "global_costmap:\n  global_costmap:\n    ros__parameters: {robot_radius: 0.22}\n"


@pytest.mark.parametrize(
    ("file", "words", "robot"),
    [
        ("width: 0.4}", "--turning-radius 1.5", BOX.steered(1.5)),
        ("width: 0.4}", "--turning-radius 1.5 --forward-only", BOX.steered(1.5, reverse=False)),
        ("width: 0.4}", "--robot disc:0.2 --turning-radius 2", Robot.disc(0.2).steered(2.0)),
        ("width: 0.4}", "--robot robot_radius:0.22", Robot.disc(0.22)),
        ("width: 0.4}", "--robot nav2_params.yaml", Robot.disc(0.22)),
        (CAR, "", BOX.steered(0.9)),
        (CAR, "--forward-only", BOX.steered(0.9, reverse=False)),
        (CAR, "--turning-radius 1.5", BOX.steered(1.5)),
        (CAR, "--robot disc:0.2", Robot.disc(0.2)),  # another robot is another robot
        (DIFFERENTIAL, "", BOX.differential(True)),
        (DIFFERENTIAL, "--drive differential", BOX.differential(True)),
        (DIFFERENTIAL, "--forward-only", BOX.differential(False)),
        (DIFFERENTIAL, "--drive differential --forward-only", BOX.differential(False)),
    ],
)
def test_robots(
    shell: Shell, yard: Path, planner: Any, monkeypatch: pytest.MonkeyPatch, file: str, words: str, robot: Robot
) -> None:
    monkeypatch.chdir(yard.parent)
    (yard.parent / "nav2_params.yaml").write_text(PARAMETERS)
    yard.write_text(yard.read_text().replace("width: 0.4}", file))
    assert shell("plan", yard, *words.split()).status == 0
    assert planner.calls[0]["robot"] == robot


@pytest.mark.slow
@pytest.mark.parametrize(("status", "code"), [("solved", 0), ("timeout", 3), ("infeasible", 4)])
def test_json_is_one_object_and_nothing_else(
    shell: Shell, yard: Path, planner: Any, tmp_path: Path, status: str, code: int
) -> None:
    planner.status = status
    file, picture = tmp_path / "path.json", tmp_path / "path.png"
    run = shell("plan", yard, "--json", "--output", file, "--plot", picture)
    assert (run.status, run.err) == (code, "")
    record = json.loads(run.out)
    assert (record["status"], record["world"], record["query"]) == (status, "yard", "across")
    assert 0.0 < record["time"]["load"] < record["time"]["total"]
    assert json.loads(file.read_text()) == record
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_path_is_written_and_what_is_no_path_replaces_none(
    shell: Shell, yard: Path, planner: Any, tmp_path: Path, suffix: str
) -> None:
    file, others = tmp_path / f"path{suffix}", [tmp_path / "drive.csv", tmp_path / "drive.gif"]
    planner.status = "timeout"
    run = shell("plan", yard, "--output", file, "--smooth", "--trajectory", others[0], "--animate", others[1])
    assert (run.status, "written" in run.out) == (3, False)
    assert run.err.splitlines() == [f"trailmark: {f}: not written: there is no path" for f in (*others, file)]
    assert list(tmp_path.iterdir()) == [yard]
    planner.status = "solved"
    for _ in range(2):  # the second one replaces the first
        assert shell("plan", yard, "--output", file).status == 0
        np.testing.assert_allclose(read_any_path(file).states, STATES, atol=1e-15)
    planner.status, before = "infeasible", file.read_text()
    run = shell("plan", yard, "--output", file)
    assert (run.status, file.read_text()) == (4, before)
    assert run.err == f"trailmark: {file}: not written: there is no path; the older file is kept\n"


def test_an_interrupt_is_one_line_and_leaves_the_old_file(
    shell: Shell, yard: Path, planner: Any, tmp_path: Path
) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    planner.action = staticmethod(interrupt)
    (tmp_path / "path.json").write_text("old")
    run = shell("plan", yard, "--output", tmp_path / "path.json", "--plot", tmp_path / "path.png")
    assert (run.status, run.problem) == (130, "interrupted")
    assert (tmp_path / "path.json").read_text() == "old"
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


@pytest.mark.slow
def test_objectives_are_planned_for_and_told(shell: Shell, yard: Path, one_round: Any, worlds: Path) -> None:
    record = json.loads(shell("plan", yard, "--objective", "clearance", "--json", *one_round).out)
    assert record["objective"]["clearance"] == 5.0
    assert record["cost"] > record["length"]
    assert record["lower_bound"] <= record["cost"]
    assert "clearance 5" in shell("plan", yard, "--objective", "clearance", *one_round).out
    given = ("plan", worlds / "parking.yaml", "--query", "bay", "--turning-radius", "4.5", *one_round)
    record = json.loads(shell(*given, "--objective", "length=1,direction_change=2,reverse=1.2", "--json").out)
    maneuvers = 2.0 * record["direction_changes"] + 0.2 * record["reverse_length"]
    assert record["cost"] == pytest.approx(record["length"] + maneuvers)
    assert "objective" not in json.loads(shell(*given, "--objective", "length", "--json").out)
    assert "a change of direction 3 m" in shell(*given).out


@pytest.mark.slow
def test_a_cars_path_in_every_format(shell: Shell, yard: Path, tmp_path: Path, one_round: Any) -> None:
    for suffix, drawn in ((".json", ("--plot", tmp_path / "plan.svg")), (".csv", ()), (".path", ())):
        file = tmp_path / f"path{suffix}"
        run = shell("plan", yard, "--turning-radius", "0.9", "--json", "--output", file, *drawn, *one_round)
        record = json.loads(run.out)
        curve = record["curve"]
        path = CurvePath(np.array(curve["knots"]), Steering(0.9, curve["kind"] == "reeds-shepp"))
        assert (run.status, curve["turning_radius"], record["length"]) == (0, 0.9, path.length)
        assert record["lower_bound"] <= record["cost"] + 1e-9
        assert np.array_equal(read_any_path(file).states, path.states)
    assert (tmp_path / "plan.svg").stat().st_size > 10_000


def test_a_trajectory_and_small_steps_are_written(shell: Shell, yard: Path, planner: Any, tmp_path: Path) -> None:
    file, path = tmp_path / "drive.csv", tmp_path / "path.csv"
    run = shell("plan", yard, "--trajectory", file, "--limits", "0.5,0.3,0.4,1", "--json")
    record, rows = json.loads(run.out), np.loadtxt(file, delimiter=",", skiprows=1)
    assert rows[-1, 0] == pytest.approx(record["trajectory"]["duration"])
    np.testing.assert_allclose(rows[[0, -1], 1:4], [record["states"][0], record["states"][-1]])
    assert np.hypot(rows[:, 4], rows[:, 5]).max() <= 0.5 * (1.0 + 1e-9)
    assert np.abs(rows[:, 6]).max() <= 0.4 * (1.0 + 1e-9)
    assert 1e-6 < np.diff(rows[:, 0]).min() <= np.diff(rows[:, 0]).max() <= 0.1 + 1e-9
    assert shell("plan", yard, "--output", path, "--step", "0.05").status == 0
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    assert se2.distance(rows[:-1], rows[1:]).max() <= 0.05 + 1e-9
    settings = tmp_path / "settings.yaml"
    settings.write_text("step: 0.05\nlimits: 0.5,0.3,0.4,1\nlandmarks: 20\n")
    words = ["--trajectory", tmp_path / "other.csv", "--output", tmp_path / "other_path.csv", "--settings", settings]
    assert shell("plan", yard, *words).status == 0
    assert (tmp_path / "other.csv").read_text() == file.read_text()
    assert (tmp_path / "other_path.csv").read_text() == path.read_text()


@pytest.mark.slow
def test_the_robot_is_shown_along_its_path(shell: Shell, yard: Path, planner: Any, tmp_path: Path) -> None:
    file = tmp_path / "drive.gif"
    assert shell("plan", yard, "--animate", file, "--limits", "9,99,9,99").status == 0
    assert file.stat().st_size > 1000


@pytest.mark.slow
def test_a_smooth_path_says_where_it_stops_and_costs_what_it_is(
    shell: Shell, yard: Path, tmp_path: Path, one_round: Any
) -> None:
    words = ("plan", yard, "--smooth", *one_round, "--json")
    record = json.loads(shell(*words, "--output", tmp_path / "path.json").out)
    assert record["smooth"]["max_curvature"] >= 0.0
    assert all(np.shape(stop) == (3,) for stop in record["smooth"]["stops"])
    assert json.loads((tmp_path / "path.json").read_text())["states"] == record["states"]
    assert record["cost"] == pytest.approx(record["length"] + 0.5 * record["rotation"], rel=1e-9)
    record = json.loads(shell(*words, "--objective", "time", "--limits", "0.5,1,0.8").out)
    assert record["cost"] == pytest.approx(record["length"] / 0.5 + record["rotation"] / 0.8, rel=1e-3)
    zone = "zones:\n  - {kind: keep-out, vertices: [[0.2, 0.2], [1.6, 0.2], [1.6, 1.8], [0.2, 1.8]]}\n"
    yard.write_text(yard.read_text() + zone)  # out of which the path stays as it is
    run = shell(*words)
    assert (run.status, "smooth" in json.loads(run.out)) == (0, False)
    assert "--smooth: the path stays as it was planned" in run.err


def test_lines_between_rows_are_free_where_the_arc_is() -> None:
    robot = Robot.disc(0.2).steered(1.0)
    arc = CurvePath(np.array([(2.0, 1.0, 0.0), (3.0, 2.0, math.pi / 2)]), Steering(1.0))
    post = Disc((2.0, 2.0), 0.7995)  # 0.5 mm inside the arc; a chord of 0.087 m is up to 0.95 mm off it
    world = World("yard", (0.0, 0.0, 5.0, 5.0), (post,), robot)
    checker = StateChecker(world)
    coarse = arc.resample(0.4).states
    assert not checker.motions_valid(coarse[:-1], coarse[1:]).all()
    rows = with_step(arc, 0.4, world, robot)
    assert checker.motions_valid(rows.states[:-1], rows.states[1:]).all()
    assert 4 < len(rows.states) <= 40
