"""``trailmark warmup``: afterwards nothing compiles, whatever is done."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

EVERYTHING = """
import sys
from dataclasses import replace
import numpy as np
from numba.core import event
late = []
class Listener(event.Listener):
    def on_start(self, what): late.append(what.data["dispatcher"].py_func.__qualname__)
    def on_end(self, what): pass
event.register("numba:compile", Listener())

from trailmark import CostZone, Goal, KeepOutZone, OneWayZone, SpeedZone
from trailmark import Disc, LandmarkPlanner, Polygon, Rectangle, Roadmap, Robot, StateChecker, World, check_path
from trailmark.roadmap.snapshot import RoadmapSnapshot
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
wall = tuple(Rectangle((5.0, y), 0.4, h) for y, h in ((4.0, 4.0), (6.75, 1.5), (8.75, 2.5)))
hall = World("hall", (0, 0, 10, 10), wall)
start, goal = (1.0, 8.0, 0.0), (9.0, 8.0, 0.0)
cells = np.zeros((40, 40), bool)
cells[10:30, 18:22] = True
for robot in (Robot.disc(0.25), arrow, arrow.differential(), arrow.steered(0.6)):
    planner = LandmarkPlanner(hall, robot, seed=1, settings=quick)
    path = planner.plan(start, goal, 60, max_iterations=1).path
    states, checker = path.states, planner.checker
    for q in (states[::-1], np.asfortranarray(states), states.tolist(), states.astype(np.float32) * 0.99, states[0]):
        checker.valid(q), checker.clearance(q), checker.clearance(q, cap=1)
    planner.roadmap.save(sys.argv[1])
    roadmap = Roadmap.load(sys.argv[1], checker)
    roadmap.add(states[:1])
    roadmap.shortest_path(0, np.int64(1), limit=100)
    roadmap.shortest_path(0, 1, banned=np.zeros(len(roadmap), bool), to_go=np.zeros(len(roadmap)))
    for changed in (hall.edited(remove=[1]), hall.edited(add=[Disc(tuple(path.at(0.5)[:2].tolist()), 0.3)]), hall):
        planner.update(changed)
        planner.replan(start, goal, path, 60)
    RoadmapSnapshot(planner.roadmap).between(0, 1)
    planner.update(hall.edited(add=[Disc((1.0, 8.2), 0.2)]))
    planner.replan(start, goal, path, 60, escape=True)
    planner.update(replace(hall, zones=(KeepOutZone([(0, 7), (2, 7), (2, 9), (0, 9)]),)))
    planner.plan(start, goal, 60, max_iterations=1)
    LandmarkPlanner(World.from_grid(cells, 0.25), robot, seed=1).plan((2, 5, 0), (8, 5, 0), 60, max_iterations=1)
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
    program = EVERYTHING.replace('"office.yaml"', repr(str(worlds / "office.yaml")))
    done = run("-c", program, str(tmp_path / "roadmap.npz"))
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"
    assert "compiling" not in done.stderr
