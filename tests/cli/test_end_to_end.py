"""The shell with the real planner on the worlds that ship; shapely, not trailmark, judges the paths."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.helpers.oracles import Oracle, motion_states

from trailmark.world import World

Shell = Callable[..., Any]


def judge(world: World, record: dict[str, Any], start: Any, goal: Any) -> None:
    """Assert that a record's path is valid, runs from start to goal and costs what it says."""
    assert world.robot is not None
    states = np.array(record["states"])
    np.testing.assert_allclose(states[[0, -1]], [start, goal])
    steps = np.diff(states, axis=0)
    length, rotation = np.hypot(*steps[:, :2].T).sum(), np.abs(np.angle(np.exp(1j * steps[:, 2]))).sum()
    assert (record["length"], record["rotation"]) == pytest.approx((length, rotation))
    assert record["cost"] == pytest.approx(length + 0.5 * rotation)
    assert record["lower_bound"] <= record["cost"] <= record["first_cost"] + 1e-9
    along = motion_states(states[:-1], states[1:], 30).reshape(-1, 3)
    assert not Oracle(world, world.robot).collides(along).any()


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
def test_status_4_is_proven_and_its_picture_tells_why_and_status_3_is_too_little_time(
    shell: Shell, worlds: Path, tmp_path: Path
) -> None:
    run = shell("plan", worlds / "enclosed.yaml", "--json", "--plot", tmp_path / "why.svg")
    assert (run.status, json.loads(run.out)["status"]) == (4, "infeasible")
    assert (tmp_path / "why.svg").read_bytes().startswith(b"<?xml")
    run = shell("plan", worlds / "maze.yaml", "--json", "--time-limit", "1e-6")
    record = json.loads(run.out)
    assert (run.status, record["status"], record["states"], record["cost"]) == (3, "timeout", [], None)
