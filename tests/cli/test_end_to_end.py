"""The shell with the real planner on the worlds that ship; shapely, not trailmark, judges the paths."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from trailmark.formats.any_path import read_any_path
from trailmark.world import World

Shell = Callable[..., Any]


def free_space(world: World) -> Any:
    region = shapely.box(*world.bounds)
    if world.boundary is not None:
        region = region.intersection(world.boundary.shapely())
    return region.difference(shapely.union_all([shape.polygon(1e-4).shapely() for shape in world.obstacles]))


def judge(world: World, record: dict[str, Any], start: Any, goal: Any) -> None:
    """Assert that a record's path is valid, runs from start to goal and costs what it says."""
    assert world.robot is not None
    states = np.array(record["states"])
    np.testing.assert_allclose(states[0], start)
    np.testing.assert_allclose(states[-1], goal)
    steps = np.diff(states, axis=0)
    steps[:, 2] = np.angle(np.exp(1j * steps[:, 2]))
    length, rotation = np.hypot(steps[:, 0], steps[:, 1]).sum(), np.abs(steps[:, 2]).sum()
    assert record["length"] == pytest.approx(length)
    assert record["rotation"] == pytest.approx(rotation)
    assert record["cost"] == pytest.approx(length + 0.5 * rotation)
    assert record["lower_bound"] <= record["cost"] <= record["first_cost"] + 1e-9
    body, free = world.robot.footprint.polygon(1e-4).shapely(), free_space(world).buffer(1e-3)
    shapely.prepare(free)
    fractions = np.linspace(0.0, 1.0, 30)[:, None]
    q = (states[:-1, None] + fractions * steps[:, None]).reshape(-1, 3)
    corners = shapely.get_coordinates(body)
    cosine, sine = np.cos(q[:, 2, None]), np.sin(q[:, 2, None])
    x = q[:, 0, None] + cosine * corners[:, 0] - sine * corners[:, 1]
    y = q[:, 1, None] + sine * corners[:, 0] + cosine * corners[:, 1]
    assert shapely.contains(free, shapely.polygons(np.stack([x, y], axis=2))).all()


JUMPING = """
import itertools, sys, time
jumps = itertools.cycle([0.0, 1e9, -1e9, float(2**40), 1.0])
time.time = lambda: next(jumps)
time.time_ns = lambda: int(next(jumps) * 1e9)
from trailmark.cli import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_a_whole_process_prints_writes_and_draws(terminal: Shell, worlds: Path, tmp_path: Path) -> None:
    office = World.load(worlds / "office.yaml")
    outputs = ["--output", tmp_path / "path.json", "--plot", tmp_path / "path.png"]
    words = ["plan", worlds / "office.yaml", "--seed", 3, "--time-limit", 0.25, "--json", *outputs]
    run = terminal(sys.executable, "-c", JUMPING, *words)  # and the clock on the wall may jump meanwhile
    assert run.status == 0, run.err
    record = json.loads(run.out)
    query = office.query()
    assert (record["world"], record["query"], record["planner"]) == ("office", query.name, "landmark")
    assert (record["status"], record["seed"]) == ("solved", 3)
    judge(office, record, query.start, query.goal)
    assert json.loads((tmp_path / "path.json").read_text()) == record
    assert (tmp_path / "path.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["path.json", "path.png"]
    assert 0.0 < record["time"]["first_solution"] < record["time"]["total"]
    seconds, costs = zip(*record["history"], strict=True)
    assert seconds[0] == record["time"]["first_solution"]
    assert list(costs) == sorted(costs, reverse=True)
    assert costs[-1] == pytest.approx(record["cost"])
    assert "planning" in run.err or "preparing" in run.err
    assert "planning" not in run.out


@pytest.mark.slow
def test_given_ends_and_robot(shell: Shell, worlds: Path, tmp_path: Path) -> None:
    file = tmp_path / "path.csv"
    words = ["--robot", "disc:0.15", "--start", "1,1,-3", "--goal=5,4.5,3", "--time-limit", "0.5", "--output", file]
    run = shell("plan", worlds / "office.yaml", *words)
    assert run.status == 0, run.err
    states = read_any_path(file).states
    np.testing.assert_allclose(states[[0, -1]], [[1.0, 1.0, -3.0], [5.0, 4.5, 3.0]])
    assert "path found" in run.out
    assert run.err == ""


@pytest.mark.slow
def test_infeasible_is_status_4_and_the_picture_tells_why(shell: Shell, worlds: Path, tmp_path: Path) -> None:
    run = shell("plan", worlds / "enclosed.yaml", "--json", "--plot", tmp_path / "why.svg")
    assert run.status == 4
    assert json.loads(run.out)["status"] == "infeasible"
    assert (tmp_path / "why.svg").read_bytes().startswith(b"<?xml")


def test_too_little_time_is_status_3(shell: Shell, worlds: Path) -> None:
    run = shell("plan", worlds / "maze.yaml", "--json", "--time-limit", "1e-6")
    assert run.status == 3
    record = json.loads(run.out)
    assert (record["status"], record["states"], record["cost"]) == ("timeout", [], None)
