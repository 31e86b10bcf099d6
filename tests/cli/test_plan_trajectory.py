"""trailmark plan --smooth, --step, --trajectory and --animate, with a planner that answers at once."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from trailmark.cli.plan_options import with_step

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.curves import CurvePath, Steering
from trailmark.shapes import Disc
from trailmark.world import Robot, World

Shell = Callable[..., Any]


def test_a_trajectory_is_written_and_told(shell: Shell, yard: Path, planner: Any, tmp_path: Path) -> None:
    file = tmp_path / "drive.csv"
    limits = ["--max-speed", "0.5", "--max-acceleration", "0.3", "--max-turn-rate", "0.4"]
    run = shell("plan", yard, "--trajectory", file, *limits, "--max-turn-acceleration", "1", "--json")
    assert run.status == 0
    record = json.loads(run.out)
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    assert rows[-1, 0] == pytest.approx(record["trajectory"]["duration"])
    np.testing.assert_allclose(rows[[0, -1], 1:4], [record["states"][0], record["states"][-1]])
    assert np.hypot(rows[:, 4], rows[:, 5]).max() <= 0.5 * (1.0 + 1e-9)
    assert np.abs(rows[:, 6]).max() <= 0.4 * (1.0 + 1e-9)
    assert np.diff(rows[:, 0]).max() <= 0.1 + 1e-9
    assert np.diff(rows[:, 0]).min() > 1e-6
    assert "trajectory" in shell("plan", yard, "--trajectory", file).out


@pytest.mark.slow
def test_a_smooth_path_says_where_it_stops(shell: Shell, yard: Path, tmp_path: Path) -> None:
    words = ("plan", yard, "--smooth", "--max-iterations", "1", "--time-limit", "20")
    run = shell(*words, "--json", "--output", tmp_path / "path.json")
    assert run.status == 0
    record = json.loads(run.out)
    assert record["smooth"]["max_curvature"] >= 0.0
    # None, unless the machine left no time to get the path away from corners.
    assert all(np.shape(stop) == (3,) for stop in record["smooth"]["stops"])
    assert json.loads((tmp_path / "path.json").read_text())["states"] == record["states"]
    assert record["cost"] == pytest.approx(record["length"] + 0.5 * record["rotation"], rel=1e-9)
    assert "stops on the way" in shell(*words).out


@pytest.mark.slow
def test_the_cost_of_a_smooth_path_is_its_own(shell: Shell, yard: Path) -> None:
    limits = ("--max-speed", "0.5", "--max-turn-rate", "0.8")
    words = ("--smooth", "--json", "--max-iterations", "1", "--objective", "time", *limits)
    record = json.loads(shell("plan", yard, *words).out)
    assert record["cost"] == pytest.approx(record["length"] / 0.5 + record["rotation"] / 0.8, rel=1e-3)


@pytest.mark.slow
def test_out_of_a_keep_out_zone_the_path_stays_as_it_is(shell: Shell, yard: Path, tmp_path: Path) -> None:
    zone = "zones:\n  - {kind: keep-out, vertices: [[0.2, 0.2], [1.6, 0.2], [1.6, 1.8], [0.2, 1.8]]}\n"
    world = tmp_path / "zone.yaml"
    world.write_text(yard.read_text() + zone)
    run = shell("plan", world, "--smooth", "--json", "--time-limit", "0.3")
    assert run.status == 0
    assert "smooth" not in json.loads(run.out)
    assert "--smooth: the path stays as it was planned" in run.err


def test_rows_are_no_farther_apart_than_the_step(shell: Shell, yard: Path, planner: Any, tmp_path: Path) -> None:
    file = tmp_path / "path.csv"
    assert shell("plan", yard, "--output", file, "--step", "0.05").status == 0
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    assert se2.distance(rows[:-1], rows[1:]).max() <= 0.05 + 1e-9


def test_lines_between_rows_are_free_where_the_arc_is() -> None:
    robot = Robot.disc(0.2).steered(1.0)
    arc = CurvePath(np.array([(2.0, 1.0, 0.0), (3.0, 2.0, math.pi / 2)]), Steering(1.0))
    post = Disc((2.0, 2.0), 0.7995)  # 0.5 mm inside the arc; a chord of 0.087 m is up to 0.95 mm off it
    world = World("yard", (0.0, 0.0, 5.0, 5.0), (post,), robot)
    checker = StateChecker(world)
    coarse = arc.resample(0.4).states
    assert not checker.motions_valid(coarse[:-1], coarse[1:]).all()
    rows = with_step(arc, 0.4, world, robot)
    assert rows is not None
    assert checker.motions_valid(rows.states[:-1], rows.states[1:]).all()
    assert 4 < len(rows.states) <= 40


@pytest.mark.slow
def test_the_robot_is_shown_along_its_path(shell: Shell, yard: Path, planner: Any, tmp_path: Path) -> None:
    file = tmp_path / "drive.gif"
    fast = ("--max-speed", 9, "--max-acceleration", 99, "--max-turn-rate", 9, "--max-turn-acceleration", 99)
    assert shell("plan", yard, "--animate", file, *fast).status == 0
    assert file.stat().st_size > 1000


def test_without_a_path_nothing_is_written(shell: Shell, yard: Path, planner: Any, tmp_path: Path) -> None:
    planner.status = "timeout"
    file, picture = tmp_path / "drive.csv", tmp_path / "drive.gif"
    run = shell("plan", yard, "--smooth", "--trajectory", file, "--animate", picture)
    assert run.status == 3
    assert list(tmp_path.glob("drive.*")) == []
