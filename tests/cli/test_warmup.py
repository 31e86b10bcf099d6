"""``trailmark warmup``: afterwards nothing compiles, whatever is done."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

EVERYTHING = """
import numpy as np
from numba.core import event
late = []
class Listener(event.Listener):
    def on_start(self, what): late.append(what.data["dispatcher"].py_func.__qualname__)
    def on_end(self, what): pass
event.register("numba:compile", Listener())

from trailmark import Disc, LandmarkPlanner, Polygon, Robot, StateChecker, World, check_path
from trailmark.ompl_bridge import SE2Problem
from trailmark.planning.warmup import warm_up

office = World.load("office.yaml")
start, goal = office.query("door").start, office.query("door").goal
arrow = Robot.polygon([[-0.3, -0.2], [0.3, -0.2], [0.0, 0.0], [0.3, 0.2], [-0.3, 0.2]])
for robot in (office.robot, Robot.disc(0.25), arrow):
    planner = LandmarkPlanner(office, robot, seed=0)
    planner.plan(start, goal, time_limit=1.0)
    planner.plan_many([start], [goal], workers=2)
    planner.checker.motion_valid(start, goal)
    planner.checker.clearance([start, goal])
    planner.roadmap.certify_all()
    for path in ([start, goal], [start, start]):
        check_path(office, robot, path)
wall = World("wall", (0, 0, 6, 4), (Polygon([[2.9, 0], [3.1, 0], [3.1, 4], [2.9, 4]]),))
assert LandmarkPlanner(wall, Robot.rectangle(0.6, 0.4), seed=0).plan((1, 1, 0), (5, 1, 0)).status == "infeasible"
gap = World("gap", (0, 0, 6, 4), (Polygon([[2.9, 0], [3.1, 0], [3.1, 1.8], [2.9, 1.8]]), Disc((3.0, 3.3), 0.9)))
LandmarkPlanner(gap, Robot.rectangle(0.9, 0.5), seed=0).plan((1, 1, 0), (5, 1, 0), time_limit=2.0)
for reverse in (True, False):
    car = LandmarkPlanner(office, office.robot.steered(0.4, reverse), seed=0)
    found = car.plan(start, goal, time_limit=2.0)
    if found.path is not None:
        found.path.at([0.0, 0.5, 1.0])
    SE2Problem(office, office.robot.steered(0.4, reverse), query="door").solve(0.2)
problem = SE2Problem(office, query="door")
problem.set_planner("RRTConnect")
problem.solve(0.2)
print(sorted(set(late)))
"""


@pytest.mark.slow
def test_afterwards_nothing_compiles(tmp_path: Path, worlds: Path) -> None:
    (tmp_path / "office.yaml").write_bytes((worlds / "office.yaml").read_bytes())
    warm = subprocess.run(
        [sys.executable, "-m", "trailmark", "warmup", "--json"], capture_output=True, text=True, timeout=900
    )
    assert warm.returncode == 0, warm.stderr
    record = json.loads(warm.stdout)
    assert record["cache"]["files"] > 0
    assert Path(record["cache"]["folder"]).is_dir()
    assert {"planning", "many queries", "discs", "many queries of discs", "cars"} <= set(record["kernels"])
    program = EVERYTHING.replace('"office.yaml"', repr(os.fspath(tmp_path / "office.yaml")))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"
    assert "compiling" not in done.stderr
