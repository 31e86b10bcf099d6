"""``trailmark warmup``: afterwards nothing compiles, whatever is done."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

EVERYTHING = """
from dataclasses import replace
import numpy as np
from numba.core import event
late = []
class Listener(event.Listener):
    def on_start(self, what): late.append(what.data["dispatcher"].py_func.__qualname__)
    def on_end(self, what): pass
event.register("numba:compile", Listener())

from trailmark import CostZone, Goal, OneWayZone, SpeedZone
from trailmark import Disc, LandmarkPlanner, Polygon, Robot, StateChecker, World, check_path
from trailmark.ompl_bridge import SE2Problem
from trailmark.planning.settings import PlannerSettings

quick = PlannerSettings(patience=1, max_spread_landmarks=400, probes=20)  # each kernel once is enough
office = World.load("office.yaml")
start, goal = office.query("door").start, office.query("door").goal
arrow = Robot.polygon([[-0.3, -0.2], [0.3, -0.2], [0.0, 0.0], [0.3, 0.2], [-0.3, 0.2]])
for robot in (office.robot, Robot.disc(0.25), arrow):
    planner = LandmarkPlanner(office, robot, seed=0, settings=quick)
    planner.plan(start, goal, time_limit=0.5)
    planner.plan_many([start], [goal], workers=2)
    planner.checker.motion_valid(start, goal)
    planner.checker.clearance([start, goal])
    planner.roadmap.certify_all()
    for path in ([start, goal], [start, start]):
        check_path(office, robot, path)
square = Polygon([[9, 5], [11, 5], [11, 7], [9, 7]])
zoned = replace(office, zones=(CostZone(square, 3.0), OneWayZone(square, 0.0, 1.0), SpeedZone(square, 0.5)))
goals = [Goal(pose=(18.0, 10.0)), Goal(pose=(1.5, 10.0, 0.0), position_tolerance=0.3)]
for robot in (office.robot, Robot.disc(0.25)):
    LandmarkPlanner(zoned, robot, seed=0, settings=quick).plan(start, goal, time_limit=0.5)
    LandmarkPlanner(office, robot, seed=0, settings=quick, objective="time").plan(start, goal, time_limit=0.5)
    LandmarkPlanner(office, robot, seed=0, settings=quick).plan(start, goals, time_limit=0.5)
    found = LandmarkPlanner(office, robot, seed=0, settings=quick, clearance=0.02).plan(start, goal, time_limit=1.0)
    found.path.timed(1.0, 0.5, 1.0)
    found.path.smooth(office, robot)
car = LandmarkPlanner(office, office.robot.steered(0.4), seed=0, settings=quick, objective="clearance")
car.plan(start, goal, time_limit=2.0)
wall = World("wall", (0, 0, 6, 4), (Polygon([[2.9, 0], [3.1, 0], [3.1, 4], [2.9, 4]]),))
shut = LandmarkPlanner(wall, Robot.rectangle(0.6, 0.4), seed=0, settings=quick)
assert shut.plan((1, 1, 0), (5, 1, 0)).status == "infeasible"
gap = World("gap", (0, 0, 6, 4), (Polygon([[2.9, 0], [3.1, 0], [3.1, 1.8], [2.9, 1.8]]), Disc((3.0, 3.3), 0.9)))
LandmarkPlanner(gap, Robot.rectangle(0.9, 0.5), seed=0, settings=quick).plan((1, 1, 0), (5, 1, 0), time_limit=2.0)
for reverse in (True, False):
    car = LandmarkPlanner(office, office.robot.steered(0.4, reverse), seed=0, settings=quick)
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
    def run(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, *words], capture_output=True, text=True, timeout=1800.0, check=False)

    warm = run("-m", "trailmark", "warmup", "--json")
    assert warm.returncode == 0, warm.stderr
    record = json.loads(warm.stdout)
    assert record["cache"]["files"] > 0
    assert Path(record["cache"]["folder"]).is_dir()
    assert {"planning (any shape)", "many queries (discs)", "objectives and zones (cars)"} <= set(record["kernels"])
    # In a process that has loaded nothing but what the warm-up compiles.
    done = run("-c", EVERYTHING.replace('"office.yaml"', repr(str(worlds / "office.yaml"))))
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"
    assert "compiling" not in done.stderr
